"""What an experiment asks of ``fvi stability``."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class RegionSettings:
    r"""A part of the plane in which stability regions are drawn.

    Parameters
    ----------
    orders
        Orders of damping, one plane for each.
    stiffness, damping
        Values of :math:`h^2 k / m` and :math:`\mu h^{2 - \gamma} / m`, increasing and positive.
    """

    orders: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class StabilitySettings:
    """What is looked at.

    Parameters
    ----------
    is_observed
        Whether runs from random data are compared with the predictions.
    region
        Where stability regions are drawn; None: nowhere.
    """

    is_observed: bool = True
    region: RegionSettings | None = None


USUAL = StabilitySettings()
"""What is looked at where nothing else is said."""
