"""Where the process begins: before anything slow is loaded, signals are answered and the surroundings are put right."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

from skillcli.cli import streams
from skillcli.stopping import heeded

NARROWEST = 20  # characters, below which a terminal's size is not to be believed


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
    """Take out of the environment what others read there and stumble over.

    Nothing here draws with OpenGL, whose drivers MuJoCo would load; a terminal that is told to have no columns shows nothing.
    """
    os.environ["MUJOCO_GL"] = "disable"
    for name, least in (("COLUMNS", NARROWEST), ("LINES", 3), ("TERMINAL_WIDTH", NARROWEST)):
        text = os.environ.get(name, "")
        if not (text.isascii() and text.isdigit() and least <= int(text) <= 10_000):
            os.environ.pop(name, None)


def _leave(_: int, __: FrameType | None) -> None:
    """End at once: nothing was begun, and an exception in the middle of an import ends in a traceback or is swallowed."""
    if "--json" in sys.argv:
        error = '{"error": {"type": "Interrupted", "message": "interrupted", "hint": "nothing was begun"}}\n'
        os.write(1, error.encode())
    os.write(2, b"error: interrupted\n hint: nothing was begun\n")
    os._exit(130)


def _late(_: int, __: FrameType | None) -> None:
    """What `run` comes back to: the outcome is told, only the end is left."""
