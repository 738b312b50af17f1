"""By which code numbers are made: neither a worker nor a stored run of another one is believed."""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

import fvi_cli

ROOMS = (
    "effects",
    "integrator",
    "mathematics",
    "planning",
    "runner/executors",
    "scenes",
    "studies",
)
"""Where numbers come from; configurations, files, tables and commands change none."""


@dataclass(frozen=True, kw_only=True)
class Code:
    """What the last digits of a number depend on.

    Parameters
    ----------
    fvi
        Version of the program.
    sources
        SHA-256 of the Python files that numbers depend on, :data:`ROOMS`, names and contents.
    numpy, scipy
        Versions of the libraries that calculate.
    """

    fvi: str
    sources: str
    numpy: str
    scipy: str

    @property
    def text(self) -> str:
        """In one line, as it is stored."""
        return json.dumps(asdict(self))

    def differences(self, other: Code) -> str:
        """In words what `other` has in place of what is here; empty where nothing differs."""
        found = [
            f"{name} {getattr(other, name)} in place of {getattr(self, name)}"
            for name in ("fvi", "numpy", "scipy")
            if getattr(self, name) != getattr(other, name)
        ]
        if not found and self.sources != other.sources:
            found.append(f"other source files of fvi {self.fvi}")
        return ", ".join(found)


@functools.cache
def own_code() -> Code:
    """The code of this process."""
    package = Path(fvi_cli.__file__).resolve().parent
    digest = hashlib.sha256()
    for path in sorted(one for room in ROOMS for one in (package / room).rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(b"\0" + path.read_bytes() + b"\0")
    return Code(
        fvi=fvi_cli.__version__,
        sources=digest.hexdigest(),
        numpy=np.__version__,
        scipy=metadata.version("scipy"),
    )
