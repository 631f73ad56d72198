"""Start of the process: handle signals and prepare the environment before anything slow is imported."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

from skillcli.cli import streams
from skillcli.stopping import heeded

NARROWEST = 20  # characters; smaller terminal sizes are ignored


def main() -> None:
    """Run `skill`."""
    for number in heeded():
        signal.signal(number, _leave)
    set_aside()
    out = streams.protect()
    from skillcli.cli.app import main as run

    for number in heeded():
        signal.signal(number, _late)
    try:
        run()
    finally:
        if trouble := streams.lost(out):
            reason = trouble.strerror or str(trouble)
            print(f"error: cannot write to stdout: {reason}\n hint: what was made is in the store", file=sys.stderr)
            sys.exit(1)


def set_aside() -> None:
    """Remove environment variables on which other libraries fail.

    OpenGL is switched off, because MuJoCo would load its drivers; a terminal width of zero would hide all output.
    """
    os.environ["MUJOCO_GL"] = "disable"
    for name, least in (("COLUMNS", NARROWEST), ("LINES", 3), ("TERMINAL_WIDTH", NARROWEST)):
        text = os.environ.get(name, "")
        if not (text.isascii() and text.isdigit() and least <= int(text) <= 10_000):
            os.environ.pop(name, None)


def _leave(_: int, __: FrameType | None) -> None:
    """Exit at once: no work has begun, and an exception during an import ends in a traceback or is lost."""
    if "--json" in sys.argv:
        error = '{"error": {"type": "Interrupted", "message": "interrupted", "hint": "nothing was begun"}}\n'
        os.write(1, error.encode())
    os.write(2, b"error: interrupted\n hint: nothing was begun\n")
    os._exit(130)


def _late(_: int, __: FrameType | None) -> None:
    """Ignore a signal after `run`: the result has been reported."""
