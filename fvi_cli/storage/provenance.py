"""Provenance of numbers: versions, commit, platform, time."""

from __future__ import annotations

import functools
import os
import platform
import shutil
import subprocess
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import fvi_cli

UNKNOWN = "unknown"
_PACKAGES = ("numpy", "scipy", "h5py", "PyYAML", "matplotlib")
_GIT_SECONDS = 10.0
_PACKAGE = Path(fvi_cli.__file__).resolve().parent


@functools.cache
def package_versions() -> dict[str, str]:
    """Versions of this package, of Python and of the libraries that compute and write."""
    versions = {"fvi-cli": fvi_cli.__version__, "python": platform.python_version()}
    for name in _PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = UNKNOWN
    return versions


def platform_name() -> str:
    """Operating system, processor and Python implementation; not the name of the machine."""
    return f"{platform.system()} {platform.machine()}, {platform.python_implementation()}"


@functools.cache
def commit_of(package: Path) -> str:
    """Commit of the checkout that holds `package`, with ``-dirty`` for uncommitted changes.

    ``unknown`` for an installed package and where there is no git.
    """
    program = shutil.which("git")
    if program is None or not (package.parent / ".git").exists():
        return UNKNOWN
    # a caller's own GIT_DIR (as in a hook) would lead to another repository
    environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    try:
        done = subprocess.run(  # noqa: S603 - fixed arguments, no shell
            [program, "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty"],
            cwd=package,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=True,
            timeout=_GIT_SECONDS,
            env={**environment, "GIT_OPTIONAL_LOCKS": "0"},
        )
    except (OSError, subprocess.SubprocessError, UnicodeDecodeError):
        return UNKNOWN
    return done.stdout.strip() or UNKNOWN


@functools.cache
def origin() -> dict[str, str]:
    """Time (UTC) at which this process first stored something, commit, versions and platform."""
    versions = package_versions()
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "fvi_version": versions["fvi-cli"],
        "git_commit": commit_of(_PACKAGE),
        "versions": ", ".join(f"{name} {one}" for name, one in versions.items()),
        "platform": platform_name(),
    }
