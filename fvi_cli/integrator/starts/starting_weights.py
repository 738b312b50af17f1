r"""Starting weights: convolution quadrature made exact on given powers (Lubich 1986).

For each sampling point :math:`\chi` the quadrature of :math:`D^\gamma f` at
:math:`t_k + \chi h` gains the terms :math:`h^{-\gamma} \sum_j w_{kj} f_j` over the first few
samples, with the w that make it exact for :math:`f = t^\sigma`, :math:`\sigma` in a given set.
This is the "correction term" of the paper (section "Numerical examples"). It gives up the
convolution structure, and with it semigroup and integration by parts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import gamma as gamma_function
from scipy.special import rgamma

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import StepTables, step_tables
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.bdf import convolution_weights

if TYPE_CHECKING:
    from mpmath import mpf

CONDITION_WARNING = 1e8  # weights of a larger condition get a remark
MOST_ITERATIONS = 20  # of Newton for the first samples
CONDITION_LIMIT = 1e12
"""Weights of a larger condition are left out: from 2e13 on errors of 5 to 1e8 were measured (a
pendulum, orders 0.3 to 1.95, BDF2 to 6 on 100 and 400 steps); up to 3e11 no error was above that
without weights."""


def starting_weights(
    bdf_order: int,
    order: float,
    exponents: tuple[float, ...],
    n_times: int,
    *,
    offset: float = 0.0,
) -> tuple[Array, float]:
    r"""Weights on the first samples that make the quadrature exact on powers.

    There are as many samples, at :math:`(k + \chi) h`, as powers :math:`\sigma > 0`; without an
    offset the sample at 0, where every power vanishes, is left out. Returns the weights
    :math:`w_{kj}` for h = 1, ``(n_times, len(exponents))``, and the condition number of the
    generalised Vandermonde matrix.
    """
    times = offset + np.arange(n_times, dtype=np.longdouble)
    weights = convolution_weights(bdf_order, order, n_times)
    defects = np.zeros((len(exponents), n_times), dtype=np.longdouble)
    later = times > 0
    for row, exponent in enumerate(exponents):
        factor = gamma_function(exponent + 1) * rgamma(exponent + 1 - order)
        defects[row, later] = factor * times[later] ** (exponent - order)
        # summed directly: the error of an FFT is that of the largest power, lost on the first steps
        defects[row] -= np.convolve(weights, times**exponent)[:n_times]
    inverse, condition = _inverse_vandermonde(offset, exponents)
    return np.asarray((inverse @ defects).T, dtype=float), condition


@lru_cache(maxsize=64)
def _inverse_vandermonde(
    offset: float, exponents: tuple[float, ...]
) -> tuple[NDArray[np.longdouble], float]:
    """Inverse of the matrix node_j**sigma_i from 60-digit arithmetic, and its condition number."""
    from mpmath import mp, mpf

    nodes = (1.0 if offset == 0 else 0.0) + offset + np.arange(len(exponents), dtype=float)
    with mp.workdps(60):
        matrix = mp.matrix([[mpf(float(x)) ** mpf(float(e)) for x in nodes] for e in exponents])
        try:
            inverse = mp.inverse(matrix)
        except ZeroDivisionError:
            return np.zeros((len(exponents),) * 2, dtype=np.longdouble), math.inf
        condition = float(mp.norm(matrix, 1) * mp.norm(inverse, 1))
        entries = [
            [_long(inverse[i, j]) for j in range(len(exponents))] for i in range(len(exponents))
        ]
    return np.array(entries, dtype=np.longdouble), condition


def _long(value: mpf) -> np.longdouble:
    """A 60-digit number as the sum of its double and the double of the rest."""
    head = float(value)
    return np.longdouble(head) + np.longdouble(float(value - head))


def corrected_powers(method: Method) -> tuple[tuple[float, ...], str]:
    """Powers that the starting weights of a run correct, and a remark on them.

    Empty if the weights would keep too few digits: then the run has no weights.
    """
    exponents = method.start_exponents
    powers = ", ".join(f"t^{e:g}" for e in exponents)
    offsets = _offsets(method, step_tables(method))
    worst = max(_inverse_vandermonde(float(chi), exponents)[1] for chi in offsets)
    if worst > CONDITION_LIMIT:
        return (), (
            f"starting weights left out: condition {worst:.2g} on {powers} leaves too few digits; "
            "take rk: gauss with start: graded, or fewer powers"
        )
    remark = f"starting weights on {powers}: condition {worst:.2g}"
    if worst > CONDITION_WARNING:
        remark += " (ill conditioned: expect to lose that many digits)"
    return exponents, remark


def _offsets(method: Method, tables: StepTables) -> Array:
    """Places of the samples in a step; for samples on the nodes only the left end."""
    return tables.sample_points[:1] if method.sampling == "nodes" else tables.sample_points


FirstSamples = Callable[[Array, int], Array]
"""From load vectors ``(N, s + 1, d)`` and n to samples of n steps without the start, (n, m, d)."""


def corrected_start(
    scene: Scene, method: Method, tables: StepTables, n_steps: int, first_samples: FirstSamples
) -> tuple[Array | None, tuple[str, ...]]:
    """Load vectors of the force of the starting weights, solving for the first samples together.

    The first n samples determine the added force, and the force determines the samples: a small
    system, affine for linear scenes, solved by Newton's iteration with a Jacobian from runs over
    the first steps alone.

    `first_samples` gives the samples of a run with certain load vectors. Returns load vectors
    ``(N, s + 1, d)``, None without a correction; and remarks.
    """
    exponents, remark = corrected_powers(method)
    if exponents and n_steps < len(exponents) + (method.sampling == "nodes"):
        exponents, remark = (), f"starting weights left out: {n_steps} steps are too few"
    if not exponents:
        return None, (remark,)
    correction = _Correction(scene, method, tables, n_steps, exponents)
    return correction.solved(first_samples), (remark,)


class _Correction:
    """The force of starting weights from the first samples, and the samples from the force."""

    def __init__(
        self,
        scene: Scene,
        method: Method,
        tables: StepTables,
        n_steps: int,
        exponents: tuple[float, ...],
    ) -> None:
        self._scene, self._tables, self._n_steps = scene, tables, n_steps
        # the first sample is the start, where every power vanishes
        self._on_nodes, offsets = method.sampling == "nodes", _offsets(method, tables)
        self._h = h = scene.final_time / n_steps
        self._first = 1 if self._on_nodes else 0
        self._shape = (len(exponents), len(offsets), scene.dimension)
        times = h * (self._first + np.arange(len(exponents))[:, None] + offsets)
        # for every term the weights, the part of the start velocity that Caputo subtracts above
        # order 1, and the matrix
        self._terms: list[tuple[Array, Array, Array]] = []
        for term in scene.active_damping:
            weights = [
                starting_weights(
                    method.bdf_order, term.order, exponents, n_steps + 1, offset=float(chi)
                )[0]
                for chi in offsets
            ]
            subtracted = np.zeros(self._shape)
            if term.order > 1:
                subtracted = times[:, :, None] * scene.initial_velocity
            own = h ** (-term.order) * np.stack(weights, axis=1)
            self._terms.append((own, subtracted, term.matrix))

    def loads_of(self, samples: Array) -> Array:
        """Load vectors from samples of shape ``(n_exponents, m, d)``."""
        force = np.zeros((self._n_steps + 1, *self._shape[1:]))
        for weights, subtracted, matrix in self._terms:
            force += np.einsum("kij,jid->kid", weights, samples - subtracted) @ matrix
        if self._on_nodes:
            # at both ends of every step; the first kick is left out
            force = np.stack([force[:-1, 0], force[1:, 0]], axis=1)
            force[0, 0] = 0.0
        to_loads = -self._h * self._tables.to_loads
        return np.asarray(np.einsum("vm,kmd->kvd", to_loads, force[: self._n_steps]))

    def solved(self, first_samples: FirstSamples) -> Array:
        """Load vectors from the samples of the run that has these load vectors."""
        count, offsets, _ = self._shape

        def samples_of(unknown: Array) -> Array:
            loads = self.loads_of(unknown.reshape(self._shape))
            found = first_samples(loads, count + self._first)
            return found[self._first :, :offsets].ravel()

        unknown = np.zeros(math.prod(self._shape))
        for _ in range(2 if self._scene.is_linear else MOST_ITERATIONS):
            value = samples_of(unknown)
            size = max(1e-3 * self._h, float(np.abs(value).max()))
            jacobian = np.empty((unknown.size, unknown.size))
            for column in range(unknown.size):
                moved = unknown.copy()
                moved[column] += size
                jacobian[:, column] = (samples_of(moved) - value) / size
            update = np.linalg.solve(np.eye(unknown.size) - jacobian, value - unknown)
            unknown = unknown + update
            if float(np.abs(update).max()) <= 1e-14 * float(np.abs(unknown).max()):
                break
        return self.loads_of(unknown.reshape(self._shape))
