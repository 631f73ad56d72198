"""A session without a browser: what is held, played, planned and recorded, and what is refused."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from skillcli.composition.plan import schedule
from skillcli.composition.sequence import parse, written
from skillcli.errors import UsageError
from skillcli.evaluation.held import rollout_held
from skillcli.evaluation.library import Library
from skillcli.viz.play.planning import methods
from skillcli.viz.play.session import PlaySession
from skillcli.viz.play.state import Pose, between
from skillcli.viz.play.take import Take

pytestmark = pytest.mark.slow  # an arm is simulated


def run(session: PlaySession, steps: int) -> None:
    for _ in range(steps):
        session.step()


def test_the_clock_stands_still_until_something_is_held(reach: Library) -> None:
    session = PlaySession(reach)
    before = session.pose()
    run(session, 3)
    assert session.pose() is before and session.status().seconds == 0
    session.hold_skill(2)
    run(session, 3)
    assert session.status().seconds == pytest.approx(3 * session.period)
    session.pause()
    assert not session.step()


@pytest.mark.parametrize("kind", ["reach", "push", "point"])
def test_a_take_is_what_a_rollout_records(kind: str, request: pytest.FixtureRequest) -> None:
    library: Library = request.getfixturevalue(kind)
    takes: list[Take] = []
    session = PlaySession(library, takes.append)
    session.set_goal(library.goals[1])
    run(session, 2)
    session.record()
    session.hold_skill(1)
    steps = library.recipe.task.horizon
    run(session, steps)
    session.stop_recording()
    (take,) = takes
    wanted, _ = rollout_held(library.world, library.agent, library.mean[[1]], library.goals[[1]], np.array([1]))
    assert take.recording.arrays().keys() == wanted.arrays().keys()
    for name, values in wanted.arrays().items():
        np.testing.assert_array_equal(getattr(take.recording, name), values, err_msg=name)
    assert take.recording.success[0] and take.goal.shape == (1, steps, 3)


def test_reset_and_close_end_a_take_and_an_empty_one_is_none(reach: Library) -> None:
    takes: list[Take] = []
    session = PlaySession(reach, takes.append)
    session.record()
    session.reset()
    session.stop_recording()
    assert not takes, "not a single control step"
    for end in (session.reset, session.close):
        session.record()
        session.hold_latent(np.array([0.1, 0.2, 0.3]))
        run(session, 2)
        end()
    assert [take.recording.length.tolist() for take in takes] == [[2], [2]]
    assert takes[0].recording.skill.tolist() == [[-1, -1]]


def test_a_take_repeats_as_the_plan_that_it_was(reach: Library) -> None:
    takes: list[Take] = []
    session = PlaySession(reach, takes.append)
    session.record()
    rng = np.random.default_rng(0)
    for _ in range(4):
        session.hold_latent(rng.uniform(*session.bounds))
        run(session, 3)
        session.hold_skill(int(rng.integers(8)))
        run(session, 2)
    session.stop_recording()
    latent, skill = takes[0].recording.latent[0], takes[0].recording.skill[0]
    entries = parse(written(latent, skill, reach.names, session.period), reach.names, 1.0)
    again_latent, again_skill = schedule([entry.segment(reach.mean, session.period) for entry in entries])
    np.testing.assert_array_equal(again_latent.astype(np.float32), latent)
    np.testing.assert_array_equal(again_skill, skill)


def test_a_written_plan_is_played_to_its_end(reach: Library) -> None:
    session = PlaySession(reach)
    session.play_text("1:0.1,1~2:0.15,[0.1;0.2;0.3]:0.05")
    run(session, 5)
    assert session.status().running
    run(session, 3)
    assert not session.status().running and session.status().seconds == pytest.approx(0.3)
    np.testing.assert_allclose(session.latent, [0.1, 0.2, 0.3])
    with pytest.raises(UsageError, match="no skill '99'"):
        session.play_text("99")


def test_a_plan_begins_where_the_arm_is_and_meets_a_goal_elsewhere(reach: Library) -> None:
    session = PlaySession(reach)
    session.hold_skill(5)
    run(session, 12)
    goal = reach.goals.mean(axis=0)
    session.set_goal(goal)
    session.plan("search")
    assert session.status().running and session.status().said.startswith("search: ")
    for _ in range(400):
        if not session.step():
            break
    assert session.status().success and session.status().distance < 0.03, session.status()


@pytest.mark.parametrize("method", methods())
def test_every_method_that_takes_goals_plans(point: Library, method: str) -> None:
    session = PlaySession(point)
    session.hold_skill(0)
    run(session, 5)
    session.set_goal(np.array([0.5, 0.6, 9.0]))
    assert session.goal.tolist() == [0.5, 0.6, 0.0], "the height does not count"
    session.plan(method)
    while session.step():
        pass
    assert session.status().success, session.status()


def test_whatever_is_held_meanwhile_drops_the_plan(reach: Library) -> None:
    session = PlaySession(reach)
    session.set_goal(reach.goals[0] + 0.01)
    planning = threading.Thread(target=session.plan, args=("search",))
    planning.start()
    while not session.status().planning and planning.is_alive():
        pass
    session.hold_skill(3)
    planning.join(30)
    assert session.status().skill == reach.names[3] and not session.status().planning


def test_a_goal_out_of_reach_is_refused_in_words(reach: Library) -> None:
    session = PlaySession(reach)
    session.set_goal(np.array([9.0, 0.0, 0.0]))
    with pytest.raises(UsageError):
        session.plan("search")
    assert "9" in session.status().said and not session.status().planning


@pytest.mark.parametrize("place", [[np.nan, 0, 0], [np.inf, 0, 0], [0, 0]])
def test_goals_and_latents_that_are_none_are_refused(reach: Library, place: list[float]) -> None:
    session = PlaySession(reach)
    with pytest.raises(UsageError, match="goal is three finite"):
        session.set_goal(np.array(place))
    with pytest.raises(UsageError, match="a latent has 3"):
        session.hold_latent(np.array(place))
    assert not session.status().running


def test_latents_stay_within_their_bounds(reach: Library) -> None:
    session = PlaySession(reach)
    session.hold_latent(np.array([99.0, -99.0, 0.0]))
    np.testing.assert_allclose(session.latent, [session.bounds[1, 0], session.bounds[0, 1], 0])
    session.hold_latent(reach.mean[4])
    assert session.status().skill == reach.names[4]


def test_knobs_change_the_robot_while_it_moves_and_not_its_state(push: Library) -> None:
    takes: list[Take] = []
    session, nominal = PlaySession(push, takes.append), PlaySession(push)
    session.record()
    for each in (session, nominal):
        each.hold_skill(0)
        run(each, 5)
    before = session.pose()
    for name, value in {"latency": 0.1, "contact_friction": 0.4, "joint_friction": 2.0, "gain": 0.5}.items():
        session.set_knob(name, value)
    assert session.pose() is before, "turning a knob moves nothing"
    for each in (session, nominal):
        run(each, 5)
    joints, others = session.pose().joint_position, nominal.pose().joint_position
    assert joints is not None and others is not None and np.abs(joints - others).max() > 1e-3
    session.stop_recording()
    assert takes[0].knobs["gain"].tolist() == [[1.0] * 5 + [0.5] * 5]
    assert takes[0].knobs["latency"].tolist() == [[0.0] * 5 + [0.1] * 5]


def test_a_knob_turned_back_leaves_the_nominal_robot(reach: Library) -> None:
    session, nominal = PlaySession(reach), PlaySession(reach)
    for name in session.values:
        session.set_knob(name, 0.15)
        session.set_knob(name, nominal.values[name])
    for each in (session, nominal):
        each.hold_skill(1)
        run(each, 10)
    np.testing.assert_array_equal(session.pose().achieved_goal, nominal.pose().achieved_goal)


def test_unknown_knobs_are_refused_and_values_are_clipped(point: Library) -> None:
    session = PlaySession(point)
    with pytest.raises(UsageError, match="'latency' cannot be changed here"):
        session.set_knob("latency", 0.1)
    with pytest.raises(UsageError, match="must be a number"):
        session.set_knob("gain", float("nan"))
    session.set_knob("gain", 99.0)
    assert session.values["gain"] == 2.0


def test_another_robot_of_the_same_build_is_played(reach: Library, tmp_path: Path) -> None:
    bundled = reach.world.robot.path
    text = bundled.read_text().replace('model = "', f'model = "{bundled.parent}/', 1)
    file = tmp_path / "other.toml"
    file.write_text(text)
    takes: list[Take] = []
    session = PlaySession(reach, takes.append)
    session.record()
    session.hold_skill(0)
    run(session, 2)
    session.set_robot(str(file))
    assert len(takes) == 1 and takes[0].robot is None, "the take ends with its robot"
    session.record()
    session.hold_skill(0)
    run(session, 3)
    session.stop_recording()
    robot = takes[1].robot
    assert robot is not None and robot.name == "other"
    with pytest.raises(UsageError):
        session.set_robot("ur5e")
    assert session.world.robot.name == "other", "a refused robot changes nothing"


def test_frames_lie_between_two_states() -> None:
    half = np.sqrt(0.5)
    before = Pose(np.zeros(3), np.zeros(7), np.array([0, 0, 0, 1.0, 0, 0, 0]))
    after = Pose(np.ones(3), np.ones(7), np.array([1, 0, 0, -half, 0, 0, -half]))
    middle = between(before, after, 0.5)
    assert middle.object_poses is not None and middle.joint_position is not None
    np.testing.assert_allclose(middle.achieved_goal, 0.5)
    np.testing.assert_allclose(middle.joint_position, 0.5)
    np.testing.assert_allclose(middle.object_poses, [0.5, 0, 0, np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)], atol=1e-9)
    assert between(before, after, 1.0) is after
