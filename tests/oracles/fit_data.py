"""Measurements that nobody made: ``python -m tests.oracles.fit_data`` writes them.

A decay, ``2 x'' + 0.9 D^0.62 x + 30 x = 0`` with x(0) = 0.03 and x'(0) = 0, by inverting its
Laplace transform with mpmath, at irregular times with normal noise of standard deviation 0.0004.
And accelerations of a mass of 4 on a rubber mount under harmonic forces, from the complex modulus
of the mount by the formula of Cole and Cole, with noise of 0.002 in both parts. And the force of a
damper on the bench, by the same law, as a sum of its responses to ramps (Mittag-Leffler's function
by its series), with noise of 20. Nothing of the package takes part; the generator of the noise is
written out here.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Iterator
from pathlib import Path

import mpmath

from tests.oracles.contour import talbot_inverse

MASS, STIFFNESS, ORDER, COEFFICIENT, START = 2.0, 30.0, 0.62, 0.9, 0.03
DEVIATION, NUMBER, LAST = 0.0004, 160, 8.0
MOUNTED, RELAXED, UNRELAXED, MOUNT_ORDER, MOUNT_TIME = 4.0, 1.0e4, 8.0e4, 0.6, 0.005
MOUNT_DEVIATION, FREQUENCIES, LOWEST, HIGHEST = 0.002, 80, 2.0, 80.0
BENCH_RELAXED, BENCH_UNRELAXED, BENCH_ORDER, BENCH_TIME = 5.0e4, 4.0e5, 0.6, 0.3
BENCH_DEVIATION, SAMPLES, BENCH_LAST = 20.0, 121, 6.0
CONFIGS = Path(__file__).parents[2] / "configs"


def moved(s: mpmath.mpc) -> mpmath.mpc:
    """Laplace transform of the motion."""
    damping = COEFFICIENT * s ** mpmath.mpf(ORDER)
    return START * (MASS * s + damping / s) / (MASS * s**2 + damping + STIFFNESS)


def uniform_numbers(seed: int) -> Iterator[float]:
    """Numbers between 0 and 1 by Park and Miller's generator."""
    while True:
        seed = 16807 * seed % 2147483647
        yield seed / 2147483647


def normal_numbers(drawn: Iterator[float]) -> Iterator[float]:
    """Numbers of the normal distribution, by Box and Muller."""
    for one in drawn:
        yield math.sqrt(-2.0 * math.log(one)) * math.cos(2.0 * math.pi * next(drawn))


def acceleration(frequency: float) -> complex:
    """Complex amplitude under a force of 1."""
    s = 2j * cmath.pi * frequency
    power = (s * MOUNT_TIME) ** MOUNT_ORDER
    modulus = RELAXED + (UNRELAXED - RELAXED) * power / (1.0 + power)
    return s**2 / (MOUNTED * s**2 + modulus)


def decay() -> list[str]:
    """Lines of the decay."""
    drawn = uniform_numbers(20_240_318)
    noise = normal_numbers(drawn)
    lines = ["# free decay, see tests/oracles/fit_data.py", "t,displacement"]
    for index in range(NUMBER):
        time = round((index + 0.8 * next(drawn) + 0.1) * LAST / NUMBER, 4)
        (exact,) = talbot_inverse(moved, [time], largest_frequency=math.sqrt(STIFFNESS / MASS))
        lines.append(f"{time:.4f},{exact + DEVIATION * next(noise):.6f}")
    return lines


def response() -> list[str]:
    """Lines of the response."""
    noise = normal_numbers(uniform_numbers(20_240_319))
    lines = ["# acceleration over force, see tests/oracles/fit_data.py", "frequency,real,imaginary"]
    for index in range(FREQUENCIES):
        frequency = round(LOWEST * (HIGHEST / LOWEST) ** (index / (FREQUENCIES - 1)), 3)
        exact = acceleration(frequency)
        parts = [part + MOUNT_DEVIATION * next(noise) for part in (exact.real, exact.imag)]
        lines.append(f"{frequency:.3f},{parts[0]:.5f},{parts[1]:.5f}")
    return lines


def ramp(time: float) -> float:
    """Force of the damper on the bench on a displacement that grows by 1 a unit of time."""
    with mpmath.workdps(40):
        z = -((mpmath.mpf(time) / BENCH_TIME) ** mpmath.mpf(BENCH_ORDER))
        series = mpmath.nsum(lambda k: z**k / mpmath.gamma(BENCH_ORDER * k + 2), [0, mpmath.inf])
        return float(time * (BENCH_RELAXED + (BENCH_UNRELAXED - BENCH_RELAXED) * series))


def bench_forces() -> list[tuple[float, float, float]]:
    """Times, displacements and exact forces on the bench: straight lines between its samples."""
    step = BENCH_LAST / (SAMPLES - 1)
    path = [0.01 * math.sin(4.0 * k * step) * (1.0 + k * step / 6.0) for k in range(SAMPLES)]
    path = [round(one, 7) for one in path]
    ramps = [0.0, *(ramp(k * step) for k in range(1, SAMPLES))]
    slopes = [(b - a) / step for a, b in itertools.pairwise(path)]
    changes = [b - a for a, b in itertools.pairwise([0.0, *slopes])]
    forces = [sum(changes[k] * ramps[i - k] for k in range(i)) for i in range(SAMPLES)]
    return [(k * step, u, force) for k, (u, force) in enumerate(zip(path, forces, strict=True))]


def bench() -> list[str]:
    """Lines of the test on the bench."""
    noise = normal_numbers(uniform_numbers(20_240_320))
    lines = ["# a damper on the bench, see tests/oracles/fit_data.py", "t,displacement,force"]
    for time, displacement, force in bench_forces():
        lines.append(f"{time:.2f},{displacement:.7f},{force + BENCH_DEVIATION * next(noise):.2f}")
    return lines


def main() -> None:
    """Write the files."""
    made = {"fit-decay": decay(), "fit-response": response(), "damper-bench": bench()}
    for name, lines in made.items():
        path = CONFIGS / f"{name}.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
