"""What is said of failures that nobody foresaw: the disk's and the machine's by their names, the rest as a defect of ours."""

from __future__ import annotations

DEFECT = "a defect of skill; --debug shows where"

# what allocators, loaders and thread pools say when they get nothing
_NO_MEMORY = (
    "cannot allocate memory", "can't allocate memory", "unable to allocate", "could not allocate", "bad_alloc", "out of memory",
    "failed to map segment", "can't start new thread", "cannot create thread", "resource temporarily unavailable",
)  # fmt: skip


def told(error: Exception) -> tuple[str, str]:
    """Message and hint."""
    text = str(error) or type(error).__name__
    if isinstance(error, MemoryError) or any(sign in text.lower() for sign in _NO_MEMORY):
        return f"there is not enough memory: {text}", "close other programs, or raise the limit (`ulimit -v`, `ulimit -u`)"
    if isinstance(error, ImportError):
        return f"a package cannot be loaded: {text}", "`make install` puts packages right, `skill doctor` looks at them"
    if isinstance(error, OSError):
        reason = error.strerror or text
        return f"{error.filename}: {reason}" if error.filename else reason, "check the disk and the folder's permissions"
    return f"unexpected: {text}", DEFECT
