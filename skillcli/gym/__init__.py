"""Tasks and libraries as Gymnasium environments: `import skillcli.gym` registers them; see docs/gymnasium.md."""

from __future__ import annotations

try:
    import gymnasium as _gymnasium  # noqa: F401
except ImportError as _error:
    raise ImportError("skillcli.gym needs Gymnasium: pip install 'skillcli[gymnasium]'") from _error

from skillcli.gym.environments import SkillEnv, SkillVectorEnv
from skillcli.gym.registration import LATENT, register_all, task_id

__all__ = ["LATENT", "SkillEnv", "SkillVectorEnv", "register_all", "task_id"]

register_all()
