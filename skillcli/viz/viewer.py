"""Open a recording with the viewer that is installed beside this Python."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from skillcli.errors import SkillError

LOOPBACK = "127.0.0.1"
STDERR = 2  # file descriptor: stdout is kept for results


def open_viewer(path: Path) -> subprocess.Popen[bytes]:
    """Start the native viewer on a recording; it keeps running when this process ends.

    Raises:
        SkillError: there is no such file, or no viewer.
    """
    quiet = subprocess.DEVNULL
    command = [*_command(path), "--bind", LOOPBACK]
    return subprocess.Popen(command, stdout=quiet, stderr=quiet, start_new_session=True, env=_environment())


def serve_web(path: Path) -> subprocess.Popen[bytes]:
    """Serve a recording to the browser, to this machine only: by default the viewer would listen on all interfaces.

    Its messages, with the address to open, go to this process's stderr.

    Raises:
        SkillError: there is no such file, or no viewer.
    """
    return subprocess.Popen([*_command(path), "--serve-web", "--bind", LOOPBACK], stdout=STDERR, env=_environment())


def check(window: bool) -> None:
    """Check before the work whether a recording can be shown, in a window or in a browser.

    Raises:
        SkillError: there is no viewer, or no display for its window.
    """
    _viewer()
    if window and sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise SkillError("there is no display to open the viewer on", "give --web, or -o FILE.rrd and open that elsewhere")


def _environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name != "RUST_LOG"}  # its messages hold the address


def _command(path: Path) -> list[str]:
    if not path.is_file():
        raise SkillError(f"there is no recording {path}", "write it first: skill viz ID -o FILE.rrd")
    return [_viewer(), str(path)]


def _viewer() -> str:
    beside = Path(sys.executable).parent
    viewer = shutil.which("rerun", path=str(beside)) or shutil.which("rerun")
    if viewer is None:
        raise SkillError(f"the rerun viewer was not found beside {sys.executable}", "pip install rerun-sdk")
    return viewer
