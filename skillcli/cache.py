"""Where small lists are kept on this account, between commands."""

from __future__ import annotations

import os
from pathlib import Path


def user_cache() -> Path:
    """The folder of the user's cache, which may not be there yet.

    Raises:
        RuntimeError: there is no home at all.
    """
    cache_home = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (cache_home if cache_home.is_absolute() else Path("~/.cache").expanduser()) / "skill"
