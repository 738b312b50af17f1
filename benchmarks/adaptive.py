"""What adaptive steps take: their number, their error, and the time of one of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.measuring import in_own_process, number, table, yardstick_seconds, yes_or_no
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.data import kepler, linear_oscillator, pendulum

YARDSTICK = 2**19
"""One transform of length 2^20."""


@dataclass(frozen=True, kw_only=True)
class AdaptiveCase:
    """What is measured, and what it should come to.

    Parameters
    ----------
    name
        Scene in words.
    tolerance, stages
        Local tolerance, and stages of the Gauss method.
    most_steps, largest_error
        Figures to meet; the error is that at the end of the run.
    """

    name: str
    tolerance: float
    stages: int
    most_steps: int
    largest_error: float


@dataclass(frozen=True, kw_only=True)
class AdaptiveRow:
    """One measured case."""

    case: AdaptiveCase
    n_steps: int
    rejected: int
    error: float
    seconds: float
    yardstick_seconds: float

    @property
    def is_met(self) -> bool:
        """Whether the figures hold."""
        return self.n_steps <= self.case.most_steps and self.error <= self.case.largest_error


def _damping(order: float, coefficient: float, dimension: int = 1) -> list[FractionalDamping]:
    return [FractionalDamping(order=order, coefficient=coefficient * np.eye(dimension))]


def _pieces(*pieces: tuple[str, float]) -> Forcing:
    return Forcing(
        pieces=tuple(
            ForcingPiece(components=(Expression.parse(text, variables=("t",)),), until=until)
            for text, until in pieces
        )
    )


def _strong(coefficient: float, order: float, stiffness: float) -> Scene:
    return linear_oscillator(
        final_time=5.0,
        stiffness=stiffness,
        damping=_damping(order, coefficient),
        initial_position=1.0,
        initial_velocity=0.5,
    )


def _kepler() -> Scene:
    eccentricity = 0.95
    return kepler(
        final_time=6.0 * np.pi,
        damping=_damping(0.5, 1e-3, 2),
        initial_position=(1 - eccentricity, 0.0),
        initial_velocity=(0.0, float(np.sqrt((1 + eccentricity) / (1 - eccentricity)))),
    )


SCENES: dict[str, Callable[[], Scene]] = {
    "pendulum, gamma = 0.5, T = 20": lambda: pendulum(
        final_time=20.0, damping=_damping(0.5, 0.3), initial_position=1.0
    ),
    "step-forced Bagley-Torvik 3/2, T = 50": lambda: linear_oscillator(
        final_time=50.0,
        damping=_damping(1.5, 0.5),
        forcing=_pieces(("8", 1.0), ("0", np.inf)),
    ),
    "mu = 50, gamma = 0.5, k = 100": lambda: _strong(50.0, 0.5, 100.0),
    "mu = 20, gamma = 1.5, k = 30": lambda: _strong(20.0, 1.5, 30.0),
    "mu = 50, gamma = 1.9, k = 1": lambda: _strong(50.0, 1.9, 1.0),
    "pendulum with a pulse of length 1e-3, T = 100": lambda: pendulum(
        final_time=100.0,
        damping=_damping(0.5, 0.3),
        initial_position=1.0,
        forcing=_pieces(("0", 10.0), ("1000", 10.001), ("0", np.inf)),
    ),
    "Kepler, e = 0.95, three revolutions": _kepler,
    "linear tail to T = 1e6": lambda: linear_oscillator(
        final_time=1e6,
        stiffness=2.0,
        damping=_damping(0.5, 0.7),
        initial_position=1.0,
        initial_velocity=0.5,
    ),
}

CASES = (
    ("pendulum, gamma = 0.5, T = 20", 1e-6, 8, 30, 1e-9),
    ("step-forced Bagley-Torvik 3/2, T = 50", 1e-5, 8, 60, 1e-9),
    ("mu = 50, gamma = 0.5, k = 100", 1e-5, 8, 35, 1e-9),
    ("mu = 20, gamma = 1.5, k = 30", 1e-5, 8, 35, 1e-9),
    ("mu = 50, gamma = 1.9, k = 1", 1e-5, 8, 35, 1e-9),
    ("pendulum with a pulse of length 1e-3, T = 100", 1e-6, 8, 130, 1e-9),
    ("Kepler, e = 0.95, three revolutions", 1e-8, 10, 160, 1e-8),
    # relative to 2e-4
    ("linear tail to T = 1e6", 1e-9, 8, 600, 2e-13),
)


def adaptive_cases() -> tuple[AdaptiveCase, ...]:
    """The figures on adaptive steps."""
    return tuple(
        AdaptiveCase(
            name=name, tolerance=tolerance, stages=stages, most_steps=most, largest_error=error
        )
        for name, tolerance, stages, most, error in CASES
    )


def run_adaptive() -> list[AdaptiveRow]:
    """Measure every case in a process of its own."""
    return [in_own_process(measure_adaptive, case) for case in adaptive_cases()]


def measure_adaptive(case: AdaptiveCase, repeats: int = 5) -> AdaptiveRow:
    """Measure one case in this process; the reference has more stages and a hundredth of it."""
    scene = SCENES[case.name]()
    method = Method(cq="gauss", degree=case.stages)
    finer = AdaptiveSteps(tolerance=1e-3 * case.tolerance)
    reference = integrate(scene, Method(cq="gauss", degree=case.stages + 2), finer)
    runs = [
        integrate(scene, method, AdaptiveSteps(tolerance=case.tolerance)) for _ in range(repeats)
    ]
    found = runs[0]
    if reference.status != "ok" or found.status != "ok":
        raise RuntimeError(f"{case.name}: {reference.message or found.message}")
    return AdaptiveRow(
        case=case,
        n_steps=found.n_steps,
        rejected=found.rejected,
        error=float(np.abs(found.position[-1] - reference.position[-1]).max()),
        seconds=min(one.setup_seconds + one.stepping_seconds for one in runs),
        yardstick_seconds=yardstick_seconds(YARDSTICK),
    )


def adaptive_table(rows: list[AdaptiveRow]) -> str:
    """The table of adaptive runs, times in one transform of length 2^20 as well."""
    return table(
        "Errors are those at the end of the run, against two stages more at a thousandth of the "
        "local tolerance. A transform is one `scipy.fft.rfft` of length 2^20 on the same core.",
        (
            "case",
            "stages",
            "local tolerance",
            "steps",
            "at most",
            "in vain",
            "error",
            "at most",
            "ms",
            "microseconds per step",
            "transforms",
            "met",
        ),
        [
            (
                row.case.name,
                str(row.case.stages),
                f"{row.case.tolerance:g}",
                str(row.n_steps),
                str(row.case.most_steps),
                str(row.rejected),
                f"{row.error:.1e}",
                number(row.case.largest_error, ".0e"),
                f"{1e3 * row.seconds:.1f}",
                f"{1e6 * row.seconds / row.n_steps:.0f}",
                f"{row.seconds / row.yardstick_seconds:.2f}",
                yes_or_no(row.is_met),
            )
            for row in rows
        ],
    )
