"""From a plain mapping (what a configuration says) to a problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.scenes.kinds import KINDS, Kind
from fvi_cli.scenes.problem import AnyProblem


def build_problem(specification: Mapping[str, Any], *, search: bool = True) -> AnyProblem:
    """The problem that a ``problem`` mapping describes.

    Parameters
    ----------
    specification
        JSON values under the keys of the configuration's ``problem``; absent keys have their
        defaults.
    search
        Look for the exact solution where none is given, which takes long.

    Raises
    ------
    ValueError
        ``key.path: what is wrong``, relative to ``problem``.
    """
    return _kind(specification).of(specification).build_problem(search=search)


def build_scene(specification: Mapping[str, Any]) -> Scene:
    """The scene alone, without an exact solution.

    Raises
    ------
    ValueError
        As :func:`build_problem`; also for ``fractional-derivative``, which is no scene.
    """
    return _kind(specification).of(specification).build_scene()


def _kind(specification: Mapping[str, Any]) -> type[Kind]:
    name = specification["kind"]
    if name not in KINDS:
        raise ArgumentError("kind", f"{name!r} is not one of {', '.join(KINDS)}")
    return KINDS[name]


def kind_title(name: str) -> str:
    """A kind in figures; a name that is none stands for itself."""
    return (KINDS[name].title or name.replace("-", " ")) if name in KINDS else name
