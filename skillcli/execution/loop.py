"""The real-time loop: an arm behind a driver, as an environment whose steps last as long as they really do.

In one step: filter the action, send the target, wait for the next tick, read. On the way to the tick readings are judged
too, so that whatever breaks or stops coming is noticed within one control period.

What the rest of skill does with simulations it can so do with an arm: `evaluation.rollouts` plays plans on it and records them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from skillcli.execution.clock import Ticks, Watchdog
from skillcli.execution.driver import Driver, DriverError, JointState, ObjectPose, ObjectSource
from skillcli.execution.episode_log import EpisodeLog
from skillcli.execution.filter import SafetyFilter, Stop
from skillcli.execution.observed import ObservedArm
from skillcli.simulation.environment import StateEstimate, Step
from skillcli.trajectories import Array

FIRST_READING = 2.0  # s, within which a new reading must come before an episode
SETTLE = 0.001  # s after a new reading, at which ticks begin: later ones then find one that is as new
LOOKS = (0.25, 0.5, 0.75)  # shares of the time between two ticks after which readings are judged too
OLD_OBJECT = 0.3  # s of the arm's time: cameras are slower than encoders


class Arm:
    """An arm in its loop; once it has stopped it takes no more targets.

    Args:
        driver: connected.
        observed: the task's simulation, which is put where the arm is.
        guard: what every target has to pass.
        period: control period, s of the arm's time.
        watchdog: holds the arm when the loop hangs.
        speed: how many of the arm's seconds pass in a second.
        share: of every action that is carried out: below one the arm is slower.
        stop_asked: whether somebody has asked to stop.
        dry: whether targets are computed, but not sent.
    """

    num_envs = 1

    def __init__(
        self,
        driver: Driver,
        observed: ObservedArm,
        guard: SafetyFilter,
        period: float,
        watchdog: Watchdog,
        speed: float = 1.0,
        share: float = 1.0,
        stop_asked: Callable[[], bool] = lambda: False,
        dry: bool = False,
    ) -> None:
        self._driver, self._observed, self._guard, self._watchdog = driver, observed, guard, watchdog
        self._env, self._speed, self._share, self._stop_asked, self._dry = observed.env, speed, share, stop_asked, dry
        self.control_period, self.tolerance, self.joints = period, observed.env.tolerance, observed.env.joints
        self.desired_goal = observed.env.desired_goal
        self.applied = np.zeros((1, observed.env.joints))
        self.unstable = np.zeros(1, dtype=bool)
        self.ticks = Ticks(period / speed)
        self.log = EpisodeLog()
        self.stopped: Stop | None = None
        self.stopped_at = 0.0  # s, on the clock of `time.monotonic`

    def begin(self) -> None:
        """Begin an episode: wait for a new reading, from which ticks count, and start from there.

        Raises:
            DriverError: no new reading comes, or the connection is lost.
        """
        self.log = EpisodeLog()
        reading = fresh_reading(self._driver)
        time.sleep(SETTLE)
        self.ticks.begin()
        self._watchdog.expect(self.ticks.tick)
        self._guard.begin(reading)
        self.log.read(reading)
        self._reading = reading
        self._observed.begin(reading, self._guard.target, self._object())

    def observe(self) -> Array:
        """See `RecordedEnvironment`."""
        return self._env.observe()

    def achieved_goal(self) -> Array:
        """See `RecordedEnvironment`."""
        return self._env.achieved_goal()

    def violations(self) -> Array:
        """See `RecordedEnvironment`."""
        return self._env.violations()

    def recorded_state(self) -> dict[str, Array]:
        """See `RecordedEnvironment`."""
        return {name: values.copy() for name, values in self._env.recorded_state().items()}

    def estimate_state(self) -> StateEstimate:
        """Estimate the state from the readings of the last control steps."""
        return self._env.estimate_state()

    def step(self, action: Array) -> Step:
        """Carry out an action (1, J) in units of the action limit; returns at the next tick with what is measured then."""
        limit = self._env.arms.action_limit
        self.go(self._guard.target + self._share * np.clip(limit * action[0], -limit, limit))
        failed = self._env.failed()
        reward = self._env.reward()
        return Step(self.observe(), reward, failed, np.zeros(1, dtype=bool), {})

    def go(self, wanted: Array) -> None:
        """Send the target that the filter makes of a wanted one (J,) rad, wait for the next tick, and read."""
        before = self._guard.target.copy()
        if self.stopped is None and self._stop_asked():
            self.stop(Stop("interrupted", "somebody asked to stop"))
        if self.stopped is not None:
            self.applied = np.zeros_like(self.applied)
            self.log.stepped(self.ticks.tick, None, before, before, ())
            self.log.read(self._reading)
            return
        passed = self._guard.limit(wanted, self._reading.position)
        self._send(passed.target)
        self.applied = (passed.target - before)[None]
        self.log.stepped(self.ticks.tick, time.monotonic(), wanted, passed.target, passed.why)
        self._watchdog.rest()
        for share in LOOKS:
            self.ticks.wait_share(share)
            self._watchdog.expect(time.monotonic())
            self._look(between=True)
            self._watchdog.rest()
        if self.stopped is None:
            self.ticks.wait()
            self._watchdog.expect(self.ticks.tick)
            self._look()
        self.log.read(self._reading)

    def stop(self, why: Stop) -> None:
        """Hold the arm, for good."""
        if self.stopped is None:
            self._driver.hold()
            self.stopped, self.stopped_at = why, time.monotonic()
            self._watchdog.rest()

    @property
    def position(self) -> Array:
        """Return the measured joint angles, (J,) rad."""
        return self._reading.position

    @property
    def target(self) -> Array:
        """Return the commanded joint angles, (J,) rad."""
        return self._guard.target

    def _send(self, target: Array) -> None:
        with self._watchdog.lock:
            if self._watchdog.fired:
                return  # the arm holds already; `_look` says why
            try:
                if not self._dry:
                    self._driver.command(target)
            except DriverError as error:
                self.stop(Stop("driver_lost", error.message))
        self.ticks.answered()

    def _look(self, between: bool = False) -> None:
        """Read, and stop if the reading is none to go on with; between two ticks it is only judged."""
        if self.stopped is not None:
            return
        try:
            reading, seen = self._driver.read(), self._object()
        except DriverError as error:
            self.stop(Stop("driver_lost", error.message))
            return
        now = time.monotonic()
        if self._watchdog.fired:
            self.stop(Stop("watchdog", f"the loop did not answer within {1000 * self._watchdog.patience:.0f} ms of its tick"))
            return
        stop = self._guard.judge(reading, now) or self._judge_object(seen, now)
        if stop is not None:
            self.stop(stop)
        elif not between:
            self._accept(reading, seen)

    def _object(self) -> ObjectPose | None:
        if not self._observed.has_object:
            return None
        assert isinstance(self._driver, ObjectSource), "checked before"
        return self._driver.object_pose()

    def _judge_object(self, seen: ObjectPose | None, now: float) -> Stop | None:
        if seen is None:
            return None
        if not np.isfinite(seen.pose).all():
            return Stop("not_finite", "the pose of the object is not finite")
        age = (now - seen.stamp) * self._speed
        if age > OLD_OBJECT:
            return Stop("stale_object", f"the object was last seen {1000 * age:.0f} ms ago")
        return None

    def _accept(self, reading: JointState, seen: ObjectPose | None) -> None:
        self._reading = reading
        self._observed.put(reading, self._guard.target, seen)


def fresh_reading(driver: Driver, within: float = FIRST_READING) -> JointState:
    """Wait for a reading that was taken after now.

    Raises:
        DriverError: none comes, it is not finite, or the connection is lost.
    """
    began = time.monotonic()
    while True:
        reading = driver.read()
        if reading.stamp > began and np.isfinite(reading.position).all():
            return reading
        if time.monotonic() - began > within:
            age = time.monotonic() - reading.stamp
            old = f"the newest is {age:.1f} s old" if math.isfinite(age) else "its stamp is not finite"
            raise DriverError(f"no new reading of the joints came within {within:g} s: {old}", "does the arm publish them?")
        time.sleep(0.0005)
