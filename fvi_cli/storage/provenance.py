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

_LIBRARIES = ("numpy", "scipy")
_PACKAGES = (*_LIBRARIES, "h5py", "PyYAML", "matplotlib")
_GIT_SECONDS = 10.0
_PACKAGE = Path(fvi_cli.__file__).resolve().parent
_GENERATED = ":(top,exclude)results"


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


def libraries() -> str:
    """The libraries that compute: ``numpy 2.4.1, scipy 1.17.0``."""
    versions = package_versions()
    return ", ".join(f"{name} {versions[name]}" for name in _LIBRARIES)


def platform_name() -> str:
    """Operating system, processor and Python implementation; not the name of the machine."""
    return f"{platform.system()} {platform.machine()}, {platform.python_implementation()}"


@functools.cache
def checkout(package: Path) -> tuple[str, str]:
    """Commit, and ``yes`` or ``no`` for uncommitted changes, of the checkout that holds `package`.

    Changes under ``results/``, which the program makes, do not count. Both are ``unknown`` for
    an installed package and where there is no git.
    """
    # an installed copy may lie inside somebody else's checkout
    if _git(package, "ls-files", "--error-unmatch", "__init__.py") is None:
        return UNKNOWN, UNKNOWN
    commit = _git(package, "rev-parse", "HEAD")
    changes = _git(package, "status", "--porcelain", "--", ":(top)", _GENERATED)
    is_dirty = UNKNOWN if changes is None else "yes" if changes.strip() else "no"
    return (commit or UNKNOWN).strip(), is_dirty


def _git(folder: Path, *arguments: str) -> str | None:
    """Standard output of a git command that only reads; None when it fails."""
    program = shutil.which("git")
    if program is None:
        return None
    # a caller's own GIT_DIR (as in a hook) would lead to another repository
    environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    environment["GIT_OPTIONAL_LOCKS"] = "0"
    try:
        done = subprocess.run(  # noqa: S603 - fixed arguments, no shell
            [program, "-C", str(folder), *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=True,
            timeout=_GIT_SECONDS,
            env=environment,
        )
    except (OSError, subprocess.SubprocessError, UnicodeDecodeError):
        return None
    return done.stdout


def origin() -> dict[str, str]:
    """Present time (UTC), version and commit, as attributes of a file or run."""
    commit, dirty = checkout(_PACKAGE)
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "fvi_version": fvi_cli.__version__,
        "git_commit": commit,
        "git_dirty": dirty,
    }
