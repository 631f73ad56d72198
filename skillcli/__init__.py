"""`skill`: learn, compose and transfer robot skills, with every result kept as a versioned artifact.

What this module lists in `__all__` is public; see docs/python.md. Each name is imported when it is first asked for, so that
`import skillcli` loads neither torch nor an engine.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from skillcli.api.library import Skill as Skill
    from skillcli.api.library import SkillLibrary as SkillLibrary
    from skillcli.api.plan import ComposedPlan as ComposedPlan
    from skillcli.api.work import Evaluation as Evaluation
    from skillcli.api.work import evaluate as evaluate
    from skillcli.api.work import load as load
    from skillcli.api.work import train as train
    from skillcli.errors import SkillError as SkillError
    from skillcli.errors import StoreError as StoreError
    from skillcli.errors import UsageError as UsageError
    from skillcli.store import Store as Store
    from skillcli.trajectories import Trajectories as Trajectories

_HOME = {
    "ComposedPlan": "skillcli.api.plan",
    "Evaluation": "skillcli.api.work",
    "Skill": "skillcli.api.library",
    "SkillError": "skillcli.errors",
    "SkillLibrary": "skillcli.api.library",
    "Store": "skillcli.store",
    "StoreError": "skillcli.errors",
    "Trajectories": "skillcli.trajectories",
    "UsageError": "skillcli.errors",
    "evaluate": "skillcli.api.work",
    "load": "skillcli.api.work",
    "train": "skillcli.api.work",
}

__all__ = [
    "ComposedPlan", "Evaluation", "Skill", "SkillError", "SkillLibrary", "Store", "StoreError", "Trajectories", "UsageError",
    "evaluate", "load", "train",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name from where it is defined."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__all__)}")
    found = globals()[name] = getattr(import_module(_HOME[name]), name)
    return found


def __dir__() -> list[str]:
    """List the public names, for completion."""
    return sorted([*__all__, "__version__"])
