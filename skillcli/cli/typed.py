"""Commands as they are typed: the present one, and proposed ones."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

PLACE = "--store"
SWITCHES = ("--json", "--quiet", "--debug")

_PROPOSED = re.compile(
    r"(?P<before>^|`|: )skill (?=(?:pretrain|embed-means|compose|transfer-eval|run|demo|sweep|compare"
    r"|viz|report|ls|show|diff|verify|pin"
    r"|unpin|rm|gc|export|import|upload|download|migrate|unlock|doctor"
    r"|execute|identify|play|robots|recipes|tasks|domains)\b|--help`)"
)


def split(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Separate the global options, which may stand anywhere before a `--`, from the rest."""
    ours: list[str] = []
    rest: list[str] = []
    pending = list(words)
    while pending and pending[0] != "--":
        word = pending.pop(0)
        if word == PLACE and pending:
            ours += [word, pending.pop(0)]
        else:
            (ours if word in SWITCHES or word.startswith(f"{PLACE}=") else rest).append(word)
    return ours, rest + pending


def recorded() -> str:
    """Return the command as typed, without the options that only concern output and paths."""
    return shlex.join(["skill", *split(sys.argv[1:])[1]])


def runnable(text: str) -> str:
    """Rewrite every proposed command in a text so that it uses the same program and store."""
    place = [word for word in split(sys.argv[1:])[0] if word not in SWITCHES]
    prefix = shlex.join([_program(), *place])
    return _PROPOSED.sub(lambda found: f"{found['before']}{prefix} ", text)


def _program() -> str:
    """Return `skill`, or its path if that word would start another program: many systems have one that sends signals."""
    called, found = Path(sys.argv[0]), shutil.which("skill")
    ours = not called.is_file() or (found is not None and called.samefile(found))
    return "skill" if ours else str(called)
