"""Random scenes whose forces are narrow pulses.

A pulse of a linear scene moves it by the convolution with the response to an impulse, which is the
free motion with Riemann-Liouville derivatives from 0 with a velocity; that has a closed form.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.tolerance_scenes import Array, Drawn, Known, Random
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.scene import Scene
from fvi_cli.scenes.structures import linear_oscillator
from tests.oracles.linear_response import ExactSolution, match_scene

TIMES = 60
NODES = 14
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


def _draw(
    random: Random,
    *,
    slope: float = 0.0,
    widths: tuple[float, float] = (-4.0, -2.0),
    told_at: Sequence[float] = (),
    **start: float,
) -> Drawn:
    """A linear oscillator that one or two pulses push beside a line, or in a free motion.

    Decades of the widths of pulses are relative to T, break points in widths from their middles.
    """
    final_time = float(random.uniform(2, 30))
    damping = [FractionalDamping(order=_order(random), coefficient=10 ** random.uniform(-2, 0.5))]
    stiffness = float(10 ** random.uniform(-0.5, 1.5))
    pulses: list[tuple[float, float, float, Shape, float]] = []
    texts = [f"{SLOPED!r} + {slope!r}*t"] if slope else []
    for _ in range(random.integers(1, 3)):
        formula, shape, reach = PROFILES[str(random.choice(list(PROFILES)))]
        width = final_time * float(10 ** random.uniform(*widths))
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
    forcing = Forcing.from_text(" + ".join(texts))
    points = sorted({m + share * w for _, m, w, _, _ in pulses for share in told_at})
    ends = [one for one in points if 0.0 < one < final_time]
    components = forcing.components
    pieces = [ForcingPiece(components=components, until=end) for end in (*ends, math.inf)]
    scene = oscillator(forcing=Forcing(pieces=tuple(pieces)), **starts)

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
        return Known(at, total[:, None], error, "convolution with an impulse")

    kind = "pulses on a slope" if slope else "pulses in motion" if start else "pulses at rest"
    return Drawn(f"narrower {kind}" if told_at else kind, scene, known)


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


def pulses_at_rest(random: Random, **more: Any) -> Drawn:
    """Pulses push an oscillator that is at rest."""
    return _draw(random, **more)


def pulses_in_motion(random: Random, **more: Any) -> Drawn:
    """Pulses push a free motion."""
    position, velocity = random.uniform(-1, 1, 2).tolist()
    return _draw(random, position=position, velocity=velocity, **more)


def pulses_on_a_slope(random: Random, **more: Any) -> Drawn:
    """Pulses beside a straight line."""
    return _draw(random, slope=float(random.uniform(-0.1, 0.1)), **more)


PULSES: tuple[Callable[..., Drawn], ...] = (
    pulses_at_rest,
    pulses_in_motion,
    pulses_on_a_slope,
)
NARROWER_PULSES = tuple(
    functools.partial(draw, widths=(-8.0, -4.0), told_at=(-20.0, -4.0, 0.0, 4.0, 20.0))
    for draw in PULSES
)
"""With break points at the pulse and around it, in widths."""
