"""Whether an artifact can mean something: types, ranges and counts, beyond the shapes of its arrays.

A file may be whole and have every hash right, and still hold infinite goals or a skill that is none. Everything that reads
artifacts relies on what is checked here. What needs the recipe is checked in `skillcli.evaluation.consistency`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain, islice
from typing import Any

import numpy as np

from skillcli.store import schema
from skillcli.store.artifact import Array, Artifact
from skillcli.store.migrate import brought_up
from skillcli.store.results import complaints
from skillcli.trajectories import SAFETY_LIMITS

_ROUNDING = 1e-9
_NOTED = 20  # of what is wrong: the first few are said


def checked(artifact: Artifact) -> Artifact:
    """The artifact itself, of whatever schema.

    Raises:
        StoreError: it holds what none of its kind can hold.
    """
    arrays, results = brought_up(artifact)
    label = str(artifact.id)
    schema.check_arrays(artifact.kind, {path: array.shape for path, array in arrays.items()}, label)
    schema.refuse(list(islice(_problems(artifact, arrays, results), _NOTED)), label)
    return artifact


def _problems(artifact: Artifact, arrays: Mapping[str, Array], results: Mapping[str, Any]) -> Iterator[str]:
    kind, found = artifact.kind, False
    sizes = schema.sizes(kind, {path: array.shape for path, array in arrays.items()})
    for problem in chain(_empty(sizes), complaints(kind, results, artifact.measured), _values(kind, arrays, sizes)):
        found = True
        yield problem
    if not found:  # what follows relies on that
        yield from _clock(arrays["trajectories/time"])
        if any(curve.size == 0 for path, curve in arrays.items() if path.startswith("curves/")):
            yield "a curve has no points"
        yield from _PARTS[kind](arrays, results, sizes)


def _empty(sizes: Mapping[str, int]) -> Iterator[str]:
    for name in ("skill", "latent", "trajectories: episode", "trajectories: step", "trajectories: action"):
        if sizes.get(name) == 0:
            yield f"it has no {name.removeprefix('trajectories: ')}"
    if sizes.get("trajectories: limit", 0) > len(SAFETY_LIMITS):
        yield f"trajectories/violations counts {sizes['trajectories: limit']} limits, there are {len(SAFETY_LIMITS)}"


def _values(kind: str, arrays: Mapping[str, Array], sizes: Mapping[str, int]) -> Iterator[str]:
    for path, array in arrays.items():
        values = schema.values_of(kind, path)
        if not _is_of(array, values.kind):
            yield f"{path} holds {array.dtype}, expected {_KINDS[values.kind]}"
        elif values.kind != "b" and array.size:
            yield from _out_of_range(path, array, values, sizes)


_KINDS = {"f": "floats of 32 or 64 bits", "i": "integers of 32 or 64 bits", "b": "booleans"}


def _is_of(array: Array, kind: str) -> bool:
    return array.dtype.kind == kind and (kind == "b" or array.dtype.itemsize in (4, 8))


def _out_of_range(path: str, array: Array, values: schema.Values, sizes: Mapping[str, int]) -> Iterator[str]:
    if values.gaps:
        return
    low, high = array.min(), array.max()  # NaN where there is one
    if not (np.isfinite(low) and np.isfinite(high)):
        yield f"{path} holds values that are not finite"
        return
    largest = sizes[values.of] - values.margin if values.of in sizes else values.high
    if low < values.low or high > largest:
        yield f"{path} reaches from {low:g} to {high:g}, allowed is {values.low:g} to {largest:g}"


def _clock(time: Array) -> Iterator[str]:
    if time[0] != 0 or not (np.diff(time) > 0).all():
        yield "trajectories/time does not begin at 0 and grow"


def _pretrain(arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Mapping[str, int]) -> Iterator[str]:
    yield from _counted("results.skills", results["skills"], sizes["skill"])
    if sizes["trajectories: episode"] % sizes["skill"]:
        yield f"{sizes['trajectories: episode']} episodes are not as many for each of {sizes['skill']} skills"
    if sizes["evaluation: sample"] == 0:
        yield "evaluation/latent has no samples"


def _embed_means(arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Mapping[str, int]) -> Iterator[str]:
    pairs = len(arrays["halfway/pair"])
    yield from _counted("results.skills", results["skills"], sizes["skill"])
    yield from _counted("results.halfway", results["halfway"], pairs)
    if sizes["trajectories: episode"] != sizes["skill"] + pairs:
        yield f"{sizes['trajectories: episode']} episodes are not one for each of {sizes['skill']} skills and {pairs} pairs"
    for skill in results["skills"]:
        yield from _counted("a mean in the results", skill["mean"], sizes["latent"])
        yield from _counted("a std in the results", skill["std"], sizes["latent"])


def _compose(arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Mapping[str, int]) -> Iterator[str]:
    routes = sizes["trajectories: episode"]
    for path in ("plan/route", "waypoints/route"):
        if not np.array_equal(np.unique(arrays[path]), np.arange(routes)) or (np.diff(arrays[path]) < 0).any():
            yield f"{path} does not name each of {routes} routes in order"
    for name, wanted in (("segments", sizes["plan: segment"]), ("waypoints", sizes["waypoints: waypoint"])):
        yield from _counted(f"results.{name}", results[name], wanted)
    yield from _counted("results.final_distances_m", results["final_distances_m"], routes)
    if results["routes"] != routes:
        yield f"results.routes is {results['routes']}, there are {routes}"
    said = [*results["segments"], *results["waypoints"], *results.get("broken", ())]
    if not all(0 <= each["route"] < routes for each in said):
        yield "the results name a route that there is not"


def _transfer_eval(arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Mapping[str, int]) -> Iterator[str]:
    domains = results["domains"]
    names, episodes = [domain["name"] for domain in domains], [domain["episodes"] for domain in domains]
    total = sizes["trajectories: episode"]
    if not names or len(set(names)) < len(names) or not all(count > 0 for count in episodes) or sum(episodes) != total:
        yield f"results.domains does not divide {total} episodes among domains of different names"
    elif not np.array_equal(arrays["episodes/domain"], np.repeat(np.arange(len(names)), episodes)):
        yield "episodes/domain is not as results.domains says"
    drawn = dict(zip(names, episodes, strict=True))
    for path in arrays:
        if path.startswith("domains/"):
            name = path.split("/")[1]
            if len(arrays[path]) != drawn.get(name, -1):
                yield f"{path} has {len(arrays[path])} episodes, results.domains has {drawn.get(name, 'none')}"
    for domain in domains:
        if not 0 <= domain["successes"] <= domain["episodes"]:
            yield f"{domain['successes']} of {domain['episodes']} episodes succeed"
        low, high = domain["ci95"]
        if not 0 <= low <= domain["success_rate"] + _ROUNDING <= high + 2 * _ROUNDING <= 1 + 3 * _ROUNDING:
            yield f"the success rate {domain['success_rate']:g} and its interval {low:g} to {high:g} contradict each other"
        if not all(0 <= each["episode"] < total for each in domain.get("worst", ())):
            yield "results.domains names an episode that there is not"
    if results["source"]["episodes"] < 1:
        yield "results.source has no episodes"


def _counted(what: str, found: list[Any], wanted: int) -> Iterator[str]:
    if len(found) != wanted:
        yield f"{what} has {len(found)} entries, expected {wanted}"


_PARTS = {"pretrain": _pretrain, "embed-means": _embed_means, "compose": _compose, "transfer-eval": _transfer_eval}
