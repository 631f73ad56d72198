"""Model predictive control in the plane: it arrives, in order, round obstacles, and stops where it should."""

from __future__ import annotations

import numpy as np
import pytest
from plane import ORIGIN, Plane

from skillcli.composition.mpc import ModelPredictiveControl, MpcSettings
from skillcli.composition.plan import schedule
from skillcli.composition.planner import run
from skillcli.composition.route import Route

BOX = np.array([[-1.0, -1.0], [1.0, 1.0]])
MEANS = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]])
SETTINGS = MpcSettings(goal_tolerance=0.3)


def control(
    *waypoints: tuple[float, float], settings: MpcSettings = SETTINGS, longest: int = 20, seed: int = 0
) -> ModelPredictiveControl:
    route = Route(np.array([[*point, 0.0] for point in waypoints]), tolerance=0.5)
    rng = np.random.default_rng(seed)
    return ModelPredictiveControl(ORIGIN, ORIGIN[None, None], route, MEANS, BOX, settings, 2, longest, rng)


def end_of(planner: ModelPredictiveControl) -> np.ndarray:
    return schedule(planner.plan())[0].sum(axis=0)


def solve(planner: ModelPredictiveControl, world: Plane | None = None) -> ModelPredictiveControl:
    run(planner, world or Plane(), lambda *_: None)  # type: ignore[arg-type]
    return planner


@pytest.mark.parametrize("goal", [(5.0, 3.0), (-4.0, 0.5), (0.0, -6.0)])
def test_it_arrives_within_the_tolerance_about_as_fast_as_can_be(goal: tuple[float, float]) -> None:
    planner = solve(control(goal))
    assert np.linalg.norm(end_of(planner) - goal) <= 0.3
    steps = sum(segment.steps for segment in planner.plan())
    assert steps <= np.abs(goal).max() + 3, "either coordinate can change by 1 per step"


def test_the_plan_ends_the_moment_it_arrives() -> None:
    planner = solve(control((1.0, 0.0), settings=MpcSettings(goal_tolerance=0.01)))
    assert [segment.steps for segment in planner.plan()] == [1], "in the middle of a segment of two steps"


def test_waypoints_are_met_in_order() -> None:
    plan = solve(control((3.0, 0.0), (0.0, 3.0))).plan()
    path = np.cumsum(schedule(plan)[0], axis=0)
    assert np.linalg.norm(path - [3, 0], axis=1).min() <= 0.5 and np.linalg.norm(path[-1] - [0, 3]) <= 0.3


def test_it_goes_round_what_lets_a_simulation_fail() -> None:
    wall = Plane(lambda path: ~((np.abs(path[..., 0] - 2) <= 0.5) & (path[..., 1] < 1)))
    planner = solve(control((4.0, 0.0), settings=MpcSettings(goal_tolerance=0.3, lookahead=5, samples=200)), wall)
    path = np.cumsum(schedule(planner.plan())[0], axis=0)
    assert np.linalg.norm(path[-1] - [4, 0]) <= 0.3 and path[:, 1].max() >= 1


def test_out_of_time_it_ends_with_what_it_has() -> None:
    planner = solve(control((50.0, 0.0), longest=4))
    assert planner.finished and len(planner.plan()) == 4 and end_of(planner)[0] > 6


def test_who_stands_at_the_goal_plans_nothing() -> None:
    planner = control((0.1, 0.0))
    assert planner.finished and planner.plan() == []


def test_the_same_seed_gives_the_same_plan_and_the_effort_is_known() -> None:
    world = Plane()
    plans = [schedule(solve(control((5.0, 3.0), seed=seed), world).plan())[0] for seed in (1, 1, 2)]
    np.testing.assert_array_equal(plans[0], plans[1])
    assert plans[0].shape != plans[2].shape or not np.array_equal(plans[0], plans[2])
    one = Plane()
    planner = solve(control((5.0, 3.0)), one)
    assert one.proposals == len(planner.plan()) * SETTINGS.rounds * SETTINGS.lookahead * SETTINGS.samples
