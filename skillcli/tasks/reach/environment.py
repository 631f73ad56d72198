"""The reach task: the arm's gripper goes to a point in space, driven by joint increments."""

from __future__ import annotations

import numpy as np

from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.environment import Array, RewardTerms


class ReachEnvironment(ArmEnvironment):
    """N arms without objects. Besides the joints, the gripper's position is observed, m."""

    def position(self) -> Array:
        """See `ArmEnvironment`."""
        return self.arms.gripper_position

    def achieved_goal(self) -> Array:
        """See `Environment`."""
        return self.arms.gripper_position.copy()

    def reward_terms(self) -> RewardTerms:
        """Return minus the distance of gripper and goal, m."""
        gap = self.arms.gripper_position - self.desired_goal
        return RewardTerms({"distance": -np.sqrt(np.einsum("ij,ij->i", gap, gap))}, {})
