"""One request to stop is taken at the next safe point, a second one at once; an echo of the first is no second one."""

from __future__ import annotations

import signal
import threading

import pytest

from skillcli import stopping
from skillcli.stopping import ECHO_SECONDS, Interrupt, StopRequest, answered, stoppable


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the clock shows."""
    now = [100.0]
    monkeypatch.setattr(stopping.time, "monotonic", lambda: now[0])
    return now


def test_the_first_signal_is_a_request(clock: list[float]) -> None:
    stop = StopRequest()
    assert not stop.requested
    stop(signal.SIGTERM, None)
    assert stop.requested


def test_a_second_ctrl_c_stops_at_once(clock: list[float]) -> None:
    stop = StopRequest()
    stop(signal.SIGINT, None)
    with pytest.raises(KeyboardInterrupt):
        stop(signal.SIGINT, None)


def test_the_echo_of_a_session_that_ends_is_not_a_second_request(clock: list[float]) -> None:
    stop = StopRequest()
    stop(signal.SIGHUP, None)
    clock[0] += ECHO_SECONDS - 0.1
    stop(signal.SIGTERM, None)
    clock[0] += 0.2
    with pytest.raises(KeyboardInterrupt):
        stop(signal.SIGTERM, None)


def test_a_signal_whose_exception_was_swallowed_is_the_first_request() -> None:
    interrupt = Interrupt()
    with answered(interrupt):
        with stoppable() as stop:
            assert not stop.requested
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)  # as other code catches it while it loads
        with stoppable() as stop:
            assert stop.requested
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)


def test_signals_are_answered_inside_the_block_only() -> None:
    before, heard = signal.getsignal(signal.SIGTERM), []
    with answered(lambda number, _: heard.append(number)):
        signal.raise_signal(signal.SIGTERM)
    assert heard == [signal.SIGTERM] and signal.getsignal(signal.SIGTERM) is before


def test_outside_the_main_thread_nothing_changes() -> None:
    before, inside = signal.getsignal(signal.SIGINT), []

    def work() -> None:
        with answered(lambda *_: None):
            inside.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert inside == [before]
