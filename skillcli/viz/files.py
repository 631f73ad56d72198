"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from skillcli.errors import SkillError

FORMATS = ("png", "pdf", "svg")  # of figures


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` which becomes `path` when the block succeeds.

    Raises:
        SkillError: the folder or the disk does not take the file; whatever was at `path` before is untouched.
    """
    temporary = None
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        temporary.chmod(0o644)  # mkstemp makes it private, which would surprise whoever shares the folder
        yield temporary
        temporary.replace(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise SkillError(f"cannot write {path}: {reason}", "choose another folder, or free some space") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
