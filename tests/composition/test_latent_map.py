"""Inverting a map in the plane, where a latent moves the point by so much per control step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plane import ORIGIN, Plane

from skillcli.composition import latent_map
from skillcli.composition.latent_environment import Outcome
from skillcli.composition.latent_map import AROUND, CLOSE, POOR, MapSettings, plan
from skillcli.composition.problem import PlanningProblem, PlanResult
from skillcli.composition.search import SearchSettings, choices_of
from skillcli.trajectories import Array

SQUARE = np.array([[1.0, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
HORIZON = 10


class World(Plane):
    """The plane as planners see it; the point starts at the origin."""

    def __init__(self, inside: Callable[[Array], Array] | None = None) -> None:
        super().__init__(inside)
        self.held = self.control_steps = 0

    def start(self) -> tuple[Array, Array]:
        return ORIGIN, ORIGIN[None, None]

    def hold(self, sim_states: Array, latent: Array, steps: int) -> Outcome:
        self.held, self.control_steps = self.held + len(latent), self.control_steps + steps * len(latent)
        return super().hold(sim_states, latent, steps)


def problem(*waypoints: tuple[float, float], slope: float = 1.0, world: World | None = None, **more: Any) -> PlanningProblem:
    """Four skills whose means lead `slope` times as far as their goals are."""
    given: Any = world or World()
    return PlanningProblem(
        settings=MapSettings(goal_tolerance=1e-3),
        names=("1", "2", "3", "4"),
        mean=slope / HORIZON * SQUARE[:, :2],
        std=np.full((4, 2), 0.1),
        goals=SQUARE,
        mixing=(0, 1, 2, 3),
        waypoints=np.array([[*place, 0.0] for place in waypoints]),
        tolerance=0.05,
        period=0.1,
        horizon=HORIZON,
        make_world=lambda _: given,
        hold_to_end=lambda latent, _: latent,
        mixtures=True,
        handed_over={"search": SearchSettings()},
        **more,
    )


def test_a_true_map_takes_one_latent_held_for_an_episode() -> None:
    found = plan(problem((0.5, -0.2)))
    (segment,) = found.segments
    np.testing.assert_allclose(segment.latent, [0.05, -0.02])
    assert (segment.steps, segment.skill, found.expanded_nodes, found.notes) == (HORIZON, -1, 1, ())
    assert found.simulated_robot_seconds == pytest.approx(1.0) and found.replayed_seconds == 0


def test_a_map_that_leads_too_short_is_corrected_by_the_slope_that_trials_show() -> None:
    # goal (0.4, 0): aims 0.4, 0.48 end at 0.32, 0.384. So the slope is 0.8, and the next aim 0.48 + 0.016 / 0.8 = 0.5 is right
    world = World()
    found = plan(problem((0.4, 0.0), slope=0.8, world=world))
    np.testing.assert_allclose(found.segments[0].latent, [0.04, 0], atol=1e-9)
    assert found.expanded_nodes == world.held == 3


def test_the_best_of_as_many_trials_as_there_may_be_is_taken() -> None:
    one = plan(replace(problem((0.4, 0.0), slope=0.8), settings=MapSettings(trials=1)))
    np.testing.assert_allclose(one.segments[0].latent, [0.032, 0], atol=1e-9)
    two = plan(replace(problem((0.4, 0.0), slope=0.8), settings=MapSettings(trials=2)))
    np.testing.assert_allclose(two.segments[0].latent, [0.0384, 0], atol=1e-9)


def test_no_latent_beyond_the_hull_is_tried() -> None:
    found = plan(problem((1.0, 0.0), slope=0.8))
    np.testing.assert_allclose(found.segments[0].latent, [0.08, 0], atol=1e-9)
    assert found.expanded_nodes == 2 + AROUND, "what would have to be tried next is outside, so others inside are"


def test_a_trial_that_fails_is_only_taken_where_there_is_no_other() -> None:
    world = World(lambda path: path[..., 0] < 0.35)  # the first trial ends at 0.32, all better ones fail
    (segment,) = plan(problem((0.4, 0.0), slope=0.8, world=world)).segments
    end = HORIZON * segment.latent
    assert end[0] < 0.35 and np.linalg.norm(end - [0.4, 0.0]) < 0.08, "one around a failing one may be nearer than the first"


def test_where_the_latent_of_the_goal_fails_the_nearest_place_around_it_that_does_not_is_aimed_at() -> None:
    world = World(lambda path: np.linalg.norm(path[..., :2] - [0.4, 0.0], axis=-1) > 0.01)  # within 1 cm of the goal all fail
    asked = problem((0.4, 0.0), world=world)
    (segment,) = plan(asked).segments
    off = np.linalg.norm(HORIZON * segment.latent - [0.4, 0.0])
    assert 0.01 < off <= 0.01 + CLOSE * asked.tolerance / AROUND + 1e-9, "radii grow evenly, so the next one is taken"
    assert AROUND < world.held <= MapSettings().trials + AROUND


def test_a_robot_that_fails_counts_as_a_tolerance_off() -> None:
    class Two(World):
        """Two robots, of which the second fails unless the place is 2 cm off."""

        def hold(self, sim_states: Array, latent: Array, steps: int) -> Outcome:
            outcome = super().hold(sim_states, latent, steps)
            risky = np.linalg.norm(outcome.path[:, 0, -1, 0, :2] - [0.4, 0.0], axis=1) < 0.02
            return replace(
                outcome,
                path=np.repeat(outcome.path, 2, axis=1),
                failed=np.stack([np.zeros(len(latent), dtype=bool), risky], axis=1),
            )

    # at the goal the distances count as 0 and 5 cm: 2.5 + 0.5 * 2.5 = 3.75 cm. 2.1 cm off on both is less
    (segment,) = plan(problem((0.4, 0.0), world=Two())).segments
    assert 0.02 <= np.linalg.norm(HORIZON * segment.latent - [0.4, 0.0]) < 0.0225


def test_each_waypoint_has_a_latent_of_its_own_from_where_the_last_one_ends() -> None:
    # from (0.5, 0) the latent for (0, 0) moves nothing: the map is no attractor here. What is off by 0.5 is corrected
    world = World()
    found = plan(problem((0.5, 0.0), (0.0, 0.0), world=world))
    np.testing.assert_allclose([segment.latent for segment in found.segments], [[0.05, 0], [-0.05, 0]], atol=1e-9)
    assert world.held == 1 + 2 and found.replayed_seconds == pytest.approx(2 * 1.0)


@pytest.fixture
def searched(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The settings of searches that planned."""
    given: list[Any] = []

    def search(problem: PlanningProblem) -> PlanResult:
        given.append(problem.settings)
        return PlanResult([])

    monkeypatch.setattr(latent_map.search, "plan", search)
    return given


def test_outside_the_hull_search_plans(searched: list[Any]) -> None:
    found = plan(problem((0.5, 0.0), (1.2, 0.0)))
    assert searched == [SearchSettings()] and "20.0 cm outside the hull" in found.notes[0] and "search" in found.notes[0]


def test_where_only_some_skills_are_a_map_search_plans_with_all(searched: list[Any]) -> None:
    found = plan(replace(problem((1.0, 0.0)), mixing=(0, 1)))
    assert searched == [SearchSettings()] and "others (3, 4)" in found.notes[0]


def test_a_search_may_hold_the_latents_of_the_map() -> None:
    asked = replace(problem((0.5, 0.0)), settings=SearchSettings(), aims=(np.array([0.5, -0.2, 0.0]), np.array([3.0, 1, 0])))
    found = choices_of(asked)
    assert found.label == ("1", "2", "3", "4", "map(0.500,-0.200,0.000)", "map(1.000,1.000,0.000)")
    np.testing.assert_allclose(found.latent[4:], [[0.05, -0.02], [0.1, 0.1]])
    assert found.skill.tolist() == [0, 1, 2, 3, -1, -1]
    assert len(choices_of(replace(asked, mixtures=False)).latent) == 4, "skills that were trained alone are no map"


def test_a_map_of_skills_that_were_trained_alone_is_called_a_guess() -> None:
    assert plan(replace(problem((0.5, 0.0)), mixtures=False)).notes == (POOR,)
