"""Scenes of many equal parts: a chain of masses, a building, a string."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece
from fvi_cli.effects.matrices import Form, SparseMatrix
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.data import (
    Damper,
    SceneData,
    given_force,
    linear_oscillator,
    per_coordinate,
    scene_function,
    with_dampers,
)
from fvi_cli.scenes.structures.rayleigh import Rayleigh, rayleigh_damping

LARGEST_DENSE: Final = 200
"""Storeys up to which matrices are dense; taller structures are not stepped by modes."""

Ends = Literal["both", "left", "none"]


def springs_form(stiffness: ArrayLike, *, is_sparse: bool = False) -> Form:
    r"""Matrix of :math:`\sum_{i=1}^{n+1} k_i (x_i - x_{i-1})^2` with walls :math:`x_0`, `x_{n+1}`.

    The n + 1 springs are numbered from left to right; an absent spring has k = 0.
    """
    values = np.asarray(stiffness, dtype=float)
    own, coupling = values[:-1] + values[1:], -values[1:-1]
    if not is_sparse:
        return np.diag(own) + np.diag(coupling, 1) + np.diag(coupling, -1)
    from scipy.sparse import diags_array

    bands = [coupling, own, coupling]
    return cast("SparseMatrix", diags_array(bands, offsets=[-1, 0, 1], format="csr"))


def neighbour_rows(masses: int, ends: Ends) -> Array:
    """Rows B such that B x are the elongations of the springs of a chain, from left to right."""
    rows = np.eye(masses + 1, masses) - np.eye(masses + 1, masses, k=-1)
    return rows[int(ends == "none") : masses + int(ends == "both")]


@scene_function
def chain(
    *,
    masses: int = 10,
    mass: float = 1.0,
    stiffness: float = 1.0,
    ends: Ends = "both",
    dampers: Sequence[Damper] = (),
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of n equal masses in a row with a spring and fractional dampers between neighbours.

    .. math:: m x_i'' + \Bigl(k + \sum_j c_j D^{\gamma_j}\Bigr) (2 x_i - x_{i-1} - x_{i+1})
              + \sum_j \mu_j D^{\gamma_j} x_i = f_i(t),

    with :math:`x_0 = x_{n+1} = 0` at walls; at a free end there are no terms of the next mass.
    """
    if ends not in ("both", "left", "none"):
        raise ArgumentError("ends", f"{ends!r} is not one of both, left, none")
    if masses < 1:
        raise ArgumentError("masses", f"{masses!r} is not allowed; there must be at least 1")
    walls = (float(ends != "none"), float(ends == "both"))
    neighbours = springs_form([walls[0], *np.ones(masses - 1), walls[1]])
    return linear_oscillator(
        mass=mass * np.eye(masses),
        stiffness=stiffness * neighbours,
        **with_dampers(data, neighbours, dampers, neighbour_rows(masses, ends)),
    )


def ground_force(acceleration: Forcing | str, masses: Array) -> Forcing:
    r"""The force :math:`-m_i a(t)` on every storey, in coordinates that move with the ground."""
    force = given_force(acceleration, "ground_acceleration")
    if force is None or force.dimension != 1:
        raise ArgumentError("ground_acceleration", "the ground has one component")
    pieces = []
    for piece in force.pieces:
        (component,) = piece.components
        by_mass = {m: _times(component, -m) for m in {float(m) for m in masses}}
        pieces.append(
            ForcingPiece(components=tuple(by_mass[float(m)] for m in masses), until=piece.until)
        )
    return Forcing(pieces=tuple(pieces))


def _times(component: ForceComponent, factor: float) -> ForceComponent:
    return (
        component.times(factor) if isinstance(component, Expression) else component.scaled(factor)
    )


@scene_function
def frame(
    *,
    storeys: int = 3,
    mass: ArrayLike = 1.0,
    stiffness: ArrayLike = 1.0,
    ground_acceleration: Forcing | str | None = None,
    dampers: Sequence[Damper] = (),
    rayleigh: Rayleigh | None = None,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of a building of n storeys that shear, shaken by the ground.

    With :math:`x_i` the displacement of storey i against the ground, :math:`x_0 = 0`, and the
    shear :math:`s_i = \bigl(k_i + \sum_j c_j D^{\gamma_j}\bigr) (x_i - x_{i-1})` (viscoelastic
    walls or dampers),

    .. math:: m_i x_i'' + s_i - s_{i+1} + \sum_j \mu_j D^{\gamma_j} x_i = -m_i a(t),

    and with `rayleigh` Rayleigh's damping.
    """
    masses = _per_part(mass, storeys, "mass")
    springs = _per_part(stiffness, storeys, "stiffness")
    if ground_acceleration is not None:
        data["forcing"] = ground_force(ground_acceleration, masses)
    is_tall = storeys > LARGEST_DENSE
    # there is no spring above the roof
    stiffness_form = springs_form([*springs, 0.0], is_sparse=is_tall)
    between = springs_form([*np.ones(storeys), 0.0], is_sparse=is_tall)
    mass_form: Form = np.diag(masses)
    if is_tall:
        from scipy.sparse import diags_array

        mass_form = cast("SparseMatrix", diags_array(masses, format="csr"))
    if rayleigh is not None:
        viscous = rayleigh_damping(mass_form, stiffness_form, rayleigh)
        data["damping"] = (*data.get("damping", ()), viscous)
    return linear_oscillator(
        mass=mass_form,
        stiffness=stiffness_form,
        **with_dampers(data, between, dampers, neighbour_rows(storeys, "left")),
    )


def pluck_amplitudes(modes: int, at: float, height: float) -> Array:
    r"""Sine coefficients of a triangle of `height` at the fraction `at` of the length.

    .. math:: q_j = \frac{2 H}{j^2 \pi^2 a (1 - a)} \sin(j \pi a), \quad j = 1..n
    """
    if not 0.0 < at < 1.0:
        raise ArgumentError("pluck.at", f"{at!r} is not allowed; it must lie in (0, 1)")
    j = np.arange(1, modes + 1)
    return np.asarray(2.0 * height * np.sin(j * np.pi * at) / (j**2 * np.pi**2 * at * (1.0 - at)))


@scene_function
def string(
    *,
    modes: int = 8,
    wave_speed: float = 1.0,
    length: float = 1.0,
    pluck: tuple[float, float] | None = None,
    internal_damping: Sequence[Damper] = (),
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of the first n modes of a string that is held at both ends.

    .. math:: u_{tt} + \sum_j \mu_j D_t^{\gamma_j} u - \sum_j \eta_j D_t^{\gamma_j} u_{ss}
              = c^2 u_{ss}, \qquad u = \sum_{j=1}^{n} x_j(t) \sin(j \pi s / L)

    gives, because the sines are orthogonal,

    .. math:: x_j'' + \sum_i \bigl(\mu_i + \eta_i \kappa_j^2\bigr) D^{\gamma_i} x_j
              + c^2 \kappa_j^2 x_j = f_j(t), \qquad \kappa_j = j \pi / L .
    """
    wave_numbers = np.arange(1, modes + 1) * np.pi / length
    if pluck is not None:
        position = per_coordinate(data.get("initial_position", 0.0), modes)
        data["initial_position"] = position + pluck_amplitudes(modes, *pluck)
    return linear_oscillator(
        mass=np.eye(modes),
        stiffness=np.diag((wave_speed * wave_numbers) ** 2),
        **with_dampers(data, np.diag(wave_numbers**2), internal_damping),
    )


def _per_part(value: ArrayLike, size: int, name: str) -> Array:
    vector = per_coordinate(value, size)
    if vector.shape != (size,):
        raise ArgumentError(name, f"{vector.size} entries for {size} storeys")
    return vector
