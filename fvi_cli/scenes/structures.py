"""Scenes of linear equations: matrices, chains of masses, buildings, strings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.matrices import (
    Form,
    as_csc,
    dense,
    entries,
    form,
    is_sparse,
    times,
)
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.data import (
    Effect,
    SceneData,
    given_force,
    make_scene,
    per_coordinate,
    scene_function,
    with_dampers,
)
from fvi_cli.scenes.keys.values import BY_FORM, Fraction, Keys, NotNegative, Order, Pair, key
from fvi_cli.scenes.records.inputs import kept_numbers
from fvi_cli.scenes.records.matrices import matrix_of

LARGEST_DENSE: Final = 200
"""Storeys up to which matrices are dense; taller structures are not stepped by modes."""
ROUND_OFF: Final = 1e-13
"""Largest square of a frequency, relative to the mean one, that is round-off of 0."""

Ends = Literal["both", "left", "none"]


class RayleighRatios(Keys):
    """Viscous damping a M + b K by the ratios of two modes."""

    ratios: Pair[Fraction] = key("Damping ratios of two modes.")
    modes: Pair[Annotated[int, Field(ge=1, le=100_000)]] = key(
        "Their numbers, counted from 1 by frequency.", [1, 2]
    )


class RayleighFactors(Keys):
    """Damping (a M + b K) D^gamma x."""

    mass: NotNegative = key("a, the factor of the masses.", 0.0, unit="time^(gamma-2)")
    stiffness: NotNegative = key("b, the factor of the stiffnesses.", 0.0, unit="time^gamma")
    order: Order = key("Order gamma of the derivative.", 1.0)


Rayleigh = Annotated[RayleighRatios | RayleighFactors, BY_FORM]


def rayleigh_damping(mass: Form, stiffness: Form, given: Any) -> FractionalDamping:
    r"""The term :math:`(a M + b K) D^\gamma x` of a mapping with its factors or two ratios.

    Of ratios :math:`\zeta_i = a/(2 \omega_i) + b \omega_i/2`, and the order is 1.

    Raises
    ------
    ArgumentError
        For modes that do not exist or have the same frequency, and ratios that need a negative
        factor, which would make other modes grow.
    """
    keys = given
    if isinstance(given, Mapping):
        model = RayleighRatios if "ratios" in given else RayleighFactors
        keys = model.model_validate(given)
    if isinstance(keys, RayleighFactors):
        whole = keys.mass * mass + keys.stiffness * stiffness
        return FractionalDamping(order=keys.order, coefficient=whole)
    from scipy.optimize import nnls

    (one, other), ratios, size = keys.modes, keys.ratios, mass.shape[0]
    if max(one, other) > size:
        words = f"mode {max(one, other)} does not exist; write 1 to {size}"
        raise ArgumentError("rayleigh.modes", words)
    found = natural_frequencies(mass, stiffness, max(one, other))
    first, second = float(found[one - 1]), float(found[other - 1])
    if not (first > 0 and second > 0) or math.isclose(first, second, rel_tol=1e-9):
        raise ArgumentError(
            "rayleigh.modes",
            f"their angular frequencies are {first:.6g} and {second:.6g}; two different ones "
            "above 0 are needed",
        )
    system = 0.5 * np.array([[1 / first, first], [1 / second, second]])
    (a, b), rest = nnls(system, np.asarray(ratios, dtype=float))
    if rest > 1e-12 * max(ratios):
        raise ArgumentError("rayleigh.ratios", "no factors a and b above 0 give these")
    return FractionalDamping(order=1.0, coefficient=a * mass + b * stiffness)


def natural_frequencies(mass: Form, stiffness: Form, count: int) -> Array:
    """The lowest angular frequencies of M and K, shape ``(count,)``."""
    k, m = as_csc(stiffness), as_csc(mass)
    scale = float(k.diagonal().sum() / m.diagonal().sum())
    if is_sparse(mass) and count < mass.shape[0] - 1:
        from scipy.sparse.linalg import eigsh

        # below 0, since the stiffness of a free structure is singular; one start for every run
        start = np.random.default_rng(1).standard_normal(mass.shape[0])
        shift = -1e-9 * scale
        squares = np.sort(eigsh(k, k=count, M=m, sigma=shift, v0=start, return_eigenvectors=False))
    else:
        from scipy.linalg import eigh

        squares = eigh(
            dense(stiffness), dense(mass), eigvals_only=True, subset_by_index=[0, count - 1]
        )
    return np.asarray(np.sqrt(np.where(squares > ROUND_OFF * scale, squares, 0.0)))


@scene_function
def structure(
    *,
    mass: object = 1.0,
    stiffness: object = 1.0,
    rayleigh: object = None,
    ground_acceleration: Forcing | str | None = None,
    ground_direction: ArrayLike = 1.0,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of a linear equation, or of a structure by its matrices, shaken by the ground.

    .. math:: M x'' + \sum_j C_j D^{\gamma_j} x + (a M + b K) D^{\gamma} x
              + K x = f(t) - M r a(t)

    `mass` and `stiffness` are numbers or matrices; `rayleigh` is a mapping with the factors a
    (``mass``), b (``stiffness``) and :math:`\gamma` (``order``), or with the ``ratios`` of two
    ``modes``; a(t) has one component. r has shape ``(d,)``, or is a number or a pattern that
    is repeated: ``[1, 0]`` shakes the first of the two coordinates of every node. A stiffness of
    zero is no potential at all.

    With one term of damping of order 1 this is the damped oscillator of the paper (section
    "Numerical examples"), with one term of order 1/2 or 3/2 its Bagley-Torvik equation.
    """
    found = [matrix_of(one, 1) for one in (mass, stiffness)]
    size = max(int(np.size(data.get("initial_position", 0.0))), *(one.shape[0] for one in found))
    m, k = (matrix_of(one, size, sparse=any(map(is_sparse, found))) for one in (mass, stiffness))
    if m.shape != k.shape:
        words = f"is for {k.shape[0]} coordinates, but mass for {m.shape[0]}"
        raise ArgumentError("stiffness", f"{words}; give as many in both")
    if rayleigh is not None:
        term = rayleigh_damping(m, k, rayleigh)
        data["damping"] = (*data.get("damping", ()), term)
    if ground_acceleration is not None:
        ground = given_force(ground_acceleration)
        if ground is None or ground.dimension != 1:
            raise ArgumentError("ground_acceleration", "the ground has one component")
        shaken = ground.along(-times(ground_shares(ground_direction, size), m)[:, None])
        given = given_force(data.get("forcing"))
        data["forcing"] = shaken if given is None else given.plus(shaken)
    potential = QuadraticPotential(stiffness=k)
    return make_scene(m, potential if entries(potential.form).any() else None, **data)


def ground_shares(direction: ArrayLike | Mapping[str, Any], size: int) -> Array:
    """The share r of the ground's motion in every coordinate, by a number, a pattern or a file.

    Raises
    ------
    ArgumentError
        If a pattern does not fit the number of coordinates.
    """
    if isinstance(direction, Mapping):
        direction = kept_numbers(str(direction["digest"]))
    pattern = np.atleast_1d(np.asarray(direction, dtype=float)).ravel()
    if pattern.size == 0 or size % pattern.size:
        raise ArgumentError(
            "ground_direction",
            f"{pattern.size} entries for {size} degrees of freedom; write one for each, or a "
            "pattern that is repeated",
        )
    return np.tile(pattern, size // pattern.size)


linear_oscillator = structure


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
    dampers: Sequence[Effect] = (),
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of n equal masses in a row with a spring and dampers between neighbours.

    .. math:: m x_i'' + \Bigl(k + \sum_j c_j D^{\gamma_j}\Bigr) (2 x_i - x_{i-1} - x_{i+1})
              + \sum_j \mu_j D^{\gamma_j} x_i = f_i(t),

    with :math:`x_0 = x_{n+1} = 0` at walls; at a free end there are no terms of the next mass.
    `dampers` are terms and laws whose coefficients are numbers, parallel to every spring, or to
    those of their ``storeys``.
    """
    rows = neighbour_rows(masses, ends)
    return structure(
        mass=mass * np.eye(masses),
        stiffness=stiffness * rows.T @ rows,
        **with_dampers(data, dampers, rows),
    )


@scene_function
def frame(
    *,
    storeys: int = 3,
    mass: ArrayLike = 1.0,
    stiffness: ArrayLike = 1.0,
    ground_acceleration: Forcing | str | None = None,
    dampers: Sequence[Effect] = (),
    rayleigh: object = None,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of a building of n storeys that shear, shaken by the ground.

    With :math:`x_i` the displacement of storey i against the ground, :math:`x_0 = 0`, and the
    shear :math:`s_i = \bigl(k_i + \sum_j c_j D^{\gamma_j}\bigr) (x_i - x_{i-1})` (viscoelastic
    walls or dampers),

    .. math:: m_i x_i'' + s_i - s_{i+1} + \sum_j \mu_j D^{\gamma_j} x_i = f_i(t) - m_i a(t),

    and with `rayleigh` Rayleigh's damping, as of a structure. `dampers` are terms and laws whose
    coefficients are numbers, in every storey, or in their ``storeys``.
    """
    masses = per_coordinate(mass, storeys, "mass")
    springs = per_coordinate(stiffness, storeys, "stiffness")
    rows, kept = neighbour_rows(storeys, "left"), form if storeys > LARGEST_DENSE else np.asarray
    return structure(
        mass=kept(np.diag(masses)),
        stiffness=kept((rows.T * springs) @ rows),
        ground_acceleration=ground_acceleration,
        rayleigh=rayleigh,
        **with_dampers(data, dampers, rows),
    )


def pluck_amplitudes(modes: int, at: float, height: float) -> Array:
    r"""Sine coefficients of a triangle of `height` at the fraction `at` of the length.

    .. math:: q_j = \frac{2 H}{j^2 \pi^2 a (1 - a)} \sin(j \pi a), \quad j = 1..n
    """
    j = np.arange(1, modes + 1)
    return np.asarray(2.0 * height * np.sin(j * np.pi * at) / (j**2 * np.pi**2 * at * (1.0 - at)))


@scene_function
def string(
    *,
    modes: int = 8,
    wave_speed: float = 1.0,
    length: float = 1.0,
    pluck: tuple[float, float] | None = None,
    internal_damping: Sequence[Effect] = (),
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of the first n modes of a string that is held at both ends.

    .. math:: u_{tt} + \sum_j \mu_j D_t^{\gamma_j} u - \sum_j \eta_j D_t^{\gamma_j} u_{ss}
              = c^2 u_{ss}, \qquad u = \sum_{j=1}^{n} x_j(t) \sin(j \pi s / L)

    gives, because the sines are orthogonal,

    .. math:: x_j'' + \sum_i \bigl(\mu_i + \eta_i \kappa_j^2\bigr) D^{\gamma_i} x_j
              + c^2 \kappa_j^2 x_j = f_j(t), \qquad \kappa_j = j \pi / L .

    The coefficients :math:`\eta` of `internal_damping` are numbers; `pluck` has place and height of
    a triangle that is added to the initial position.
    """
    wave_numbers = np.arange(1, modes + 1) * np.pi / length
    if pluck is not None:
        position = per_coordinate(data.get("initial_position", 0.0), modes, "initial_position")
        data["initial_position"] = position + pluck_amplitudes(modes, *pluck)
    return structure(
        mass=np.eye(modes),
        stiffness=np.diag((wave_speed * wave_numbers) ** 2),
        **with_dampers(data, internal_damping, np.diag(wave_numbers), "internal_damping"),
    )
