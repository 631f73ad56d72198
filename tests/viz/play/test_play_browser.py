"""The page in Debian's Chromium: a slider, a skill, a click and a drag on the pad, a goal that is dragged and planned to."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_play_loop import eventually, served

from skillcli.evaluation.library import Library
from skillcli.viz.play import loop
from skillcli.viz.play.session import PlaySession

pytest.importorskip("viser")
sync_api = pytest.importorskip("playwright.sync_api")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium"),
]
# Without a GPU, and asking nobody for updates.
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
PATIENCE = 240.0  # s: software draws slowly where other tests run


class Page:
    """A browser on a session, and where things of the scene are on its screen."""

    def __init__(self, page: Any, view: Any) -> None:
        self.page, self.view = page, view

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).first.click(force=True, no_wait_after=True)

    def place(self, point: Any) -> tuple[float, float]:
        """Where a point (3,) m of the scene is, in pixels of the page."""
        (client,) = self.view._server.get_clients().values()
        camera, box = client.camera, self.page.locator("canvas").first.bounding_box()
        w, x, y, z = camera.wxyz
        turn = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip
        right, down, ahead = (np.asarray(point) - camera.position) @ turn
        focal = box["height"] / 2 / np.tan(camera.fov / 2)
        return box["x"] + box["width"] / 2 + focal * right / ahead, box["y"] + box["height"] / 2 + focal * down / ahead

    def drag(self, start: Any, end: Any) -> None:
        mouse, (first, last) = self.page.mouse, (self.place(start), self.place(end))
        mouse.move(*first)
        self.page.wait_for_timeout(500)
        mouse.down()
        for share in (0.25, 0.5, 0.75, 1.0):
            mouse.move(*(np.array(first) + share * (np.array(last) - np.array(first))))
            self.page.wait_for_timeout(200)
        mouse.up()


@pytest.fixture
def page(
    reach: Library, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[tuple[PlaySession, loop.Rate, Page, list[str], list[Any]]]:
    from skillcli.viz.play import serve

    views: list[Any] = []
    pads: list[Any] = []

    class SeenView(serve.View):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            views.append(self)

    class SeenPad(serve.Pad):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            pads.append(self)

    monkeypatch.setattr(serve, "View", SeenView)
    monkeypatch.setattr(serve, "Pad", SeenPad)
    session, rate, asked = PlaySession(reach), loop.Rate(), list[str]()
    with served(session, rate) as url, sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        opened = browser.new_page(viewport={"width": 860, "height": 560})
        opened.set_default_timeout(1000 * PATIENCE)
        opened.on("request", lambda request: asked.append(request.url))
        opened.on("websocket", lambda socket: asked.append(socket.url))
        opened.goto(url)
        opened.get_by_role("button", name="reset").wait_for()
        assert eventually(lambda: len(views[0]._server.get_clients()) == 1, PATIENCE)
        yield session, rate, Page(opened, views[0]), asked, pads
        opened.screenshot(path=tmp_path / "page.png")
        browser.close()


def on_pad(pad: Any, latent: Any) -> Any:
    """Where the first two dimensions of a latent are on the pad, (3,) m."""
    return pad.center + ((latent - pad._middle) * pad._scale) @ pad.axes[:2]


def test_what_is_pressed_moved_and_dragged_in_a_browser_happens(
    page: tuple[PlaySession, loop.Rate, Page, list[str], list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    session, _, browser, asked, (pad,) = page
    browser.press("2")
    assert eventually(lambda: session.status().skill == "2" and session.status().seconds > 0, PATIENCE)

    before = session.latent
    browser.page.get_by_role("slider").first.press("ArrowRight")
    assert eventually(lambda: session.latent[0] != before[0], PATIENCE)
    assert session.latent[1:].tolist() == before[1:].tolist() and session.status().skill == "latent"

    wanted = np.array([0.2, -0.3])
    browser.page.mouse.click(*browser.place(on_pad(pad, wanted)))
    assert eventually(lambda: bool(np.abs(session.latent[:2] - wanted).max() < 0.1), PATIENCE), session.latent

    held, third, end = list[Any](), session.latent[2], np.array([-0.6, 0.5])
    hold = session.hold_latent
    monkeypatch.setattr(session, "hold_latent", lambda latent: (held.append(latent.copy()), hold(latent)))
    browser.drag(on_pad(pad, np.array([0.6, -0.4])), on_pad(pad, end))
    assert eventually(lambda: bool(np.abs(session.latent[:2] - end).max() < 0.1), PATIENCE), session.latent
    on_the_way = [latent for latent in held if np.abs(latent[:2] - [0.0, 0.05]).max() < 0.4]
    assert on_the_way, "the arm follows while the button is down"
    assert all(latent[2] == third for latent in held), "the third dimension stays"

    browser.press("reset")
    assert eventually(lambda: session.status().seconds == 0, PATIENCE)
    goal, arm = session.goal, 0.6 * browser.view.extent / 7
    along = np.array([0.0, -1.0, 0.0])
    for _ in range(3):  # a browser without a graphics card draws late: another handle may still be under the pointer
        browser.drag(goal + arm * np.abs(along), goal + arm * np.abs(along) + 0.15 * along)
        assert eventually(lambda: bool(np.abs(session.goal - goal).max() > 0.05), 20), session.goal
        if np.abs((session.goal - goal)[[0, 2]]).max() < 1e-3:
            break
        session.set_goal(goal)
    assert np.abs((session.goal - goal)[[0, 2]]).max() < 1e-3, "along one arrow"

    browser.press("plan and play")
    assert eventually(lambda: session.status().seconds > 0 and not session.status().running, PATIENCE), session.status()
    assert session.status().success, session.status()
    told = browser.page.get_by_text("reached", exact=True)
    told.wait_for()
    own = {f"{scheme}://127.0.0.1" for scheme in ("http", "ws", "blob:http")}
    strangers = [url for url in asked if url.rpartition(":")[0] not in own and not url.startswith(tuple(own))]
    assert asked and not strangers, "everything comes from this machine"


def test_a_killed_browser_leaves_the_others_and_the_arm(
    page: tuple[PlaySession, loop.Rate, Page, list[str], list[Any]], tmp_path: Path
) -> None:
    session, _, browser, _, _ = page
    words = [CHROMIUM, "--headless", *FLAGS, "--remote-debugging-port=0", f"--user-data-dir={tmp_path}", browser.page.url]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as second:
        try:
            assert eventually(lambda: len(browser.view._server.get_clients()) == 2, PATIENCE)
            browser.press("3")
            assert eventually(lambda: session.status().skill == "3" and session.status().seconds > 0, PATIENCE)
        finally:
            second.kill()
    assert eventually(lambda: len(browser.view._server.get_clients()) == 1, PATIENCE)
    seconds = session.status().seconds
    browser.press("4")
    assert eventually(lambda: session.status().skill == "4", PATIENCE)
    assert eventually(lambda: session.status().seconds > seconds, 10), "the arm goes on"
