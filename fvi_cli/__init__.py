"""Fractional variational integrators for mechanical systems with fractional damping.

Every name of :mod:`fvi_cli.api` can be imported from here; it is loaded when it is first used, so
that importing the package itself takes no time.
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import TYPE_CHECKING, Any

__version__ = "1.0.0"

if TYPE_CHECKING:
    from fvi_cli.api import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """A public name of :mod:`fvi_cli.api`."""
    # the import system also looks up submodules here, which must not load the whole api
    if not name.startswith("_") and importlib.util.find_spec(f"{__name__}.{name}") is None:
        api = importlib.import_module("fvi_cli.api")
        if name in api.__all__:
            # the next use finds it without this function
            return globals().setdefault(name, getattr(api, name))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names, for completion."""
    api = importlib.import_module("fvi_cli.api")
    return sorted([*api.__all__, "__version__"])
