from __future__ import annotations

from pathlib import Path

import pytest

from skillcli.errors import StoreError, UnknownArtifact
from skillcli.kinds import KINDS
from skillcli.store import STAGES, ArtifactId
from skillcli.store.resolve import match

KNOWN = [
    ArtifactId.parse(text)
    for text in (
        "a/pretrain-v1",
        "a/pretrain-v2",
        "a/pretrain-v10",
        "a/compose-v1",
        "ab/pretrain-v1",
        "arm.left/embed-means-v3",
    )
]


def test_an_id_survives_formatting_and_parsing() -> None:
    one = ArtifactId("push-2.x", "transfer-eval", 12)
    assert ArtifactId.parse(str(one)) == one
    assert one.path(Path("root")) == Path("root/push-2.x/transfer-eval-v12.h5")


def test_every_stage_has_a_schema() -> None:
    assert set(STAGES) == set(KINDS)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a/pretrain",
        "a/pretrain-v0",
        "a/pretrain-v01",
        "a/pretrain-v1\n",
        "a/pretrain-v1.h5",
        "a/other-v1",
        "../a/pretrain-v1",
        "/etc/pretrain-v1",
        "a..b/pretrain-v1",
        ".a/pretrain-v1",
        "a b/pretrain-v1",
        f"{'a' * 65}/pretrain-v1",
        "é/pretrain-v1",
        "a/pretrain-v\u0661",
    ],
)
def test_what_is_not_an_id_is_refused(text: str) -> None:
    with pytest.raises(StoreError, match="not an artifact id"):
        ArtifactId.parse(text)


def test_an_id_cannot_be_built_to_leave_the_store() -> None:
    with pytest.raises(StoreError):
        ArtifactId("../../etc", "pretrain", 1)


@pytest.mark.parametrize(
    ("text", "kinds", "expected"),
    [
        ("a/pretrain-v2", (), "a/pretrain-v2"),
        ("a/pretrain-v1", (), "a/pretrain-v1"),  # not v10, which it begins
        ("a/pretrain", (), "a/pretrain-v10"),
        ("a/p", (), "a/pretrain-v10"),
        ("a", ("pretrain",), "a/pretrain-v10"),  # the name a, not the beginning of ab
        ("arm", (), "arm.left/embed-means-v3"),
        ("a/", ("compose", "transfer-eval"), "a/compose-v1"),
    ],
)
def test_prefixes_mean_the_newest_of_one_series(text: str, kinds: tuple[str, ...], expected: str) -> None:
    assert str(match(text, KNOWN, kinds)) == expected


def test_an_ambiguous_prefix_lists_the_candidates() -> None:
    with pytest.raises(UnknownArtifact, match=r"a/compose-v1, a/pretrain-v10"):
        match("a", KNOWN)


def test_near_misses_are_suggested() -> None:
    with pytest.raises(UnknownArtifact) as caught:
        match("a/pretrian", KNOWN)
    assert "a/pretrain" in caught.value.hint
    with pytest.raises(UnknownArtifact) as caught:
        match("zzz", KNOWN)
    assert "available: a/compose-v1" in caught.value.hint


def test_a_wrong_kind_says_what_was_expected_and_got() -> None:
    with pytest.raises(StoreError, match=r"expected .* pretrain, got 'a/compose-v1'") as caught:
        match("a/compose-v1", KNOWN, ["pretrain"])
    assert "a/pretrain-v10" in caught.value.hint


@pytest.mark.parametrize("text", ["../x", "/etc/passwd", "a/b/c", "a..b", "*", "a/../b"])
def test_paths_are_not_prefixes(text: str) -> None:
    with pytest.raises(StoreError, match="not an artifact id or prefix"):
        match(text, KNOWN)
