"""`skill` as a user meets it, without a process of its own: words in; exit code, stdout and stderr out."""

from __future__ import annotations

import io
import json
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

from skillcli.cli.app import main

# The stages of a chain, each made from the one before; an execution needs an arm too.
CHAIN = ("pretrain", "embed-means", "compose", "transfer-eval")

# A chain on the Sawyer that learns nothing worth having, in a second.
TINY = (
    "training.iterations=2", "training.simulations=16", "training.minibatch=128", "task.horizon=16", "evaluation.latents=3",
    "evaluation.stored=1", "search.budget=12", "search.batch=4", "transfer.episodes=3",
)  # fmt: skip
TINY_SET = tuple(word for setting in TINY for word in ("--set", setting))

# The same with a box, on robots that differ.
TINY_PUSH = (
    *TINY, "task.horizon=24", "randomisation.dynamics.gain={uniform=[0.9, 1.1]}",
    "randomisation.starts.object_offset={uniform=[-0.05, 0.05]}", "randomisation.sensing.latency={one_of=[0.0, 0.05]}",
    "randomisation.starts_span=[0, 0]", "randomisation.sensing_span=[0.5, 0.5]",
)  # fmt: skip
TINY_PUSH_SET = tuple(word for setting in TINY_PUSH for word in ("--set", setting))

# Displacements of the box: where it is already; past two places to where it never gets; straight on.
PLACES = (((0.0, 0.0),), ((0.01, 0.0), (0.0, 0.02), (0.2, 0.0)), ((0.1, 0.1),))


# As the installed command, but that it says when the training runs.
TELLING = """
import sys
from skillcli.learning.learner import Learner
iterate = Learner.iterate
def told(self):
    print("iterating", file=sys.stderr, flush=True)
    return iterate(self)
Learner.iterate = told
from skillcli.cli.main import main
sys.argv[0] = "skill"
main()
"""


class Result(NamedTuple):
    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The one JSON object on stdout; anything else there is an error."""
        found = json.loads(self.out)
        assert isinstance(found, dict)
        return found


def skill(*words: str | Path) -> Result:
    arguments = ["skill", *map(str, words)]
    with (
        mock.patch.object(sys, "argv", arguments),
        redirect_stdout(io.StringIO()) as out,
        redirect_stderr(io.StringIO()) as err,
    ):
        try:
            main()
            code = 0
        except SystemExit as leaving:
            code = leaving.code if isinstance(leaving.code, int) else 1
    return Result(code, out.getvalue(), err.getvalue())


def made(*words: str | Path) -> Any:
    """What a command that must succeed reports under --json."""
    result = skill("--json", *words)
    assert result.code == 0, result.err
    return result.json


def files(folder: Path) -> set[str]:
    """Every file below a folder, but for the record of version numbers that were given."""
    found = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    return {name for name in found if ".claims" not in name}
