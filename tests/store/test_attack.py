"""A part of the hostile corpus, quickly: each file in a forked child, refused where it must be, and never anything else.

`python -m tests.store.attack` runs all of it through the command line, with what uses an artifact after an import.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command import CHAIN, skill
from forked import MEGABYTES, SECONDS, End, forked
from hostile import CASES, Case, Good
from hostile.checkpoints import SETTINGS, place
from hostile.good import NAME
from hostile.layout import Bytes, lookup3

from skillcli.errors import StoreError
from skillcli.evaluation.consistency import check_meaning
from skillcli.store import ArtifactId, Store, import_file

pytestmark = pytest.mark.slow

SOME = """
header.key_twice header.time_of_year_9999 header.name_of_200_letters header.version_of_nine_digits header.ten_thousand_parents
header.itself_as_parent header.no_parent_of_embed-means header.other_recipe_name header.lone_surrogate
texts.results_nested_930_deep texts.recipe_with_a_key_twice texts.60000_packages texts.measured_of_500000_numbers
attributes.dimensions_of_another_rank attributes.unknown_name_on_a_group attributes.seed_without_sign attributes.kind_of_4_kB
attributes.kind_space_padded_type
meaning.pretrain_mean_is_nan meaning.pretrain_weight_of_another_shape meaning.pretrain_no_weights
meaning.pretrain_window_of_6400000 meaning.pretrain_hidden_layers_of_4096 meaning.pretrain_length_beyond
meaning.pretrain_task_file_without_end meaning.pretrain_task_file_of_a_lone_surrogate
meaning.pretrain_step_limit_of_1e300 meaning.pretrain_curve_beyond_all_pictures meaning.pretrain_robot_is_a_device
meaning.compose_skill_beyond meaning.transfer-eval_domain_beyond meaning.embed-means_pair_beyond
sizes.60_datasets_of_256_mib_chunks sizes.chunk_larger_than_its_extent sizes.900_groups_deep sizes.compact_data
groups_v1.group_is_its_own_child groups_v1.group_mutual_children groups_v1.group_its_own_right_sibling
groups_v1.heap_free_list_in_a_circle groups_v1.heap_of_another_group groups_v1.chunks_their_own_child
groups_v1.chunk_of_three_bytes groups_v1.superblock_leaf_of_0
headers_v1.continues_in_itself headers_v1.type_is_a_compound headers_v1.filter_values_65535
groups_v2.tree_with_one_child_again_and_again groups_v2.tree_of_one_record groups_v2.tree_nodes_of_0_bytes
groups_v2.tree_nodes_of_2_gib groups_v2.heap_of_width_65535 groups_v2.link_to_its_own_group
messages_v2.type_variable_8000_deep messages_v2.type_shared_with_itself messages_v2.layout_chunk_stored_as_1_gib
messages_v2.fixed_array_of_2_to_the_40 messages_v2.header_goes_on_in_itself messages_v2.space_of_rank_255
messages_v2.nothing_wrong messages_v2.17_notes_uncounted messages_v2.layout_chunk_stored_as_3 bombs.60_of_16_mib
archives.good archives.long_names_by_the_thousand archives.own_parent archives.parents_in_a_circle archives.damaged_inside
archives.version_without_room_after_it archives.manifest_of_version_true archives.tar_gz
"""
GOOD = Good()


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """The chain that the good files are made from."""
    shutil.copytree(GOOD.root, tmp_path / "artifacts" / GOOD.root.name)
    return Store(tmp_path / "artifacts")


def refusal(work: Callable[[], Any]) -> str:
    """The line with which it is refused; "" where it is not."""
    try:
        work()
    except StoreError as error:
        return error.message
    return ""


def check(end: End, right: str, what: str) -> None:
    assert end.signal == "", f"{what} dies of {end.signal} after {end.cpu:.1f} s"
    assert isinstance(end.value, list), f"{what}: {end.value}"
    assert all("\n" not in line for line in end.value)
    assert end.cpu < SECONDS and end.megabytes < MEGABYTES, f"{what}: {end.cpu:.1f} s, {end.megabytes:.0f} MB"
    if right != "either":
        assert (end.value != []) == (right == "refused"), f"{what}: {end.value}"


@pytest.mark.parametrize("name", SOME.split())
def test_a_hostile_file_is_refused_and_never_anything_else(store: Store, tmp_path: Path, name: str) -> None:
    case, file, one = CASES[name], tmp_path / "file", ArtifactId(NAME, CASES[name].kind, 1)
    built = forked(lambda: file.write_bytes(case.build(GOOD)), 20)
    assert isinstance(built.value, int), built
    if case.form == "artifact":
        place = store.path(one)
        place.parent.mkdir()
        shutil.copyfile(file, place)
        check(forked(lambda: store.verify(one, check_meaning)), case.right, f"verify {name}")
        shutil.rmtree(place.parent)
    known = store.ids()
    check(
        forked(lambda: list(filter(None, [refusal(lambda: import_file(store, file, check_meaning))]))),
        case.right,
        f"import {name}",
    )
    new = [one for one in store.ids() if one not in known]
    assert not new or case.right != "refused"
    assert [problem for one in new for problem in store.verify(one)] == []


@pytest.mark.parametrize("kind", CHAIN)
def test_what_the_forger_writes_unchanged_is_as_good_as_the_original(store: Store, tmp_path: Path, kind: str) -> None:
    copy = GOOD.forged(kind)
    copy.header["content_sha256"] = ""
    file = tmp_path / "file.h5"
    file.write_bytes(copy.file())
    (found,) = import_file(store, file)
    assert store.verify(found.id) == []
    original = store.header(ArtifactId(GOOD.root.name, kind, 1))
    assert (found.new, store.header(found.id).content_sha256) == (True, original.content_sha256)


def test_checksums_of_hdf5_are_made_as_hdf5_makes_them() -> None:
    data = GOOD.forged().file()
    file = Bytes(data)
    assert {bytes(data[start : start + 4]) for start, _, _ in file.structures} >= {b"OHDR", b"OCHK", b"BTHD", b"FRHP", b"FHDB"}
    assert file.file() == data
    assert lookup3(data[4096 : 4096 + 44]) == int.from_bytes(data[4096 + 44 : 4096 + 48], "little")


@pytest.mark.parametrize("name", ["checkpoints.curve_missing", "reuse.of_fewer_iterations", "archives.two_trainings"])
def test_files_that_take_a_training_or_several_artifacts_can_be_made(name: str) -> None:
    assert len(CASES[name].build(GOOD)) > 4096  # here: a fork would inherit torch's threads by name only, and wait for them


@pytest.mark.parametrize("name", ["good", "weight_missing", "state_is_a_list", "seconds_are_nan"])
def test_a_hostile_checkpoint_is_refused_and_an_unchanged_one_resumed(tmp_path: Path, name: str) -> None:
    case, path = CASES[f"checkpoints.{name}"], place(tmp_path)
    path.parent.mkdir(parents=True)
    path.write_bytes(case.build(GOOD))
    told = skill("--store", tmp_path, "pretrain", "point", "--name", NAME, "--resume", *SETTINGS)
    assert told.code == (0 if name == "good" else 1), told.err
    assert "unexpected" not in told.err


def test_there_are_many_cases_of_every_family() -> None:
    families: dict[str, list[Case]] = {}
    for case in CASES.values():
        families.setdefault(case.family, []).append(case)
    assert len(CASES) > 800 and min(len(cases) for cases in families.values()) > 3
