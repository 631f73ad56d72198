"""Planning again on the way: what a target is told from, limits that are kept, when it stops and when it gives up."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from worlds import blocks_env, make_env, push_env, target_robot, world

from skillcli.cli.tables import _gave_up
from skillcli.composition.latent_environment import LatentEnvironment
from skillcli.evaluation.identification import Identification
from skillcli.evaluation.reflex import Reflex
from skillcli.evaluation.replanned_episode import LONGEST, ReplannedEpisode
from skillcli.evaluation.replanning import Replanner
from skillcli.kinds.transfer_eval import DomainResults
from skillcli.recipe import Recipe, resolve
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.environment import StateEstimate
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.push.environment import PushEnvironment
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.settings import ReachTask
from skillcli.trajectories import SAFETY_LIMITS, Array, Trajectories

SAGGING = Path(__file__).parent.parent / "robots" / "meshes.toml"  # does not carry its own weight
LIMIT = ReachTask().action_limit
FIRST = np.array([0])


class Joints:
    """A library whose latent moves the first three joints."""

    agent = SimpleNamespace(act=lambda observation, latent: np.pad(latent, ((0, 0), (0, 4))))
    mean = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 0.5, 0], [0, -0.5, 0], [0, 0, 0.5]])
    std = np.full((5, 3), 0.1)
    goals = np.zeros((5, 3))
    names = ("left", "right", "down", "up", "still")
    world = world(ReachTask())


def target(robot: Path | None = None, **parameters: float) -> ArmEnvironment:
    env = make_env(ReachTask(), 1, 1, delay=True, robot=target_robot(robot) if robot else None)
    assert isinstance(env, ArmEnvironment)
    if parameters:
        env.randomize({name: np.array([value]) for name, value in parameters.items()}, np.random.default_rng(3))
        env.reset(FIRST, FIRST)
    return env


def segment(env: ArmEnvironment, seed: int, steps: int = 10) -> tuple[Array, list[Array], list[Array]]:
    """A random segment: the sighting before it, what was applied, what was measured behind each step."""
    begun, rng = env.estimate_state().state, np.random.default_rng(seed)
    action, applied, measured = 0.5 * rng.uniform(-1, 1, (1, 7)), [], []
    for _ in range(steps):
        measured.append(env.step(action).observation[0, :7])
        applied.append(env.applied[0].copy())
    return begun, applied, measured


def planning(task: str = "reach", **sections: dict[str, object]) -> Replanner:
    recipe: Recipe = resolve({"name": "r", "task": {"name": task}, "search": {"segments": [0.1], "weight": 4.0}, **sections})
    library = Joints()
    library.world = world(recipe.task)
    return Replanner(library, recipe, "search")  # type: ignore[arg-type]


# --- how a target obeys -----------------------------------------------------------------------------------------------


def hanging() -> tuple[ArmEnvironment, Array]:
    """An arm at rest that hangs off its targets, and by how much, (7,) rad."""
    env = target(SAGGING)
    for _ in range(40):
        env.step(np.zeros((1, 7)))
    return env, (env.arms.joint_position - env.arms.commanded)[0]


def test_an_arm_that_hangs_is_told_from_how_it_rests() -> None:
    hangs, known, env = hanging()[1], Identification(world(ReachTask())), target(SAGGING)
    assert np.abs(hangs).max() > 0.02, "more than a degree"
    for seed in range(3):
        known.update(*segment(env, seed))
    np.testing.assert_allclose(known.sag, hangs, atol=0.006), "it hangs otherwise in every pose"
    assert known.latency == 0.0
    known.reset()
    assert not known.sag.any(), "another target"


def test_after_a_fifth_of_a_second_most_of_it_is_known() -> None:
    known, hangs = Identification(world(ReachTask())), hanging()[1]
    known.update(*segment(target(SAGGING), 0, steps=4))
    assert known.sag[1] / hangs[1] > 0.5, "dry friction holds it up for a moment"


def test_an_arm_that_is_imagined_to_hang_stays_where_it_hangs() -> None:
    env, hangs = hanging()
    here = env.arms.gripper_position[0].copy()
    planner = make_env(ReachTask(), 3, 1)
    planner.set_estimated_state(
        np.array([1, 2]), np.repeat(env.estimate_state().state, 2, axis=0), np.stack([hangs, 0 * hangs])
    )
    sim_states = planner.save(np.array([1]))
    for _ in range(20):
        planner.step(np.zeros((3, 7)))
    told, untold = np.linalg.norm(planner.achieved_goal()[1:] - here, axis=1)
    assert told < 0.002 and untold > 0.01, "an arm that carries its weight rises to its targets: every plan began with that"
    planner.restore(np.array([0]), sim_states)
    for _ in range(20):
        planner.step(np.zeros((3, 7)))
    assert np.linalg.norm(planner.achieved_goal()[0] - here) < 0.002, "what pulls it down is part of the state"


@pytest.mark.parametrize("latency", [0.0, 0.05, 0.1])
def test_how_late_a_hanging_arm_obeys_is_told_beside(latency: float) -> None:
    env, known = target(SAGGING, latency=latency, joint_noise=0.005), Identification(world(ReachTask()))
    for seed in range(3):
        known.update(*segment(env, seed))
    assert known.latency == latency


def test_a_joint_that_is_stuck_does_not_decide_how_late_the_others_are() -> None:
    env, known = target(), Identification(world(ReachTask()))
    for seed in range(3):
        begun, applied, measured = segment(env, seed)
        known.update(begun, applied, [np.array([*joints[:6], begun[0, 6]]) for joints in measured])
    assert known.latency == 0.0 and (np.abs(known.sag) <= env.arms.largest_sag).all()


def test_the_width_between_fingers_is_replayed_too() -> None:
    task = BlocksTask(grasped_starts=False)
    env, known = blocks_env(task, 1, 1), Identification(world(task))
    begun = env.estimate_state().state
    env.step(np.array([[0.0] * 7 + [-0.5]]))
    known.update(begun, [env.applied[0].copy()], [env.estimate_state().state[0, :7]])
    assert known._robots is not None
    np.testing.assert_allclose(known._robots.arms.fingers.commanded, env.arms.fingers.commanded[0], atol=1e-6)
    assert env.arms.fingers.commanded[0] < env.arms.fingers.widest - 0.005


# --- what a search tries on the way -------------------------------------------------------------------------------------


def test_the_maps_latent_of_the_goal_is_offered_while_planning_again() -> None:
    offered = {}
    for share in (0.0, 0.5):
        recipe: Recipe = resolve({"name": "r", "task": {"name": "push"}, "mixtures": {"share": share}})
        library = Joints()
        library.world = world(recipe.task)
        library.mean, library.goals, library.names = Joints.mean[:4], library.world.goals, Joints.names[:4]
        replanner = Replanner(library, recipe, "search")  # type: ignore[arg-type]
        inside, outside = np.array([[0.6, 0.0, 0.0], [1.1, 0.0, 0.0]])
        offered[share] = [replanner._choices(goal[None]).label[4:] for goal in (inside, outside)]  # type: ignore[union-attr]
    assert offered == {0.0: [(), ()], 0.5: [("map(0.600,0.000,0.000)",), ("map(0.750,0.000,0.000)",)]}, "or the nearest place"


# --- limits of the box ------------------------------------------------------------------------------------------------


def tipping(monkeypatch: pytest.MonkeyPatch, replanner: Replanner, when: object) -> None:
    """Let boxes tip where `when` says so of the simulations."""
    for env in (replanner._simulations, replanner._others):
        assert isinstance(env, ArmEnvironment)
        monkeypatch.setattr(
            env, "violations",
            lambda env=env: np.column_stack([np.zeros((env.num_envs, 4), dtype=bool), when(env)]),  # type: ignore[operator]
        )  # fmt: skip


def next_label(replanner: Replanner) -> str:
    env = make_env(PushTask(), 1, 1)
    waypoints = np.array([[0.7, 0.1, 0.0]])
    return replanner.next(env.estimate_state(), waypoints, np.random.default_rng(0)).segment.label


def test_what_tips_the_box_is_not_held_and_where_everything_does_something_is(monkeypatch: pytest.MonkeyPatch) -> None:
    replanner = planning("push", transfer={"replan_budget": 2, "replan_batch": 1})
    free = next_label(replanner)
    turned = {"left": 1.0, "right": -1.0}
    tipping(monkeypatch, replanner, lambda env: np.sign(env.applied[:, 0]) == turned.get(free, 2.0))
    kept = next_label(replanner)
    assert free in turned and kept != free
    tipping(monkeypatch, replanner, lambda env: np.ones(env.num_envs, dtype=bool))
    assert next_label(replanner) == free, "the least bad, and no freezing"


def test_limits_that_noise_breaks_by_itself_are_left_to_the_arm() -> None:
    replanner = planning("push")
    assert isinstance(replanner._world, LatentEnvironment)
    assert set(replanner._world.limits) == {"box_pressed", "box_tipped"} < set(SAFETY_LIMITS)


# --- a box that begins to tip ------------------------------------------------------------------------------------------


def dragged(drag: tuple[float, float, float], reflex: Reflex | None) -> float:
    """How far a box tips, in degrees, that a finger comes down on beside the middle of its top and then drags, m a step."""
    env = make_env(PushTask(), 1, 1, delay=True)
    assert isinstance(env, PushEnvironment)
    env.randomize({"contact_friction": np.array([1.3]), "latency": np.array([0.05])}, np.random.default_rng(0))
    env.reset(FIRST, FIRST)
    above, lowest = env.arms.object_pose[0, :3] + [-0.025, 0, 0.042], 1.0
    if reflex:
        reflex.reset(env.estimate_state())
    for step in range(80):
        way = np.clip(above - env.arms.gripper_position[0], -0.02, 0.02) if step < 25 else np.array(drag)
        answer = reflex.action(env.estimate_state(), np.zeros(7)) if reflex else None
        env.step(env.arms.turns_towards(way[None]) / LIMIT if answer is None else answer)
        lowest = min(lowest, float(env._up()[0, 2]))
    return float(np.degrees(np.arccos(lowest)))


@pytest.mark.parametrize("drag", [(-0.01, 0, -0.01), (0, 0, -0.01)])
def test_a_finger_on_the_rim_lets_go_before_the_box_falls(drag: tuple[float, float, float]) -> None:
    reflex = Reflex(push_env(PushTask(), 2))
    assert dragged(drag, None) > 80 and dragged(drag, reflex) < 40


def sighting(env: PushEnvironment, *tilt: float) -> StateEstimate:
    """With the box leaning along x by some degrees, and turned by 0.3 rad."""
    return env.estimate_state()._replace(tilt=np.sin(np.radians([[*tilt, 0]])))


def test_a_lean_that_grows_is_answered_against_it_and_one_that_rests_is_not() -> None:
    env, imagined = push_env(PushTask(), 1), push_env(PushTask(), 1)
    reflex = Reflex(imagined)
    for degrees, answered in ((0, False), (4, True)):  # 12 degrees are foreseen
        reflex.reset(sighting(env, 0))
        before = env.arms.gripper_position[0].copy()
        assert reflex.action(sighting(env, degrees / 2), np.zeros(7)) is None
        action = reflex.action(sighting(env, 2 * degrees), np.zeros(7))
        assert (action is not None) == answered
    assert action is not None
    for _ in range(3):
        env.step(action)
    moved = env.arms.gripper_position[0] - before
    assert moved[2] > 0.003 and moved[0] < -0.002, "up, and back from where it leans"
    for _ in range(2):
        assert reflex.action(sighting(env, 0), np.zeros(7)) is None, "it stands, and the finger is far off"
    reflex.reset(sighting(env, 11))
    for _ in range(3):
        assert reflex.action(sighting(env, 11), np.zeros(7)) is None, "a table may be tilted"


def test_a_finger_that_cannot_get_away_is_left_to_the_next_plan() -> None:
    env = push_env(PushTask(), 1)
    reflex = Reflex(push_env(PushTask(), 1))
    reflex.reset(sighting(env, 0))
    answers = [reflex.action(sighting(env, 20), np.zeros(7)) is not None for _ in range(42)]
    assert answers == 2 * ([True] * 20 + [False])


def test_a_box_that_begins_to_tip_ends_the_segment(monkeypatch: pytest.MonkeyPatch) -> None:
    replanner = planning("push", transfer={"replan_budget": 2, "replan_batch": 1})
    up, answers = np.full((1, 7), 0.25), iter([False, False, True, True])
    assert replanner.reflex is not None
    monkeypatch.setattr(replanner.reflex, "action", lambda *_: up if next(answers, False) else None)
    env = make_env(PushTask(), 1, 1)
    recording = replanner.episode(env, np.array([[0.75, 0.0, 0.0]]), 6, seed=0)
    np.testing.assert_allclose(recording.action[0, 2:4], 0.25 * LIMIT, rtol=1e-5)
    assert (recording.skill[0, 2:4] == -1).all() and (recording.latent[0, 2:4] == 0).all(), "no latent is held"
    assert (recording.action[0, [0, 1, 4, 5]].min() != 0.25 * LIMIT) and replanner.effort.plans >= 2


# --- when it stops, and when it gives up ------------------------------------------------------------------------------


def episode(goal: tuple[float, float, float], steps: int, **search: object) -> Trajectories:
    settings = {"segments": [0.1], "weight": 4.0, **search}
    replanner = planning(search=settings, transfer={"replan_budget": 4})
    return replanner.episode(target(), np.array([goal]), steps, seed=0)


def test_an_episode_that_never_comes_near_says_that_it_gave_up() -> None:
    away = episode((0.4, -0.5, 0.6), 12)
    assert away.given_up.tolist() == [True] and not away.success[0] and 12 <= away.length[0] <= LONGEST * 12
    near = episode((0.6, 0.1, 0.25), 60)
    assert near.given_up.tolist() == [False] and near.gave_up is None and near.success[0]
    assert Trajectories.join([near, away]).given_up.tolist() == [False, True]


def ends_after(gaps: list[float], steps: int) -> int:
    """Control steps after which the time of an episode is up that is so far from its goal, m, at each of them."""
    mission = ReplannedEpisode(planning(), target(), np.zeros((1, 3)), steps)
    for passed, gap in enumerate(gaps):
        mission._path.append(np.array([gap, 0.0, 0.0]))
        if mission._time_is_up():
            return passed
    return len(gaps)


def test_an_episode_goes_on_as_long_as_it_comes_nearer() -> None:
    assert ends_after([0.5] * 30, 10) == 10
    assert ends_after([0.5] * 6 + [0.48] * 30, 10) == 16, "ten steps after it came nearer"
    assert ends_after([0.5] * 6 + [0.495] * 30, 10) == 10, "5 mm may be noise"
    assert ends_after([0.5] * 6 + [0.6] * 3 + [0.5] * 30, 10) == 10, "back is not nearer"


def test_who_gave_up_is_told_below_the_table() -> None:
    ended = {"mean": 0.1, "median": 0.1, "p90": 0.1}
    told = {"episodes": 20, "successes": 9, "success_rate": 0.45, "ci95": [0.3, 0.6], "final_distance_m": ended}
    more = {**told, "retention": None, "parameters": {}}
    counts: list[tuple[str, dict[str, int]]] = [("mild", {"gave_up": 0}), ("odd", {"gave_up": 2}), ("old", {})]
    rows = [DomainResults.read({**more, "name": name, **count}) for name, count in counts]
    assert _gave_up(rows) == ["gave up: odd in 2 of 20 episodes; no latent led close enough to the goal in time"]
    assert _gave_up(rows[:1]) == []


def test_where_little_is_allowed_it_comes_nearer_than_the_planner_would() -> None:
    assert planning().goal_tolerance == 0.02
    for method in ("search", "mpc"):
        recipe = resolve({"name": "r", "task": {"name": "reach", "tolerance": 0.02}, "mpc": {"samples": 4, "elites": 2}})
        library = Joints()
        library.world = world(recipe.task)
        strict = Replanner(library, recipe, method)  # type: ignore[arg-type]
        assert strict.goal_tolerance == pytest.approx(0.016), "the sensors are off by millimetres"


def test_near_the_goal_it_stops_where_a_plan_should_end_no_nearer() -> None:
    away = episode((0.6, 0.1, 0.25), 60, goal_tolerance=1e-6)
    assert away.success[0] and away.length[0] < 30, "not to overshoot again and again until half of the time is over"


def test_a_plan_that_may_end_farther_off_is_found_sooner() -> None:
    tried = []
    for within in (None, 0.08):
        replanner = planning(transfer={"replan_budget": 30, "replan_batch": 1})
        env = target()
        goal = env.achieved_goal() + np.array([[0.0, 0.1, 0.0]])
        replanner.next(env.estimate_state(), goal, np.random.default_rng(0), within)
        tried.append(replanner._world.held)
    assert tried[1] < tried[0]
