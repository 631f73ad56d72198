"""The clock of the loop: ticks at the control rate, how late each was answered, and a watchdog that holds the arm."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

DEADLINE = 0.5  # control periods after its tick, by which a target must have been sent
PATIENCE = 0.05  # s, that the watchdog waits at least: an operating system may put a process aside for so long


class Ticks:
    """Ticks at the control rate, on the clock of `time.monotonic`: a jump of the clock on the wall does not matter.

    Args:
        period: between two ticks, s.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self.tick = 0.0  # s, the present tick
        self.late: list[float] = []  # s, from each tick to when its target was sent

    def begin(self) -> None:
        """Let the first tick be now."""
        self.tick = time.monotonic()

    def answered(self) -> None:
        """Note that the target of the present tick is sent."""
        self.late.append(time.monotonic() - self.tick)

    def wait_share(self, share: float) -> None:
        """Wait until a share of the time between this tick and the next has passed."""
        time.sleep(max(0.0, self.tick + share * self.period - time.monotonic()))

    def wait(self) -> None:
        """Wait for the next tick; ticks that are over by now are left out, not made up for."""
        following, now = self.tick + self.period, time.monotonic()
        if now < following:
            time.sleep(following - now)
        else:
            following += self.period * int((now - following) / self.period)
        self.tick = following

    def missed(self) -> int:
        """Count the ticks that were answered after their deadline."""
        return sum(late > DEADLINE * self.period for late in self.late)


class Watchdog:
    """Holds the arm if the loop does not come back in time, wherever it hangs.

    Args:
        hold: what to do then, from another thread.
        patience: s after a tick.
    """

    def __init__(self, hold: Callable[[], None], patience: float) -> None:
        self._hold, self.patience = hold, max(patience, PATIENCE)
        self._due = float("inf")  # s, on the clock of `time.monotonic`
        self._woken, self._ended = threading.Event(), False
        self.fired = False
        self.lock = threading.Lock()  # held while a target is sent, so that none follows the hold
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def __enter__(self) -> Watchdog:
        """Begin to watch."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop watching."""
        self._ended = True
        self._woken.set()
        self._thread.join()

    def expect(self, tick: float) -> None:
        """Expect the answer to a tick, s."""
        asleep = self._due == float("inf")
        self._due = tick + self.patience
        if asleep:
            self._woken.set()

    def rest(self) -> None:
        """Expect nothing for now."""
        self._due = float("inf")

    def _watch(self) -> None:
        while not self._ended:
            left = self._due - time.monotonic()
            if left <= 0:
                self.rest()
                self.fired = True
                taken = self.lock.acquire(timeout=0.005)  # who hangs while sending keeps it: hold all the same
                self._hold()
                if taken:
                    self.lock.release()
                continue
            self._woken.wait(None if left == float("inf") else left)
            self._woken.clear()


@contextmanager
def urgent() -> Iterator[None]:
    """Let this thread come before others inside the block, where the system allows it, as for every controller of an arm.

    It takes a few hundredths of a core: it mostly waits.
    """
    if not hasattr(os, "sched_setscheduler"):
        yield
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(OSError):  # it is a privilege
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    try:
        yield
    finally:
        with suppress(OSError):
            os.sched_setscheduler(0, *before)
