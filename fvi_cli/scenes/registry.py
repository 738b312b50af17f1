"""All kinds of problems, and the construction of a problem from the mapping in a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import not_known
from fvi_cli.keys.kinds import ByKind
from fvi_cli.keys.settings import record_of
from fvi_cli.scenes.kinds.fractional_derivative import FractionalDerivative
from fvi_cli.scenes.kinds.kind import Kind
from fvi_cli.scenes.kinds.material import Material
from fvi_cli.scenes.kinds.oscillators import (
    BagleyTorvik,
    DampedOscillator,
    DoublePendulum,
    Duffing,
    Kepler,
    LagrangianKind,
    Pendulum,
)
from fvi_cli.scenes.kinds.rows import Chain, FrameKind, String
from fvi_cli.scenes.kinds.structures import Structure
from fvi_cli.scenes.problem import AnyProblem

KINDS: Final[Mapping[str, type[Kind]]] = MappingProxyType(
    {
        one.kind: one
        for one in (
            DampedOscillator,
            BagleyTorvik,
            Pendulum,
            Duffing,
            Kepler,
            Chain,
            FrameKind,
            Structure,
            String,
            DoublePendulum,
            LagrangianKind,
            Material,
            FractionalDerivative,
        )
    }
)
"""Every kind by its name, in the order in which they are shown."""

PROBLEM: Final = ByKind(
    name="Problem",
    kinds={name: record_of(kind) for name, kind in KINDS.items()},
    meant={
        **dict.fromkeys(
            ("oscillator", "harmonic-oscillator", "spring", "mass-spring", "sdof"),
            "write kind: damped-oscillator",
        ),
        **dict.fromkeys(
            ("van-der-pol", "vanderpol", "vdp"),
            "its damping depends on x, and damping here is linear; conservative forces of any kind "
            "are written with kind: lagrangian",
        ),
        **dict.fromkeys(("building", "shear-building", "storeys"), "write kind: frame"),
        **dict.fromkeys(("mdof", "fem", "matrices"), "write kind: structure"),
        **dict.fromkeys(
            ("custom", "general", "own", "henon-heiles", "spring-pendulum"),
            "write kind: lagrangian, with coordinates and lagrangian",
        ),
    },
)
"""The shape of ``problem``."""


def build_problem(specification: Mapping[str, Any], *, search: bool = True) -> AnyProblem:
    """The problem that a ``problem`` mapping of JSON values describes; absent keys have defaults.

    `search`: search for the exact solution where none is given, which takes long.

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
    known = KINDS[name].keys
    for key in specification:
        if key not in known and key != "kind":
            raise ArgumentError(key, not_known(key, known))
    return KINDS[name]


def kind_title(name: str) -> str:
    """The title of a kind in figures; an unknown name is its own title."""
    return (KINDS[name].title or name.replace("-", " ")) if name in KINDS else name
