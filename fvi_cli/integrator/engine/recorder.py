"""What is kept of a run."""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State
from fvi_cli.mathematics.arrays import Array


class Recorder:
    """Positions and momenta after all steps, members first."""

    def __init__(self, state: State) -> None:
        self._x, self._p = [state.x[:, None].copy()], [state.p[:, None].copy()]
        self._t = [np.array([state.t])]

    def add(self, begin: float, h: float, x: Array, p: Array) -> None:
        """Note the ends of equal steps, ``(q, n, e)``."""
        self._x.append(x)
        self._p.append(p)
        self._t.append(begin + h * np.arange(1, x.shape[1] + 1))

    def finish(self, engine: Engine) -> tuple[Array, Array, Array]:
        """Times ``(n + 1,)``, positions and momenta of all scenes ``(S, n + 1, d)``."""
        x, p = engine.to_scene(np.concatenate(self._x, axis=1), np.concatenate(self._p, axis=1))
        return np.concatenate(self._t), x, p
