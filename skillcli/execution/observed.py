"""What the policy observes on an arm: readings put into the simulation of the task, which computes everything else.

So a task needs no code of its own for a real arm: gripper, relative positions, achieved goal and safety limits are those
that the same joint angles, and the same pose of the object, have in the simulation.
"""

from __future__ import annotations

import numpy as np

from skillcli.execution.driver import JointState, ObjectPose
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.tasks.world import World
from skillcli.trajectories import Array


class ObservedArm:
    """One simulation that is put where an arm is.

    Args:
        world: a task with an arm, on the robot file of the arm.
    """

    def __init__(self, world: World) -> None:
        env = world.make_env(1, threads=1)
        assert isinstance(env, ArmEnvironment), "only tasks on an arm are executed"
        self.env = env
        self.has_object = "object_pose" in world.spec.environment().recorded
        self.start = env.arms.joint_position[0].copy()  # (J,) rad

    def put(self, reading: JointState, target: Array, seen: ObjectPose | None) -> None:
        """Put the simulation where the arm is.

        Args:
            reading: of the joints.
            target: (J,) rad, commanded joint angles.
            seen: the object, None without one.
        """
        self.env.remember()
        pose = None if seen is None else seen.pose[None]
        self.env.arms.set_state(
            np.array([0]), reading.position[None], reading.velocity[None], target[None, None], object_pose=pose
        )
        self.env.observe()

    def begin(self, reading: JointState, target: Array, seen: ObjectPose | None) -> None:
        """Do the same as `put`, at the beginning of an episode: what was before is forgotten."""
        self.put(reading, target, seen)
        self.env.remember(again=True)
