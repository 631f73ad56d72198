"""What a log of an arm says: measured joint angles, and what was commanded, at the moments of the control steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillcli.errors import UsageError
from skillcli.trajectories import Array, Trajectories

MOST_ROWS = 200_000  # nearly three hours at 20 Hz
LONGEST_GAP = 1.5  # control periods: after a longer one a new episode begins
FARTHEST = 100.0  # rad or m: no arm turns or reaches so far
USUAL_PERIOD = 0.05  # s, where a log has no stamps
PERIODS = 1e-3, 1.0  # s, control periods that a simulation takes
FEWEST_STEPS = 20  # control steps in a log: one second at 20 Hz


@dataclass(frozen=True)
class Log:
    """Episodes of one arm, one after the other: T rows, one for each control step.

    A row holds what was measured, and the command that was sent then: it acts until the next row. The command of an episode's
    last row acts on nothing.

    Attributes:
        names: of the joints, in the order of the columns; empty if the log does not tell.
        stamps: (T,) s, increasing within an episode.
        position: (T, J) rad.
        sent: (T, J) rad, commanded joint angles, or increments.
        increments: whether `sent` are increments.
        starts: first row of each episode, increasing from 0.
        velocity: (T, J) rad/s, or None.
        gripper_position: (T, 3) m in the frame of the base, or None.
        notes: what was guessed while it was read, one line each.
    """

    names: tuple[str, ...]
    stamps: Array
    position: Array
    sent: Array
    increments: bool
    starts: tuple[int, ...] = (0,)
    velocity: Array | None = None
    gripper_position: Array | None = None
    notes: tuple[str, ...] = ()

    @property
    def joints(self) -> int:
        """Return the number of joints, J."""
        return int(self.position.shape[1])

    @property
    def episodes(self) -> list[slice]:
        """Return the rows of each episode."""
        ends = (*self.starts[1:], len(self.stamps))
        return [slice(first, end) for first, end in zip(self.starts, ends, strict=True)]

    @property
    def control_steps(self) -> int:
        """Count the control steps: pairs of rows of one episode."""
        return len(self.stamps) - len(self.starts)

    @property
    def period(self) -> float:
        """Return the control period, s: the median time between two rows of an episode, to a tenth of a millisecond."""
        apart = np.concatenate([np.diff(self.stamps[rows]) for rows in self.episodes])
        return round(float(np.median(apart)), 4)

    @property
    def speed(self) -> Array:
        """Return the joint speeds, (T, J) rad/s: measured, or from the last two steps; nothing later than each row is used."""
        if self.velocity is not None:
            return self.velocity
        speed = np.zeros_like(self.position)
        for rows in self.episodes:
            angles, stamps = self.position[rows], self.stamps[rows]
            back = np.maximum(np.arange(len(angles)) - 2, 0)
            apart = np.maximum(stamps - stamps[back], 1e-9)
            speed[rows] = (angles - angles[back]) / apart[:, None]
        return speed


def checked(log: Log, what: str) -> Log:
    """Refuse a log that cannot be; begin new episodes where rows are missing, and leave out episodes of less than two rows.

    Args:
        log: as read.
        what: it is called in errors, such as the name of its file.

    Raises:
        UsageError: shapes do not fit, a number is not finite or absurd, stamps do not increase, or it is too short or long.
    """
    rows = len(log.stamps)
    if rows < FEWEST_STEPS:
        raise UsageError(
            f"{what} has {rows} rows, expected at least {FEWEST_STEPS} control steps", "record some seconds of motion"
        )
    if rows > MOST_ROWS:
        raise UsageError(f"{what} has {rows} rows, at most {MOST_ROWS} are read", "cut it into several logs")
    wanted = {"position": (rows, log.joints), "sent": (rows, log.joints), "velocity": (rows, log.joints)}
    for name, shape in {**wanted, "gripper_position": (rows, 3), "stamps": (rows,)}.items():
        values = getattr(log, name)
        if values is None:
            continue
        if values.shape != shape:
            raise UsageError(f"{what}: {name} has the shape {values.shape}, expected {shape}", "one row for each control step")
        wrong = np.flatnonzero(~np.isfinite(values.reshape(rows, -1)).all(axis=1))
        if len(wrong):
            raise UsageError(f"{what}: {name} is not a finite number in row {wrong[0] + 1}", "leave out rows without a reading")
        far = np.flatnonzero(np.abs(values.reshape(rows, -1)).max(axis=1, initial=0.0) > FARTHEST)
        if name != "stamps" and len(far):
            raise UsageError(
                f"{what}: {name} is {np.abs(values[far[0]]).max():g} in row {far[0] + 1}, at most {FARTHEST:g} is believed",
                "angles are in rad, positions in m",
            )
    for episode in log.episodes:
        back = np.flatnonzero(np.diff(log.stamps[episode]) <= 0)
        if len(back):
            row = episode.start + int(back[0]) + 2
            raise UsageError(
                f"{what}: the stamp of row {row} is not later than the one before", "sort the rows by their stamps"
            )
    if log.control_steps > 0 and not PERIODS[0] <= log.period <= PERIODS[1]:
        said = f"{what}: the control period is {log.period:g} s, expected {PERIODS[0]:g} to {PERIODS[1]:g} s"
        raise UsageError(said, "stamps are in s")
    parted = _parted(log)
    if parted.control_steps < FEWEST_STEPS:
        raise UsageError(
            f"{what} has {max(0, parted.control_steps)} control steps, expected at least {FEWEST_STEPS}",
            "record some seconds of motion",
        )
    return parted


def _parted(log: Log) -> Log:
    """Return the log with new episodes after gaps, and without episodes of one row."""
    if log.control_steps < 1:
        return log
    usual = log.period
    starts: list[int] = []
    for episode in log.episodes:
        gaps = np.flatnonzero(np.diff(log.stamps[episode]) > LONGEST_GAP * usual) + 1
        starts += [episode.start, *(episode.start + int(gap) for gap in gaps)]
    ends = [*starts[1:], len(log.stamps)]
    kept = [(first, end) for first, end in zip(starts, ends, strict=True) if end - first > 1]
    rows = np.concatenate([np.arange(*pair) for pair in kept] or [np.zeros(0, dtype=int)])
    lengths = [end - first for first, end in kept]
    extra = len(starts) - len(log.starts)
    said = (f"rows are missing at {extra} places: each is the start of a new episode",) if extra else ()
    return replace(
        log,
        stamps=log.stamps[rows],
        position=log.position[rows],
        sent=log.sent[rows],
        starts=tuple(int(first) for first in np.cumsum([0, *lengths[:-1]])),
        velocity=None if log.velocity is None else log.velocity[rows],
        gripper_position=None if log.gripper_position is None else log.gripper_position[rows],
        notes=(*log.notes, *said),
    )


def log_of_trajectories(
    trajectories: Trajectories, names: Sequence[str], what: str = "the recording", targets: Array | None = None
) -> Log:
    """Read the episodes of an artifact.

    Args:
        trajectories: E episodes.
        names: of the joints of the arm that it should be; a recording of another number of joints keeps none.
        what: it is called in errors.
        targets: (E, T, J) rad, the targets that were sent; without them they are added up from the start, since the actions
            of an artifact are what the targets moved by.

    Raises:
        UsageError: it is not of an arm, or of another one.
    """
    angles = trajectories.joint_position
    if angles is None or trajectories.action.shape[2] != angles.shape[2]:
        raise UsageError(f"{what} holds no joint angles with commands", "identify from a reach or push on an arm")
    parts = []
    for episode, length in enumerate(np.asarray(trajectories.length).astype(int)):
        position = np.asarray(angles[episode, : length + 1], dtype=float)
        if targets is None:
            sent = position[0] + np.cumsum(trajectories.action[episode, :length].astype(float), axis=0)
        else:
            sent = np.asarray(targets[episode, :length], dtype=float)
        sent = np.concatenate([sent, sent[-1:] if length else position[:1]])
        gripper = trajectories.gripper_position
        place = np.zeros((length + 1, 0)) if gripper is None else np.asarray(gripper[episode, : length + 1], dtype=float)
        parts.append((np.asarray(trajectories.time[: length + 1], dtype=float), position, sent, place))
    stamps, position, sent, place = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    log = Log(
        names=tuple(names) if len(names) == position.shape[1] else (),
        stamps=stamps,
        position=position,
        sent=sent,
        increments=False,
        starts=tuple(int(first) for first in np.cumsum([0, *(len(part[0]) for part in parts[:-1])])),
        gripper_position=place if place.shape[1] else None,
    )
    return checked(log, what)
