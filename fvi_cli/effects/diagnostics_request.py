"""Diagnostics to compute with a motion; in a module of its own, so that requests load no engine."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, eq=False)
class DiagnosticsRequest:
    """Which diagnostics are computed with a trajectory; by default none."""

    # dissipated work, work of the forcing, and the defect of the energy balance
    energy_balance: bool = False

    @property
    def is_empty(self) -> bool:
        """Whether no diagnostics are requested."""
        return not self.energy_balance


NO_DIAGNOSTICS = DiagnosticsRequest()
