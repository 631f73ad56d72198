"""An episode whose planner needs a while: the target holds until the plan is there, and waiting is no time of the episode."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from worlds import blocks_env, make_env

from skillcli.composition.plan import Segment
from skillcli.evaluation.replanned_episode import Prospect, ReplannedEpisode, Sighting
from skillcli.evaluation.rollouts import rollout_closed_loop
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.reach.settings import ReachTask
from skillcli.trajectories import Array, Trajectories

FAR = np.array([[0.4, -0.5, 0.6]])  # m, no segment leads there
LASTS = 6  # control steps of a segment


class Slow:
    """An adviser that answers when it was polled `takes` times; its segments turn the first joint."""

    reflex, way_back, latent_size, goal_tolerance, final_speed, sag = None, None, 3, 0.01, 0.0, np.zeros(7)

    def __init__(self, takes: int) -> None:
        self.takes, self.polled, self.told = takes, 0, list[Sighting]()

    def act(self, observation: Array, latent: Array) -> Array:
        return np.array([[latent[0, 0], 0, 0, 0, 0, 0, 0]])

    def ask(self, sighting: Sighting) -> None:
        self.told.append(sighting)
        self.polled = 0

    def answer(self) -> Prospect | None:
        self.polled += 1
        if self.polled <= self.takes:
            return None
        return Prospect(Segment(np.array([0.5, 0.0, 0.0]), 0, "turn", LASTS), np.zeros(3), 0.0)


def played(
    adviser: Slow, steps: int, most: int = 200, waypoints: Array = FAR, **more: float
) -> tuple[Trajectories, ReplannedEpisode]:
    env = make_env(ReachTask(), 1, 1)
    assert isinstance(env, ArmEnvironment)
    mission = ReplannedEpisode(adviser, env, waypoints, steps, **more)  # type: ignore[arg-type]
    return rollout_closed_loop(env, mission.act, mission.condition, most)[0], mission


def runs(skill: Array) -> list[tuple[int, int]]:
    """Skill and length of each stretch."""
    edges = np.flatnonzero(np.diff(skill, prepend=skill[0] - 1))
    return [(int(skill[a]), int(b - a)) for a, b in zip(edges, [*edges[1:], len(skill)], strict=True)]


def test_the_target_holds_until_the_plan_is_there_and_rests_before_it_is_looked_at() -> None:
    recording, _ = played(adviser := Slow(takes=3), steps=16, settle=2)
    assert runs(recording.skill[0]) == [(-1, 3), (0, 4), (-1, 5), (0, LASTS), (-1, 5), (0, LASTS)], (
        "two steps to rest, three to think"
    )
    held = recording.skill[0] == -1
    assert not recording.action[0, held].any() and recording.action[0, ~held].any(axis=1).all()
    rested = adviser.told[1]
    assert len(rested.applied) == len(rested.measured) == 4 + 2, "it is told of the segment and how it came to rest"
    assert rested.begun.shape == rested.seen.state.shape and not adviser.told[0].applied


def test_a_hand_neither_opens_nor_closes_while_it_waits() -> None:
    env = blocks_env(BlocksTask(grasped_starts=False), 1, 1)
    mission = ReplannedEpisode(Slow(takes=2), env, FAR, 8)
    recording, _ = rollout_closed_loop(env, mission.act, mission.condition, 2)
    assert recording.action.shape == (1, 2, 8) and not recording.action.any()


def test_waiting_is_no_time_of_the_episode() -> None:
    slow, _ = played(Slow(takes=7), steps=16)
    quick, mission = played(Slow(takes=0), steps=16)
    for recording in (slow, quick):
        assert np.count_nonzero(recording.skill[0] >= 0) == 16
    assert len(slow.skill[0]) == 16 + 3 * 7 and len(quick.skill[0]) == 16 and mission.gave_up()


def test_an_arm_that_carries_out_half_of_every_action_holds_latents_twice_as_long() -> None:
    recording, _ = played(Slow(takes=1), steps=16, share=0.5)
    assert runs(recording.skill[0])[:4] == [(-1, 1), (0, 8), (-1, 1), (0, 2 * LASTS)]
    assert np.count_nonzero(recording.skill[0] >= 0) == 32


def test_a_plan_for_a_waypoint_that_is_met_meanwhile_is_asked_for_again() -> None:
    here = make_env(ReachTask(), 1, 1).achieved_goal()[0]
    recording, _ = played(adviser := Slow(takes=2), steps=8, most=6, waypoints=np.array([here, FAR[0]]))
    assert [len(one.waypoints) for one in adviser.told] == [1], "met before it was asked"
    assert runs(recording.skill[0])[0] == (-1, 2)


def test_what_was_asked_before_the_reflex_is_no_longer_wanted() -> None:
    adviser = Slow(takes=2)
    let_go = iter([None, np.ones((1, 7)), None, None, None, None, None])
    adviser.reflex = SimpleNamespace(reset=lambda seen: None, action=lambda seen, sag: next(let_go))  # type: ignore[assignment]
    recording, _ = played(adviser, steps=8, most=6)
    assert len(adviser.told) == 2 and not adviser.told[1].applied, "what the reflex did tells nothing of the policy"
    assert recording.action[0, 1].all() and runs(recording.skill[0]) == [(-1, 4), (0, 2)]


def test_after_half_of_the_time_a_plan_may_end_as_far_off_as_the_episode() -> None:
    _, mission = played(adviser := Slow(takes=0), steps=24)
    assert mission.gave_up()
    within = [told.within for told in adviser.told]
    assert within[:3] == [0.01] * 3 and set(within[3:]) == {0.8 * ReachTask().tolerance}, (
        "asked after 0, 4, 10 and 16 of 24 steps"
    )
