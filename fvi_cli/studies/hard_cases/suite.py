"""The hard cases and the methods that are examined on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from fvi_cli.integrator.method import Method
from fvi_cli.studies.hard_cases.case import HardCase
from fvi_cli.studies.hard_cases.chaos import chaotic_double_pendulum
from fvi_cli.studies.hard_cases.forced_cases import (
    every_singular_power,
    jumps_at_every_period,
)
from fvi_cli.studies.hard_cases.law_cases import relaxation_laws
from fvi_cli.studies.hard_cases.linear_cases import (
    extreme_orders,
    huge_damping,
    negative_damping,
    stiff_springs,
    strong_damping,
    through_order_one,
)
from fvi_cli.studies.hard_cases.long_cases import (
    algebraic_tail,
    beats,
    million_steps,
    resonance,
)
from fvi_cli.studies.hard_cases.scale_cases import tiny_and_huge_scales

MAKERS: tuple[Callable[[], HardCase], ...] = (
    stiff_springs,
    huge_damping,
    strong_damping,
    extreme_orders,
    through_order_one,
    negative_damping,
    algebraic_tail,
    million_steps,
    resonance,
    beats,
    tiny_and_huge_scales,
    jumps_at_every_period,
    every_singular_power,
    relaxation_laws,
    chaotic_double_pendulum,
)

FLAGSHIP = "Gauss3"
"""The method for which everything must hold."""


def hard_cases() -> Mapping[str, HardCase]:
    """All cases by their names, in the order of the report."""
    cases = [make() for make in MAKERS]
    return {case.name: case for case in cases}


def examined_methods() -> Mapping[str, Method]:
    """Every family with the defaults that a configuration gives it, by its name in the report."""
    orders = range(1, 7)
    return {
        **{f"Gauss{m}": Method(cq="gauss", degree=m, start="graded") for m in (3, 1, 2, 4)},
        "Radau IIA 3": Method(cq="radau-iia", degree=3, start="none"),
        "Lobatto IIIC 4": Method(cq="lobatto-iiic", degree=3, start="none"),
        **{
            f"BDF{p} points": Method(cq=f"bdf{p}", degree=(p + 1) // 2, forcing_quadrature="exact")
            for p in orders
        },
        **{f"BDF{p} nodes": Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in orders},
    }
