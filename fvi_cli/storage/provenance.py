"""Provenance of numbers: versions, commit, platform, time."""

from __future__ import annotations

import functools
import platform
import subprocess
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import fvi_cli

_PACKAGES = ("numpy", "scipy", "h5py", "PyYAML", "matplotlib")
_PACKAGE = Path(fvi_cli.__file__).resolve().parent


@functools.cache
def package_versions() -> dict[str, str]:
    """Versions of this package, of Python and of the libraries that compute and write."""
    versions = {"fvi-cli": fvi_cli.__version__, "python": platform.python_version()}
    return versions | {name: metadata.version(name) for name in _PACKAGES}


def platform_name() -> str:
    """Operating system, processor and Python implementation; not the name of the machine."""
    return f"{platform.system()} {platform.machine()}, {platform.python_implementation()}"


@functools.cache
def commit_of(package: Path) -> str:
    """Commit of the checkout that holds `package`, with ``-dirty`` for uncommitted changes.

    ``unknown`` for an installed package and where there is no git.
    """
    if not (package.parent / ".git").exists():
        return "unknown"
    command = ["git", "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty"]
    try:
        return subprocess.check_output(  # noqa: S603
            command, cwd=package, stderr=subprocess.DEVNULL, text=True, timeout=10.0
        ).strip()
    except (OSError, subprocess.SubprocessError):
        return "unknown"


def origin() -> dict[str, str]:
    """Time (UTC), commit, versions and platform."""
    versions = package_versions()
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "fvi_version": versions["fvi-cli"],
        "git_commit": commit_of(_PACKAGE),
        "versions": ", ".join(f"{name} {one}" for name, one in versions.items()),
        "platform": platform_name(),
    }
