"""Goals and starts on arms that the tasks were not written for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from worlds import SAWYER

from skillcli.errors import UsageError
from skillcli.recipe import load_recipe, resolve
from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.robots.robot import load_robot
from skillcli.tasks.placement import relative_reach
from skillcli.tasks.push.placement import place_push
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.placement import place_reach
from skillcli.tasks.reach.settings import ReachTask
from skillcli.tasks.world import World

pytestmark = pytest.mark.slow  # postures are searched for

TORQUE = Path(__file__).parent.parent / "robots" / "torque.toml"


def test_the_sawyer_would_be_given_what_the_tasks_were_written_with() -> None:
    assert relative_reach(SAWYER) == 1
    found = place_reach(ReachTask(), SAWYER)
    assert np.array(found["goals"]) == pytest.approx(np.array(ReachTask().goals), abs=5e-3)
    assert tuple(found["start"]) == SAWYER.home and found["action_limit"] == 0.04
    assert place_push(PushTask(), SAWYER)["box_start"] == list(PushTask().box_start)


@pytest.mark.parametrize("arm", ["ur5e", "panda", str(TORQUE)])
@pytest.mark.parametrize("task", ["reach", "push"])
def test_a_recipe_shows_where_the_goals_lie_and_the_arm_gets_there(arm: str, task: str) -> None:
    recipe = resolve({"name": "t", "robot": arm, "task": {"name": task}})
    world, robot = World.of(recipe), load_robot(arm)
    kinematics = Kinematics(robot)
    start = np.array(recipe.task.start)  # type: ignore[attr-defined]
    assert len(start) == robot.joint_count and not kinematics.collides(start)
    env = world.make_env(2)
    env.reset(np.arange(2), np.zeros(2, dtype=int))
    for goal in world.goals:
        world.check_goal(goal)
        if task == "reach":
            assert kinematics.solve(goal, start) is not None


def test_what_a_recipe_says_stays() -> None:
    goals = ((0.4, 0.1, 0.2), (0.4, -0.1, 0.3))
    said = resolve({"name": "t", "robot": "ur5e", "task": {"name": "reach", "goals": goals, "action_limit": 0.03}})
    assert said.task.goals == goals and said.task.action_limit == 0.03  # type: ignore[attr-defined]
    again = resolve(said.model_dump(mode="json"))
    assert again == said, "a resolved recipe is placed nowhere else"
    assert load_recipe("reach").task.goals == ReachTask().goals


def test_the_recipe_of_another_robot_is_one_option_away() -> None:
    assert load_recipe("reach", robot="ur5e") == load_recipe("reach", ["robot=ur5e"])


def test_actions_keep_to_what_the_slowest_joint_can_follow(tmp_path: Path) -> None:
    slow = tmp_path / "slow.toml"
    text = TORQUE.read_text(encoding="utf-8").replace('"torque.xml"', f'"{TORQUE.with_suffix(".xml")}"')
    slow.write_text(text.replace("joints =", "speed_limit = [2, 2, 2, 0.5, 2, 2, 2]\njoints =", 1), encoding="utf-8")
    assert load_robot(slow).largest_action(0.04, 0.05) == 0.023, "0.95 of 0.5 rad/s in 0.05 s, in whole mrad"
    assert resolve({"name": "t", "robot": str(slow), "task": {"name": "reach"}}).task.action_scale == 0.023
    assert SAWYER.largest_action(0.04, 0.05) == 0.04


def test_an_arm_without_room_is_refused_in_one_line(tmp_path: Path) -> None:
    high = tmp_path / "high.toml"
    text = TORQUE.read_text(encoding="utf-8").replace('"torque.xml"', f'"{TORQUE.with_suffix(".xml")}"')
    high.write_text(text + "\n[base]\npos = [0, 0, 5]\n", encoding="utf-8")
    with pytest.raises(UsageError, match="no place for the reach task was found on 'high'") as caught:
        resolve({"name": "t", "robot": str(high), "task": {"name": "reach"}})
    assert "task.goals" in caught.value.hint


def test_a_named_route_moves_and_shrinks_with_the_goals() -> None:
    """The triangle of the paper on an arm whose cuboid is half as large and lies nearer."""
    usual = ReachTask()
    halved = [[0.2 + 0.5 * (x - 0.5), 0.5 * y, 0.5 * z] for x, y, z in usual.goals]
    world = World.of(resolve({"name": "t", "robot": "ur5e", "task": {"name": "reach", "goals": halved}}))
    expected = [[0.25, 0.15, 0.075], [0.25, -0.15, 0.075], [0.25, 0.0, 0.15], [0.25, 0.15, 0.075]]
    assert world.named_routes("triangle")[0] == pytest.approx(np.array(expected))
    (same,) = World(usual, SAWYER).named_routes("triangle")
    assert same.tolist()[0] == [0.6, 0.3, 0.15]


@pytest.mark.parametrize("name", ["reach-ur5e", "reach-panda", "reach-so101", "push-ur5e", "push-panda"])
def test_shipped_recipes_name_their_arm(name: str) -> None:
    recipe = load_recipe(name)
    assert recipe.robot == name.split("-")[1] and recipe.name == name


def test_a_small_arm_has_no_room_for_the_box() -> None:
    with pytest.raises(UsageError, match="no place for the push task"):
        load_recipe("push", robot="so101")


@pytest.mark.parametrize(
    ("task", "wrong", "key"),
    [
        ("reach", "task.goals=5", "task.goals"),
        ("reach", 'task.goals=[["a",1,2]]', "task.goals"),
        ("reach", 'task.control_period="x"', "task.control_period"),
        ("push", "task.goals=[]", "task.goals"),
        ("push", "task.goals=[[1]]", "task.goals"),
        ("push", "task.box_size=[0.1]", "task.box_size"),
        ("push", "task.box_start=[1,2,3]", "task.box_start"),
    ],
)
def test_a_wrong_key_is_told_before_anything_is_placed(task: str, wrong: str, key: str) -> None:
    with pytest.raises(UsageError, match=f"recipe key '{key}'"):
        load_recipe(task, [wrong], robot="ur5e")
