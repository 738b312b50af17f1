"""Kinds of problems: what stands under ``problem``."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from fvi_cli.keys.records import ByKind
from fvi_cli.keys.settings import record_of
from fvi_cli.scenes.kinds.formulas import DoublePendulum, LagrangianKind
from fvi_cli.scenes.kinds.fractional_derivative import FractionalDerivative
from fvi_cli.scenes.kinds.kind import Kind, SceneKind
from fvi_cli.scenes.kinds.material import Material
from fvi_cli.scenes.kinds.oscillators import (
    BagleyTorvik,
    DampedOscillator,
    Duffing,
    Kepler,
    Pendulum,
)
from fvi_cli.scenes.kinds.rows import Chain, FrameKind, String
from fvi_cli.scenes.kinds.structures.matrices import Structure
from fvi_cli.scenes.kinds.structures.sandwich_beam import SandwichBeam

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
            SandwichBeam,
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
        **dict.fromkeys(("building", "shear-building", "storeys"), "write kind: frame"),
        **dict.fromkeys(("mdof", "fem", "matrices"), "write kind: structure"),
        **dict.fromkeys(
            ("custom", "general", "own", "henon-heiles", "spring-pendulum"),
            "write kind: lagrangian, with coordinates and lagrangian",
        ),
    },
)
"""What may stand under ``problem``."""

__all__ = ["KINDS", "PROBLEM", "Kind", "SceneKind"]
