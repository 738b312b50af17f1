"""The identity of the code that computes; workers and stored runs of other code are not used."""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

import fvi_cli

HASHED_PACKAGES = (
    "effects",
    "integrator",
    "mathematics",
    "planning",
    "runner/executors",
    "scenes",
    "storage/records",
    "studies",
)
"""Packages that determine numbers and the stored form of a run; configurations, tables and commands
determine neither."""

LIBRARIES = ("numpy", "scipy", "mpmath")
"""The libraries that compute."""


@dataclass(frozen=True, kw_only=True)
class Code:
    """Versions and sources on which the last digits of a number depend."""

    fvi: str  # version of the program
    sources: str  # SHA-256 of the Python files of HASHED_PACKAGES, names and contents
    # versions of the libraries that compute; empty where an older version did not store it
    numpy: str
    scipy: str
    mpmath: str = ""

    @functools.cached_property
    def text(self) -> str:
        """All of it as one line of JSON, as it is stored."""
        return json.dumps(asdict(self))

    @functools.cached_property
    def digest(self) -> str:
        """SHA-256 of the sources and of the versions of the libraries."""
        made_by = [self.sources, *(getattr(self, name) for name in LIBRARIES)]
        return hashlib.sha256(json.dumps(made_by).encode()).hexdigest()

    def differences(self, other: Code) -> str:
        """``numpy 2.4.1 in place of 2.4.0``: what `other` has in place of this; empty: equal."""
        found = [
            f"{name} {getattr(other, name)} in place of {getattr(self, name)}"
            for name in ("fvi", *LIBRARIES)
            if "" != getattr(self, name) != getattr(other, name) != ""
        ]
        if not found and self.sources != other.sources:
            found.append(f"other source files of fvi {self.fvi}")
        return ", ".join(found)


@functools.cache
def own_code() -> Code:
    """The code of this process."""
    package = Path(fvi_cli.__file__).resolve().parent
    digest = hashlib.sha256()
    roots = [package / name for name in HASHED_PACKAGES]
    files = {file for root in roots for file in ([root] if root.is_file() else root.rglob("*.py"))}
    for path in sorted(files):
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(b"\0" + path.read_bytes() + b"\0")
    return Code(
        fvi=fvi_cli.__version__,
        sources=digest.hexdigest(),
        **{name: metadata.version(name) for name in LIBRARIES},
    )
