"""Random scenes whose forces are narrow pulses.

A pulse of a linear scene moves it by the convolution with the response to an impulse, which is the
free motion with Riemann-Liouville derivatives from 0 with a velocity; that has a closed form.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.tolerance_scenes import Array, Drawn, Known, Random
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.structures import linear_oscillator
from tests.oracles.linear_response import match_scene

TIMES = 60
NODES = 14
OF_SCALE = 1e-12
"""Error of the closed forms, relative to the motion and to the pulse."""

PROFILES: dict[str, tuple[str, float]] = {
    "exp": ("exp(-{u}**2)", 7.0),
    "tanh": ("(1 - tanh{u}**2)", 20.0),
    "cosh": ("1/cosh({u})", 38.0),
    "doublet": ("{u}*exp(-{u}**2)", 7.0),
    "gate": ("(tanh({u} + 3) - tanh({u} - 3))/2", 23.0),
}
"""Formula, and where it ends, in widths."""


class Pulse(NamedTuple):
    """A profile with its height, the time of its middle and its width."""

    profile: str
    width: float
    middle: float
    height: float

    @property
    def text(self) -> str:
        """Its formula in t."""
        place = f"((t - {self.middle!r})/{self.width!r})"
        return f"{self.height!r}*" + PROFILES[self.profile][0].replace("{u}", place)

    def moved(self, response: Callable[[Array], Array], times: Array) -> Array:
        """Convolution with the response to an impulse, at times."""
        formula, reach = PROFILES[self.profile]
        shape = Expression.parse(formula.replace("{u}", "(t)"), variables=("t",))
        points, weights = np.polynomial.legendre.leggauss(NODES)
        begin = max(0.0, self.middle - reach * self.width)
        total = np.zeros(times.size)
        for index, time in enumerate(times):
            end = min(time, self.middle + reach * self.width)
            if end <= begin:
                continue
            # parts of two widths, the last of them halved towards a time inside of the pulse
            edges = np.linspace(begin, end, max(2, math.ceil((end - begin) / (2.0 * self.width))))
            if time - end < self.width:
                last = edges[-1] - edges[-2]
                edges = np.concatenate([edges[:-1], end - last * 0.5 ** np.arange(1, 18), [end]])
            half = 0.5 * np.diff(edges)
            at = (edges[:-1] + half)[:, None] + half[:, None] * points
            force = np.asarray(shape.evaluate({"t": (at - self.middle) / self.width}))
            values = response(np.maximum(time - at, 1e-300).ravel()).reshape(at.shape)
            total[index] = self.height * float((half[:, None] * weights * force * values).sum())
        return total


def draw_pulses(
    random: Random, kind: str, widths: tuple[float, float], told_at: Sequence[float] = ()
) -> Drawn:
    """A linear oscillator that one or two pulses push at rest, in motion or beside a line.

    Decades of the widths of pulses are relative to T, break points in widths from their middles.
    """
    free: dict[str, Any] = {}
    texts = []
    if kind == "pulses in motion":
        position, velocity = random.uniform(-1, 1, 2).tolist()
        free = {"initial_position": position, "initial_velocity": velocity}
    if kind == "pulses on a slope":
        texts = [f"0.7 + {random.uniform(-0.1, 0.1)!r}*t"]
        free = {"forcing": Forcing.from_text(*texts)}
    final_time = random.uniform(2, 30)
    order = float(random.choice([random.uniform(0.05, 0.97), random.uniform(1.03, 1.99)]))
    damping = [FractionalDamping(order=order, coefficient=10 ** random.uniform(-2, 0.5))]
    stiffness = 10 ** random.uniform(-0.5, 1.5)
    pulses = []
    for _ in range(random.integers(1, 3)):
        profile = str(random.choice(list(PROFILES)))
        width = final_time * 10 ** random.uniform(*widths)
        first = min(PROFILES[profile][1] * width, 0.5 * final_time)
        middle = random.uniform(first, 0.9 * final_time)
        height = float(random.choice([-1.0, 1.0])) * 10 ** random.uniform(-1, 1)
        pulses.append(Pulse(profile, width, middle, height))

    def oscillator(**more: Any) -> Scene:
        return linear_oscillator(
            stiffness=stiffness, damping=damping, final_time=final_time, **more
        )

    components = Forcing.from_text(" + ".join([*texts, *(one.text for one in pulses)])).components
    points = sorted({one.middle + share * one.width for one in pulses for share in told_at})
    ends = [*(one for one in points if 0.0 < one < final_time), math.inf]
    pieces = tuple(ForcingPiece(components=components, until=end) for end in ends)
    scene = oscillator(**{**free, "forcing": Forcing(pieces=pieces)})

    def known() -> Known:
        impulse = match_scene(oscillator(initial_velocity=1.0, derivative="riemann-liouville"))
        times = [final_time * random.uniform(0.0, 1.0, TIMES)]
        times += [one.middle + one.width * random.uniform(-4, 4, 8) for one in pulses]
        at = np.sort(np.concatenate(times))
        at = at[(at > 0) & (at <= final_time)]
        total = match_scene(oscillator(**free)).position(at)[:, 0]
        total = total + sum(one.moved(impulse.position, at) for one in pulses)
        pushed = sum(2 * abs(one.height) * one.width for one in pulses)
        error = OF_SCALE * max(float(np.abs(total).max()), pushed * min(1.0, final_time))
        return Known(at, total[:, None], error)

    return Drawn(f"narrower {kind}" if told_at else kind, scene, known)


NAMES = ("pulses at rest", "pulses in motion", "pulses on a slope")
PULSES = tuple(functools.partial(draw_pulses, kind=kind, widths=(-4.0, -2.0)) for kind in NAMES)
NARROWER_PULSES = tuple(
    functools.partial(
        draw_pulses, kind=kind, widths=(-8.0, -4.0), told_at=(-20.0, -4.0, 0.0, 4.0, 20.0)
    )
    for kind in NAMES
)
"""With break points at the pulse and around it, in widths."""
