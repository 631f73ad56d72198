"""A task on a robot: everything that can be simulated, and all that is asked of the two together."""

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
from skillcli.simulation.settings import TaskSettings
from skillcli.tasks.goals import typed
from skillcli.tasks.registry import find_task
from skillcli.tasks.spec import TaskSpec

MAX_SIMULATIONS = 1024  # side by side, where there may be any number of episodes: the rest comes after, memory is bounded


class WorldRecipe(Protocol):
    """What a world needs of a recipe."""

    @property
    def task(self) -> TaskSettings:
        """What the skills are for."""

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
        """What a recipe is about.

        Raises:
            UsageError: its robot cannot be read.
        """
        return World(recipe.task, load_robot(recipe.robot))

    @cached_property
    def spec(self) -> TaskSpec:
        """What the task is."""
        return find_task(self.task.name)

    def on(self, robot: Robot) -> World:
        """The same task on another robot, from the start of that one where its file names one.

        Raises:
            UsageError: there is no arm in the task.
        """
        if not self.spec.uses_robot:
            raise UsageError(f"the {self.task.name} task has no robot to replace", "it is simulated without an arm")
        own = robot.description.starts.get(self.task.name, robot.description.start)
        started = getattr(self.task, "start", ()) or self.robot.start(self.task.name)
        return replace(self, task=self.task.model_copy(update={"start": own or started}), robot=robot)

    def make_env(self, num_envs: int, threads: int = 0, delay: bool = False) -> Environment:
        """N simulations.

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
        """N simulations at the start, each a robot of its own.

        Args:
            skill: (N,) index of the goal of each.
            parameters: what differs between them, (N,) or (N, n) by name, see `skillcli.config.randomization`; nothing where
                empty.
            rng: of what goes on by chance in them, sensor noise and pushes; one for all, or one for each.
            threads: as for `make_env`.
        """
        env = self.make_env(len(skill), threads, "latency" in parameters)
        randomize_and_reset(env, skill, parameters, rng)
        return env

    @property
    def joints(self) -> int:
        """Joints of the robot, J."""
        return self.robot.joint_count

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Sizes of observation, action and of what only the value function sees, without a simulation."""
        return sizes(self.task, self.joints)

    @property
    def observation_terms(self) -> tuple[ObservationTerm, ...]:
        """What the policy sees, in order."""
        return self.spec.environment().observation_terms(self.task, self.joints)

    def model(self) -> mujoco.MjModel | None:
        """The MuJoCo model, None where no engine simulates the task."""
        scene = self.spec.environment().scene(self.task, self.robot)
        return None if scene is None else scene.compile()

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of the scene; empty where no engine simulates the task."""
        scene = self.spec.environment().scene(self.task, self.robot)
        return "" if scene is None else fingerprint(scene)

    @property
    def goals(self) -> Array:
        """Where the skills should end, (K, 3) m."""
        return skill_goals(self.task)

    def place_goal(self, goal: Sequence[float]) -> list[float]:
        """Where a goal is, (3,) m, from how it is typed; see `place_goal`."""
        return place_goal(self.task, goal)

    def check_goal(self, goal: Array) -> None:
        """Refuse a goal (3,) m that cannot be reached whatever the skills.

        Raises:
            UsageError: it is not finite, too far away, or where nothing can be.
        """
        if not np.isfinite(goal).all():
            raise UsageError(f"goal {typed(goal)} is not finite", f"give metres, for example --goal {self.spec.example}")
        self.spec.check_goal(self.task, self.robot, goal)

    def check_start(self, low: float, high: float) -> None:
        """Refuse starts that make no sense where an object starts from `low` to `high` m off in x and y.

        Raises:
            UsageError: it may start where there is no room.
        """
        self.spec.check_start(self.task, low, high)

    def named_routes(self, name: str) -> tuple[Array, ...]:
        """The routes of a named composition, (W, 3) m each.

        Raises:
            UsageError: this task has no composition of that name.
        """
        known = self.spec.compositions
        if name not in known:
            raise UsageError(
                f"no composition {name!r} for the {self.task.name} task", f"compositions: {', '.join(known)}; or give --goal"
            )
        return tuple(np.array([self.place_goal(goal) for goal in route]) for route in known[name])


def randomize_and_reset(env: Environment, skill: Array, parameters: Mapping[str, Array], rng: Rng) -> None:
    """Make simulations the robots of `parameters`, and put them at the start; see `World.make_randomized_env`."""
    if parameters:
        env.randomize(parameters, rng)
    env.reset(np.arange(len(skill)), skill)


def sizes(task: TaskSettings, joints: int) -> tuple[int, int, int]:
    """Sizes of observation, action and of what only the value function sees, with an arm of this many joints."""
    spec = find_task(task.name)
    environment = spec.environment()
    observation = sum(term.size for term in environment.observation_terms(task, joints))
    privileged = sum(term.size for term in environment.privileged_terms)
    return observation, joints if spec.uses_robot else observation, privileged


def recorded(task: TaskSettings, joints: int) -> dict[str, int]:
    """Fields that a recording has of this task, and how many numbers each of them has at a moment."""
    spec = find_task(task.name)
    arm = {"joint_position": joints} if spec.uses_robot else {}
    return {**arm, **spec.environment().recorded}


def skill_goals(task: TaskSettings) -> Array:
    """Where the task's skills should end, (K, 3) m."""
    return np.array([place_goal(task, goal) for goal in task.goals])


def place_goal(task: TaskSettings, goal: Sequence[float]) -> list[float]:
    """Where a goal is, (3,) m, from how it is typed for a task.

    Raises:
        UsageError: it has the wrong number of coordinates.
    """
    wanted, spec = len(task.goals[0]), find_task(task.name)  # every goal of a recipe is typed as long
    if len(goal) != wanted:
        raise UsageError(
            f"a goal of the {task.name} task has {wanted} numbers, got {len(goal)}", f"for example --goal {spec.example}"
        )
    return spec.place_goal(task, goal)
