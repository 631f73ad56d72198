"""The known tasks: bundled ones and the user's.

A new bundled task is one folder beside this file and one line here. A user's task is a Python file that a recipe names,
`task.module = "my_task.py"`, or an installed package with an entry point in the group `skillcli.tasks`; both hold a
`TaskSpec` named TASK.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.metadata
import importlib.util
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from skillcli.cache import user_cache
from skillcli.errors import UsageError
from skillcli.paths import read_small
from skillcli.tasks.spec import TaskSpec

ROOMS = ("point", "reach", "push", "blocks")
ENTRY_POINTS = "skillcli.tasks"
MAX_SOURCE_BYTES = 1 << 20  # larger than the Python file of any task
_OF_USERS: dict[str, TaskSpec] = {}  # by name, loaded from files


def task_names() -> list[str]:
    """List the names of all known tasks."""
    return [*ROOMS, *sorted(_installed()), *sorted(_OF_USERS)]


def find_task(name: str) -> TaskSpec:
    """Return a task by name.

    Raises:
        UsageError: there is none.
    """
    if name in ROOMS:
        return _room(name)
    if name in _OF_USERS:
        return _OF_USERS[name]
    if name in _installed():
        return _checked(_installed()[name].load(), f"the entry point {name!r}")
    raise UsageError(f"no task {name!r}", f"tasks: {', '.join(task_names())}; or name a file of your own: task.module")


@cache
def _room(name: str) -> TaskSpec:
    spec: TaskSpec = importlib.import_module(f"skillcli.tasks.{name}.task").TASK
    return spec


@cache
def _installed() -> dict[str, importlib.metadata.EntryPoint]:
    return {point.name: point for point in importlib.metadata.entry_points(group=ENTRY_POINTS)}


def source_digest(path: Path) -> str:
    """Hash the Python file of a task with SHA-256.

    Raises:
        UsageError: it cannot be read.
    """
    try:
        return hashlib.sha256(read_small(path, MAX_SOURCE_BYTES)).hexdigest()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", "") or error
        raise UsageError(f"task.module: {path} cannot be read: {reason}", "give the path of a .py file") from None


def load_task(path: Path, digest: str) -> TaskSpec:
    """Load the task of a Python file with this SHA-256; afterwards `find_task` knows it, and `ran_here` the file.

    Raises:
        UsageError: the file fails, or holds no task, or one with the name of another.
    """
    name = f"skillcli_task_{digest[:16]}"
    if name not in sys.modules:
        sys.modules[name] = _run(path, name)
    spec = _checked(getattr(sys.modules[name], "TASK", None), f"task.module {path.name}")
    if spec.name in ROOMS or spec.name in _installed():
        raise UsageError(f"task.module {path.name}: there is a task {spec.name!r} already", "give it a name of its own")
    _OF_USERS[spec.name] = spec
    if not ran_here(digest):
        with suppress(OSError, RuntimeError):  # there may be no home folder
            _ran_list().parent.mkdir(parents=True, exist_ok=True)
            with _ran_list().open("a", encoding="ascii") as listed:
                listed.write(f"{digest}\n")
    return spec


def ran_here(digest: str) -> bool:
    """Return whether a task's file with this SHA-256 ran on this account before: artifacts alone never run one."""
    with suppress(OSError, RuntimeError, UnicodeDecodeError):
        return digest in _ran_list().read_text(encoding="ascii").split()
    return False


def _ran_list() -> Path:
    return user_cache() / "tasks-run-here"


def _run(path: Path, name: str) -> Any:
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise UsageError(f"task.module: {path.name} is no Python file", "its name has to end in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pydantic look up their module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise UsageError(
            f"task.module: {path.name} fails: {type(error).__name__}: {error}", "run it by itself to see where"
        ) from error
    return module


def _checked(spec: Any, what: str) -> TaskSpec:
    match spec:
        case TaskSpec():
            return spec
    raise UsageError(f"{what} holds no task: TASK has to be a TaskSpec", "docs/add-a-task.md shows one")


def cost_to_go(task: Any) -> Any:
    """Return the cost that planners use, see `TaskSpec`."""
    return find_task(task.name).cost_to_go(task)
