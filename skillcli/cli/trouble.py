"""Messages for unexpected failures: those of disk and machine by their names, all others as a defect of skill."""

from __future__ import annotations

DEFECT = "a defect of skill; --debug shows where"

# messages of allocators, loaders and thread pools that get no memory
_NO_MEMORY = (
    "cannot allocate memory", "can't allocate memory", "unable to allocate", "could not allocate", "bad_alloc", "out of memory",
    "failed to map segment", "can't start new thread", "cannot create thread", "resource temporarily unavailable",
)  # fmt: skip


def explain(error: Exception) -> tuple[str, str]:
    """Return message and hint."""
    text = str(error) or type(error).__name__
    if isinstance(error, MemoryError) or any(sign in text.lower() for sign in _NO_MEMORY):
        return f"there is not enough memory: {text}", "close other programs, or raise the limit (`ulimit -v`, `ulimit -u`)"
    if isinstance(error, ImportError):
        return f"a package cannot be loaded: {text}", "reinstall with `make install`, or check with `skill doctor`"
    if isinstance(error, OSError):
        reason = error.strerror or text
        return f"{error.filename}: {reason}" if error.filename else reason, "check the disk and the folder's permissions"
    return f"unexpected: {text}", DEFECT
