"""By which code numbers are made: neither a worker nor a stored run of another one is believed."""

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
"""Where numbers come from, and what is stored of a run; configurations, tables and commands change
neither."""

LIBRARIES = ("numpy", "scipy", "mpmath")
"""Those that calculate."""


@dataclass(frozen=True, kw_only=True)
class Code:
    """What the last digits of a number depend on."""

    fvi: str  # version of the program
    sources: str  # SHA-256 of the Python files of HASHED_PACKAGES, names and contents
    # versions of the libraries that calculate; empty where an older version did not store it
    numpy: str
    scipy: str
    mpmath: str = ""

    @functools.cached_property
    def text(self) -> str:
        """In one line, as it is stored."""
        return json.dumps(asdict(self))

    @functools.cached_property
    def digest(self) -> str:
        """SHA-256 of the sources and of the libraries, which make numbers."""
        made_by = [self.sources, *(getattr(self, name) for name in LIBRARIES)]
        return hashlib.sha256(json.dumps(made_by).encode()).hexdigest()

    def differences(self, other: Code) -> str:
        """In words what `other` has in place of what is here; empty where nothing differs."""
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
