"""How far a motion is regular: in its mass matrix and energy, and in the order of its momenta."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fvi_cli.effects.diagnostics_request import DiagnosticsRequest
from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.meshes.singular_start import rate_jumps
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.definite import least_scaled_eigenvalue

AHEAD = np.linspace(0.0, 2.0, 9)
"""Distances ahead of a failed step, in steps, at which the mass matrix is examined."""
NEARLY_SINGULAR = 0.1
"""A mass matrix is mentioned if its least eigenvalue falls to this share (guessed)."""
MOST_FOR_MOMENTA = 2**27
"""Most numbers of the steps that are kept to compute the momenta."""


def has_rough_momenta(scene: Scene, method: Method) -> bool:
    """Whether momenta at mesh points keep an error of the first step, h**(2 - order), for good."""
    return method.cq == "gauss" and rate_jumps(scene)


def keeps_for_momenta(scene: Scene, method: Method, n_steps: int) -> bool:
    """Whether all steps are kept because momenta are computed from their velocities."""
    size = n_steps * scene.dimension * (method.degree + 2)
    return has_rough_momenta(scene, method) and size <= MOST_FOR_MOMENTA


def rough_remarks(
    scene: Scene, request: DiagnosticsRequest, *, are_stored_smooth: bool
) -> tuple[str, ...]:
    """Remark on values that have the error of the first step, if the momenta are rough."""
    what = [] if are_stored_smooth else ["momenta and energies"]
    what += ["dissipated work and energies of the balance"] if request.energy_balance else []
    what += ["momentum maps"] if request.symmetries else []
    more = "; positions do not, nor do velocities by quantities, such as vx"
    return (rough_remark(scene, f"{' and '.join(what)} keep", more),) if what else ()


def rough_remark(scene: Scene, what: str, more: str = "") -> str:
    """Remark on the values, `what`, that keep the error of the first step."""
    order = max(term.order for term in scene.active_damping)
    return (
        f"{what} an error like h**{2 - order:.4g} of the first step h (a Riemann-Liouville "
        f"derivative of order {order:g} of a motion with an initial velocity){more}"
    )


def regular_until(
    lagrangian: Lagrangian, position: Array, velocity: Array, energy: Array, grid: Array
) -> tuple[int, Failure | None]:
    """How many points of the grid have a positive definite mass matrix and an energy.

    Returns their number, and the failure after them or None. The path's end may be not finite.
    """
    with np.errstate(all="ignore"):
        mass = lagrangian.derivatives(position, velocity, grid).mass
    wrong = np.logical_not(np.isfinite(mass).all(axis=(1, 2)))
    mass = np.where(np.expand_dims(wrong, (1, 2)), 0.0, mass)
    smallest = least_scaled_eigenvalue(mass)
    bad = np.flatnonzero(~(smallest > 0) | ~np.isfinite(energy))
    if not bad.size:
        return grid.size, None
    first = int(bad[0])
    step, time = max(first - 1, 0), float(grid[first])
    place = f"step {step}, t = {time:.6g}: "
    if smallest[first] > 0:
        # derivatives may be finite where L is not, as beyond the end of a logarithm
        near = ", ".join(f"{value:.4g}" for value in position[first])
        words = f"{place}the Lagrangian is not finite near q = [{near}]"
        return first, Failure(words, "irregular", step, time)
    words = (
        f"{place}the mass matrix d2L/dv2 is not positive definite any more "
        f"(smallest eigenvalue {np.linalg.eigvalsh(mass[first])[0]:.3g})"
    )
    return first, Failure(words, "irregular", step, time)


def with_singular_mass(
    failure: Failure, lagrangian: Lagrangian, path: Array, time: Array, step: float
) -> Failure:
    """The failure of a step after `path`, with a hint if the mass ahead is nearly singular."""
    here, velocity = path[-1], 0.0 * path[-1]
    if len(path) > 1:
        velocity = (path[-1] - path[-2]) / (time[-1] - time[-2])
    ahead = np.stack([path[0], *(here + AHEAD[:, None] * step * velocity)])
    with np.errstate(all="ignore"):
        mass = lagrangian.derivatives(ahead, np.broadcast_to(velocity, ahead.shape), time[-1]).mass
        if not np.isfinite(mass).all():
            return failure
        least = np.linalg.eigvalsh(mass)[:, 0]
    if least[1:].min() > NEARLY_SINGULAR * least[0]:
        return failure
    return replace(
        failure, words=f"{failure.words}, or see whether the mass matrix is singular there"
    )
