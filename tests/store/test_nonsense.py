"""Artifacts with every hash right that mean nothing: refused whenever they are read."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from forge import forge

from skillcli.errors import StoreError
from skillcli.kinds import KINDS
from skillcli.kinds.record import Measured, Record, slots
from skillcli.store import STAGES, ArtifactId, Draft, Store, import_file
from skillcli.store.schema import check_parents

pytestmark = pytest.mark.slow  # random files, many of them

Make = Callable[..., Draft]


def refused(store: Store, artifact: ArtifactId) -> str:
    """The one line with which reading, verifying and importing refuse it."""
    with pytest.raises(StoreError) as caught:
        store.read(artifact)
    assert store.verify(artifact) == [caught.value.message]
    with pytest.raises(StoreError):
        import_file(Store(store.root / "other"), store.path(artifact))
    assert not (store.root / "other" / artifact.name).exists()
    assert "\n" not in caught.value.message
    return caught.value.message


def place(path: str, index: Any, value: Any) -> Callable[[dict[str, Any]], None]:
    """Another number at one place of an array."""

    def change(arrays: dict[str, Any]) -> None:
        arrays[path] = np.array(arrays[path])
        arrays[path][index] = value

    return change


def turn(path: str, function: Callable[[Any], Any]) -> Callable[[dict[str, Any]], None]:
    """Another array."""

    def change(arrays: dict[str, Any]) -> None:
        arrays[path] = function(np.array(arrays[path]))

    return change


def without(*folders: str) -> Callable[[dict[str, Any]], None]:
    def change(arrays: dict[str, Any]) -> None:
        for path in [path for path in arrays if path.startswith(folders)]:
            del arrays[path]

    return change


ARRAYS = [
    ("pretrain", without("weights/"), "weights/** is missing"),
    ("pretrain", place("weights/policy/0.weight", 0, np.nan), "weights/policy/0.weight holds values that are not finite"),
    ("pretrain", turn("weights/policy/0.weight", lambda one: one.astype(int)), "holds int64, expected floats"),
    ("pretrain", turn("weights/policy/0.weight", lambda one: one.astype(np.float16)), "holds float16, expected floats"),
    ("pretrain", place("embedding/mean", 0, np.nan), "embedding/mean holds values that are not finite"),
    ("pretrain", place("embedding/std", (1, 1), 0.0), "embedding/std reaches from 0 "),
    ("pretrain", place("skills/goal", (0, 2), np.inf), "skills/goal holds values that are not finite"),
    ("pretrain", place("skills/goal", (0, 2), 1e13), "skills/goal reaches from"),
    ("pretrain", turn("curves/return", lambda one: one[:0]), "a curve has no points"),
    ("pretrain", place("curves/return", slice(2), [1e308, np.nan]), "curves/return reaches from"),
    ("pretrain", place("curves/return", slice(2), [np.inf, -1e101]), "curves/return reaches from -1e+101"),
    ("pretrain", place("trajectories/length", 0, 5), "trajectories/length reaches from 4 to 5, allowed is 1 to 4"),
    ("pretrain", place("trajectories/length", 0, 0), "trajectories/length reaches from 0 to 4"),
    ("pretrain", place("trajectories/skill", (0, 0), 5), "trajectories/skill reaches from -1 to 5, allowed is -1 to 4"),
    ("pretrain", place("trajectories/skill", (0, 0), -2), "trajectories/skill reaches from -2"),
    ("pretrain", turn("trajectories/skill", lambda one: one.astype(np.float32)), "trajectories/skill holds float32"),
    ("pretrain", turn("trajectories/skill", lambda one: one.astype(np.uint8)), "trajectories/skill holds uint8"),
    ("pretrain", turn("trajectories/success", lambda one: one.astype(int)), "trajectories/success holds int64"),
    ("pretrain", place("trajectories/time", 2, 0.0), "trajectories/time does not begin at 0 and grow"),
    ("pretrain", place("trajectories/time", 0, -1.0), "trajectories/time does not begin at 0 and grow"),
    ("embed-means", place("halfway/pair", (0, 1), 5), "halfway/pair reaches from 0 to 5"),
    ("embed-means", place("halfway/pair", 1, [2, 2]), "halfway/pair names a pair of one and the same"),
    (
        "embed-means",
        lambda found: found.update({"map/place": np.zeros((0, 3))}),
        "map/place is there without map/latent, map/end",
    ),
    (
        "embed-means",
        lambda found: found.update({"map/end_on_robots": np.zeros((1, 3))}),
        "map/end_on_robots and results.map.on_robots are not both there",
    ),
    (
        "compose",
        lambda found: found.update({"calibration/end": np.zeros((1, 1, 3))}),
        "calibration/end is there without calibration/pair, calibration/share",
    ),
    ("compose", place("plan/skill", 0, -2), "plan/skill reaches from -2"),
    ("compose", place("plan/route", 2, 2), "plan/route reaches from 0 to 2"),
    ("compose", place("plan/route", 2, 0), "plan/route does not name each of 2 routes in order"),
    ("compose", place("plan/route", slice(None), [1, 0, 1]), "plan/route does not name each of 2 routes in order"),
    ("compose", place("waypoints/route", 0, 1), "waypoints/route does not name each"),
    ("compose", place("waypoints/target", (0, 0), np.nan), "waypoints/target holds values that are not finite"),
    ("compose", place("plan/seconds", 0, -1.0), "plan/seconds reaches from -1"),
    ("compose", place("plan/seconds", 0, np.inf), "plan/seconds holds values that are not finite"),
    ("compose", lambda found: found.update({"curves/return": np.zeros(0)}), "a curve has no points"),
    ("transfer-eval", place("episodes/domain", 9, 2), "episodes/domain is not as results.domains says"),
    ("transfer-eval", place("episodes/domain", 0, 1), "episodes/domain is not as results.domains says"),
    ("transfer-eval", place("domains/heavy/mass", 0, np.nan), "domains/heavy/mass holds values that are not finite"),
    ("transfer-eval", turn("domains/heavy/mass", lambda one: one[:5]), "domains/heavy/mass has 5 episodes"),
    ("transfer-eval", lambda found: found.update({"domains/late/mass": np.ones((4, 2))}), "domains/late/mass has (2,) values"),
]


@pytest.mark.parametrize(("kind", "change", "told"), ARRAYS, ids=[f"{kind}: {told}" for kind, _, told in ARRAYS])
def test_arrays_that_mean_nothing_are_refused(
    store: Store, make: Make, kind: str, change: Callable[[dict[str, Any]], None], told: str
) -> None:
    good = store.write(make(kind))
    arrays = dict(good.arrays)
    change(arrays)
    assert told in refused(store, forge(store, good, arrays=arrays))


def test_a_curve_may_have_gaps_and_infinities(store: Store, make: Make) -> None:
    good = store.write(make("pretrain"))
    for values in (np.array([np.nan, np.inf, -np.inf, 1e100]), np.array([np.nan]), np.array([3e38, np.inf], np.float32)):
        arrays = {**good.arrays, "curves/return": values}
        assert store.verify(forge(store, good, arrays=arrays)) == []


def test_an_artifact_without_episodes_is_refused(store: Store, make: Make) -> None:
    good = store.write(make("compose"))
    empty = {path: array[:0] for path, array in good.arrays.items() if path != "trajectories/time"}
    results = {**good.results, "routes": 0, "segments": [], "waypoints": [], "final_distances_m": []}
    arrays = {**empty, "trajectories/time": good.arrays["trajectories/time"]}
    assert "it has no episode" in refused(store, forge(store, good, arrays=arrays, results=results))


def test_counts_that_are_not_those_of_the_steps_are_refused(store: Store, make: Make) -> None:
    good = store.write(make("compose"))
    violated = np.zeros((2, 4, 3), dtype=bool)
    violated[0, 2:, 1] = True
    arrays = {**good.arrays, "trajectories/violated": violated}
    counted = {**arrays, "trajectories/violations": violated.sum(axis=1, dtype=np.int32)}
    assert store.verify(forge(store, good, arrays=counted)) == []
    told = "trajectories/violations does not count the control steps of trajectories/violated"
    assert told in refused(store, forge(store, good, arrays=arrays))
    counted["trajectories/violations"] = counted["trajectories/violations"] + 1
    assert told in refused(store, forge(store, good, arrays=counted))


def put(path: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(results: Any) -> None:
        *outer, last = (int(key) if key.isdigit() else key for key in path.split("."))
        for key in outer:
            results = results[key]
        results[last] = value

    return change


def foreseen(**changes: Any) -> dict[str, Any]:
    return {"domain": "mild", "robots": 40, "successes": 30, "success_rate": 0.75, "ci95": [0.6, 0.86], **changes}


ANSWERS = [
    ("pretrain", lambda found: found.clear(), "results.env_steps is missing; results.success_rate is missing"),
    ("pretrain", put("env_steps", True), "results.env_steps must be a whole number, got bool"),
    ("pretrain", put("env_steps", 10**30), "results.env_steps must be a whole number"),
    ("pretrain", put("success_rate", None), "results.success_rate must be a number, got NoneType"),
    ("pretrain", put("skills", {}), "results.skills must be a list"),
    ("pretrain", put("skills", []), "results.skills has 0 entries, expected 5"),
    ("pretrain", put("skills.1.name", 3), "results.skills[1].name must be text, got int '3'"),
    ("pretrain", put("skills.1.goal", [1, 2]), "results.skills[1].goal must have 3 entries, got 2"),
    ("pretrain", put("embedding", "x"), "results.embedding must be an object"),
    ("pretrain", put("randomised", {"episodes": 1}), "results.randomised.success_rate is missing"),
    ("embed-means", put("halfway.0.from", None), "results.halfway[0].from must be text"),
    ("embed-means", put("halfway", []), "results.halfway has 0 entries, expected 2"),
    ("embed-means", put("skills.0.mean", [0.0]), "a mean in the results has 1 entries, expected 3"),
    ("compose", put("method", 7), "results.method must be text"),
    ("compose", put("routes", 3), "results.routes is 3, there are 2"),
    ("compose", put("final_yaws_deg", [0.0]), "results.final_yaws_deg has 1 entries, expected 2"),
    ("compose", put("final_yaws_deg", "ninety"), "results.final_yaws_deg must be a list"),
    ("compose", put("predicted", foreseen(successes=41)), "41 of 40 episodes succeed"),
    (
        "compose",
        put("predicted", {**foreseen(successes=30), "successes_within_limits": 31}),
        "31 of 30 successes are within the safety limits",
    ),
    ("compose", put("predicted", foreseen(ci95=[0.8, 0.9])), "the success rate 0.75 and its interval 0.8 to 0.9 contradict"),
    ("compose", put("predicted", foreseen(domain="[red]x")), "names one '[red]x', which is not the name of a domain"),
    ("compose", put("predicted", foreseen(robots="all")), "results.predicted.robots must be a whole number"),
    ("compose", put("segments.0.route", 9), "the results name a route that does not exist"),
    ("compose", put("broken", [{"route": 0}]), "results.broken[0].limit is missing"),
    ("compose", put("violations", {"x": "y"}), "results.violations.'x' must be a whole number"),
    ("transfer-eval", put("domains", []), "does not divide 10 episodes among domains"),
    ("transfer-eval", put("domains.1.name", "heavy"), "among domains of different names"),
    ("transfer-eval", put("domains.0.episodes", 7), "does not divide 10 episodes"),
    ("transfer-eval", put("domains.0.successes", 7), "7 of 6 episodes succeed"),
    ("transfer-eval", put("domains.0.ci95", [0.6, 1.0]), "the success rate 0.5 and its interval 0.6 to 1 contradict"),
    ("transfer-eval", put("domains.0.ci95", [-1.0, 1.0]), "contradict each other"),
    ("transfer-eval", put("domains.0.success_rate", 7), "contradict each other"),
    ("transfer-eval", put("domains.0.ci95", 1), "results.domains[0].ci95 must be a list"),
    ("transfer-eval", put("domains.0.name", "a" * 41), "which is not the name of a domain"),
    ("transfer-eval", put("domains.0.name", "$x$"), "names one '$x$', which is not the name of a domain"),
    ("transfer-eval", put("domains.0.name", "light"), "domains/heavy/mass has 6 episodes, results.domains has none"),
    ("transfer-eval", put("source.episodes", 0), "results.source has no episodes"),
    ("transfer-eval", put("robot", "x"), "results.robot must be an object"),
]


@pytest.mark.parametrize(("kind", "change", "told"), ANSWERS, ids=[f"{kind}: {told}" for kind, _, told in ANSWERS])
def test_results_that_nobody_could_read_are_refused(
    store: Store, make: Make, kind: str, change: Callable[[dict[str, Any]], None], told: str
) -> None:
    good = store.write(make(kind))
    results = copy.deepcopy(dict(good.results))
    change(results)
    assert told in refused(store, forge(store, good, results=results))


def test_places_without_number_are_refused(store: Store, make: Make) -> None:
    good, places = store.write(make("embed-means")), np.zeros((10_001, 3))
    arrays = {**good.arrays, "map/place": places, "map/latent": places, "map/end": places}
    judged = dict.fromkeys(("median_m", "p90_m", "p95_m", "max_m"), 0.1) | {"places": 10_001, "latent_end_correlation": None}
    told = refused(store, forge(store, good, arrays=arrays, results={**good.results, "map": judged}))
    assert "map/place has 10001 places, at most 10000 are read" in told


def test_domains_without_number_are_refused(store: Store, make: Make) -> None:
    good, count = store.write(make("transfer-eval")), 101
    arrays = {
        path: array if path == "trajectories/time" else np.resize(array, (count, *array.shape[1:]))
        for path, array in good.arrays.items()
        if not path.startswith("domains/")
    }
    arrays["episodes/domain"] = np.arange(count)
    one = {**good.results["domains"][0], "episodes": 1, "successes": 1}
    results = {**good.results, "domains": [{**one, "name": f"d{i}"} for i in range(count)]}
    told = refused(store, forge(store, good, arrays=arrays, results=results))
    assert "results.domains has 101 domains, at most 100 are read" in told


@pytest.mark.parametrize(
    ("measured", "told"),
    [
        ({}, "measured.wall_seconds is missing"),
        ({"wall_seconds": 1.0, "throughput": 3}, "measured.throughput must be an object"),
        ({"migrated_from": {"id": 1}}, "measured.migrated_from.id must be text"),
    ],
)
def test_measurements_that_nobody_could_read_are_refused(store: Store, make: Make, measured: Any, told: str) -> None:
    good = store.write(make("pretrain"))
    kept = dict(good.measured) if "migrated_from" in measured else {}
    assert told in refused(store, forge(store, good, measured={**kept, **measured}))


def test_much_that_is_wrong_is_said_in_short(store: Store, make: Make) -> None:
    good = store.write(make("pretrain"))
    skills = [{} for _ in range(5000)]
    told = refused(store, forge(store, good, results={**good.results, "skills": skills}))
    assert "and 17 more" in told and len(told) < 300


def test_there_is_a_table_of_results_for_every_kind() -> None:
    assert KINDS.keys() == set(STAGES)
    assert all(issubclass(spec.results, Record) and issubclass(spec.measured, Measured) for spec in KINDS.values())
    assert all(slots(spec.results) for spec in KINDS.values())


@pytest.mark.parametrize(
    ("kind", "parents", "told"),
    [
        ("pretrain", [], ""),
        ("pretrain", ["pretrain"], "none, got one of kind pretrain"),
        ("embed-means", ["pretrain"], ""),
        ("embed-means", [], "one of kind pretrain, got none"),
        ("embed-means", ["embed-means"], "one of kind pretrain, got one of kind embed-means"),
        ("embed-means", ["pretrain", "pretrain"], "got 2 parents"),
        ("compose", ["pretrain"], ""),
        ("compose", ["embed-means"], ""),
        ("compose", ["compose"], "one of kind embed-means or pretrain"),
        ("transfer-eval", ["compose"], ""),
        ("transfer-eval", ["embed-means"], ""),
        ("transfer-eval", ["pretrain"], ""),
        ("transfer-eval", ["transfer-eval"], "got one of kind transfer-eval"),
        ("transfer-eval", ["compose"] * 10_000, "got 10000 parents"),
    ],
)
def test_every_kind_has_the_parents_that_it_is_made_from(kind: str, parents: list[str], told: str) -> None:
    if not told:
        check_parents(kind, parents, "x")
        return
    with pytest.raises(StoreError) as caught:
        check_parents(kind, parents, "x")
    assert told in caught.value.message
