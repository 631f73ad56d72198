"""Where a result came from: the code and the packages that are running now."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path

from skillcli import __version__

PACKAGES = ("mujoco", "torch", "numpy", "h5py", "pydantic")


def package_versions() -> dict[str, str]:
    """Versions of this package, of Python and of what results depend on, as far as it is installed."""
    versions = {"skillcli": __version__, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def git_state(folder: Path | None = None) -> tuple[str, bool]:
    """Commit of the checkout that the code runs from, and whether the code differs from it; ("", False) outside one."""
    folder = folder or Path(__file__).parent.parent
    commit = _git(folder, "rev-parse", "HEAD")
    return commit, bool(commit and _git(folder, "status", "--porcelain", "--", "."))


def _git(folder: Path, *arguments: str) -> str:
    environment = {**os.environ, "GIT_OPTIONAL_LOCKS": "0"}  # looking must not write the index
    command = ["git", "-C", str(folder), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True, env=environment)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
