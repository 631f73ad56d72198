"""The safety filter between a policy and an arm. Whatever is asked, what leaves it keeps every limit.

A target passes, is limited, or the arm is told to hold. Limits of range, speed and acceleration are kept together: a joint
may only be as fast as it can still brake before the end of its range, and a target is let through only if the arm could
brake from it without touching the table or itself. So there is always a way to slow down.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skillcli.execution.driver import JointState
from skillcli.robots.robot import Robot
from skillcli.simulation.arms import ArmBatch
from skillcli.simulation.foresight import ITSELF, TABLE
from skillcli.trajectories import Array

LIMITED = ("joint_range", "joint_speed", "joint_acceleration", "tracking", TABLE, ITSELF)
"""Why a target was changed, in the order of the columns that are stored."""

LATEST = 0.005  # s, by which a stamp may be ahead of our clock: that of the arm's reader ticks a little otherwise
OLDEST = 0.75  # control periods, age of a reading at which it says nothing of the present
MOVING = 0.2  # rad/s: an arm that was so fast does not stand still to the last bit soon after
SOON = 0.4  # control periods: within less, a coarse encoder may well show the same
ARRIVED = 0.005  # rad from its target, where an arm may well stand still
JUMPED = 2.0  # times the largest speed, and `JUMP` in addition: no joint moves so far between two readings
JUMP = 0.05  # rad
LOST = 1.5  # times the largest lead: an arm that far behind its target does not follow
_EXACT = 1e-9


class Stop(NamedTuple):
    """Why the arm has to hold."""

    reason: str  # one word, as it is stored
    message: str  # one line


@dataclass(frozen=True)
class Limits:
    """What a target may ask of J joints."""

    low: Array  # (J,) rad
    high: Array  # (J,) rad
    speed: Array  # (J,) rad/s
    acceleration: Array  # (J,) rad/s²
    lead: float  # rad, by which a target may be ahead of the joint

    @staticmethod
    def of(robot: Robot, arms: ArmBatch, period: float, share: float = 1.0) -> Limits:
        """Return the limits of an arm: those of its robot file, and where it has none those that its skills kept in training.

        Args:
            robot: the arm.
            arms: its simulation.
            period: control period, s.
            share: of speed and acceleration that are allowed.
        """
        low, high = arms.target_range
        trained = arms.action_limit / period  # rad/s
        speed = np.where(np.isfinite(robot.speed_limit), robot.speed_limit, trained)
        # a policy may turn round within a step: a motion at its full speed becomes one at full speed back
        acceleration = np.where(np.isfinite(robot.acceleration_limit), robot.acceleration_limit, 2 * trained / period)
        return Limits(low, high, share * speed, share * acceleration, ArmBatch.MAX_TRACKING_ERROR)


class Passed(NamedTuple):
    """What the filter lets through."""

    target: Array  # (J,) rad
    why: frozenset[str]  # of `LIMITED`, empty if it is what was asked


class SafetyFilter:
    """Filters the targets of one arm.

    Args:
        limits: of the arm.
        period: control period, s of the arm's time.
        touches: what the arm would touch at joint angles (J,) rad, "" for nothing.
        speed: how many of the arm's seconds pass in a second of the clock.
        patience: s of the clock, by which readings may be older.
    """

    def __init__(
        self, limits: Limits, period: float, touches: Callable[[Array], str], speed: float = 1.0, patience: float = 0.0
    ) -> None:
        self.limits, self._touches, self._speed, self._period = limits, touches, speed, period
        self._fastest = limits.speed * period  # (J,) rad per control step
        self._change = limits.acceleration * period**2  # (J,) rad per control step, from one step to the next
        # a simulated arm may be faster than real time, but the machine that simulates it is not
        self._oldest = OLDEST * period / min(speed, 1.0) + patience  # s of the clock
        self._before: JointState | None = None

    def begin(self, reading: JointState) -> None:
        """Begin with an arm at rest, whose target is where it is."""
        self.target: Array = reading.position.copy()
        self._step = np.zeros_like(self.target)  # rad, of the last target
        self._before = self._mark = reading  # the last one, and one some time before
        self._fast = 0.0  # rad/s, of the fastest joint before the mark

    def judge(self, reading: JointState, now: float) -> Stop | None:
        """Return why a reading is none to go on with, if it is so.

        Args:
            reading: the newest.
            now: on the clock of `time.monotonic`, s.
        """
        before, self._before = self._before, reading
        assert before is not None, "begin first"
        stop = self._untrusted(reading, before, now)
        since = (reading.stamp - self._mark.stamp) * self._speed
        if stop is None and since >= SOON * self._period:
            self._fast = float(np.abs(reading.position - self._mark.position).max()) / since
            self._mark = reading
        return stop

    def _untrusted(self, reading: JointState, before: JointState, now: float) -> Stop | None:
        if reading.names != before.names:
            return Stop("joint_names", f"the joints came as {_listed(before.names)} and now as {_listed(reading.names)}")
        if not (np.isfinite(reading.position).all() and np.isfinite(reading.velocity).all()):
            broken = ~(np.isfinite(reading.position) & np.isfinite(reading.velocity))
            return Stop("not_finite", f"the reading of {reading.names[int(np.argmax(broken))]} is not a finite number")
        since, age = reading.stamp - before.stamp, now - reading.stamp
        if since < 0 or age < -LATEST:
            told = f"{-since:.3g} s before the last one" if since < 0 else f"{-age:.3g} s in the future"
            return Stop("clock_jump", f"a reading is stamped {told}")
        if age > self._oldest:
            return Stop("stale_reading", f"no new reading came; the newest is {1000 * age:.0f} ms old")
        if self._stands_still(reading):
            return Stop("frozen_reading", "the angles of a moving arm are the same to the last digit")
        moved = np.abs(reading.position - before.position)
        farthest = JUMPED * self.limits.speed * max(since * self._speed, self._period) + JUMP
        if (moved > farthest).any():
            joint = int(np.argmax(moved - farthest))
            return Stop(
                "jumped_reading",
                f"{reading.names[joint]} is {moved[joint]:.2f} rad from where it was {1000 * since:.0f} ms before",
            )
        behind = np.abs(self.target - reading.position)
        if (behind > LOST * self.limits.lead).any():
            joint = int(np.argmax(behind))
            return Stop("not_following", f"{reading.names[joint]} is {behind[joint]:.2f} rad from where it was sent")
        return None

    def _stands_still(self, reading: JointState) -> bool:
        """Return whether an arm that moved, and is not where it was sent, is to the last bit where it was some time ago."""
        soon = (reading.stamp - self._mark.stamp) * self._speed < SOON * self._period
        if soon or self._fast < MOVING or (reading.position != self._mark.position).any():
            return False
        return bool(np.abs(self.target - reading.position).max() > ARRIVED)

    def limit(self, wanted: Array, measured: Array) -> Passed:
        """Return the target (J,) rad nearest to the wanted one that keeps every limit; the next one starts from it.

        Args:
            wanted: (J,) rad; one that is not finite counts as the present target.
            measured: (J,) rad.
        """
        wanted = np.where(np.isfinite(wanted), wanted, self.target)
        led = np.clip(wanted, measured - self.limits.lead, measured + self.limits.lead)
        why = {"tracking"} if _differ(led, wanted) else set()
        step = led - self.target
        up, down = self._room(self.limits.high - self.target), self._room(self.target - self.limits.low)
        for name, low, high in (
            ("joint_range", -down, up),
            ("joint_speed", -self._fastest, self._fastest),
            ("joint_acceleration", self._step - self._change, self._step + self._change),
        ):  # each narrows what the one before left; together they always leave a step, see `_room`
            kept = np.clip(step, low, high)
            why |= {name} if _differ(kept, step) else set()
            step = kept
        step = np.clip(step, np.maximum(-down, -self._fastest), np.minimum(up, self._fastest))
        if touched := self._would_touch(step):
            why.add(touched)
            step = np.sign(self._step) * np.maximum(np.abs(self._step) - self._change, 0.0)  # brake on the way found free
        self.target, self._step = self.target + step, step
        return Passed(self.target.copy(), frozenset(why))

    def _room(self, left: Array) -> Array:
        """Return the largest step towards the end of a range, (J,) rad, from which a joint can still brake before it.

        Of a step d, braking by c per step takes the way d + (d - c) + (d - 2c) + … <= d/2 + d²/2c + c/8.

        Args:
            left: (J,) rad, way to the end; negative beyond it.
        """
        left, change = np.maximum(left, 0.0), self._change
        room: Array = np.maximum(np.minimum(left, change), np.sqrt(2 * change * left) - change / 2)
        return room

    def _would_touch(self, step: Array) -> str:
        """Return what the arm would touch at the next target, or where it would come to rest if it then braked."""
        target, way = self.target + step, self._braking_way(step)
        return self._touches(target) or (self._touches(target + way) if way.any() else "")

    def _braking_way(self, step: Array) -> Array:
        """Return how far the targets still go after a step (J,) rad if each is `_change` shorter than the one before."""
        size = np.abs(step)
        count = np.floor(size / self._change)
        way: Array = np.sign(step) * (count * size - self._change * count * (count + 1) / 2)
        return way


def _differ(a: Array, b: Array) -> bool:
    return bool((np.abs(a - b) > _EXACT).any())


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names)
