"""``python -m benchmarks fits``: what estimates and intervals of fits are worth.

Data are made by inverting Laplace transforms, with which fits have nothing in common.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

from benchmarks.fit_benches import BENCH, SMOOTH, drawn_bench, samples_per_period
from benchmarks.fit_coverage import between_lines, coverage_lines, covered_between
from benchmarks.fit_coverage import covered as covered_kind
from benchmarks.fit_kinds import KINDS, kind_named
from benchmarks.measuring import yardstick_seconds
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.fits.fitting import fit_model
from fvi_cli.studies.fits.profile import CONFIDENCE, quantile
from fvi_cli.studies.fits.result import ModelFit
from fvi_cli.studies.fits.settings import DataSet, FitModel, FitParameter, FitSettings, Series

Array = NDArray[np.float64]

N_FITS = 1000
"""Of noisy data, for the share of intervals that hold the truth."""
N_STARTS = 200
N_BENCH = 200
BENCH_ROWS = "bench-fits.csv"
LINES = f"{BENCH}; between its samples"
PER_PERIOD = (6, 10, 20, 40)
"""Ends of the groups of samples per period."""
ROWS = "fits.csv"
"""What came of every one of them; fits that stand there are not done again."""
CLEAN = 1e-8
"""Largest relative error of parameters from clean data."""
STIFFNESS, COEFFICIENT, ORDER, NOISE = 4.0, 0.6, 0.6, 0.02
NOISY = np.linspace(0.2, 6.0, 30)
"""Times of the samples with noise."""
FAR = 10.0
"""Bad starts are wrong by up to this factor."""


def oscillator(order: float, velocity: float = 0.0) -> dict[str, Any]:
    """The ``problem`` mapping of the true motion."""
    return {
        "kind": "damped-oscillator",
        "mass": 1.0,
        "stiffness": STIFFNESS,
        "damping": [{"order": order, "coefficient": COEFFICIENT}],
        "initial": {"position": 1.0, "velocity": velocity},
        "final_time": 10.0,
    }


def motion(
    order: float,
    times: Array,
    velocity: float = 0.0,
    *,
    stiffness: float = STIFFNESS,
    coefficient: float = COEFFICIENT,
) -> Array:
    """Its position, by inverting the Laplace transform in extended precision (Talbot)."""

    def transform(s: mpmath.mpc) -> mpmath.mpc:
        start = s ** (order - 1) + (velocity * s ** (order - 2) if order > 1 else 0)
        return (s + velocity + coefficient * start) / (s**2 + coefficient * s**order + stiffness)

    with mpmath.workdps(35):
        return np.array(
            [
                float(mpmath.invertlaplace(transform, t, method="talbot", degree=70))
                for t in times.tolist()
            ]
        )


def _settings(times: Array, values: Array) -> FitSettings:
    series = Series(
        name="x", column="x", component=0, is_velocity=False, times=times, values=values
    )
    return FitSettings(data=(DataSet(name="a", series=(series,)),), models=())


def _model(specification: dict[str, Any], start: Sequence[float]) -> FitModel:
    parameters = (
        FitParameter(key="problem.stiffness", start=start[0], low=0.0),
        FitParameter(key="problem.damping.0.coefficient", start=start[1], low=0.0),
        FitParameter(key="problem.damping.0.order", start=start[2], low=0.05, high=1.95),
    )
    return FitModel(name="", specification=specification, parameters=parameters)


def clean_errors() -> dict[str, float]:
    """Largest relative error of three parameters from clean data, by order."""
    times, found = np.linspace(0.1, 10.0, 100), {}
    for order, velocity in ((0.3, 0.5), (0.6, 0.0), (1.0, 0.0), (1.4, 0.0), (1.7, 0.5)):
        given = _settings(times, motion(order, times, velocity))
        begin = (STIFFNESS * 1.3, COEFFICIENT * 0.7, min(order + 0.15, 1.9))
        fitted = fit_model(given, _model(oscillator(order, velocity), begin))
        truth = (STIFFNESS, COEFFICIENT, order)
        errors = [abs(e.value / t - 1) for e, t in zip(fitted.estimates, truth, strict=True)]
        found[f"order {order:g}, start velocity {velocity:g}"] = max(errors)
    return found


def covered(numbers: Iterable[int]) -> Iterator[tuple[bool, ...]]:
    """For every noisy fit which of the intervals hold the truth."""
    exact, truth = motion(ORDER, NOISY), (STIFFNESS, COEFFICIENT, ORDER)
    for number in numbers:
        given, model = _settings(NOISY, exact + _noise(number)), _model(oscillator(ORDER), truth)
        fitted = fit_model(given, model, with_scan=False)
        yield tuple(
            bool(e.low <= t <= e.high) for e, t in zip(fitted.estimates, truth, strict=True)
        )


def _noise(number: int) -> Array:
    return NOISE * np.random.default_rng([1, number]).standard_normal(NOISY.size)


def covered_in_theory(count: int) -> Array:
    """The same for a motion that is linear in its parameters, shape ``(count, 3)``.

    There the intervals by Student's distribution are exact: what the first noises of these happen
    to do to them is no property of a fit.
    """
    truth, step = np.array([STIFFNESS, COEFFICIENT, ORDER]), 1e-5

    def moved(by: Array) -> Array:
        stiffness, coefficient, order = truth + by
        return motion(order, NOISY, stiffness=stiffness, coefficient=coefficient)

    slopes = [(moved(step * e) - moved(-step * e)) / (2 * step) for e in np.eye(3)]
    jacobian = np.stack(slopes, axis=1)
    inverse, freedom = np.linalg.pinv(jacobian), NOISY.size - 3
    noise = np.stack([_noise(number) for number in range(count)], axis=1)
    found = inverse @ noise
    variance = ((noise - jacobian @ found) ** 2).sum(axis=0) / freedom
    errors = np.sqrt(np.diag(inverse @ inverse.T))[:, None] * np.sqrt(variance)
    return np.asarray(np.abs(found) <= quantile(freedom, is_known=False) * errors).T


def failed_starts(numbers: Iterable[int]) -> Iterator[tuple[bool, ...]]:
    """For every bad start whether the fit missed the truth by more than six standard errors."""
    times = np.linspace(0.2, 10.0, 50)
    exact, truth = motion(ORDER, times), (STIFFNESS, COEFFICIENT, ORDER)
    for number in numbers:
        generator = np.random.default_rng([2, number])
        noise = NOISE * generator.standard_normal(times.size)
        factors = FAR ** generator.uniform(-1, 1, 2)
        start = (*(np.array(truth[:2]) * factors).tolist(), float(generator.uniform(0.05, 1.95)))
        fitted = fit_model(_settings(times, exact + noise), _model(oscillator(ORDER), start))
        far = [
            abs(e.value - t) > 6 * e.standard_error
            for e, t in zip(fitted.estimates, truth, strict=True)
        ]
        yield (bool(not fitted.is_converged or any(far)),)


def kept(
    path: Path,
    study: str,
    count: int,
    measure: Callable[[Iterable[int]], Iterator[tuple[bool, ...]]],
) -> list[tuple[bool, ...]]:
    """The first rows of a study, each computed once: a command that is stopped goes on later.

    Parameters
    ----------
    path
        CSV file of study, number and a digit for every answer, to which is added.
    study, count
        Its name, and how many rows are wanted.
    measure
        From numbers to rows.
    """
    rows = [line.split(",") for line in path.read_text().splitlines()] if path.exists() else []
    known = {int(row[1]): row[2] for row in rows if row[0] == study}
    missing = [number for number in range(count) if number not in known]
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        for number, found in zip(missing, measure(missing) if missing else (), strict=True):
            known[number] = "".join(str(int(one)) for one in found)
            file.write(f"{study},{number},{known[number]}\n")
            file.flush()
    return [tuple(digit == "1" for digit in known[number]) for number in range(count)]


@dataclass(frozen=True, kw_only=True)
class TimedFit:
    """A fit and the processor seconds it took, scan and intervals included.

    `transform` is what a Fourier transform of 2^20 numbers took beside it.
    """

    name: str
    seconds: float
    runs: int
    worst: float
    transform: float = math.nan


def three_parameters() -> TimedFit:
    """Three parameters to 160 samples."""
    times = np.linspace(0.05, 10.0, 160)
    noise = NOISE * np.random.default_rng(3).standard_normal(times.size)
    given = _settings(times, motion(ORDER, times) + noise)
    truth = (STIFFNESS, COEFFICIENT, ORDER)
    model = _model(oscillator(ORDER), (STIFFNESS * 1.3, COEFFICIENT * 0.7, 0.8))
    return _timed("three parameters to 160 samples", given, model, truth)


def ten_parameters() -> TimedFit:
    """Eight stiffnesses, order and coefficient of a frame of ten storeys to five channels."""
    truth = [60.0 - 3.0 * k for k in range(8)] + [0.5, 0.8]
    problem: dict[str, Any] = {
        "kind": "frame",
        "storeys": 10,
        "stiffness": [*truth[:8], 35.0, 30.0],
        "dampers": [{"order": 0.5, "coefficient": 0.8}],
        "ground_acceleration": "exp(-0.4*t)*sin(4*t)*10",
        "final_time": 8.0,
    }
    times = np.linspace(0.1, 8.0, 80)
    moved = _reference(problem, times)
    generator = np.random.default_rng(4)
    series = tuple(
        Series(
            name=f"x{floor}",
            column=f"x{floor}",
            component=floor - 1,
            is_velocity=False,
            times=times,
            values=moved[:, floor - 1] + 0.002 * generator.standard_normal(times.size),
        )
        for floor in (2, 4, 6, 8, 10)
    )
    given = FitSettings(data=(DataSet(name="a", series=series),), models=())
    parameters = [
        FitParameter(
            key=f"problem.stiffness.{k}", start=truth[k] * (1.3 if k % 2 else 0.8), low=0.0
        )
        for k in range(8)
    ]
    parameters += [
        FitParameter(key="problem.dampers.0.order", start=0.8, low=0.05, high=0.99),
        FitParameter(key="problem.dampers.0.coefficient", start=0.5, low=0.0),
    ]
    model = FitModel(name="", specification=problem, parameters=tuple(parameters))
    return _timed("ten parameters of a frame to five channels", given, model, truth)


def _reference(problem: dict[str, Any], times: Array) -> Array:
    """The motion of the frame by another method on other steps."""
    from fvi_cli.integrator.gradients.gradient import run_steps
    from fvi_cli.integrator.meshes.mesh import graded_mesh
    from fvi_cli.integrator.method import Method

    scene = build_scene(problem)
    done = run_steps(scene, Method(cq="gauss", degree=5, start="none"), graded_mesh(8.0, 200, 2.0))
    return done(times)


def _timed(name: str, given: FitSettings, model: FitModel, truth: Sequence[float]) -> TimedFit:
    began = time.process_time()
    fitted = fit_model(given, model)
    seconds = time.process_time() - began
    return TimedFit(
        name=name,
        seconds=seconds,
        runs=fitted.evaluations,
        worst=_worst(fitted, truth),
        transform=yardstick_seconds(2**19),
    )


def _worst(fitted: ModelFit, truth: Sequence[float]) -> float:
    """Largest error in standard errors."""
    return max(
        abs(e.value - t) / e.standard_error for e, t in zip(fitted.estimates, truth, strict=True)
    )


def fits_page(
    clean: dict[str, float],
    held: Sequence[tuple[bool, ...]],
    theory: Array,
    failed: Sequence[tuple[bool, ...]],
    timed: Sequence[TimedFit],
    by_kind: Sequence[str] = (),
) -> str:
    """The page in Markdown."""
    share = 100 * np.mean(np.array(held), axis=0)
    in_theory = 100 * np.mean(theory, axis=0)
    differing = np.array(held, dtype=float) - theory
    spread = 100 * float(np.std(differing, axis=0).max()) / math.sqrt(len(held))
    corrected = 100 * CONFIDENCE + 100 * np.mean(differing, axis=0)
    lines = ["| clean data, 100 samples | largest relative error of a parameter |", "|---|---|"]
    lines += [f"| {name} | {error:.0e} |" for name, error in clean.items()]
    lines += [
        "",
        f"**Intervals.** Of {len(held)} fits of three parameters to 30 samples with noise of 2 % "
        f"the 95 % intervals held the truth in {share[0]:.1f} % (stiffness), {share[1]:.1f} % "
        f"(coefficient) and {share[2]:.1f} % (order). With the same noise the exact intervals of "
        f"a motion that is linear in its parameters hold it in {in_theory[0]:.1f} %, "
        f"{in_theory[1]:.1f} % and {in_theory[2]:.1f} %, and with all noise "
        f"{100 * CONFIDENCE:g} %; "
        f"by the difference the intervals of the fits hold it in {corrected[0]:.1f} %, "
        f"{corrected[1]:.1f} % and {corrected[2]:.1f} %, to within {spread:.1f} %.",
        "",
        f"**Bad starts.** From {len(failed)} random starts, stiffness and coefficient wrong by a "
        f"factor of up to {FAR:g}, the order anywhere in (0.05, 1.95), "
        f"{sum(map(any, failed))} fits failed.",
        "",
        "| fit, with scan and intervals | processor seconds | Fourier transform of 2^20 numbers, "
        "seconds | runs of the last stage | largest error in standard errors |",
        "|---|---|---|---|---|",
        *(
            f"| {o.name} | {o.seconds:.1f} | {o.transform:.3f} | {o.runs} | {o.worst:.1f} |"
            for o in timed
        ),
        *by_kind,
    ]
    return "\n".join(lines)


def run_bench(folder: Path, fits: int = N_BENCH) -> str:
    """Intervals of fits of a damper on the bench to forces from a closed form, with noise.

    Straight lines between the samples of its displacement are the truth; of smooth displacements,
    of which there are half as many fits, they are not.
    """
    path = folder / BENCH_ROWS
    held = kept(path, BENCH, fits, partial(covered_kind, kind_named(BENCH)))
    drawn = kept(path, SMOOTH, fits // 2, partial(covered_between, drawn_bench))
    control = kept(path, LINES, fits // 5, partial(covered_between, lambda _: kind_named(BENCH)))
    groups = {
        f"{low} to {high}": [
            row for number, row in enumerate(drawn) if low <= samples_per_period(number) < high
        ]
        for low, high in itertools.pairwise(PER_PERIOD)
    }
    lines = between_lines({**groups, "straight lines in truth": control})
    return "\n".join([*coverage_lines({BENCH: held})[1:], *lines])


def run_fits(folder: Path, fits: int = N_FITS, starts: int = N_STARTS) -> str:
    """Measure everything."""
    per_kind = math.ceil(fits / len(KINDS))
    held = {
        name: kept(
            folder / ROWS,
            name.replace(",", ";"),
            per_kind,
            partial(covered_kind, kind_named(name)),
        )
        for name in KINDS
    }
    return fits_page(
        clean_errors(),
        kept(folder / ROWS, "interval", fits, covered),
        covered_in_theory(fits),
        kept(folder / ROWS, "start", starts, failed_starts),
        [three_parameters(), ten_parameters()],
        coverage_lines(held),
    )
