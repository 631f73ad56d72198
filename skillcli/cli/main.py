"""Where the process begins: Ctrl-C is answered from the first moment, before anything that takes time is loaded."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType


def main() -> None:
    """Run `skill`."""
    signal.signal(signal.SIGINT, _leave)
    from skillcli.cli.app import main as run

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # what `run` comes back to: the outcome is told, only the end is left
    run()


def _leave(_: int, __: FrameType | None) -> None:
    """End at once: nothing was begun, and an exception in the middle of an import ends in a traceback or is swallowed."""
    if "--json" in sys.argv:
        error = '{"error": {"type": "Interrupted", "message": "interrupted", "hint": "nothing was begun"}}\n'
        os.write(1, error.encode())
    os.write(2, b"error: interrupted\n hint: nothing was begun\n")
    os._exit(130)
