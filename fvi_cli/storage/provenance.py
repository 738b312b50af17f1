"""What a run is identified by, and where numbers come from: versions, commit, platform, time."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

import fvi_cli
from fvi_cli.storage.code import LIBRARIES, own_code
from fvi_cli.studies.experiment import Run

FORMAT = 2
"""Number of the file format; a program reads files of its own number."""

SOLVER_VERSION = 11
"""To be raised whenever the same run gives other numbers; stored runs are then computed anew."""

CHECKSUM = "checksum"
"""Attribute that holds the checksum of all others."""

UNKNOWN = "unknown"

_PACKAGES = (*LIBRARIES, "h5py", "PyYAML", "matplotlib")
_AT_A_TIME = 4096
_GIT_SECONDS = 10.0
_GENERATED = ":(top,exclude)results"


def canonical_json(value: object) -> str:
    """JSON with sorted keys and without spaces: equal values give equal text.

    Raises
    ------
    ValueError
        For numbers that are not finite.
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def checksum(said: Mapping[str, Any]) -> str:
    """SHA-256 of attributes and columns by name, whatever numbers they are."""
    # JSON with sorted keys, some at a time: columns of many members are long
    digest = hashlib.sha256(b"{")
    for place, name in enumerate(sorted(said)):
        digest.update(f"{', ' if place else ''}{json.dumps(name)}: ".encode())
        for text in _json_texts(said[name]):
            digest.update(text.encode())
    digest.update(b"}")
    return digest.hexdigest()


def _json_texts(value: Any) -> Iterator[str]:
    """The JSON of a value in pieces, lists some thousand entries at a time."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        yield json.dumps(plain(value), sort_keys=True)
        return
    yield "["
    for start in range(0, len(value), _AT_A_TIME):
        text = json.dumps(plain(value[start : start + _AT_A_TIME]), sort_keys=True)
        yield f"{', ' if start else ''}{text[1:-1]}"
    yield "]"


def plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(one) for one in value]
    return value


def sha256(text: str) -> str:
    """Hexadecimal SHA-256 of a text in UTF-8."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def identity(run: Run) -> str:
    """SHA-256 of what determines the numbers of a run: its values, and by which code they are made.

    That is the format, the version of the solver, its sources and the libraries that calculate.
    Whether it may be unstable is no part of that.
    """
    specification = {k: v for k, v in run.specification().items() if k != "allow_unstable"}
    code = own_code()
    solver = [SOLVER_VERSION, code.sources, *(getattr(code, name) for name in LIBRARIES)]
    described = {"format": FORMAT, "solver": solver, "run": specification}
    return sha256(canonical_json(described))


def package_versions() -> dict[str, str]:
    """Versions of this package, of Python and of the libraries that calculate and write."""
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
def checkout(package: Path) -> tuple[str, str]:
    """Commit, and ``yes`` or ``no`` for uncommitted changes, of the checkout that holds `package`.

    Files under ``results/`` do not count: they are made by the program. Both are ``unknown`` for
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
    """Standard output of a git command that changes nothing; None when it fails."""
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
    """Time in UTC, version and commit of what is computed now, as attributes of a file or run."""
    commit, dirty = checkout(Path(fvi_cli.__file__).resolve().parent)
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "fvi_version": fvi_cli.__version__,
        "git_commit": commit,
        "git_dirty": dirty,
    }
