"""The origin of a result: the code and the packages that are running."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path

from skillcli import __version__

PACKAGES = ("mujoco", "torch", "numpy", "h5py", "pydantic")


def package_versions() -> dict[str, str]:
    """Return the versions of this package, of Python and of all installed packages that results depend on."""
    versions = {"skillcli": __version__, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def git_state(folder: Path | None = None) -> tuple[str, bool]:
    """Return the commit of the running checkout, and whether the code differs from it; ("", False) outside one."""
    folder = folder or Path(__file__).parent.parent
    commit = _git(folder, "rev-parse", "HEAD")
    return commit, bool(commit and _git(folder, "status", "--porcelain", "--", "."))


def _git(folder: Path, *arguments: str) -> str:
    environment = {**os.environ, "GIT_OPTIONAL_LOCKS": "0"}  # must not write the index
    command = ["git", "-C", str(folder), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True, env=environment)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
