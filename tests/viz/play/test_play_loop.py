"""The clock of a play, and what a server of viser does to it: lost, slow and several browsers."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import TINY_SET, made

from skillcli.errors import SkillError
from skillcli.evaluation.library import Library, open_library
from skillcli.store import ArtifactId, Store
from skillcli.viz.play import loop
from skillcli.viz.play.session import PlaySession
from skillcli.viz.play.state import Pose

pytestmark = pytest.mark.real_time


def test_every_control_step_has_its_frames_and_lasts_its_period(point: Library) -> None:
    session, rate, poses = PlaySession(point), loop.Rate(), list[Pose]()
    session.hold_skill(0)
    began = time.monotonic()
    loop.run(session, poses.append, lambda: len(poses) >= 40, rate)
    assert session.status().seconds == pytest.approx(1.0)
    assert time.monotonic() - began >= 0.95, "it does not hurry"
    lengths = np.linalg.norm(np.diff([pose.achieved_goal for pose in poses], axis=0), axis=1)
    assert (lengths[3:9] > 0).all(), "frames lie between control steps"


def test_a_busy_machine_makes_the_clock_late_and_not_fast(point: Library) -> None:
    session, rate = PlaySession(point), loop.Rate()
    session.hold_skill(0)
    frames = 0

    def draw(_: Pose) -> None:
        nonlocal frames
        frames += 1
        if frames == 4:
            time.sleep(0.5)

    began = time.monotonic()
    loop.run(session, draw, lambda: frames >= 12, rate)
    assert time.monotonic() - began >= 0.5 + 8 * 0.025 and rate.skipped >= 1


@contextlib.contextmanager
def served(session: PlaySession, rate: loop.Rate) -> Iterator[str]:
    """Serve in a thread; yields the address."""
    pytest.importorskip("viser")
    from skillcli.viz.play.serve import serve

    ready, stop, urls, failed = threading.Event(), threading.Event(), list[str](), list[BaseException]()

    def told(url: str) -> None:
        urls.append(url)
        ready.set()

    def work() -> None:
        try:
            map_places = session.library.goals, session.library.mean  # as of a library with a map
            serve(session, "test", None, map_places, told, stop.is_set, rate)
        except BaseException as error:
            failed.append(error)
            ready.set()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        assert ready.wait(60) and not failed, failed
        yield urls[0]
    finally:
        stop.set()
        thread.join(30)
    assert not thread.is_alive() and not failed, failed


def connected(url: str) -> Any:
    """A browser's connection, by hand."""
    import viser
    from websockets.sync.client import connect

    protocol = f"viser-v{viser.__version__}"
    return connect(url.replace("http", "ws"), subprotocols=[protocol], max_size=None, open_timeout=60)  # type: ignore[list-item]


def eventually(holds: Callable[[], bool], seconds: float = 30.0) -> bool:
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.05)
    return holds()


def test_lost_and_slow_browsers_keep_nobody_waiting(reach: Library) -> None:
    session, rate = PlaySession(reach), loop.Rate()
    with served(session, rate) as url:
        slow, lost, live = connected(url), connected(url), connected(url)
        assert len(live.recv(timeout=30)) > 0
        session.hold_skill(0)
        lost.socket.close()  # killed: no word of farewell
        frames, seconds = len(rate.ends) and rate.ends[-1], session.status().seconds
        received, end = 0, time.monotonic() + 3
        while time.monotonic() < end:  # `slow` reads nothing meanwhile
            with contextlib.suppress(TimeoutError):
                received += len(live.recv(timeout=0.5))
        assert session.status().seconds >= seconds + 0.5 and rate.ends[-1] > frames
        assert received > 1000, "the live one gets what moves"
        slow.socket.close()
        live.socket.close()
    assert not session.step(), "closed with its server"


def tell(browser: Any, message: Any) -> None:
    """Send a message of viser as its page does."""
    msgpack = pytest.importorskip("msgspec").msgpack
    browser.send(msgpack.encode({"type": type(message).__name__, **vars(message)}))


def test_drags_on_the_pad_and_of_the_goal_are_followed(reach: Library, monkeypatch: pytest.MonkeyPatch) -> None:
    messages = pytest.importorskip("viser._messages")
    from skillcli.viz.play import serve

    pads: list[serve.Pad] = []

    class SeenPad(serve.Pad):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            pads.append(self)

    monkeypatch.setattr(serve, "Pad", SeenPad)
    session = PlaySession(reach)
    third, eye = session.latent[2], np.array([1.5, -2.0, 1.2])
    with served(session, loop.Rate()) as url, connected(url) as browser:
        look = {"look_at": (0.5, 0.0, 0.2), "up_direction": (0.0, 0.0, 1.0), "image_height": 560, "image_width": 860}
        camera = {"wxyz": (1.0, 0.0, 0.0, 0.0), "position": tuple(eye.tolist()), "fov": 1.0, "near": 0.01, "far": 100.0, **look}
        tell(browser, messages.ViewerCameraMessage(**camera))
        (pad,) = pads
        for phase, wanted in (("start", [0.5, -0.4]), ("update", [0.1, 0.2]), ("update", [-0.3, 0.6]), ("end", [-0.3, 0.6])):
            place = np.array(pad.axes[:2].T @ ((np.array(wanted) - pad._middle) * pad._scale) + pad.center)
            pointer = tuple((eye + 0.5 * (place - eye)).tolist())  # the page tells a point on the ray, not on the board
            tell(
                browser,
                messages.SceneNodeDragMessage(
                    phase=phase, name="/pad/board", instance_index=None, start_position=pointer, start_screen_pos=(0.0, 0.0),
                    end_position=pointer, end_screen_pos=(0.0, 0.0), button="left", modifier=None,
                ),
            )  # fmt: skip
            assert eventually(lambda wanted=wanted: np.allclose(session.latent[:2], wanted, atol=1e-6)), session.latent  # type: ignore[misc]
        assert session.latent[2] == third and session.status().skill == "latent"
        for goal in ((0.55, 0.1, 0.2), (0.6, -0.1, 0.25)):
            tell(browser, messages.TransformControlsUpdateMessage(name="/goal", wxyz=(1.0, 0.0, 0.0, 0.0), position=goal))
            assert eventually(lambda goal=goal: np.allclose(session.goal, goal)), session.goal  # type: ignore[misc]
        browser.socket.close()


@pytest.mark.parametrize(("recipe", "joints"), [("reach-so101", 5), ("reach-ur5e", 6), ("reach-panda", 7)])
def test_two_browsers_share_an_arm_of_any_build(recipe: str, joints: int, tmp_path: Path) -> None:
    made("--store", tmp_path, "pretrain", recipe, "--name", "tiny", *TINY_SET)
    store = Store(tmp_path)
    session, rate = PlaySession(open_library(store, store.read(ArtifactId("tiny", "pretrain", 1)))), loop.Rate()
    with served(session, rate) as url, connected(url) as first, connected(url) as second:
        for browser in (first, second):
            assert len(browser.recv(timeout=30)) > 0
        session.hold_skill(1)
        assert eventually(lambda: session.status().seconds > 0.5)
        for browser in (first, second):
            received, end = 0, time.monotonic() + 10
            while received < 1000 and time.monotonic() < end:
                received += len(browser.recv(timeout=10))
            assert received >= 1000, "both get what moves"
        pose = session.pose()
        assert pose.joint_position is not None and pose.joint_position.shape == (joints,)
        for browser in (first, second):
            browser.socket.close()


def test_another_robot_takes_the_place_of_the_first_in_the_scene(reach: Library, tmp_path: Path) -> None:
    bundled = reach.world.robot.path
    file = tmp_path / "other.toml"
    file.write_text(bundled.read_text().replace('model = "', f'model = "{bundled.parent}/', 1))
    session, rate = PlaySession(reach), loop.Rate()
    with served(session, rate) as url:
        session.set_robot(str(file))
        drawn = rate.ends[-1] if rate.ends else 0.0
        assert eventually(lambda: len(rate.ends) > 0 and rate.ends[-1] > drawn + 0.2)
        session.hold_skill(2)
        with connected(url) as browser:  # a late one is told of everything that is there now
            assert len(browser.recv(timeout=30)) > 0
            assert eventually(lambda: session.status().seconds > 0.2)
            browser.socket.close()
    assert session.world.robot.name == "other"


def test_a_port_that_is_taken_is_named(point: Library) -> None:
    pytest.importorskip("viser")
    from skillcli.viz.play.serve import serve

    session = PlaySession(point)
    with served(session, loop.Rate()) as url:
        port = int(url.rpartition(":")[2])
        with pytest.raises(SkillError, match=f"port {port} is not free"):
            serve(PlaySession(point), "test", port, None, print, lambda: True, loop.Rate())
        with served(PlaySession(point), loop.Rate()) as other:
            assert other != url, "without a wish the next free one is taken"
