"""Serve a session to browsers on this machine."""

from __future__ import annotations

import contextlib
import io
import socket
import time
from collections.abc import Callable

import numpy as np
import viser

from skillcli.errors import SkillError
from skillcli.plaintext import line
from skillcli.trajectories import Array
from skillcli.viz.play import loop
from skillcli.viz.play.controls import Controls
from skillcli.viz.play.pad import Pad
from skillcli.viz.play.session import PlaySession
from skillcli.viz.play.state import Pose
from skillcli.viz.play.view import View

LOOPBACK = "127.0.0.1"
FIRST_PORT, PORTS = 8080, 100  # without a wish the first free one
REFRESH = 0.2  # s between two looks at what changes rarely


class _Local(viser.ViserServer):
    """A server that never asks another machine for a public address."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Do nothing: any browser could ask for it."""
        return None


def serve(
    session: PlaySession,
    title: str,
    port: int | None,
    map_places: tuple[Array, Array] | None,
    ready: Callable[[str], None],
    stop: Callable[[], bool],
    rate: loop.Rate,
) -> None:
    """Serve until `stop` says so.

    Args:
        session: what is played; all browsers share it.
        title: of the page.
        port: to listen on; None for the first free one.
        map_places: where the map's latents end (P, 3) m, and those latents (P, d); None without a map.
        ready: called with the address as soon as it answers.
        stop: asked before every control step.
        rate: is kept up to date.

    Raises:
        SkillError: the port is taken.
    """
    chosen = _free_port(port)
    with _silent():
        server = _Local(host=LOOPBACK, port=chosen, label=line(title), verbose=False)
    try:
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        server.gui.main_panel.dock_right()
        ends, latents = map_places or (np.zeros((0, 3)), np.zeros((0, session.bounds.shape[1])))
        view = View(server, session, ends, latents)
        pad = Pad(server, session, view, latents) if session.bounds.shape[1] > 1 else None
        view.look_from(pad.corners if pad is not None else view.points)
        controls = Controls(server.gui, session, rate)
        looked = 0.0

        def draw(pose: Pose) -> None:
            nonlocal looked
            view.draw(pose)
            if pad is not None:
                pad.refresh()
            if time.monotonic() >= looked + REFRESH:
                looked = time.monotonic()
                view.refresh()
                controls.refresh()

        ready(f"http://{LOOPBACK}:{server.get_port()}")
        loop.run(session, draw, stop, rate)
    finally:
        session.close()
        with _silent():
            server.stop()


def _silent() -> contextlib.AbstractContextManager[object]:
    """Keep what viser prints off stdout, which is for results."""
    return contextlib.redirect_stdout(io.StringIO())


def _free_port(port: int | None) -> int:
    """Return the port if it is free, or the first free one.

    Raises:
        SkillError: it is taken, or all are.
    """
    for candidate in range(FIRST_PORT, FIRST_PORT + PORTS) if port is None else (port,):
        with socket.socket() as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                tried.bind((LOOPBACK, candidate))
            except OSError as error:
                reason = error.strerror
                continue
            return int(tried.getsockname()[1])
    named = f"port {port} is" if port is not None else f"ports {FIRST_PORT} to {FIRST_PORT + PORTS - 1} are"
    raise SkillError(f"{named} not free: {reason}", "--port names another one")
