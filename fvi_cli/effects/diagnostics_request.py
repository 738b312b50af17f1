"""What is to be computed beside a motion; a value of its own, so that asking loads no engine."""

from __future__ import annotations

from dataclasses import dataclass

from fvi_cli.effects.symmetry import Symmetry


@dataclass(frozen=True, kw_only=True, eq=False)
class DiagnosticsRequest:
    """Which diagnostics are computed beside a trajectory; by default none."""

    # dissipated work, work of the forcing, and the defect of the energy balance
    energy_balance: bool = False
    symmetries: tuple[Symmetry, ...] = ()  # those whose momentum maps are followed

    @property
    def is_empty(self) -> bool:
        """Whether nothing is asked for."""
        return not (self.energy_balance or self.symmetries)


NO_DIAGNOSTICS = DiagnosticsRequest()
