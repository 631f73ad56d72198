"""A take: one recording, from the start to where somebody ended it, in the format of all trajectories."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from skillcli import metrics
from skillcli.robots.robot import Robot
from skillcli.simulation.environment import Environment, Step
from skillcli.trajectories import Array, Trajectories

LONGEST = 600.0  # s: a forgotten recording ends here


@dataclass(frozen=True)
class Take:
    """A finished recording."""

    recording: Trajectories  # one episode
    goal: Array  # (1, T, 3) m, the goal in each control step
    knobs: Mapping[str, Array]  # (1, T) by name
    failed: bool
    robot: Robot | None  # that was simulated; None: that of the skills


class Recorder:
    """Collects the control steps of one take.

    Args:
        env: one simulation at its start.
        robot: see `Take`.
    """

    def __init__(self, env: Environment, robot: Robot | None) -> None:
        self._env, self._robot = env, robot
        self._moments = [self._moment()]
        self._rows: list[dict[str, Array]] = []
        self._knobs: list[dict[str, float]] = []
        self._failed = False

    @property
    def seconds(self) -> float:
        """Return how long it is so far, s."""
        return len(self._rows) * self._env.control_period

    def add(self, latent: Array, skill: int, step: Step, knobs: Mapping[str, float]) -> None:
        """Add the control step that was just made; one that failed keeps the state before, as everywhere."""
        env, failed = self._env, bool(step.terminated[0])
        self._failed |= failed
        self._moments.append(self._moments[-1] if failed else self._moment())
        self._knobs.append(dict(knobs))
        self._rows.append({
            "latent": latent[None].astype(np.float32),
            "skill": np.array([skill], dtype=np.int32),
            "action": env.applied.astype(np.float32),
            "reward": np.asarray(step.reward, dtype=np.float32),
            "goal": env.desired_goal.copy(),
            "violated": env.violations(),
            "unstable": env.unstable & step.terminated,
        })  # fmt: skip

    def take(self) -> Take | None:
        """Return what was recorded; None if it is not a single control step."""
        if not self._rows:
            return None
        rows = {name: np.stack([row[name] for row in self._rows], axis=1) for name in self._rows[0]}
        state = {name: np.stack([each[name] for each in self._moments], axis=1) for name in self._moments[0]}
        violated, unstable, goal = rows.pop("violated"), np.asarray(rows.pop("unstable").any(axis=1)), rows.pop("goal")
        recording = Trajectories(
            time=np.arange(len(self._moments)) * self._env.control_period,
            target=goal[:, -1],
            success=np.array([not self._failed]),
            length=np.array([len(self._rows)]),
            unstable=unstable if unstable.any() else None,
            violations=violated.sum(axis=1, dtype=np.int32) if violated.shape[2] else None,
            violated=violated if violated.any() else None,
            **{name: values.astype(np.float32) for name, values in state.items()},
            **rows,
        )
        if np.array_equal(recording.usual_achieved_goal, recording.achieved_goal):
            recording = replace(recording, judged_position=None)
        near = metrics.final_distance(recording) <= self._env.tolerance
        knobs = {name: np.array([[each[name] for each in self._knobs]]) for name in self._knobs[0]}
        return Take(recording.with_success(recording.success & near), goal, knobs, self._failed, self._robot)

    def _moment(self) -> dict[str, Array]:
        return {**self._env.recorded_state(), "judged_position": self._env.achieved_goal()}
