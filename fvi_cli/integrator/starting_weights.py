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

import numpy as np
from scipy.special import gamma as gamma_function
from scipy.special import rgamma

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array, LongArray
from fvi_cli.mathematics.bdf import convolution_weights

MOST_ITERATIONS = 20  # of Newton for the first samples
CONDITION_LIMIT = 1e12
"""Weights of a larger condition are refused: from 2e13 on errors of 5 to 1e8 were measured (a
pendulum, orders 0.3 to 1.95, BDF2 to 6 on 100 and 400 steps); up to 3e11 no error was above that
without weights."""

FirstSamples = Callable[[Array, int], Array]
"""From load vectors ``(N, s + 1, d)`` and n to samples of n steps without the start, (n, m, d)."""


def starting_weights(
    bdf_order: int, order: float, exponents: tuple[float, ...], n_times: int, *, offset: float = 0.0
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
def _inverse_vandermonde(offset: float, exponents: tuple[float, ...]) -> tuple[LongArray, float]:
    """Inverse of the matrix node_j**sigma_i, and its condition number."""
    n = len(exponents)
    nodes = np.longdouble(offset) + np.arange(n) + (offset == 0)
    matrix = nodes ** np.array(exponents, dtype=np.longdouble)[:, None]
    inverse = np.linalg.inv(matrix.astype(float)).astype(np.longdouble)
    # Newton's iteration (Schulz 1933) in extended precision
    for _ in range(3):
        inverse = inverse @ (2 * np.eye(n) - matrix @ inverse)
    return inverse, float(np.linalg.cond(matrix.astype(float), 1))


def weights_objection(method: Method, n_steps: int | None = None) -> str:
    """Why a method cannot correct its powers, in a number of steps; empty if it can."""
    powers = method.start_exponents
    worst = max(_inverse_vandermonde(chi, powers)[1] for chi in _offsets(method).tolist())
    if worst > CONDITION_LIMIT:
        return (
            f"start: weights on {', '.join(f't^{e:g}' for e in powers)} leave too few digits "
            f"(condition {worst:.2g}); give fewer powers, or take rk: gauss with start: graded"
        )
    fewest = len(powers) + (method.sampling == "nodes")
    if n_steps is not None and n_steps < fewest:
        return f"start: weights on {len(powers)} powers take {fewest} steps or more"
    return ""


def _offsets(method: Method) -> Array:
    """Places of the samples in a step; for samples on the nodes only the left end."""
    points = step_tables(method).sample_points
    return points[:1] if method.sampling == "nodes" else points


def starting_loads(
    scene: Scene, method: Method, n_steps: int, first_samples: FirstSamples
) -> Array:
    """Load vectors of the force of the starting weights, ``(N, s + 1, d)``.

    The first samples determine the added force, and the force determines the samples: a small
    system, affine for linear scenes, solved by Newton's iteration with a Jacobian from runs over
    the first steps alone. `first_samples` gives the samples of a run with certain load vectors.

    Raises
    ------
    ValueError
        For powers that leave too few digits, too few steps, and a general Lagrangian.
    """
    if scene.lagrangian is not None:
        raise ValueError("start: weights are not made for a general Lagrangian; use none")
    if reason := weights_objection(method, n_steps):
        raise ValueError(reason)
    powers, h, offsets = method.start_exponents, scene.final_time / n_steps, _offsets(method)
    # the first sample on nodes is the start, where every power vanishes
    on_nodes = method.sampling == "nodes"
    first, shape = int(on_nodes), (len(powers), len(offsets), scene.dimension)
    times = h * (first + np.arange(len(powers))[:, None] + offsets)
    # for every term the weights (N + 1, n, m), the part of the start velocity that Caputo subtracts
    # above order 1, and the matrix
    terms: list[tuple[Array, Array, Array]] = []
    for term in scene.active_damping:
        weights = [
            starting_weights(method.bdf_order, term.order, powers, n_steps + 1, offset=chi)[0]
            for chi in offsets.tolist()
        ]
        subtracted = (term.order > 1) * times[:, :, None] * scene.initial_velocity
        terms.append((h ** (-term.order) * np.stack(weights, axis=1), subtracted, term.matrix))

    def loads_of(samples: Array) -> Array:
        """Load vectors from samples of shape ``(n, m, d)``, flat."""
        force = np.zeros((n_steps + 1, *shape[1:]))
        for weights, subtracted, matrix in terms:
            moved = samples.reshape(shape) - subtracted
            force += np.einsum("kij,jid->kid", weights, moved) @ matrix
        if on_nodes:
            # at both ends of every step; the first kick is left out
            force = np.stack([force[:-1, 0], force[1:, 0]], axis=1)
            force[0, 0] = 0.0
        to_loads = -h * step_tables(method).to_loads
        return np.asarray(np.einsum("vm,kmd->kvd", to_loads, force[:n_steps]))

    def samples_of(samples: Array) -> Array:
        """The samples of the run with these load vectors."""
        found = first_samples(loads_of(samples), len(powers) + first)
        return found[first:, : len(offsets)].ravel()

    unknown = np.zeros(math.prod(shape))
    for _ in range(2 if scene.is_linear else MOST_ITERATIONS):
        value = samples_of(unknown)
        size = max(1e-3 * h, float(np.abs(value).max()))
        moved = [samples_of(unknown + size * unit) for unit in np.eye(unknown.size)]
        jacobian = (np.array(moved) - value).T / size
        update = np.linalg.solve(np.eye(unknown.size) - jacobian, value - unknown)
        unknown = unknown + update
        if float(np.abs(update).max()) <= 1e-14 * float(np.abs(unknown).max()):
            break
    return loads_of(unknown)
