"""Kinds of problems, one file for each."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from fvi_cli.keys.records import ByKind
from fvi_cli.scenes.kinds.chain import CHAIN
from fvi_cli.scenes.kinds.double_pendulum import DOUBLE_PENDULUM
from fvi_cli.scenes.kinds.duffing import DUFFING
from fvi_cli.scenes.kinds.fractional_derivative import FRACTIONAL_DERIVATIVE
from fvi_cli.scenes.kinds.frame import FRAME
from fvi_cli.scenes.kinds.kepler import KEPLER
from fvi_cli.scenes.kinds.kind import Kind, SceneKind
from fvi_cli.scenes.kinds.lagrangian import LAGRANGIAN
from fvi_cli.scenes.kinds.oscillators import BAGLEY_TORVIK, DAMPED_OSCILLATOR
from fvi_cli.scenes.kinds.pendulum import PENDULUM
from fvi_cli.scenes.kinds.string import STRING
from fvi_cli.scenes.kinds.structures.matrices import STRUCTURE
from fvi_cli.scenes.kinds.structures.sandwich_beam import SANDWICH_BEAM

KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {
        kind.name: kind
        for kind in (
            DAMPED_OSCILLATOR,
            BAGLEY_TORVIK,
            PENDULUM,
            DUFFING,
            KEPLER,
            CHAIN,
            FRAME,
            STRUCTURE,
            SANDWICH_BEAM,
            STRING,
            DOUBLE_PENDULUM,
            LAGRANGIAN,
            FRACTIONAL_DERIVATIVE,
        )
    }
)
"""Every kind by its name, in the order in which they are shown."""

PROBLEM: Final = ByKind(kinds={name: kind.record for name, kind in KINDS.items()})
"""What may stand under ``problem``."""

__all__ = ["KINDS", "PROBLEM", "Kind", "SceneKind"]
