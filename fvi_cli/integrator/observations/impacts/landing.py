"""Steps that end on a surface."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.mathematics.arrays import Array

SWEEPS = 60  # most steps that are tried


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneStep:
    """A solved step in the coordinates of the scene."""

    begin: float
    size: float
    position: Array  # at its beginning, (d,)
    momentum: Array
    end_position: Array
    end_momentum: Array
    unknowns: Array  # (s, d)

    @property
    def end(self) -> float:
        """Time at its end."""
        return self.begin + self.size

    @property
    def reach(self) -> Array:
        """Largest displacements, shape ``(d,)``."""
        return np.asarray(self.size * np.abs(self.unknowns).max(axis=0))

    @classmethod
    def of(cls, engine: Engine, state: State, steps: Steps) -> SceneStep:
        """The step from one solved step of one scene."""
        x = np.stack([state.x, state.x + steps.dx[:, 0]], axis=1)
        p = np.stack([state.p, state.p + steps.dp[:, 0]], axis=1)
        x, p = engine.to_scene(x, p)
        return cls(
            begin=state.t,
            size=steps.h,
            position=x[0, 0],
            momentum=p[0, 0],
            end_position=x[0, 1],
            end_momentum=p[0, 1],
            unknowns=engine.scene_positions(steps.unknowns[:, 0])[0],
        )


@dataclass(kw_only=True, eq=False)
class Landing:
    """The search for the length of the step that ends on a surface.

    Newton's iteration, and bisection where that leaves the part of the step in which the gap
    changes its sign.
    """

    surface: str
    low: float  # lengths between which the root lies
    high: float
    size: float  # length to try; in the end that of the best step
    has_ended: bool = False
    _best: tuple[float, float, float] | None = None
    _sweeps: int = 0

    def take(self, gap: float, speed: float, tolerance: float) -> bool:
        """Whether the search ends, from the gap at the end of this step and its rate."""
        now, best = self.size, self._best
        self._sweeps += 1
        if best is None or abs(gap) < abs(best[1]):
            self._best = now, gap, tolerance
        elif abs(best[1]) <= best[2]:
            return self._end()
        self.low, self.high = (now, self.high) if gap > 0.0 else (self.low, now)
        self.size = now - gap / speed if speed else now
        if not self.low < self.size < self.high:
            self.size = 0.5 * (self.low + self.high)
        is_still = gap == 0.0 or abs(self.size - now) <= 0.5 * math.ulp(now)
        return self._end() if is_still or self._sweeps == SWEEPS else False

    def _end(self) -> bool:
        """Go back to the best step."""
        if self._best is not None:
            self.size, self.has_ended = self._best[0], True
        return self.has_ended
