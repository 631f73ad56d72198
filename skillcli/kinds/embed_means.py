"""Mean latents of skills: their separation, and the motion of each and of the mean of two."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillcli.kinds.arrays import EMBEDDING, TRAJECTORIES
from skillcli.kinds.pretrain import PRETRAIN
from skillcli.kinds.record import Measured, Point, Record, optional
from skillcli.kinds.spec import Array, Arrays, Field, KindSpec, Results, Sizes, all_or_none, counted, different, index

MOST_PLACES = 10_000
"""Most places at which a map is judged: a picture draws each."""


@dataclass(frozen=True, kw_only=True)
class MeanSkill(Record):
    """One skill at its mean latent."""

    name: str
    mean: tuple[float, ...]
    std: tuple[float, ...]
    final_distance_m: float


@dataclass(frozen=True, kw_only=True)
class Halfway(Record):
    """The mean of two neighbouring latents, compared with the point half-way between their goals."""

    from_: str
    to: str
    final_distance_m: float  # from half-way between the goals
    moved_m: Point
    direction_error_deg: float | None
    magnitude_ratio: float | None


@dataclass(frozen=True, kw_only=True)
class MapOnRobots(Record):
    """The same latents, each held on another robot drawn from a domain."""

    domain: str
    median_m: float
    p90_m: float
    p95_m: float
    max_m: float


@dataclass(frozen=True, kw_only=True)
class MapQuality(Record):
    """Places between the goals, each by the one latent that the map gives for it, held: how far from them it ends."""

    places: int
    median_m: float
    p90_m: float
    p95_m: float
    max_m: float
    latent_end_correlation: float | None  # of distances between the latents and between where they end
    on_robots: MapOnRobots | None = optional(None)  # None: no arm takes part, or an older artifact


@dataclass(frozen=True, kw_only=True)
class EmbedMeansResults(Record):
    """Quality of the mean latents; None where it is undefined."""

    skills: tuple[MeanSkill, ...]
    halfway: tuple[Halfway, ...]
    latent_goal_correlation: float | None
    efficiency: float | None
    inference_accuracy: float
    map: MapQuality | None = optional(None)  # of skills that were trained with mixtures


def _check(arrays: Mapping[str, Array], results: Mapping[str, Any], sizes: Sizes) -> Iterator[str]:
    pairs = len(arrays["halfway/pair"])
    yield from counted("results.skills", results["skills"], sizes["skill"])
    yield from counted("results.halfway", results["halfway"], pairs)
    if sizes["trajectories: episode"] != sizes["skill"] + pairs:
        yield f"{sizes['trajectories: episode']} episodes are not one for each of {sizes['skill']} skills and {pairs} pairs"
    places = len(arrays.get("map/place", ()))
    if places != results.get("map", {}).get("places", 0):
        yield "results.map does not count the places of map/place"
    if places > MOST_PLACES:
        yield f"map/place has {places} places, at most {MOST_PLACES} are read"
    yield from all_or_none(arrays, "map/place", "map/latent", "map/end")
    if ("map/end_on_robots" in arrays) != ("on_robots" in results.get("map", {})):
        yield "map/end_on_robots and results.map.on_robots are not both there"
    yield from different(arrays, "halfway/pair")
    for skill in results["skills"]:
        yield from counted("a mean in the results", skill["mean"], sizes["latent"])
        yield from counted("a std in the results", skill["std"], sizes["latent"])


def _from_1(arrays: Arrays, results: Results) -> tuple[Arrays, Results]:
    """Migrate from version 1; version 2 adds the latents half-way between two skills."""
    return {**arrays, "halfway/pair": np.zeros((0, 2), dtype=np.int64)}, {**results, "halfway": []}


EMBED_MEANS = KindSpec(
    name="embed-means",
    version=2,
    fields={
        "embedding/bounds": Field("bound,latent"),
        "embedding/latent_distance": Field("skill,skill"),
        "embedding/goal_distance": Field("skill,skill", "m"),
        "halfway/pair": Field("pair,member", values=index("skill")),
        "map/place": Field("place,xyz", "m", required=False),
        "map/latent": Field("place,latent", required=False),
        "map/end": Field("place,xyz", "m", required=False),
        "map/end_on_robots": Field("place,xyz", "m", required=False),
        **EMBEDDING,
        **TRAJECTORIES,
    },
    results=EmbedMeansResults,
    measured=Measured,
    made_from=(PRETRAIN.name,),
    check=_check,
    migrations={1: _from_1},
)
