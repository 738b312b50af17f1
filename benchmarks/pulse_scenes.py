"""Random scenes whose forces are narrow pulses, and such as begin singularly, with output times.

A pulse of a linear scene moves it by the convolution with the response to an impulse, which is the
free motion with Riemann-Liouville derivatives from 0 with a velocity; that has a closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.tolerance_scenes import Array, Drawn, Known, Random
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.scenes.data import linear_oscillator
from fvi_cli.scenes.linear_response import ExactSolution, match_scene

TIMES = 60
NODES = 14
LEAST_WIDTH, MOST_WIDTH = -5.0, -2.0
"""Decades of the widths of pulses, relative to T."""
SLOPED = 0.7
OF_SCALE = 1e-12
"""Error of the closed forms, relative to the motion and to the pulse."""

Shape = Callable[[Array], Array]


def _bell(z: Array) -> Array:
    """1 / cosh z."""
    return np.asarray(1.0 / np.cosh(np.clip(z, -300.0, 300.0)))


PROFILES: dict[str, tuple[str, Shape, float]] = {
    "exp": ("exp(-{u}**2)", lambda z: np.exp(-(z**2)), 7.0),
    "tanh": ("(1 - tanh{u}**2)", lambda z: _bell(z) ** 2, 20.0),
    "cosh": ("1/cosh({u})", _bell, 38.0),
    "doublet": ("{u}*exp(-{u}**2)", lambda z: z * np.exp(-(z**2)), 7.0),
    "gate": (
        "(tanh({u} + 3) - tanh({u} - 3))/2",
        lambda z: 0.5 * (np.tanh(z + 3.0) - np.tanh(z - 3.0)),
        23.0,
    ),
}
"""Formula, the same on arrays, and where it ends, in widths."""


def _order(random: Random) -> float:
    return float(random.choice([random.uniform(0.05, 0.97), random.uniform(1.03, 1.99)]))


def _closed(scene: Scene) -> ExactSolution:
    found = match_scene(scene)
    if found is None:
        raise ValueError("no closed form")
    return found


def _draw(random: Random, slope: float = 0.0, **start: float) -> Drawn:
    """A linear oscillator that one or two pulses push beside a line, or in a free motion."""
    final_time = float(random.uniform(2, 30))
    damping = [FractionalDamping(order=_order(random), coefficient=10 ** random.uniform(-2, 0.5))]
    stiffness = float(10 ** random.uniform(-0.5, 1.5))
    pulses: list[tuple[float, float, float, Shape, float]] = []
    texts = [f"{SLOPED!r} + {slope!r}*t"] if slope else []
    for _ in range(random.integers(1, 3)):
        formula, shape, reach = PROFILES[str(random.choice(list(PROFILES)))]
        width = final_time * float(10 ** random.uniform(LEAST_WIDTH, MOST_WIDTH))
        middle = float(random.uniform(min(reach * width, 0.5 * final_time), 0.9 * final_time))
        height = float(random.choice([-1.0, 1.0]) * 10 ** random.uniform(-1, 1))
        texts.append(f"{height!r}*" + formula.replace("{u}", f"((t - {middle!r})/{width!r})"))
        pulses.append((height, middle, width, shape, reach))

    def oscillator(**more: object) -> Scene:
        data: dict[str, Any] = {
            "stiffness": stiffness,
            "damping": damping,
            "final_time": final_time,
            **more,
        }
        return linear_oscillator(**data)

    starts = {f"initial_{name}": value for name, value in start.items()}
    scene = oscillator(forcing=Forcing.from_text(" + ".join(texts)), **starts)

    def known() -> Known:
        impulse = _closed(oscillator(initial_velocity=1.0, derivative="riemann-liouville"))
        times = [final_time * random.uniform(0.0, 1.0, TIMES)]
        times += [m + w * random.uniform(-4, 4, 8) for _, m, w, _, _ in pulses]
        at = np.sort(np.concatenate(times))
        at = at[(at > 0) & (at <= final_time)]
        total = np.zeros(at.size)
        if start:
            total += _closed(oscillator(**starts)).position(at).ravel()
        for share, text in ((SLOPED, "1"), (slope, "t")) if slope else ():
            one = _closed(oscillator(forcing=Forcing.from_text(text)))
            total += share * one.position(at).ravel()
        for height, middle, width, shape, reach in pulses:
            total += _pushed(impulse.position, at, height, middle, width, shape, reach)
        scale = float(np.abs(total).max())
        pushed = sum(abs(h) * w * 2 for h, _, w, _, _ in pulses)
        error = OF_SCALE * max(scale, pushed * min(1.0, final_time))
        return Known(
            times=at, positions=total[:, None], error=error, source="convolution with an impulse"
        )

    kind = "pulses on a slope" if slope else "pulses in motion" if start else "pulses at rest"
    return Drawn(kind=kind, scene=scene, known=known, with_output=True)


def _pushed(
    response: Shape,
    times: Array,
    height: float,
    middle: float,
    width: float,
    shape: Shape,
    reach: float,
) -> Array:
    """Convolution of a pulse with the response to an impulse, at times."""
    points, weights = np.polynomial.legendre.leggauss(NODES)
    begin = max(0.0, middle - reach * width)
    total = np.zeros(times.size)
    for index, time in enumerate(times):
        end = min(time, middle + reach * width)
        if end <= begin:
            continue
        # parts of two widths, the last of them halved towards a time inside of the pulse
        edges = np.linspace(begin, end, max(2, math.ceil((end - begin) / (2.0 * width))))
        if time - end < width:
            last = edges[-1] - edges[-2]
            edges = np.concatenate([edges[:-1], end - last * 0.5 ** np.arange(1, 18), [end]])
        half = 0.5 * np.diff(edges)
        at = (edges[:-1] + half)[:, None] + half[:, None] * points
        force = shape((at - middle) / width)
        values = response(np.maximum(time - at, 1e-300).ravel()).reshape(at.shape)
        total[index] = height * float((half[:, None] * weights * force * values).sum())
    return total


def pulses_at_rest(random: Random) -> Drawn:
    """Pulses push an oscillator that is at rest."""
    return _draw(random)


def pulses_in_motion(random: Random) -> Drawn:
    """Pulses push a free motion."""
    return _draw(
        random,
        position=float(random.uniform(-1, 1)),
        velocity=float(random.uniform(-1, 1)),
    )


def pulses_on_a_slope(random: Random) -> Drawn:
    """Pulses beside a straight line."""
    return _draw(random, float(random.uniform(-0.1, 0.1)))


def riemann_liouville(random: Random) -> Drawn:
    """Riemann-Liouville derivatives of orders up to 1.99 from 0 with a velocity."""
    final_time = float(random.uniform(1, 20))
    scene = linear_oscillator(
        stiffness=float(10 ** random.uniform(-0.5, 1.5)),
        damping=[FractionalDamping(order=_order(random), coefficient=10 ** random.uniform(-2, 1))],
        initial_velocity=float(random.choice([-1.0, 1.0]) * random.uniform(0.1, 2.0)),
        derivative="riemann-liouville",
        final_time=final_time,
    )

    def known() -> Known:
        found = _closed(scene)
        times = np.sort(final_time * random.uniform(0.0, 1.0, TIMES) ** 2)
        values = found.position(times).reshape(times.size, -1)
        error = 3e-13 * float(np.abs(values).max())
        return Known(times=times, positions=values, error=error, source=found.source)

    return Drawn(kind="Riemann-Liouville", scene=scene, known=known, with_output=True)


PULSE_KINDS: tuple[Callable[[Random], Drawn], ...] = (
    pulses_at_rest,
    pulses_in_motion,
    pulses_on_a_slope,
    riemann_liouville,
)
