"""One simulated robot that moves while time passes, instead of by control steps.

Physics, drawn robot, sensors and disturbances are those of `transfer-eval`. Its own controller works in cycles of at most
`LONGEST_CYCLE`: a command counts from the beginning of the cycle in which it arrives, and between two commands the servos
hold the last target. So a loop that answers a reading within a cycle moves this arm exactly as an episode of
`transfer-eval` does, whatever its own small delays are.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.environment import NO_SKILL
from skillcli.tasks.world import World
from skillcli.trajectories import Array

LONGEST_CYCLE = 0.01  # s: arms report and take commands at 100 Hz and more


class SimulatedArm:
    """One arm of a world.

    Args:
        world: task and robot.
        delay: whether robots may delay their actuators.
    """

    def __init__(self, world: World, delay: bool) -> None:
        env = world.make_env(1, threads=1, delay=delay)
        assert isinstance(env, ArmEnvironment), "only arms are executed"
        self._env = env
        timestep, substeps = float(env.arms.model.opt.timestep), env.arms.substeps
        fitting = [k for k in range(1, substeps + 1) if substeps % k == 0 and k * timestep <= LONGEST_CYCLE + 1e-9]
        self._in_cycle, self._in_period = max(fitting, default=1), substeps
        self.cycle = self._in_cycle * timestep  # s
        env.sensor_period = self.cycle
        self.reset({}, np.random.default_rng(0))

    def reset(self, parameters: Mapping[str, Array], rng: np.random.Generator) -> None:
        """Become another robot, at the start of the task and at rest.

        Args:
            parameters: (1,) or (1, n) by name, see `skillcli.config.randomization`.
            rng: of noise and disturbances.
        """
        self._env.randomize(parameters, [rng])
        self._env.arms.release()
        self._env.reset(np.zeros(1, dtype=np.int64), np.full(1, NO_SKILL))
        self._offset = np.broadcast_to(parameters.get("joint_offset", 0.0), (1, self._env.joints))[0]  # rad, of encoders
        self._substep, self._due = 0, list[tuple[int, Array]]()  # commands and when they take effect, in physics steps

    def command(self, target: Array) -> None:
        """Take a target (J,) rad, as the encoders show it."""
        late = None if self._env.disturbance is None else self._env.disturbance.latency()
        when = self._substep + (0 if late is None else int(late[0]))
        self._due.append((when, target - self._offset))

    def hold(self) -> None:
        """Stay where it is: forget what was told, and make the present angles the target."""
        self._due.clear()
        self._env.arms.commanded[0] = self._env.arms.joint_position[0]

    def advance(self) -> None:
        """Let one cycle pass."""
        arms = self._env.arms
        for substep in range(self._in_cycle):
            self._begin(self._substep)
            ready = [target for when, target in self._due if when <= self._substep]
            if ready:
                arms.commanded[0] = ready[-1]
                self._due = [entry for entry in self._due if entry[0] > self._substep]
            self._substep += 1
            if substep + 1 < self._in_cycle:
                arms.coast(1)
            else:
                self._env.coast(1)

    def _begin(self, substep: int) -> None:
        """Draw external forces at the beginning of every control period."""
        disturbance = self._env.disturbance
        if disturbance is None or substep % self._in_period:
            return
        forces = disturbance.forces()
        if forces is not None:
            self._env.arms.apply_external_force(*forces)

    def read(self) -> tuple[Array, Array, Array | None]:
        """Return joint angles (J,) rad, speeds (J,) rad/s, and the pose (7,) of the object or None, as sensors show them."""
        position, pose = self._env.measure()
        return position[0], self._env.arms.joint_velocity[0].copy(), None if pose is None else pose[0]

    def diverged(self) -> bool:
        """Return whether the simulation is unstable."""
        return bool(self._env.arms.unstable()[0])
