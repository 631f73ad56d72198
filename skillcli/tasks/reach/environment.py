"""The reach task: the Sawyer's gripper goes to a point in space, driven by joint increments."""

from __future__ import annotations

import mujoco
import numpy as np

from skillcli.robots import sawyer
from skillcli.robots.robot import Robot
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.environment import Array
from skillcli.tasks.reach.settings import ReachTask


def reach_spec(task: ReachTask, delay: bool = False, robot: Robot | None = None) -> mujoco.MjSpec:
    """The scene of the task: the arm behind its table."""
    return robot.arm_spec(task, delay) if robot else sawyer.arm_spec(task.timestep, delay)


class ReachEnvironment(ArmEnvironment):
    """N arms without objects.

    Observed beside the joints: the gripper's position, m. Reward: minus the distance of gripper and goal, m.
    """

    def __init__(self, task: ReachTask, num: int, threads: int = 0, delay: bool = False, robot: Robot | None = None) -> None:
        super().__init__(task, reach_spec(task, delay, robot), np.array(task.goals), num, threads, robot)

    def position(self) -> Array:
        """See `ArmEnvironment`."""
        return self.arms.gripper_position

    def judged(self) -> Array:
        """See `Environment`."""
        return self.arms.gripper_position.copy()

    def reward(self) -> Array:
        """See `ArmEnvironment`."""
        gap = self.arms.gripper_position - self.target
        distance: Array = -np.sqrt(np.einsum("ij,ij->i", gap, gap))
        return distance
