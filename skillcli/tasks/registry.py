"""Which tasks there are: how each is built, which goals it can be asked for, and its named compositions.

A new task is one file beside this one and one line in each table here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import assert_never

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.robots import sawyer
from skillcli.robots.robot import Robot
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.chance import Rng
from skillcli.simulation.environment import Array, Environment
from skillcli.tasks.point.environment import PointEnvironment
from skillcli.tasks.point.settings import PointTask
from skillcli.tasks.push.environment import PushEnvironment, push_spec
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.environment import ReachEnvironment, reach_spec
from skillcli.tasks.reach.settings import ReachTask

Task = PointTask | ReachTask | PushTask

MAX_SIMULATIONS = 1024  # side by side, where there may be any number of episodes: the rest comes after, memory is bounded

DESCRIPTIONS = {
    "point": "a point in the plane moved by velocity; no physics, trains in seconds",
    "reach": "the Sawyer's gripper goes to points in space, joint increments at 20 Hz",
    "push": "the Sawyer's finger pushes a box over the table, with real contact",
}

# Routes from the start, each of waypoints in order: goals as they are typed.
Route = tuple[tuple[float, ...], ...]
COMPOSITIONS: dict[str, dict[str, tuple[Route, ...]]] = {
    "point": {
        "triangle": (((2.0, 1.0), (-2.0, 1.0), (0.0, -2.0)),),
    },
    "reach": {  # Julian et al. 2018, the searched triangle
        "triangle": (((0.6, 0.3, 0.15), (0.6, -0.3, 0.15), (0.6, 0.0, 0.3), (0.6, 0.3, 0.15)),),
    },
    "push": {  # every 30 degrees, 20 cm from the start: outside the square that the skills span
        "ring": tuple(
            ((round(0.2 * math.cos(math.radians(angle)), 4), round(0.2 * math.sin(math.radians(angle)), 4)),)
            for angle in range(0, 360, 30)
        ),
    },
}

# Chains through skills by number, for interpolation.
CHAINS: dict[str, dict[str, str]] = {
    "point": {},
    "reach": {"u-shape": "3,4,8,7"},  # Julian et al. 2018: draws a U
    "push": {},
}
INTERPOLATED_SETS = ("pairs", "neighbours")  # interpolations of many routes, one for each pair of skills


def make(task: Task, num: int, threads: int = 0, delay: bool = False, robot: Robot | None = None) -> Environment:
    """N simulations of a task.

    Args:
        task: from a recipe.
        num: simulations.
        threads: of the engine, 0 for all cores; results do not depend on it.
        delay: whether a domain may delay the actuators.
        robot: another robot instead of the Sawyer that skills are trained on.

    Raises:
        UsageError: the robot does not fit the task.
    """
    if isinstance(task, PointTask):
        if robot is not None:
            raise UsageError("the point task has no robot to replace", "robots are for reach and push")
        return PointEnvironment(task, num)
    env = _arm_environment(task, num, threads, delay, robot)
    if env.robot is not robot:
        raise UsageError(
            f"the {task.name} task plays on the Sawyer only: its environment leaves the robot out",
            "it has to take `robot` and hand it on; docs/add-a-task.md shows how",
        )
    return env


def _arm_environment(task: ReachTask | PushTask, num: int, threads: int, delay: bool, robot: Robot | None) -> ArmEnvironment:
    if isinstance(task, PushTask):
        return PushEnvironment(task, num, threads, delay, robot)
    if isinstance(task, ReachTask):
        return ReachEnvironment(task, num, threads, delay, robot)
    assert_never(task)  # a new task needs a line here


def stand(
    task: Task, skill: Array, parameters: Mapping[str, Array], rng: Rng, threads: int = 0,
    robot: Robot | None = None,
) -> Environment:  # fmt: skip
    """N simulations at the start, each a robot of its own.

    Args:
        task: from a recipe.
        skill: (N,) index of the goal of each.
        parameters: what differs between them, (N,) or (N, n) by name, see `skillcli.config.randomization`; nothing where empty.
        rng: of what goes on by chance in them, sensor noise and pushes; one for all, or one for each.
        threads: as for `make`.
        robot: as for `make`.
    """
    env = make(task, len(skill), threads, "latency" in parameters, robot)
    begin(env, skill, parameters, rng)
    return env


def begin(env: Environment, skill: Array, parameters: Mapping[str, Array], rng: Rng) -> None:
    """Make simulations the robots of `parameters`, and put them at the start; see `stand`."""
    if parameters:
        env.perturb(parameters, rng)
    env.reset(np.arange(len(skill)), skill)


def sizes(task: Task) -> tuple[int, int, int]:
    """Sizes of observation, action and of what only the value function sees, without a simulation."""
    if isinstance(task, PointTask):
        return PointEnvironment.observation_size, PointEnvironment.action_size, PointEnvironment.privileged_size
    kind = PushEnvironment if isinstance(task, PushTask) else ReachEnvironment
    return kind.observes(task), kind.action_size, kind.privileged_size


def _spec_of(task: ReachTask | PushTask) -> mujoco.MjSpec:
    if isinstance(task, PushTask):
        return push_spec(task)
    if isinstance(task, ReachTask):
        return reach_spec(task)
    assert_never(task)


def model_of(task: Task) -> mujoco.MjModel | None:
    """The task's MuJoCo model; None for the point."""
    return None if isinstance(task, PointTask) else _spec_of(task).compile()


def model_fingerprint(task: Task) -> str:
    """SHA-256 of the task's model with the Sawyer; empty for the point. Other robots have a fingerprint of their own."""
    return "" if isinstance(task, PointTask) else sawyer.fingerprint(_spec_of(task))


def named_routes(task: Task, name: str) -> tuple[Array, ...]:
    """The routes of a named composition, (W, 3) m each.

    Raises:
        UsageError: this task has no composition of that name.
    """
    known = COMPOSITIONS[task.name]
    if name not in known:
        raise UsageError(
            f"no composition {name!r} for the {task.name} task", f"compositions: {', '.join(known)}; or give --goal"
        )
    return tuple(np.array([goal_place(task, goal) for goal in route]) for route in known[name])


def skill_goals(task: Task) -> Array:
    """Where the task's skills should end, (K, 3) m."""
    return np.array([goal_place(task, goal) for goal in task.goals])


def goal_place(task: Task, goal: Sequence[float]) -> list[float]:
    """Where a goal is, (3,) m, from how it is typed for a task: for push a displacement of the box from its nominal start.

    Raises:
        UsageError: it has the wrong number of coordinates.
    """
    wanted = len(task.goals[0])  # every goal of a recipe is typed as long
    if len(goal) != wanted:
        raise UsageError(
            f"a goal of the {task.name} task has {wanted} numbers, got {len(goal)}",
            f"for example --goal {_EXAMPLES[task.name]}",
        )
    if isinstance(task, PushTask):
        return [task.box_start[0] + goal[0], task.box_start[1] + goal[1], 0.0]
    if isinstance(task, ReachTask):
        return [*goal]
    if isinstance(task, PointTask):
        return [*goal, 0.0]
    assert_never(task)


_EXAMPLES = {"point": "1.0,2.0", "reach": "0.6,0.0,0.2", "push": "0.1,-0.1"}


def half_edges(task: Task) -> tuple[float, float]:
    """Half of the edges of the box along x and y, m; 0 without a box."""
    if not isinstance(task, PushTask):
        return 0.0, 0.0
    return task.box_size[0] / 2, task.box_size[1] / 2


def check_goal(task: Task, goal: Array) -> None:
    """Refuse a goal (3,) m that cannot be reached whatever the skills.

    Raises:
        UsageError: it is not finite, too far away, or inside table or base.
    """
    shown = ",".join(f"{x:g}" for x in goal)
    if not np.isfinite(goal).all():
        raise UsageError(f"goal {shown} is not finite", f"give metres, for example --goal {_EXAMPLES[task.name]}")
    if isinstance(task, PointTask):
        if np.abs(goal[:2]).max() > task.bound:
            raise UsageError(f"goal {shown} is out of bounds", f"both coordinates must lie within ±{task.bound:g} m")
        return
    if isinstance(task, PushTask):
        _check_on_table(task, goal)
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


def check_start(task: Task, low: float, high: float) -> None:
    """Refuse a box that starts off the table, or may: drawn from `low` to `high` m off its nominal start in x and y.

    Raises:
        UsageError: it does.
    """
    if not isinstance(task, PushTask):
        return
    lowest, highest = _room(task)
    if not ((lowest <= np.array(task.box_start) + low) & (np.array(task.box_start) + high <= highest)).all():
        drawn = f", drawn {low:g} to {high:g} m off," if high > low else ""
        raise UsageError(
            f"a box at task.box_start {_listed(np.array(task.box_start))}{drawn} starts off the table",
            f"there is room for it at {_listed(lowest)} .. {_listed(highest)} m",
        )


def _room(task: PushTask) -> tuple[Array, Array]:
    """Lowest and highest place of a box, however it has turned by quarters, on the table, (2,) m each."""
    room = np.array(sawyer.TABLE_HALF_SIZE[:2]) - max(task.box_size[:2]) / 2
    return sawyer.TABLE_CENTRE - room, sawyer.TABLE_CENTRE + room


def _check_on_table(task: PushTask, goal: Array) -> None:
    lowest, highest = _room(task)
    if ((goal[:2] < lowest) | (goal[:2] > highest)).any():
        low, high = lowest - task.box_start, highest - task.box_start
        raise UsageError(
            f"displacement {_listed(goal[:2] - task.box_start)} leaves no room for the box on the table",
            f"displacements lie between {_listed(low)} and {_listed(high)} m",
        )


def _listed(numbers: Array) -> str:
    return "(" + ", ".join(f"{x:g}" for x in numbers) + ")"


def _box(points: Array) -> str:
    return " .. ".join(_listed(corner) for corner in (points.min(axis=0), points.max(axis=0)))
