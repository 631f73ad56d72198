"""Speed of the bare engine, with which the speed of training is compared."""

from __future__ import annotations

import time

import numpy as np

from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.environment import Environment

STEPS = 10  # control steps per measurement: a tenth of a second at the default size


class BareEngine:
    """The engine of an environment without policy, observation and reward: same model, simulations, threads, substeps.

    Measurements are spread over a run, so that a machine that slows down affects both sides of the ratio.
    """

    def __init__(self, env: Environment) -> None:
        self._env = env
        self.control_steps, self.seconds = 0, 0.0

    def measure(self) -> None:
        """Step the engine from the environment's states with random commands, and restore the states."""
        if not isinstance(self._env, ArmEnvironment):  # no engine to measure
            return
        arms = self._env.arms
        everyone = np.arange(arms.num_envs)
        sim_states = arms.save(everyone)
        control = arms.batch.bind("ctrl")
        increments = np.random.default_rng(0).uniform(-arms.action_limit, arms.action_limit, (STEPS, *control.shape))
        started = time.perf_counter()
        for increment in increments:
            control += increment
            arms.batch.step(nstep=arms.substeps)
        self.seconds += time.perf_counter() - started
        self.control_steps += STEPS * arms.num_envs
        arms.restore(everyone, sim_states)

    @property
    def rate(self) -> float | None:
        """Control steps per second, None without a measurement."""
        return self.control_steps / self.seconds if self.control_steps else None
