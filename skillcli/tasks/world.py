"""`World`: a task on a robot, with its simulations, goals and checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.robot import Robot, load_robot
from skillcli.robots.scene import fingerprint
from skillcli.simulation.chance import Rng
from skillcli.simulation.environment import Array, Environment, ObservationTerm
from skillcli.simulation.fingers import Fingers
from skillcli.simulation.settings import TaskSettings
from skillcli.tasks.goals import typed
from skillcli.tasks.registry import find_task
from skillcli.tasks.spec import TaskSpec

MAX_SIMULATIONS = 1024  # in one batch: more episodes are simulated in several batches, to limit memory


class WorldRecipe(Protocol):
    """What a world needs of a recipe."""

    @property
    def task(self) -> TaskSettings:
        """Settings of the task."""

    @property
    def robot(self) -> str:
        """Name of a bundled robot, or the path of a robot file."""


@dataclass(frozen=True, eq=False)
class World:
    """A task on a robot."""

    task: TaskSettings
    robot: Robot

    @staticmethod
    def of(recipe: WorldRecipe) -> World:
        """Return the world of a recipe.

        Raises:
            UsageError: its robot cannot be read.
        """
        return World(recipe.task, load_robot(recipe.robot))

    @cached_property
    def spec(self) -> TaskSpec:
        """Return the spec of the task."""
        return find_task(self.task.name)

    def on(self, robot: Robot) -> World:
        """Return the same task on another robot, with that robot's start if its file names one.

        Raises:
            UsageError: the task has no arm.
        """
        if not self.spec.uses_robot:
            raise UsageError(f"the {self.task.name} task has no robot to replace", "it is simulated without an arm")
        own = robot.description.starts.get(self.task.name, robot.description.start)
        started = getattr(self.task, "start", ()) or self.robot.start(self.task.name)
        return replace(self, task=self.task.model_copy(update={"start": own or started}), robot=robot)

    def make_env(self, num_envs: int, threads: int = 0, delay: bool = False) -> Environment:
        """Make N simulations.

        Args:
            num_envs: simulations.
            threads: of the engine, 0 for all cores; results do not depend on it.
            delay: whether a domain may delay the actuators.

        Raises:
            UsageError: the robot does not fit the task.
        """
        env = self.spec.environment()(self.task, self.robot, self.goals, num_envs, threads, delay)
        if env.robot is not self.robot:
            raise UsageError(
                f"the environment of the {self.task.name} task leaves the robot out",
                "it has to take `robot` and hand it on; docs/add-a-task.md shows how",
            )
        return env

    def make_randomized_env(self, skill: Array, parameters: Mapping[str, Array], rng: Rng, threads: int = 0) -> Environment:
        """Make N simulations at the start, each with parameters of its own.

        Args:
            skill: (N,) index of the goal of each.
            parameters: (N,) or (N, n) by name, see `skillcli.config.randomization`; may be empty.
            rng: of sensor noise and disturbances; one for all, or one each.
            threads: see `make_env`.
        """
        env = self.make_env(len(skill), threads, "latency" in parameters)
        randomize_and_reset(env, skill, parameters, rng)
        return env

    @property
    def joints(self) -> int:
        """Return the joint count of the robot, J."""
        return self.robot.joint_count

    @property
    def action_scale(self) -> Array:
        """Return the size of an action of one, (a,): rad of each joint, and m of the width between fingers."""
        scale = np.full(self.sizes[1], self.task.action_scale)
        if self.spec.grasps:
            scale[-1] = Fingers.MAX_LEAD
        return scale

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Return the sizes of observation, action and privileged observation, without a simulation."""
        return sizes(self.task, self.joints)

    @property
    def observation_terms(self) -> tuple[ObservationTerm, ...]:
        """Return the terms of the observation in order."""
        return self.spec.environment().observation_terms(self.task, self.joints)

    def model(self) -> mujoco.MjModel | None:
        """Compile the MuJoCo model; None if no engine simulates the task."""
        scene = self.spec.environment().scene(self.task, self.robot)
        return None if scene is None else scene.compile()

    @cached_property
    def fingerprint(self) -> str:
        """Hash the scene with SHA-256; empty if no engine simulates the task."""
        scene = self.spec.environment().scene(self.task, self.robot)
        return "" if scene is None else fingerprint(scene)

    @property
    def goals(self) -> Array:
        """Return the goals of the skills, (K, 3) m."""
        return skill_goals(self.task)

    def place_goal(self, goal: Sequence[float]) -> list[float]:
        """Convert a typed goal to its place, (3,) m; see `place_goal`."""
        return place_goal(self.task, goal)

    def check_goal(self, goal: Array) -> None:
        """Refuse a goal (3,) m that no skill can reach.

        Raises:
            UsageError: it is not finite, too far away, or inside something.
        """
        if not np.isfinite(goal).all():
            raise UsageError(f"goal {typed(goal)} is not finite", f"give metres, for example --goal {self.spec.example}")
        self.spec.check_goal(self.task, self.robot, goal)

    def check_start(self, low: float, high: float) -> None:
        """Refuse starts of an object that is moved `low` to `high` m in x and y, if they are invalid.

        Raises:
            UsageError: it may start where there is no room.
        """
        self.spec.check_start(self.task, low, high)

    def named_routes(self, name: str) -> tuple[Array, ...]:
        """Return the routes of a named composition, (W, 3) m each.

        Raises:
            UsageError: this task has no composition of that name.
        """
        known = self.spec.compositions
        if name not in known:
            raise UsageError(
                f"no composition {name!r} for the {self.task.name} task", f"compositions: {', '.join(known)}; or give --goal"
            )
        routes = (self.spec.fit_route(self.task, route) for route in known[name])
        return tuple(np.array([self.place_goal(goal) for goal in route]) for route in routes)


def randomize_and_reset(env: Environment, skill: Array, parameters: Mapping[str, Array], rng: Rng) -> None:
    """Give simulations the `parameters`, and put them at the start; see `World.make_randomized_env`."""
    if parameters:
        env.randomize(parameters, rng)
    env.reset(np.arange(len(skill)), skill)


def sizes(task: TaskSettings, joints: int) -> tuple[int, int, int]:
    """Return the sizes of observation, action and privileged observation, on an arm with this many joints."""
    spec = find_task(task.name)
    environment = spec.environment()
    observation = sum(term.size for term in environment.observation_terms(task, joints))
    privileged = sum(term.size for term in environment.privileged_terms)
    return observation, joints + spec.grasps if spec.uses_robot else observation, privileged


def recorded(task: TaskSettings, joints: int) -> dict[str, int]:
    """Return the fields in a recording of this task, and the size of each."""
    spec = find_task(task.name)
    arm = {"joint_position": joints} if spec.uses_robot else {}
    return {**arm, **spec.environment().recorded}


def skill_goals(task: TaskSettings) -> Array:
    """Return the goals of the task's skills, (K, 3) m."""
    return np.array([place_goal(task, goal) for goal in task.goals])


def place_goal(task: TaskSettings, goal: Sequence[float]) -> list[float]:
    """Convert a typed goal of a task to its place, (3,) m.

    Raises:
        UsageError: it has the wrong number of coordinates.
    """
    wanted, spec = len(task.goals[0]), find_task(task.name)  # every goal of a recipe is typed with as many numbers
    if len(goal) != wanted:
        usual = spec.example.count(",") + 1 == wanted
        example = spec.example if usual else typed(np.array(task.goals[0]))
        raise UsageError(
            f"a goal of these {task.name} skills has {wanted} numbers, got {len(goal)}", f"for example --goal={example}"
        )
    return spec.place_goal(task, goal)
