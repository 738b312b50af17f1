"""Dampers on the bench whose forces have a closed form, and what is fitted to them."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from scipy.special import roots_legendre

from benchmarks.fit_data import (
    BENCH_DEVIATION,
    BENCH_ORDER,
    BENCH_RELAXED,
    BENCH_TIME,
    BENCH_UNRELAXED,
    bench_forces,
)
from benchmarks.fit_kind import Array, Kind
from fvi_cli.api import load
from fvi_cli.scenes.records.data_files import samples_as_text


@cache
def bench() -> Kind:
    """The shipped damper on the bench, with its exact forces."""
    (experiment,) = load("damper-bench").experiments
    assert experiment.fit is not None
    (data,) = experiment.fit.data
    (force,) = data.series
    exact = np.array([force for _, _, force in bench_forces()])
    return Kind(
        problem=experiment.problem_specification,
        free={
            "law.order": BENCH_ORDER,
            "law.time": BENCH_TIME,
            "law.relaxed": BENCH_RELAXED,
            "law.unrelaxed": BENCH_UNRELAXED,
        },
        data=(replace(data, series=(replace(force, values=exact),)),),
        deviations=(BENCH_DEVIATION,),
    )


Waves = tuple[tuple[float, float], ...]
"""Angular frequencies and amplitudes of a smooth displacement on the bench, the fastest last."""
WAVES: Waves = ((4.0, 0.01), (9.0, 0.003))


def force_of_waves(times: Array, waves: Waves = WAVES) -> Array:
    r"""Force of the damper on the bench along such a displacement from rest.

    Of the transform :math:`G(s) \sum a \omega / (s^2 + \omega^2)` the residues at
    :math:`\pm i \omega` and the integral along the branch cut, by Gauss's rule in
    :math:`\log x`.
    """
    points, weights = roots_legendre(4000)
    # outside of these rates the cut adds less than 1e-11 of the force
    log_rate = math.log(1e9) * points
    rate = np.exp(log_rate)

    def modulus(power: Any) -> Any:
        return BENCH_RELAXED + (BENCH_UNRELAXED - BENCH_RELAXED) * power / (1.0 + power)

    cut = modulus((rate * BENCH_TIME) ** BENCH_ORDER * np.exp(1j * math.pi * BENCH_ORDER)).imag
    fading = np.exp(-np.outer(times, rate)) * (rate * math.log(1e9) * weights)
    total = np.zeros(times.size)
    for omega, amplitude in waves:
        steady = modulus((1j * omega * BENCH_TIME) ** BENCH_ORDER) * np.exp(1j * omega * times)
        kernel = cut * omega / (rate**2 + omega**2)
        total += amplitude * (steady.imag - fading @ kernel / math.pi)
    return total


def smooth_bench(per_period: float, noise: float, waves: Waves = WAVES) -> Kind:
    """A smooth displacement by so many samples per period of its fastest wave.

    Read as straight lines, which the remark of the fit says how to change.
    """
    shipped = bench()
    last = 6.0
    times = np.linspace(0.0, last, round(last * waves[-1][0] / (2.0 * math.pi) * per_period) + 1)
    moved = sum(amplitude * np.sin(omega * times) for omega, amplitude in waves)
    force = force_of_waves(times, waves)
    displacement = {
        **shipped.problem["displacement"],
        "content": samples_as_text(times, np.asarray(moved)),
    }
    (data,) = shipped.data
    (series,) = data.series
    return replace(
        shipped,
        problem={**shipped.problem, "displacement": displacement, "final_time": last},
        data=(replace(data, series=(replace(series, times=times, values=force),)),),
        deviations=(noise * float(np.abs(force).max()),),
    )


BENCH = "a damper on the bench"
SMOOTH = "a smooth displacement on the bench"
FEWEST, MOST_PER_PERIOD = 6.0, 40.0
"""Samples per period of the faster wave."""


def samples_per_period(number: int) -> float:
    """Of the drawn displacement of this number, equally likely in every octave."""
    generator = np.random.default_rng([7, number])
    return float(np.exp(generator.uniform(math.log(FEWEST), math.log(MOST_PER_PERIOD))))


def drawn_bench(number: int) -> Kind:
    """A smooth displacement of two waves by coarse samples, all of which are drawn.

    The noise is 0.1 to 0.5 % of the largest force.
    """
    generator = np.random.default_rng([8, number])
    waves = (
        (generator.uniform(2.0, 6.0), 0.01),
        (generator.uniform(7.0, 11.0), generator.uniform(0.001, 0.005)),
    )
    noise = math.exp(generator.uniform(math.log(0.001), math.log(0.005)))
    return replace(smooth_bench(samples_per_period(number), noise, waves), name=SMOOTH)
