"""By which code numbers are made, so that a worker with another one is not believed."""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

import fvi_cli


@dataclass(frozen=True, kw_only=True)
class Code:
    """What the last digits of a number depend on.

    Parameters
    ----------
    fvi
        Version of the program.
    sources
        SHA-256 of all its Python files, names and contents.
    numpy, scipy
        Versions of the libraries that calculate.
    """

    fvi: str
    sources: str
    numpy: str
    scipy: str

    def differences(self, other: Code) -> str:
        """In words what `other` has in place of what is here; empty where nothing differs."""
        found = [
            f"{name} {getattr(other, name)} in place of {getattr(self, name)}"
            for name in ("fvi", "numpy", "scipy")
            if getattr(self, name) != getattr(other, name)
        ]
        if not found and self.sources != other.sources:
            found.append(f"other source files of fvi {self.fvi} than here")
        return ", ".join(found)


@functools.cache
def own_code() -> Code:
    """The code of this process."""
    package = Path(fvi_cli.__file__).resolve().parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(b"\0" + path.read_bytes() + b"\0")
    return Code(
        fvi=fvi_cli.__version__,
        sources=digest.hexdigest(),
        numpy=np.__version__,
        scipy=metadata.version("scipy"),
    )
