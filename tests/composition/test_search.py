"""The search in worlds without a simulator: a latent moves the point by a fixed step, and the state is the position."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from skillcli.composition.latent_environment import LatentEnvironment, Outcome
from skillcli.composition.plan import Choices
from skillcli.composition.planner import run
from skillcli.composition.problem import PlanningProblem
from skillcli.composition.search import Expansions, SearchSettings, plan
from skillcli.composition.uniform_cost import Node, SearchSetup, UniformCostSearch
from skillcli.tasks.push.cost_to_go import BoxCostToGo
from skillcli.trajectories import Array

RIGHT, UP, DIAGONAL = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 1.0, 0.0)
COMPASS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))
SETTINGS = SearchSetup(
    durations=(1,), tolerance=0.1, resolution=0.5, step_seconds=1.0, weight=0.0, max_speed=math.sqrt(2), approach_speed=0.0,
    final_speed=math.inf, budget=1000,
)  # fmt: skip


class World:
    """Positions, their own only keypoint; whoever leaves `inside` fails."""

    def __init__(self, inside: Callable[[Array], Array] | None = None) -> None:
        self.inside, self.control_steps = inside, 0

    def hold(self, sim_states: Array, latent: Array, steps: int) -> Outcome:
        path = sim_states[:, None] + np.arange(steps + 1)[None, :, None] * latent[:, None]
        failed = np.zeros(len(sim_states), dtype=bool)
        if self.inside is not None:
            failed = ~self.inside(path).all(axis=1)
        self.control_steps += steps * len(sim_states)
        return Outcome(path[:, None, :, None], failed[:, None], path[:, -1])


def choices(*latent: tuple[float, ...]) -> Choices:
    return Choices.of(np.array(latent), [str(k + 1) for k in range(len(latent))], interpolated=False)


def planner(waypoints: list[tuple[float, ...]], latent: Choices, **changes: object) -> UniformCostSearch:
    settings = replace(SETTINGS, **changes)  # type: ignore[arg-type]
    return UniformCostSearch(np.zeros(3), np.zeros((1, 1, 3)), np.array(waypoints), latent, settings)


def solve(plan: UniformCostSearch, world: World | None = None, batch: int = 1) -> Node:
    run(Expansions(plan, batch), world or World(), lambda *_: None)  # type: ignore[arg-type]
    return plan.best


def test_a_barred_choice_leads_nowhere_from_the_start_and_is_free_later() -> None:
    plan = planner([(3, 2, 0)], choices(RIGHT, UP, DIAGONAL))
    plan = UniformCostSearch(np.zeros(3), np.zeros((1, 1, 3)), plan.waypoints, plan.choices, SETTINGS, barred={2})
    found = [(segment.label, segment.steps) for segment in plan.plan(solve(plan))]
    assert found == [("1", 1), ("3", 2)] and plan.best is plan.goal


def test_a_plan_tells_where_its_first_segment_leads_and_what_it_leaves_of_the_way() -> None:
    plan = planner([(3, 2, 0), (3, 3.05, 0)], choices(RIGHT, UP, DIAGONAL))
    expansions = Expansions(plan, 1)
    assert expansions.remaining_length == pytest.approx(math.hypot(3, 2) + 1.05)
    run(expansions, World(), lambda *_: None)  # type: ignore[arg-type]
    assert expansions.remaining_length == pytest.approx(0.05), "what the tolerance leaves"
    first = expansions.plan()[0]
    np.testing.assert_allclose(expansions.next_place, first.latent), "a segment of one step"


def test_uniform_cost_finds_the_shortest_way() -> None:
    plan = planner([(3, 2, 0)], choices(RIGHT, UP, DIAGONAL))
    node = solve(plan)
    assert node is plan.goal and node.cost == 3, "two diagonals and one to the right"
    assert sorted(segment.label for segment in plan.plan(node) for _ in range(segment.steps)) == ["1", "3", "3"]
    np.testing.assert_allclose(node.keypoints, [[[3, 2, 0]]])


def test_the_admissible_heuristic_finds_the_same_cost_with_no_more_work() -> None:
    blind, guided = (planner([(3, 2, 0)], choices(*COMPASS, DIAGONAL), weight=weight) for weight in (0.0, 1.0))
    assert solve(blind).cost == solve(guided).cost == 3
    assert guided.expanded < blind.expanded


@pytest.mark.parametrize("batch", [1, 4, 32])
def test_expanding_several_nodes_at_once_finds_the_same_cost(batch: int) -> None:
    assert solve(planner([(4, -3, 0)], choices(*COMPASS, DIAGONAL)), batch=batch).cost == 7


def test_a_cheaper_way_found_later_replaces_the_dearer_one() -> None:
    # three slow steps to x = 3 are seen before two fast ones
    plan = planner([(3, 0, 0)], choices((1.0, 0, 0), (1.5, 0, 0)), durations=(1, 3), max_speed=1.5)
    assert solve(plan).cost == 2


def cheapest(moves: Array, durations: tuple[int, ...], goal: tuple[int, ...], limit: int) -> float:
    """Dijkstra on the grid, for moves between grid points; a goal that is passed counts."""
    cost, open_ = {(0, 0): 0}, [(0, (0, 0))]
    best = math.inf
    while open_:
        spent, at = heapq.heappop(open_)
        if spent > cost[at] or spent >= best:
            continue
        for move in moves:
            for steps in durations:
                passed = [(at[0] + int(move[0]) * t, at[1] + int(move[1]) * t) for t in range(1, steps + 1)]
                if goal in passed:
                    best = min(best, spent + passed.index(goal) + 1)
                end = passed[-1]
                if max(map(abs, end)) <= limit and spent + steps < cost.get(end, math.inf):
                    cost[end] = spent + steps
                    heapq.heappush(open_, (spent + steps, end))
    return best


@pytest.mark.parametrize("weight", [0.0, 1.0])
@pytest.mark.slow
def test_random_worlds_are_solved_at_the_least_cost(weight: float) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        moves = np.concatenate([rng.integers(-3, 4, (4, 2)), np.zeros((4, 1), dtype=int)], axis=1).astype(float)
        goal = tuple(int(x) for x in rng.integers(-4, 5, 2))
        if goal == (0, 0):
            continue
        durations = (1, 3)
        top = float(np.linalg.norm(moves, axis=1).max())
        expected = cheapest(moves, durations, goal, 12)
        plan = planner(
            [(*goal, 0)], choices(*map(tuple, moves)), durations=durations, weight=weight, max_speed=top, budget=3000
        )
        found = solve(plan, World(lambda path: (np.abs(path[:, 1:]) <= 12).all(axis=2)))
        assert (plan.goal is not None) == math.isfinite(expected)
        assert plan.goal is None or found.cost == expected, f"moves {moves[:, :2].tolist()}, goal {goal}"


def test_waypoints_are_met_in_order() -> None:
    plan = planner([(2, 0, 0), (0, 0, 0), (0, 1, 0)], choices(*COMPASS))
    node = solve(plan)
    assert node.cost == 5 and node.next_waypoint.tolist() == [3]
    assert "".join(segment.label * segment.steps for segment in plan.plan(node)) == "11332"


def test_several_waypoints_may_be_passed_within_one_segment() -> None:
    plan = planner([(1, 0, 0), (2, 0, 0), (3, 0, 0)], choices(*COMPASS), durations=(4,))
    node = solve(plan)
    assert node.cost == 3 and [segment.steps for segment in plan.plan(node)] == [3], "and the plan ends at the last one"


def test_at_the_end_of_its_budget_the_nearest_node_is_given() -> None:
    plan = planner([(50, 0, 0)], choices(*COMPASS), budget=20, weight=1.0, max_speed=1.0)
    node = solve(plan)
    assert plan.expanded == 20 and plan.goal is None
    assert node.keypoints.tolist() == [[[20, 0, 0]]], "straight towards the goal"
    several = planner([(50, 0, 0)], choices(*COMPASS), budget=20)
    solve(several, batch=8)
    assert several.expanded == 20, "the last batch is cut short"


def test_meeting_more_waypoints_counts_more_than_being_near() -> None:
    plan = planner([(1, 0, 0), (-60, 0, 0)], choices(*COMPASS), budget=30)
    assert solve(plan).next_waypoint.tolist() == [1]


def test_states_in_one_cell_are_expanded_once() -> None:
    plan = planner([(9, 0, 0)], choices(*COMPASS), budget=10_000)
    solve(plan, World(lambda path: (np.abs(path) <= 2).all(axis=2)))
    assert plan.goal is None and plan.expanded == 25, "the 5 x 5 grid points there are"


def test_failed_outcomes_are_dropped() -> None:
    wall = World(lambda path: ~((path[..., 0] == 1) & (path[..., 1] < 2)))
    plan = planner([(2, 0, 0)], choices(*COMPASS), budget=200)
    assert solve(plan, wall).cost == 6, "around the wall, not through it"


def test_the_last_goal_must_be_met_slowly_where_asked() -> None:
    fast, slow = (2.0, 0.0, 0.0), (0.5, 0.0, 0.0)
    assert solve(planner([(2, 0, 0)], choices(fast, slow))).cost == 1
    careful = planner([(2, 0, 0)], choices(fast, slow), final_speed=1.0)
    node = solve(careful)
    assert node.cost == 4 and node.speed == 0.5
    passing = planner([(2, 0, 0), (2.5, 0, 0)], choices(fast, slow), final_speed=1.0)
    assert solve(passing).cost == 2, "waypoints before the last may be passed at any speed"


def test_the_same_latent_twice_in_a_row_is_one_segment() -> None:
    plan = planner([(3, 1, 0)], choices(RIGHT, UP))
    segments = plan.plan(solve(plan))
    labels = [segment.label for segment in segments]
    assert all(a != b for a, b in itertools.pairwise(labels))
    assert sum(segment.steps for segment in segments) == 4
    assert {segment.skill for segment in segments} == {0, 1}


def test_latents_that_only_look_the_same_stay_segments_of_their_own() -> None:
    grid = np.array([[1.001, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.001, 0.0]])
    plan = planner([(2, 2.001, 0)], Choices.of(np.zeros((1, 3)), ["rest"], False, grid), tolerance=1e-4, resolution=1e-4)
    segments = plan.plan(solve(plan))
    assert [segment.label for segment in segments] == ["(1.00,1.00,0.00)"] * 2
    assert sorted(segment.latent[1] for segment in segments) == [1.0, 1.001]


def test_nothing_to_meet_is_met_at_once() -> None:
    plan = UniformCostSearch(np.zeros(3), np.zeros((1, 3)), np.zeros((0, 3)), choices(RIGHT), SETTINGS)
    assert plan.finished and plan.plan(solve(plan)) == []


# Two keypoints: a box, and a gripper whose places are given outright, since this world has no contact.
PUSHING = {"weight": 1.0, "max_speed": 1.0, "cost_to_go": BoxCostToGo((0.985, 0.985))}
BOX, SOUTH, NORTH = (0.0, 0.0, 0.0), (0.0, -3.0, 0.0), (0.0, 3.0, 0.0)


def pushing(waypoints: list[tuple[float, ...]], **changes: object) -> tuple[UniformCostSearch, Node]:
    """A planner that has just asked for its root: a box at the origin, a gripper 3 m south of it."""
    settings = replace(SETTINGS, **{**PUSHING, **changes})  # type: ignore[arg-type]
    plan = UniformCostSearch(np.zeros(6), np.array([[BOX, SOUTH]]), np.array(waypoints), choices(RIGHT), settings)
    (root,) = plan.ask(1)
    return plan, root


def lead(plan: UniformCostSearch, node: Node, *ends: tuple[tuple[float, ...], tuple[float, ...]]) -> list[Node]:
    """Tell that one step from a node led to these places of box and gripper; returns the children kept."""
    path = np.array([[[node.keypoints[0], end]] for end in ends])
    sim_states = path[:, -1].reshape(len(ends), -1)
    outcome = Outcome(path, np.zeros((len(ends), 1), dtype=bool), sim_states)
    return plan.tell([node] * len(ends), np.zeros(len(ends), dtype=int), outcome, 1)


def grippers(nodes: list[Node]) -> list[tuple[float, ...]]:
    return [tuple(node.keypoints[0, 1].tolist()) for node in nodes]


WEST, EAST, NEAR_SOUTH = (-2.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, -2.0, 0.0)


def test_the_gripper_that_is_nearest_to_the_far_side_of_the_box_is_expanded_first() -> None:
    # the box is to go 5 m east, so the gripper belongs 1 m west of it: 1, sqrt(5), 3 and sqrt(10) m away
    plan, root = pushing([(5, 0, 0)], approach_speed=1.0)
    assert len(lead(plan, root, (BOX, NORTH), (BOX, EAST), (BOX, WEST), (BOX, NEAR_SOUTH))) == 4
    assert grippers(plan.ask(4)) == [WEST, NEAR_SOUTH, EAST, NORTH]
    plan, root = pushing([(5, 0, 0)], approach_speed=0.0)
    lead(plan, root, (BOX, NORTH), (BOX, EAST), (BOX, WEST), (BOX, NEAR_SOUTH))
    assert grippers(plan.ask(4)) == [NORTH, EAST, WEST, NEAR_SOUTH], "all alike without it: the first comes first"


@pytest.mark.parametrize(("speed", "first"), [(0.5, WEST), (1.0, (0.5, 2.0, 0.0))])
def test_the_approach_counts_as_time_at_its_speed(speed: float, first: tuple[float, ...]) -> None:
    # the box 5 m from its goal and the gripper 1 m from where it belongs, against 3.5 m and 2 m
    plan, root = pushing([(5, 0, 0)], approach_speed=speed)
    lead(plan, root, (BOX, WEST), ((1.5, 0, 0), (0.5, 2.0, 0)))
    assert grippers(plan.ask(1)) == [first], "5 + 2 s against 3.5 + 4 s, or 5 + 1 s against 3.5 + 2 s"


def test_the_gripper_belongs_behind_the_box_as_seen_from_the_next_waypoint() -> None:
    plan, root = pushing([(3, 0, 0), (3, 4, 0)], approach_speed=1.0)
    places = [(2.0, 0, 0), (3.0, 1.0, 0), (3.0, -1.0, 0)]
    nodes = lead(plan, root, *(((3, 0, 0), place) for place in places))
    assert [int(node.next_waypoint[0]) for node in nodes] == [1, 1, 1] and grippers(plan.ask(1)) == [(3, -1, 0)]


def test_a_box_that_is_where_it_should_be_needs_no_side_to_be_pushed_from() -> None:
    plan, root = pushing([(0, 0, 0)], approach_speed=1.0, final_speed=-1.0)  # there, and yet never slow enough
    lead(plan, root, ((5, 0, 0), (6, 0, 0)), (BOX, WEST))
    assert grippers(plan.ask(1)) == [WEST], "2 s of approach against 5 s of the box"


def test_states_count_as_one_by_box_and_gripper_together() -> None:
    # cells of 0.5 m for the box and of 1 m for the gripper
    plan, root = pushing([(9, 0, 0)])
    kept = lead(plan, root, (BOX, (2.1, 0, 0)), (BOX, (2.9, 0, 0)), (BOX, (3.1, 0, 0)), ((0.6, 0, 0), (2.1, 0, 0)))
    assert [tuple(node.keypoints[0, :, 0].tolist()) for node in kept] == [(0, 2.1), (0, 3.1), (0.6, 2.1)]


def test_only_the_box_meets_waypoints_and_has_a_speed() -> None:
    plan, root = pushing([(2, 0, 0)], final_speed=0.5)
    passed, pushed, slow = lead(
        plan, root, (BOX, (2.0, 0, 0)), ((2.0, 0, 0), (1.0, 0, 0)), ((0.4, 0, 0), (-4.0, 0, 0))
    )  # fmt: skip
    assert (int(passed.next_waypoint[0]), passed.speed) == (0, 0), "the gripper was there, the box was not"
    assert (int(pushed.next_waypoint[0]), pushed.speed) == (0, 2), "too fast to count"
    assert (int(slow.next_waypoint[0]), slow.speed) == (0, 0.4)
    assert plan.goal is None and plan.best is pushed, "the nearest box, wherever its gripper"


class Pusher:
    """A gripper that walks on a grid, and moves a box by walking into it."""

    def hold(self, sim_states: Array, latent: Array, steps: int) -> Outcome:
        box, gripper = sim_states[:, :3].copy(), sim_states[:, 3:].copy()
        path = [np.stack([box, gripper], axis=1)]
        for _ in range(steps):
            gripper = gripper + latent
            box = np.where((gripper == box).all(axis=1, keepdims=True), box + latent, box)
            path.append(np.stack([box, gripper], axis=1))
        behind = np.concatenate([box, gripper], axis=1)
        return Outcome(np.stack(path, axis=1)[:, None], np.zeros((len(sim_states), 1), dtype=bool), behind)


def test_a_box_is_pushed_round_a_corner_and_the_approach_saves_most_of_the_work() -> None:
    expanded = []
    for speed in (0.0, 1.0):
        settings = replace(
            SETTINGS, weight=1.0, max_speed=1.0, approach_speed=speed, cost_to_go=BoxCostToGo((0.985, 0.985)), resolution=0.5
        )
        start = np.array([BOX, (0.0, -1.0, 0.0)])
        plan = UniformCostSearch(start.ravel(), start[None], np.array([(3.0, 0, 0), (3.0, 2, 0)]), choices(*COMPASS), settings)
        node = solve(plan, Pusher())  # type: ignore[arg-type]
        # west, north, three times east; then south, east, and twice north
        assert node is plan.goal and node.cost == 9
        assert "".join(segment.label * segment.steps for segment in plan.plan(node)) == "321114122"
        expanded.append(plan.expanded)
    assert expanded[1] < expanded[0] / 2


class Two(World):
    """Two points beside each other in the state; a latent moves the first one until it is at (1, 0, 0), then the other."""

    follow = LatentEnvironment.follow

    def start(self) -> tuple[Array, Array]:
        return np.array([0.0, 0, 0, 0, 3, 0]), np.zeros((1, 1, 3))

    def hold(self, sim_states: Array, latent: Array, steps: int) -> Outcome:
        state, path = sim_states, []
        done = np.linalg.norm(state[:, :3] - [1.0, 0, 0], axis=1, keepdims=True) < 0.1
        path.append(np.where(done, state[:, 3:], state[:, :3]))
        for _ in range(steps):
            moved = np.concatenate([np.where(done, 0.0, latent), np.where(done, latent, 0.0)], axis=1)
            state = state + moved
            path.append(np.where(done, state[:, 3:], state[:, :3]))
            done = np.linalg.norm(state[:, :3] - [1.0, 0, 0], axis=1, keepdims=True) < 0.1
        self.control_steps += steps * len(state)
        return Outcome(np.stack(path, axis=1)[:, None, :, None], np.zeros((len(state), 1), dtype=bool), state)


def test_waypoints_of_several_objects_are_planned_for_one_after_the_other() -> None:
    world: Any = Two()
    settings = SearchSettings(
        segments=(1.0,), goal_tolerance=0.1, resolution=0.5, max_speed=1.0, weight=20.0, batch=1, budget=60
    )
    found = plan(
        PlanningProblem(
            settings=settings, names=("right", "up", "left", "down"), mean=np.array(COMPASS), std=np.ones((4, 3)),
            goals=np.array(COMPASS), mixing=(), waypoints=np.array([[1.0, 0, 0], [1.0, 1.0, 0]]), tolerance=0.1, period=1.0,
            horizon=9, make_world=lambda _: world, hold_to_end=lambda latent, _: latent, one_by_one=True,
        )
    )  # fmt: skip
    held = [segment.label for segment in found.segments for _ in range(segment.steps)]
    assert held[0] == "right" and sorted(held[1:]) == ["down", "down", "right"], "the second point begins at (0, 3, 0)"
    assert found.replayed_seconds > 4, "to try a second leg, a robot has to go the first one again"
