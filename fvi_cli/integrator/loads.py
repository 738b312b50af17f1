r"""Load vectors :math:`g_\nu = h \int_0^1 l_\nu(\tau) f(t + \tau h) d\tau` of given forces."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import StepTables
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis
from fvi_cli.mathematics.quadrature import gauss_rule, jacobi_rule

FINE_POINTS = 24  # Gauss points of a panel
GRADED = (0.0, *(0.15 ** np.arange(199, -1, -1.0)).tolist())
"""Ends of panels that shrink towards a singular point: in the first one t**0.1 is below 1e-16, so
that powers from t**-0.9 on are integrated to round-off."""
PANEL_RATIO = 4.0
"""If the end of a step is later than 4 times its beginning, it is integrated in panels whose ends
have this ratio, since forces may be powers of t."""

Force = Callable[[Array, float, Array], Array]
"""As :meth:`fvi_cli.effects.forcing.Forcing.on_steps`."""


@lru_cache(maxsize=64)
def _tested_rule(degree: int, edges: tuple[float, ...]) -> tuple[Array, Array]:
    """Points ``(r,)`` of a rule on panels, and weights times the basis there, ``(s + 1, r)``."""
    fine, ends = gauss_rule(FINE_POINTS), np.array(edges)
    widths = np.diff(ends)[:, None]
    points = (ends[:-1, None] + widths * fine.nodes).ravel()
    return points, lobatto_basis(degree).values(points) * (widths * fine.weights).ravel()


class StepLoads:
    r"""Known forces of a scene, step by step or on many equal steps at once.

    These are its forcing, what Riemann-Liouville derivatives of the initial data add to those of
    Caputo (:attr:`fvi_cli.effects.scene.Scene.initial_loads`), and the force of starting weights.

    ``forcing_quadrature: galerkin`` takes the rule of the action, ``exact`` integrates to
    round-off. What the initial data add is always integrated to round-off, since it is singular at
    0.
    """

    def __init__(self, scene: Scene, method: Method, tables: StepTables) -> None:
        self._forcing, self._tables = scene.forcing, tables
        self._rule, self._dimension = method.forcing_quadrature, scene.dimension
        # for backward differences: load vectors of the first steps, ``(n, s + 1, d)``
        self._added = np.zeros((0, method.degree + 1, scene.dimension))
        self._initial = scene.initial_loads

    def add(self, loads: Array) -> None:
        """Give the load vectors of the force of starting weights, ``(N, s + 1, d)``."""
        self._added = loads

    def of_steps(
        self, begin: float, step_size: float, n_steps: int, *, is_fresh: bool
    ) -> Array | None:
        """Load vectors of equal steps, shape ``(n_steps, s + 1, d)``; None without forces.

        A fresh step begins where a force may be singular.
        """
        parts = self.parts(begin, step_size, n_steps, is_fresh=is_fresh).values()
        return np.add.reduce(list(parts)) if parts else None

    def parts(
        self, begin: float, step_size: float, n_steps: int, *, is_fresh: bool
    ) -> dict[str, Array]:
        """Load vectors of the forces that there are: ``forcing``, ``initial`` data, ``weights``."""
        start, found = begin + step_size * np.arange(n_steps, dtype=float), dict[str, Array]()
        if self._forcing is not None and self._rule == "exact":
            on_steps = self._forcing.on_steps
            found["forcing"] = self._exact(on_steps, start, step_size, is_fresh=is_fresh)
        elif self._forcing is not None:
            values = self._forcing.on_steps(start, step_size, self._tables.points)
            found["forcing"] = step_size * np.einsum(
                "ni,kid->knd", self._tables.test_weights, values
            )
        if self._initial:
            initial = self._exact(self._initial_force, start, step_size, is_fresh=False)
            if begin == 0.0:
                initial[0] = self._initial_loads_at_zero(step_size)
            found["initial"] = initial
        if self._added.size:
            first = round(begin / step_size)
            found["weights"] = self._added[first : first + n_steps]
        return found

    def _initial_force(self, start: Array, step_size: float, offsets: Array) -> Array:
        times = (start[:, None] + step_size * offsets)[..., None]
        return np.asarray(sum(times**power * load for power, load in self._initial))

    def _initial_loads_at_zero(self, step_size: float) -> Array:
        r"""Load vectors of the step from 0 on, shape ``(s + 1, d)``, by Gauss-Jacobi quadrature.

        With :math:`l(\tau) = l(0) + \tau r(\tau)` the singular part of the force :math:`t^e` is
        :math:`h^{1 + e} l(0) / (1 + e)`, an impulse at 0 for e near -1.
        """
        basis = lobatto_basis(self._tables.degree)
        at_zero = basis.values(np.zeros(1))
        total = np.zeros((at_zero.shape[0], self._dimension))
        for power, load in self._initial:
            nodes, weights = jacobi_rule(at_zero.shape[0], 1.0 + power)
            rest = ((basis.values(1.0 - nodes) - at_zero) / (1.0 - nodes)) @ weights
            own = at_zero[:, 0] / (1.0 + power) + rest
            total += step_size ** (1.0 + power) * np.outer(own, load)
        return total

    def _exact(self, force: Force, start: Array, step_size: float, *, is_fresh: bool) -> Array:
        degree, edges = self._tables.degree, [_edges(float(start[0]), step_size, is_fresh=is_fresh)]
        edges += [(0.0, 1.0)] if start.size > 1 else []
        found = []
        for steps, own in zip((start[:1], start[1:]), edges, strict=False):
            points, tested = _tested_rule(degree, own)
            values = force(steps, step_size, points)
            found.append(step_size * np.einsum("ni,kid->knd", tested, values))
        return np.concatenate(found)


def _edges(begin: float, step_size: float, *, is_fresh: bool) -> tuple[float, ...]:
    """Edges in [0, 1] of the panels of a step."""
    if is_fresh:
        return GRADED
    if not 0.0 < begin * (PANEL_RATIO - 1.0) < step_size:
        return (0.0, 1.0)
    n_panels = math.ceil(math.log1p(step_size / begin) / math.log(PANEL_RATIO))
    inside = begin * (PANEL_RATIO ** np.arange(1.0, n_panels) - 1.0) / step_size
    return (0.0, *inside[inside < 1.0].tolist(), 1.0)
