"""Relaxation laws at the edges of orders, relaxation times and moduli."""

from __future__ import annotations

from fvi_cli.effects.laws.cole_cole import fractional_maxwell, fractional_zener
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.laws.prony import prony
from fvi_cli.effects.laws.tempered import tempered
from fvi_cli.scenes.named import linear_oscillator
from fvi_cli.studies.hard_cases.case import Claim, HardCase, Setting
from fvi_cli.studies.hard_cases.judging import LAPLACE, accurate, largest_energy

FINAL_TIME, N_STEPS = 16.0, 128


def _setting(law: Law) -> Setting:
    scene = linear_oscillator(
        final_time=FINAL_TIME,
        stiffness=1.0,
        laws=(law,),
        initial_position=1.0,
        initial_velocity=0.5,
    )
    return Setting(scene, N_STEPS)


def _zener(order: float, time: float, unrelaxed: float = 3.0) -> Law:
    return fractional_zener(
        order=order, time=time, relaxed=1.0, unrelaxed=unrelaxed, coefficient=1.0
    )


def relaxation_laws() -> HardCase:
    """Fractional Zener, Maxwell, Prony and tempered laws, far from what steps resolve."""
    zener = [_setting(_zener(order, 0.3)) for order in (0.02, 0.3, 0.675, 0.97)]
    apart = [_setting(_zener(0.5, time)) for time in (1e-6, 1e-3, 1e3, 1e6)]
    series = prony(moduli=[1.0] * 4, times=[1e-4, 1e-1, 1e1, 1e4], coefficient=1.0)
    others = [
        _setting(fractional_maxwell(order=0.5, time=0.2, modulus=5.0, coefficient=1.0)),
        _setting(series),
        *(_setting(tempered(order=0.5, rate=rate, coefficient=1.0)) for rate in (1e-3, 0.3, 2.0)),
    ]
    stiff = [
        _setting(_zener(order, time, unrelaxed=1e8)) for order in (0.1, 0.9) for time in (1e-3, 1e3)
    ]
    return HardCase(
        name="relaxation-laws",
        title="relaxation laws of all orders, times and moduli",
        description="x'' + G(D) x + x = 0 with fractional Zener, Maxwell, Prony and tempered laws "
        f"from x(0) = 1, x'(0) = 0.5; {N_STEPS} steps on [0, {FINAL_TIME:g}]; Runge-Kutta methods "
        "only",
        reference=f"{LAPLACE}; energy law",
        claims=(
            accurate("error, Zener of orders 0.02 to 0.97", 1e-7, *zener),
            accurate("error, Zener relaxing in 1e-6 to 1e6", 1e-7, *apart),
            accurate("error, Maxwell, Prony of times 1e-4 to 1e4, tempered", 1e-7, *others),
            Claim("gain of energy, unrelaxed modulus 1e8", 1e-9, stiff, largest_energy),
        ),
    )
