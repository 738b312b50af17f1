"""A measured decay that nobody measured: ``python -m benchmarks.decay_data`` writes it.

The motion is that of ``2 x'' + 0.9 D^0.62 x + 30 x = 0`` with x(0) = 0.03 and x'(0) = 0, by
inverting its Laplace transform with mpmath; nothing of the package takes part. Normal noise of
standard deviation 0.0004 is added, from a generator that is written out here, and times are
irregular.
"""

from __future__ import annotations

import math
from pathlib import Path

import mpmath

MASS, STIFFNESS, ORDER, COEFFICIENT, START = 2.0, 30.0, 0.62, 0.9, 0.03
DEVIATION, NUMBER, LAST = 0.0004, 160, 8.0
OUTPUT = Path(__file__).parents[1] / "configs" / "fit-decay.csv"


def position(time: float) -> float:
    """The exact motion, 30 digits in between."""
    with mpmath.workdps(30):

        def transform(s: mpmath.mpc) -> mpmath.mpc:
            damping = COEFFICIENT * s ** mpmath.mpf(ORDER)
            return START * (MASS * s + damping / s) / (MASS * s**2 + damping + STIFFNESS)

        return float(mpmath.invertlaplace(transform, time, method="talbot", degree=60))


def uniform_numbers(seed: int, count: int) -> list[float]:
    """Numbers between 0 and 1 by Park and Miller's generator."""
    found = []
    for _ in range(count):
        seed = 16807 * seed % 2147483647
        found.append(seed / 2147483647)
    return found


def main() -> None:
    """Write the file."""
    drawn = iter(uniform_numbers(20_240_318, 3 * NUMBER))
    lines = ["# free decay, see benchmarks/decay_data.py", "t,displacement"]
    for index in range(NUMBER):
        time = round((index + 0.8 * next(drawn) + 0.1) * LAST / NUMBER, 4)
        one, other = next(drawn), next(drawn)
        noise = math.sqrt(-2.0 * math.log(one)) * math.cos(2.0 * math.pi * other)
        lines.append(f"{time:.4f},{position(time) + DEVIATION * noise:.6f}")
    OUTPUT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(OUTPUT)


if __name__ == "__main__":
    main()
