"""Tasks on the Sawyer, or on another robot, as tests want them: one call each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco

from skillcli.config.randomization import PARAMETERS
from skillcli.robots.robot import Robot, load_robot, load_target
from skillcli.simulation.environment import Environment
from skillcli.tasks.blocks.environment import BlocksEnvironment
from skillcli.tasks.point.environment import PointEnvironment
from skillcli.tasks.push.environment import PushEnvironment
from skillcli.tasks.reach.environment import ReachEnvironment
from skillcli.tasks.registry import find_task
from skillcli.tasks.world import World

SAWYER = load_robot("sawyer")
PANDA = load_robot("panda")  # has a hand that grasps
JOINTS = SAWYER.joint_count


def width(name: str) -> int:
    """How many values a parameter has in each episode."""
    return PARAMETERS[name].size or JOINTS


def world(task: Any, robot: Robot | None = None) -> World:
    """A task on the Sawyer, or the arm of a task that it cannot do, or on another robot that plays it in its place."""
    usual = World(task, load_robot(find_task(task.name).robot))
    return usual if robot is None else usual.on(robot)


def target_robot(path: Path) -> Robot:
    """A robot of a file, for skills that were learned on the Sawyer."""
    return load_target(path, SAWYER)


def make_env(task: Any, num_envs: int, threads: int = 0, delay: bool = False, robot: Robot | None = None) -> Any:
    """N simulations."""
    env: Environment = world(task, robot).make_env(num_envs, threads, delay)
    return env


def reach_env(task: Any, num_envs: int, threads: int = 0, delay: bool = False) -> ReachEnvironment:
    """N simulations of reach."""
    env = make_env(task, num_envs, threads, delay)
    assert isinstance(env, ReachEnvironment)
    return env


def push_env(task: Any, num_envs: int, threads: int = 0, delay: bool = False) -> PushEnvironment:
    """N simulations of push."""
    env = make_env(task, num_envs, threads, delay)
    assert isinstance(env, PushEnvironment)
    return env


def blocks_env(task: Any, num_envs: int, threads: int = 0, delay: bool = False) -> BlocksEnvironment:
    """N simulations of blocks."""
    env = make_env(task, num_envs, threads, delay)
    assert isinstance(env, BlocksEnvironment)
    return env


def point_env(task: Any, num_envs: int) -> PointEnvironment:
    """N simulations of the point."""
    env = make_env(task, num_envs)
    assert isinstance(env, PointEnvironment)
    return env


def sizes(task: Any) -> tuple[int, int, int]:
    """See `World.sizes`."""
    return world(task).sizes


def model_of(task: Any) -> mujoco.MjModel | None:
    """See `World.model`."""
    return world(task).model()


def model_fingerprint(task: Any) -> str:
    """See `World.fingerprint`."""
    return world(task).fingerprint


def named_routes(task: Any, name: str) -> tuple[Any, ...]:
    """See `World.named_routes`."""
    return world(task).named_routes(name)


def check_goal(task: Any, goal: Any) -> None:
    """See `World.check_goal`."""
    world(task).check_goal(goal)


def check_start(task: Any, low: float, high: float) -> None:
    """See `World.check_start`."""
    world(task).check_start(low, high)
