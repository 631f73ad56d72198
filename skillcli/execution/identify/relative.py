"""Logs whose angles count from an unknown start: find where the arm began from the measured gripper positions.

Some controllers report how far joints have turned since they were switched on. Predicting such an arm needs its real angles.
With gripper positions beside them the start is what makes the kinematics of the robot file meet them, together with where the
tool is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from skillcli.errors import UsageError
from skillcli.execution.identify.kinematics import TOOL_SPREAD
from skillcli.execution.log import Log
from skillcli.robots.robot import Robot
from skillcli.simulation.replay import ForwardKinematics
from skillcli.trajectories import Array

ZERO = 0.01  # rad: an arm whose joints all begin nearer to zero is likely to count from its start
NOISE = 0.005  # m, of each coordinate of a measured position, as far as is known before
START_SPREAD = 1.0  # rad, of the start about the robot file's own, before anything is measured
GUESSES, FITTED = 600, 16  # starts that are tried, and the best of them, from which fits begin
EVALUATIONS = 30  # of each fit, at most
EDGE = 1e-3  # of a joint's range: a search begins no nearer to its end
FEW, MANY = 40, 200  # poses that the search and the last fit take
LARGEST_MISS = 0.03  # m, median: beyond, the positions are not those of this arm
LEAST_TURN = 0.1  # rad, that the joints must turn together
HINT = "leave --relative out if the angles are the arm's own"


def counts_from_start(log: Log, robot: Robot) -> bool:
    """Return whether every episode begins with all joints at zero, where this arm does not usually begin."""
    firsts = log.position[list(log.starts)]
    return bool((np.abs(firsts) < ZERO).all() and np.abs(robot.home).max() > 10 * ZERO)


def from_start(log: Log, robot: Robot) -> Log:
    """Return the log with the arm's own angles.

    The gripper positions are used up: what they said of zeros and tool went into the start.

    Args:
        log: its angles count from where each episode began; of commanded angles the same holds.
        robot: the arm.

    Raises:
        UsageError: there are no gripper positions, the joints hardly turn, or no start meets the positions.
    """
    if log.gripper_position is None:
        raise UsageError("--relative: the log has no gripper positions, so where the arm began is unknown", HINT)
    search = _Search(robot, log)
    position, sent, missed = log.position.copy(), log.sent.copy(), []
    for rows in log.episodes:
        start, off = search.start(rows)
        position[rows] += start
        if not log.increments:
            sent[rows] += start
        missed.append(off)
    miss = float(np.median(np.concatenate(missed)))
    if miss > LARGEST_MISS:
        raise UsageError(
            "--relative: no start of this arm meets the gripper positions; "
            f"the best one misses them by {100 * miss:.1f} cm in the median",
            "are they in the frame of the base, and the joints in the order of the robot file?",
        )
    said = (
        "the angles count from an unknown start, which was found from the gripper positions; "
        f"it meets them to {1000 * miss:.1f} mm in the median; zeros and tool are not fitted"
    )
    return replace(log, position=position, sent=sent, gripper_position=None, notes=(*log.notes, said))


class _Search:
    """Finds starts; the tool is that of the first episode in all."""

    def __init__(self, robot: Robot, log: Log) -> None:
        self._kinematics, self._log = ForwardKinematics(robot), log
        self._home = np.array(robot.home)
        ranges = [robot.model.joint(name).range for name in robot.names.joints]
        self._low, self._high = (np.array(ends) for ends in zip(*ranges, strict=True))
        self._tool: Array | None = None  # (3,) m, in the axes of the gripper

    def start(self, rows: slice) -> tuple[Array, Array]:
        """Return the start of an episode (J,) rad, and how far it is off each position, (T,) m."""
        turned = self._log.position[rows]
        if np.ptp(turned, axis=0).sum() < LEAST_TURN:
            raise UsageError("--relative: the joints hardly turn, so the gripper does not tell where they began", HINT)
        low, high = self._low - turned.min(axis=0), self._high - turned.max(axis=0)  # in range all the time
        if (low >= high).any():
            raise UsageError("--relative: a joint turns farther than its range in the robot file allows", HINT)
        tried = [self._home, *np.random.default_rng(0).uniform(low, high, (GUESSES - 1, len(low)))]
        guesses = sorted(tried, key=lambda guess: self._missed(rows, guess))[:FITTED]
        tries = [self._fitted(rows, guess, (low, high), FEW, EVALUATIONS) for guess in guesses]
        best = min(tries, key=lambda found: float(found.cost))
        found = self._fitted(rows, best.x[: len(self._home)], (low, high), MANY, EVALUATIONS, best.x[len(self._home) :])
        start, tool = found.x[: len(self._home)], self._tool_of(found.x)
        if self._tool is None:
            self._tool = tool
        return start, np.linalg.norm(self._off(rows, start, tool, MANY), axis=1)

    def _missed(self, rows: slice, start: Array) -> float:
        """Return how far a start is off the positions with the tool that suits it best by linear least squares, m."""
        chosen = _spread(rows, FEW)
        place, axes = self._kinematics.frames(self._log.position[chosen] + start)
        assert self._log.gripper_position is not None, "checked before"
        to_go = (self._log.gripper_position[chosen] - place).ravel()
        turned = axes.reshape(-1, 3)
        loose = np.concatenate([turned, NOISE / TOOL_SPREAD * np.eye(3)])
        tool = np.linalg.lstsq(loose, np.concatenate([to_go, np.zeros(3)]), rcond=None)[0]
        return float(np.abs(turned @ tool - to_go).mean())

    def _tool_of(self, x: Array) -> Array:
        return x[len(self._home) :] if self._tool is None else self._tool

    def _fitted(
        self, rows: slice, guess: Array, ends: tuple[Array, Array], poses: int, evaluations: int, tool: Array | None = None
    ) -> OptimizeResult:
        def errors(x: Array) -> Array:
            start, tool = x[: len(self._home)], self._tool_of(x)
            off = self._off(rows, start, tool, poses).ravel() / NOISE
            return np.concatenate([off, (start - self._home) / START_SPREAD, x[len(self._home) :] / TOOL_SPREAD])

        loose = np.zeros(3 if self._tool is None else 0) if tool is None else tool
        inside = EDGE * (ends[1] - ends[0])
        x = np.concatenate([np.clip(guess, ends[0] + inside, ends[1] - inside), loose])
        bounds = [np.concatenate([end, np.full(len(loose), far)]) for end, far in zip(ends, (-np.inf, np.inf), strict=True)]
        # one position that is far off, as while somebody stands before the camera, must not decide
        return least_squares(errors, x, bounds=bounds, loss="soft_l1", max_nfev=evaluations)

    def _off(self, rows: slice, start: Array, tool: Array, poses: int) -> Array:
        """Return where the gripper would be less where it was measured, (P, 3) m."""
        chosen = _spread(rows, poses)
        place, axes = self._kinematics.frames(self._log.position[chosen] + start)
        assert self._log.gripper_position is not None, "checked before"
        off: Array = place + axes @ tool - self._log.gripper_position[chosen]
        return off


def _spread(rows: slice, poses: int) -> Array:
    """Return that many rows at most, evenly spread over an episode."""
    return np.unique(np.linspace(rows.start, rows.stop - 1, poses).round().astype(int))
