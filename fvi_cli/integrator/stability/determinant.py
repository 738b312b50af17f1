r"""Determinants whose zeros are the modes of a linear scene and of its discretisation.

The step equations are those of :mod:`fvi_cli.integrator.stability.patterns`. Their determinant is
analytic in :math:`|z| < 1`, and a zero z there is a mode that grows by :math:`1 / |z|` in a step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import decouple_forms
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.patterns import pattern_size, step_patterns
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.mathematics.transforms.argument import LogFunction

LARGEST_FREQUENCY = 1e3
"""Times the step size: faster growth of the exact scene is beyond every method and number."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MatrixPencil:
    r"""A homogeneous linear scene :math:`M x'' + \sum_j D_j D^{\gamma_j} x + K x = 0`.

    Parameters
    ----------
    mass, stiffness
        M and K, shape ``(d, d)``.
    damping
        Orders with their matrices, one per order.
    """

    mass: Array
    stiffness: Array
    damping: tuple[tuple[float, Array], ...]

    @property
    def sizes(self) -> tuple[tuple[float, float], ...]:
        """Orders with the norms of their matrices relative to the mass, those that are not 0."""
        root = np.linalg.inv(np.linalg.cholesky(self.mass))
        pairs = ((0.0, self.stiffness), *self.damping)
        norms = ((order, float(np.linalg.norm(root @ form @ root.T, 2))) for order, form in pairs)
        return tuple((order, size) for order, size in norms if size > 0)

    @property
    def is_dissipative(self) -> bool:
        r"""Whether K and all damping matrices are positive semi-definite: then nothing grows.

        For Re s > 0 every term of :math:`s M + \sum_j s^{\gamma_j - 1} D_j + K / s` has a
        positive semi-definite Hermitian part, that of the first one definite.
        """
        forms = [self.stiffness, *(matrix for _, matrix in self.damping)]
        return all(
            float(np.linalg.eigvalsh(form)[0]) >= -1e-14 * float(np.abs(form).max())
            for form in forms
        )


def matrix_pencil(scene: Scene) -> MatrixPencil:
    """Matrices of a linear scene, damping terms of one order added up.

    Raises
    ------
    ValueError
        If the scene is not linear.
    """
    if not scene.is_linear:
        raise ValueError("scene: it is not linear, and has no modes")
    d = scene.dimension
    stiffness = np.zeros((d, d))
    if isinstance(scene.potential, QuadraticPotential):
        stiffness = scene.potential.stiffness
    sums: dict[float, Array] = {}
    for term in scene.active_damping:
        sums[term.order] = sums.get(term.order, np.zeros((d, d))) + term.coefficient
    return MatrixPencil(
        mass=scene.inertia.mass,
        stiffness=stiffness,
        damping=tuple((order, matrix) for order, matrix in sums.items() if np.any(matrix != 0)),
    )


def independent_systems(scene: Scene) -> tuple[MatrixPencil, ...]:
    """The linear systems into which the scene falls apart, each of them once; itself otherwise."""
    whole = matrix_pencil(scene)
    if scene.dimension == 1:
        return (whole,)
    parts = decouple_forms(whole.mass, whole.stiffness, [matrix for _, matrix in whole.damping])
    if parts.batch == 1:
        return (whole,)
    mass, stiffness = parts.matrices(whole.mass), parts.matrices(whole.stiffness)
    damping = [(order, parts.matrices(matrix)) for order, matrix in whole.damping]
    systems: dict[tuple[float, ...], MatrixPencil] = {}
    for index in range(parts.batch):
        system = MatrixPencil(
            mass=mass[index],
            stiffness=stiffness[index],
            damping=tuple((order, matrices[index]) for order, matrices in damping),
        )
        forms = (system.mass, system.stiffness, *(matrix for _, matrix in system.damping))
        key = tuple(float(f"{value:.12e}") for form in forms for value in form.ravel())
        systems.setdefault(key, system)
    return tuple(systems.values())


def number_of_unknowns(system: MatrixPencil, method: AnyMethod) -> int:
    """Rows of the determinant: position, momentum and the increments of a step."""
    return pattern_size(method) * int(system.mass.shape[0])


def step_determinant(system: MatrixPencil, method: AnyMethod, step_size: float) -> LogFunction:
    """Logarithm of the determinant of one step of `method`, as a function of arrays of z."""
    patterns = step_patterns(method, tuple(order for order, _ in system.damping))
    forms = dimensionless_forms(system, step_size)

    def log_determinant(z: ComplexArray) -> ComplexArray:
        return log_determinants(_summed(patterns(z), forms))

    return log_determinant


def dimensionless_forms(system: MatrixPencil, step_size: float) -> Array:
    r"""The forms of the patterns: 1, M, :math:`h^2 K`, :math:`h^{2-\gamma_j} D_j`, by size of M.

    Shape ``(3 + number of orders, d, d)``.
    """
    h, d = step_size, system.mass.shape[0]
    scale = float(np.abs(system.mass).max())
    damping = [h ** (2.0 - order) / scale * matrix.T for order, matrix in system.damping]
    stiffness = h * h / scale * system.stiffness
    return np.array([np.eye(d), system.mass / scale, stiffness, *damping])


def _summed(patterns: ComplexArray, forms: Array) -> ComplexArray:
    """Sum of the Kronecker products of patterns and forms."""
    k, _, n, _ = patterns.shape
    d = forms.shape[1]
    if d == 1:
        return np.asarray(np.einsum("ki...,i->k...", patterns, forms[:, 0, 0]))
    products = np.tensordot(patterns, forms, axes=(1, 0))
    return np.asarray(products.swapaxes(2, 3).reshape(k, n * d, n * d))


def log_determinants(matrices: ComplexArray) -> ComplexArray:
    """Logarithms of determinants, shape ``(..., n, n)`` to ``(...,)``."""
    # rows of one size, lest the size of one of them drown the others
    sizes = np.abs(matrices).max(axis=-1)
    sizes = np.where(sizes == 0, 1.0, sizes)
    with np.errstate(divide="ignore"):
        sign, logarithm = np.linalg.slogdet(matrices / sizes[..., None])
        logarithm = logarithm + np.log(sizes).sum(axis=-1)
    return np.asarray(logarithm + 1j * np.angle(sign))


@dataclass(frozen=True, kw_only=True, eq=False)
class HalfPlane:
    r"""The characteristic determinant of the exact scene on the right half-plane as a disc.

    :math:`s = c (1 + \zeta) / (1 - \zeta)`; divided by :math:`(s + c)^{2 d}` the determinant of
    :math:`s^2 M + \sum_j s^{\gamma_j} D_j + K` is analytic in the disc and det M at 1.

    Parameters
    ----------
    system
        The scene.
    scale
        c > 0, of the size of the largest zero.
    """

    system: MatrixPencil
    scale: float

    def log_determinant(self, zeta: ComplexArray) -> ComplexArray:
        """Logarithm of the determinant divided by (s + c)^(2 d)."""
        s = (self.frequency(zeta))[:, None, None]
        system = self.system
        matrix = s**2 * system.mass + system.stiffness
        for order, coefficient in system.damping:
            matrix = matrix + s**order * coefficient
        return log_determinants(matrix / (s + self.scale) ** 2)

    def frequency(self, zeta: ComplexArray) -> ComplexArray:
        """The s that belong to points of the disc."""
        return np.asarray(self.scale * (1.0 + zeta) / (1.0 - zeta))

    def radius(self, growth: float) -> float:
        """Radius of the disc that holds the zeros with Re s > `growth` on the real axis."""
        ratio = growth / self.scale
        return (1.0 - ratio) / (1.0 + ratio)


def half_plane(system: MatrixPencil, step_size: float) -> HalfPlane:
    """The half-plane on a scale at which no zero is larger than c, or no step of h can follow."""
    sizes = system.sizes
    high = math.log(LARGEST_FREQUENCY / step_size)
    if not sizes:
        return HalfPlane(system=system, scale=math.exp(high))
    # the positive zero of s^2 - sum_j size_j s^gamma_j, beyond which s^2 is larger than the rest
    orders = np.array([order for order, _ in sizes])
    logs = np.log([size for _, size in sizes])
    low = float((logs / (2.0 - orders)).max())
    if low >= high:
        return HalfPlane(system=system, scale=math.exp(high))
    for _ in range(30):
        middle = 0.5 * (low + high)
        if np.logaddexp.reduce(logs + orders * middle) > 2.0 * middle:
            low = middle
        else:
            high = middle
    return HalfPlane(system=system, scale=math.exp(high))
