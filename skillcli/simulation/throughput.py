"""Speed of the bare engine, with which the speed of training is compared."""

from __future__ import annotations

import time

import numpy as np

from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.arms import Stretch
from skillcli.simulation.environment import Environment

STEPS = 10  # control steps per measurement: a tenth of a second at the default size


class BareEngine:
    """The engine of an environment without policy, observation and reward: it does some steps of a rollout again.

    Same model, simulations, threads, states and commands: arms that move and touch cost more than arms at rest. Measurements
    are spread over a run, so that a machine that slows down affects both sides of the ratio.
    """

    def __init__(self, env: Environment) -> None:
        self._arms = env.arms if isinstance(env, ArmEnvironment) else None  # None: no engine to measure
        self._longest = max(0, env.horizon - STEPS)
        self._rng = np.random.default_rng(0)
        self.control_steps, self.seconds = 0, 0.0

    def watch(self) -> None:
        """Choose steps of the next episode, at a random moment, for `measure`."""
        if self._arms is not None:
            self._arms.noted = Stretch(int(self._rng.integers(self._longest + 1)), STEPS)

    def measure(self) -> None:
        """Do the chosen steps again, and restore the states."""
        if self._arms is None or (chosen := self._arms.noted) is None or chosen.sim_states is None:
            return
        arms, everyone = self._arms, np.arange(self._arms.num_envs)
        arms.noted = None
        afterwards = arms.save(everyone)
        arms.restore(everyone, chosen.sim_states)
        commanded = arms.commanded
        started = time.perf_counter()
        for commands in chosen.commands:
            commanded[:] = commands
            arms.batch.step(nstep=arms.substeps)
        self.seconds += time.perf_counter() - started
        self.control_steps += len(chosen.commands) * arms.num_envs
        arms.restore(everyone, afterwards)

    @property
    def rate(self) -> float | None:
        """Control steps per second, None without a measurement."""
        return self.control_steps / self.seconds if self.control_steps else None
