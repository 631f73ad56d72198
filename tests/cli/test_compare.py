"""Two artifacts side by side: what differs, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skillcli.cli.compare import differences
from skillcli.store import Artifact, ArtifactId, Parent

PARENT = Parent(ArtifactId("run", "pretrain", 1), "a" * 64)
ONE = Artifact(
    id=ArtifactId("run", "embed-means", 1), schema_version=2, created_utc="2026-01-01T00:00:00.000000", seed=0,
    recipe_name="smoke", parents=(PARENT,), content_sha256="b" * 64, inputs_sha256="c" * 64, bytes=100,
    command="skill embed-means", recipe={"training": {"rate": 0.1, "layers": [8, 8]}}, recipe_sha256="d" * 64,
    model_sha256="e" * 64, git_commit="f" * 40, git_dirty=False, packages={"numpy": "2.4.6"},
    results={"skills": [{"name": "left", "far": 0.1}, {"name": "right", "far": 0.2}], "rows": [{"x": 1}]}, measured={},
    arrays={"a/x": np.array([1.0, 2.0, np.nan]), "a/n": np.array([1, 2, 3])},
)  # fmt: skip
NOTHING: dict[str, dict[str, tuple[object, object]]] = {
    part: {} for part in ("origin", "recipe", "packages", "results", "arrays")
}


def test_names_times_and_commands_are_no_difference() -> None:
    other = replace(ONE, id=ArtifactId("other", "embed-means", 3), created_utc="2027", command="skill run", measured={"s": 1})
    assert differences(ONE, other) == NOTHING


def test_origins_are_told_short() -> None:
    changed = replace(PARENT, content_sha256="0" * 64)
    found = differences(ONE, replace(ONE, seed=1, git_dirty=True, parents=(changed,)))
    assert found == NOTHING | {
        "origin": {
            "seed": (0, 1),
            "git": ("f" * 12, "f" * 12 + " with changes"),
            "parents": ("a" * 12, "0" * 12),
        }
    }


def test_keys_are_dotted_entries_go_by_their_name_and_what_one_lacks_is_none() -> None:
    recipe = {"training": {"rate": 0.2, "layers": [8, 8]}, "seed": 1}
    results = {"skills": [{"name": "left", "far": 0.1}, {"name": "right", "far": 0.3}], "rows": [{"x": 2}]}
    found = differences(ONE, replace(ONE, recipe=recipe, results=results, packages={}))
    assert found["recipe"] == {"training.rate": (0.1, 0.2), "seed": (None, 1)}
    assert found["results"] == {"skills[right].far": (0.2, 0.3), "rows[0].x": (1, 2)}
    assert found["packages"] == {"numpy": ("2.4.6", None)}


@pytest.mark.parametrize(
    ("arrays", "told"),
    [
        # 0.5 and 0.1 apart, the gap in both does not count
        ({"a/x": np.array([1.5, 2.1, np.nan])}, {"a/x": ("float64 (3,)", "differs by up to 0.5, on average 0.3")}),
        ({"a/x": np.array([1.0, 2.0, np.nan], np.float32)}, {"a/x": ("float64 (3,)", "float32 (3,)")}),
        ({"a/n": np.array([1, 2])}, {"a/n": ("int64 (3,)", "int64 (2,)")}),
        ({"a/x": np.full(3, np.nan)}, {"a/x": ("float64 (3,)", "differs in what is missing or infinite")}),
        ({"a/x": np.array([1.0, np.inf, np.inf])}, {"a/x": ("float64 (3,)", "differs in what is missing or infinite")}),
        ({"b": np.zeros((2, 2), bool)}, {"b": (None, "bool (2, 2)")}),
    ],
)
def test_arrays_are_compared_by_type_shape_and_distance(
    arrays: dict[str, np.ndarray], told: dict[str, tuple[str | None, str]]
) -> None:
    assert differences(ONE, replace(ONE, arrays={**ONE.arrays, **arrays})) == NOTHING | {"arrays": told}
