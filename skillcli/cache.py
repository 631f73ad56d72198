"""The user's cache folder, for small lists kept between commands."""

from __future__ import annotations

import os
from pathlib import Path


def user_cache() -> Path:
    """Return the user's cache folder, which may not exist yet.

    Raises:
        RuntimeError: there is no home folder.
    """
    cache_home = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (cache_home if cache_home.is_absolute() else Path("~/.cache").expanduser()) / "skill"
