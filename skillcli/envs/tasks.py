"""Which tasks there are: how each is built, which goals it can be asked for, and its named compositions.

A new task is one file beside this one and one line in each table here.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from skillcli.envs import sawyer
from skillcli.envs.environment import Array, Environment
from skillcli.envs.point import PointEnvironment
from skillcli.envs.reach import ReachEnvironment, reach_spec
from skillcli.errors import UsageError
from skillcli.recipe import PointTask, ReachTask

Task = PointTask | ReachTask

MAX_SIMULATIONS = 1024  # side by side, where there may be any number of episodes: the rest comes after, memory is bounded

DESCRIPTIONS = {
    "point": "a point in the plane moved by velocity; no physics, trains in seconds",
    "reach": "the Sawyer's gripper goes to points in space, joint increments at 20 Hz",
}

# Waypoints in order, m. triangle and square-through-the-middle of the cuboid that the trained reach goals span.
COMPOSITIONS: dict[str, dict[str, tuple[tuple[float, float, float], ...]]] = {
    "point": {
        "triangle": ((2.0, 1.0, 0.0), (-2.0, 1.0, 0.0), (0.0, -2.0, 0.0)),
    },
    "reach": {  # Julian et al. 2018, the searched triangle
        "triangle": ((0.6, 0.3, 0.15), (0.6, -0.3, 0.15), (0.6, 0.0, 0.3), (0.6, 0.3, 0.15)),
    },
}


def make(task: Task, num: int, threads: int = 0, delay: bool = False) -> Environment:
    """N simulations of a task.

    Args:
        task: from a recipe.
        num: simulations.
        threads: of the engine, 0 for all cores; results do not depend on it.
        delay: whether a domain may delay the actuators.
    """
    if isinstance(task, PointTask):
        return PointEnvironment(task, num)
    return ReachEnvironment(task, num, threads, delay)


def model_of(task: Task) -> mujoco.MjModel | None:
    """The task's MuJoCo model; None for the point."""
    return None if isinstance(task, PointTask) else reach_spec(task).compile()


def model_fingerprint(task: Task) -> str:
    """SHA-256 of the task's model; empty for the point."""
    return "" if isinstance(task, PointTask) else sawyer.fingerprint(reach_spec(task))


def named_waypoints(task: Task, name: str) -> Array:
    """The waypoints of a named composition, (W, 3) m.

    Raises:
        UsageError: this task has no composition of that name.
    """
    known = COMPOSITIONS[task.name]
    if name not in known:
        raise UsageError(
            f"no composition {name!r} for the {task.name} task", f"compositions: {', '.join(known)}; or give --goal"
        )
    return np.array(known[name])


def skill_goals(task: Task) -> Array:
    """The goals of the task's skills, (K, 3) m."""
    return np.array([point3(task, goal) for goal in task.goals])


def point3(task: Task, goal: Sequence[float]) -> list[float]:
    """A goal as it is typed for a task, with three coordinates.

    Raises:
        UsageError: it has the wrong number of coordinates.
    """
    wanted = 2 if isinstance(task, PointTask) else 3
    if len(goal) != wanted:
        example = "1.0,2.0" if wanted == 2 else "0.6,0.0,0.2"
        raise UsageError(
            f"a goal of the {task.name} task has {wanted} numbers, got {len(goal)}", f"for example --goal {example}"
        )
    return [*goal, 0.0][:3]


def check_goal(task: Task, goal: Array) -> None:
    """Refuse a goal (3,) m that cannot be reached whatever the skills.

    Raises:
        UsageError: it is not finite, too far away, or inside table or base.
    """
    shown = ",".join(f"{x:g}" for x in goal)
    if not np.isfinite(goal).all():
        raise UsageError(f"goal {shown} is not finite", "give metres, for example --goal 0.6,0.0,0.2")
    if isinstance(task, PointTask):
        if np.abs(goal[:2]).max() > task.bound:
            raise UsageError(f"goal {shown} is out of bounds", f"both coordinates must lie within ±{task.bound:g} m")
        return
    distance = float(np.linalg.norm(goal - sawyer.SHOULDER))
    if distance > sawyer.LONGEST_REACH:
        raise UsageError(
            f"goal {shown} is out of reach: {distance:.2f} m from the shoulder at {_listed(sawyer.SHOULDER)}",
            f"the arm with its finger reaches {sawyer.LONGEST_REACH:.2f} m; trained goals lie at {_box(np.array(task.goals))}",
        )
    if np.hypot(goal[0], goal[1]) < sawyer.BASE_RADIUS and goal[2] < sawyer.BASE_HEIGHT:
        raise UsageError(
            f"goal {shown} lies inside the robot's own base",
            f"keep {sawyer.BASE_RADIUS:g} m away from the axis of the first joint",
        )
    if goal[2] < sawyer.TABLE_TOP:
        raise UsageError(f"goal {shown} lies below the table", f"the table top is at z = {sawyer.TABLE_TOP:g} m")


def _listed(numbers: Array) -> str:
    return "(" + ", ".join(f"{x:g}" for x in numbers) + ")"


def _box(points: Array) -> str:
    return " .. ".join(_listed(corner) for corner in (points.min(axis=0), points.max(axis=0)))
