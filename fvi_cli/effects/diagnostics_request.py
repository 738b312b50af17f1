"""Diagnostics to compute with a motion; in a module of its own, so that requests load no engine."""

from __future__ import annotations

from dataclasses import dataclass

from fvi_cli.effects.symmetry import Symmetry


@dataclass(frozen=True, kw_only=True, eq=False)
class DiagnosticsRequest:
    """Which diagnostics are computed with a trajectory; by default none."""

    # dissipated work, work of the forcing, and the defect of the energy balance
    energy_balance: bool = False
    symmetries: tuple[Symmetry, ...] = ()  # symmetries whose momentum maps are computed

    @property
    def is_empty(self) -> bool:
        """Whether no diagnostics are requested."""
        return not (self.energy_balance or self.symmetries)


NO_DIAGNOSTICS = DiagnosticsRequest()
