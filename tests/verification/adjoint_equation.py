r"""The other half of the restricted variational principle: the equation of y.

The doubled system moves x forward with the retarded derivative and y backward with the advanced
one (Hariz Belgacem, Jimenez, Ober-Bloebaum, arXiv 2403.18362, section on the discrete restricted
Hamilton's principle). The discrete equations of y have the same discrete Lagrangian and the right
operator :math:`J_+`. With data at the end that are those of x at the start, velocity reversed, and
forcing f(T - t), :math:`y_k = x_{N-k}`: the mirror system adds no physics. This module exists to
test that; it is written literally, in positions and with the plain weights.
"""

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.bdf import convolution_weights

Array = NDArray[np.float64]


def integrate_advanced(
    scene: Scene, method: Method, n_steps: int, end_position: Array, end_velocity: Array
) -> Array:
    r"""Positions y_0..y_N, from data at t = T backwards, shape ``(N + 1, d)``.

    For the step from t_k to t_{k+1} with values :math:`y_k^0..y_k^s`, rows :math:`\nu = 1..s`:

    .. math:: D_{\nu+1} L_d(y_k) - h \sum_i \beta_i l_\nu(\chi_i) G_{i,k} = P_{k+1}\delta_{\nu s},
              \qquad G_{i,k} = \mu h^{-\gamma} \sum_n \omega_n Y_{i,k+n}.

    For samples on the nodes the rule is mirrored: the sample of a step lies at its right end.

    Parameters
    ----------
    scene
        Effects; its own initial data are not used. Riemann-Liouville derivative.
    method
        BDF method without start correction.
    n_steps
        Number N of steps.
    end_position, end_velocity
        y and y' at T, shape ``(d,)``.

    Raises
    ------
    ValueError
        For Runge-Kutta methods and start corrections.
    """
    if method.is_runge_kutta or method.start != "none":
        raise ValueError("the equation of y is written for BDF without a start correction")
    tables = step_tables(method)
    h = scene.final_time / n_steps
    s, d = tables.degree, scene.dimension
    mass, potential = scene.inertia.mass, scene.potential
    nodes = method.sampling == "nodes"
    # the mirror image of the sampling rule: on the nodes the right end, otherwise the same points
    sample_basis = np.eye(s + 1)[:, -1:] if nodes else tables.sample_basis
    sample_weights = np.ones(1) if nodes else tables.weights
    weights = [
        (h ** (-term.order) * convolution_weights(method.bdf_order, term.order, n_steps + 1), term)
        for term in scene.active_damping
    ]
    moments = np.zeros((n_steps, s + 1, d))
    if scene.forcing is not None:
        values = scene.forcing.on_steps(h * np.arange(n_steps), h, tables.points)
        moments = h * np.einsum("ni,kid->knd", tables.test_weights, values)
    m = sample_basis.shape[1]
    samples = np.zeros((n_steps + 1, m, d))
    result = np.empty((n_steps + 1, d))
    result[n_steps] = end_position
    momentum = mass @ end_velocity
    stiffness = np.einsum("i,ni,mi->nm", tables.weights, tables.slopes, tables.slopes) / h
    newest = sum((w[0] * term.matrix for w, term in weights), start=np.zeros((d, d)))
    for k in range(n_steps - 1, -1, -1):
        values = np.repeat(result[k + 1][None], s + 1, axis=0)
        past = np.zeros((m, d))
        for w, term in weights:
            later = samples[k + 1 : n_steps]
            past += np.einsum("n,nid->id", w[1 : later.shape[0] + 1], later) @ term.matrix

        def residual(values: Array, k: int = k, past: Array = past) -> tuple[Array, Array]:
            points = tables.basis.T @ values
            force = past + (sample_basis.T @ values) @ newest
            if nodes and k == n_steps - 1:
                force = np.zeros((m, d))
            rows = stiffness @ values @ mass + moments[k]
            if potential is not None:
                rows = rows - h * tables.test_weights @ potential.gradient(points)
            kick = sample_weights * sample_basis
            return rows - h * kick @ force, force

        for _ in range(50):
            rows, _ = residual(values)
            error = rows[1:].copy()
            error[-1] -= momentum
            jacobian = np.kron(stiffness, mass)
            if potential is not None:
                curvature = potential.hessian(tables.basis.T @ values)
                jacobian = jacobian - h * np.einsum(
                    "ni,mi,iab->namb", tables.test_weights, tables.basis, curvature
                ).reshape((s + 1) * d, -1)
            if not (nodes and k == n_steps - 1):
                kick = sample_weights * sample_basis
                jacobian = jacobian - h * np.kron(kick @ sample_basis.T, newest)
            # y_k^s is known; the unknowns are y_k^0 .. y_k^{s-1}, the equations rows 1..s
            update = np.linalg.solve(jacobian[d:, :-d], error.ravel()).reshape(s, d)
            values[:-1] -= update
            if np.abs(update).max() <= 1e-15 * max(1e-300, np.abs(values).max()):
                break
        rows, _ = residual(values)
        momentum = -rows[0]
        samples[k] = sample_basis.T @ values
        result[k] = values[0]
    return result
