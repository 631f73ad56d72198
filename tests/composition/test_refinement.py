"""Refining plans in a plane, where a latent (vx, vy) moves the point by so much per control step."""

from __future__ import annotations

import math

import numpy as np
import pytest
from plane import ORIGIN, Plane

from skillcli.composition.plan import Choices
from skillcli.composition.planner import run
from skillcli.composition.refinement import Refinement
from skillcli.composition.search import Expansions, Settings, UniformCostSearch
from skillcli.trajectories import Array

COMPASS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
BOX = np.array([[-1.0, -1.0], [1.0, 1.0]])
SETTINGS = Settings(
    durations=(1, 2), tolerance=0.02, resolution=0.01, step_seconds=1.0, weight=1.0, max_speed=math.sqrt(2), approach_speed=0.0,
    half_edges=(0.0, 0.0), final_speed=math.inf, budget=1,
)  # fmt: skip


def searched(goal: tuple[float, float], world: Plane, budget: int = 1) -> UniformCostSearch:
    settings = SETTINGS if budget == 1 else Settings(**{**vars(SETTINGS), "budget": budget})
    choices = Choices.of(COMPASS, ["e", "n", "w", "s"], interpolated=False)
    search = UniformCostSearch(ORIGIN, ORIGIN[None, None], np.array([[*goal, 0.0]]), choices, settings)
    run(Expansions(search, 1), world, lambda *_: None)  # type: ignore[arg-type]
    return search


def refined(search: UniformCostSearch, world: Plane, rounds: int, box: Array = BOX) -> Refinement:
    finer = Refinement(search, box, np.array([0.5, 0.5]), rounds)
    run(finer, world, lambda *_: None)  # type: ignore[arg-type]
    return finer


@pytest.mark.parametrize("goal", [(1.3, 0.7), (-0.9, 1.1), (0.3, -1.7), (-1.45, -0.6)])
def test_a_goal_between_the_latents_is_met_by_one_of_its_own(goal: tuple[float, float]) -> None:
    world = Plane()
    search = searched(goal, world)
    assert search.goal is None and search.merit(search.best)[1] > 0.4
    plan = refined(search, world, 20).plan()
    assert search.goal is not None and len(plan) == 1 and plan[0].skill == -1
    assert np.linalg.norm(plan[0].steps * plan[0].latent - goal) <= 0.02


def test_what_comes_before_the_last_latent_stays() -> None:
    world = Plane()
    search = searched((3.4, 1.3), world, budget=3)
    plan = refined(search, world, 20).plan()
    assert search.goal is not None and [segment.label for segment in plan[:-1]] == ["e"] and plan[-1].skill == -1
    assert np.linalg.norm(sum(segment.steps * segment.latent for segment in plan) - [3.4, 1.3]) <= 0.02


def test_every_round_is_as_near_as_the_one_before_or_nearer() -> None:
    search = searched((0.77, 1.41), Plane())
    gaps = [search.merit(search.best)]
    for rounds in range(1, 8):
        search = searched((0.77, 1.41), Plane())
        refined(search, Plane(), rounds)
        gaps.append(search.merit(search.best))
    assert gaps == sorted(gaps, reverse=True) and gaps[-1][1] < 0.2 * gaps[0][1]


def test_latents_stay_in_their_box() -> None:
    search = searched((4.0, 4.0), Plane())  # out of reach
    finer = refined(search, Plane(), 12, np.array([[-1.0, -0.3], [1.0, 0.3]]))
    assert finer.plan()[0].latent == pytest.approx([1.0, 0.3])


def test_latents_that_fail_are_not_taken() -> None:
    world = Plane(inside=lambda path: path[..., 1] <= 0.5)
    search = searched((1.0, 1.0), world)
    finer = refined(search, world, 12)
    (segment,) = finer.plan()
    assert search.goal is None and 0.3 < segment.steps * segment.latent[1] <= 0.5


def test_nothing_is_tried_where_the_goal_is_met_or_nothing_led_anywhere() -> None:
    met, stuck = Plane(), Plane(inside=lambda path: np.abs(path).max(axis=-1) < 0.1)
    for search, world in ((searched((2.0, 0.0), met), met), (searched((1.0, 1.0), stuck), stuck)):
        tried = world.proposals
        refined(search, world, 5)
        assert world.proposals == tried
