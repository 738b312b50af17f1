r"""Determinants whose zeros are the modes of a linear scene and of its discretisation.

With :math:`x_k, p_k, \delta_k \sim z^{-k}` the step equations in momentum form become a linear
system for position, momentum and increments,

.. math::
   (1 - z) x - z \delta^s &= 0 \\
   (1 - z) p + z h \Big[ K \Big(x + \sum_{i,\nu} b_i l_\nu(c_i) \delta^\nu\Big)
     + \sum_i \beta_i F_i \Big] &= 0 \\
   \frac1h \sum_{i,\mu} b_i l_\nu' l_\mu' M \delta^\mu - h \sum_i b_i l_\nu K X_i
     - h \sum_i \beta_i l_\nu F_i + p\, \delta_{\nu 0} &= 0,

where :math:`F = \sum_j h^{-\gamma_j} \gamma_p(z)^{\gamma_j} / (1 - z) \, U \mu_j` for backward
differences, and likewise with :math:`\Delta(z)^{\gamma_j - 1}` for Runge-Kutta methods. Its
determinant is analytic in :math:`|z| < 1`, and a zero z there is a mode that grows by
:math:`1 / |z|` in a step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import decouple
from fvi_cli.integrator.memory import Channel, build_memory, runge_kutta_tableau
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.stage_basis import StageBasis, legendre_stages
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.mathematics.bdf import symbol_at
from fvi_cli.mathematics.disc_zeros import ComplexArray, LogFunction
from fvi_cli.mathematics.runge_kutta_symbol import symbol_power

Array = NDArray[np.float64]


LARGEST_CONDITION = 1e6
"""Eigenvectors worse conditioned than this belong to eigenvalues that meet."""

LARGEST_FREQUENCY = 1e3
"""Times the step size: faster growth of the exact scene is beyond every method and number."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearSystem:
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


def linear_system(scene: Scene) -> LinearSystem:
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
    return LinearSystem(
        mass=scene.inertia.mass,
        stiffness=stiffness,
        damping=tuple((order, matrix) for order, matrix in sums.items() if np.any(matrix != 0)),
    )


def independent_systems(scene: Scene, method: Method | None = None) -> tuple[LinearSystem, ...]:
    """The linear systems into which the scene falls apart, each of them once; itself otherwise."""
    whole = linear_system(scene)
    if scene.dimension == 1:
        return (whole,)
    method = method or Method(cq="gauss", degree=1)
    memory = build_memory(scene, method, step_tables(method), 1, ())
    directions = tuple(
        Channel(direction=matrix, weights=np.zeros(1)) for _, matrix in whole.damping
    )
    parts = decouple(whole.mass, whole.stiffness, replace(memory, channels=directions))
    mass, stiffness = parts.matrices(whole.mass), parts.matrices(whole.stiffness)
    damping = [(order, parts.matrices(matrix)) for order, matrix in whole.damping]
    systems: dict[tuple[float, ...], LinearSystem] = {}
    for index in range(parts.batch):
        system = LinearSystem(
            mass=mass[index],
            stiffness=stiffness[index],
            damping=tuple((order, matrices[index]) for order, matrices in damping),
        )
        forms = (system.mass, system.stiffness, *(matrix for _, matrix in system.damping))
        key = tuple(float(f"{value:.12e}") for form in forms for value in form.ravel())
        systems.setdefault(key, system)
    return tuple(systems.values())


def number_of_unknowns(system: LinearSystem, method: AnyMethod) -> int:
    """Rows of the determinant: position, momentum and the increments of a step."""
    rows = 2 if isinstance(method, Baseline) else method.degree + 2
    return rows * int(system.mass.shape[0])


def step_determinant(system: LinearSystem, method: AnyMethod, step_size: float) -> LogFunction:
    """Logarithm of the determinant of one step of `method`, as a function of arrays of z."""
    if isinstance(method, Baseline):
        return _euler_determinant(system, method, step_size)
    h, d = step_size, system.mass.shape[0]
    tables = step_tables(method)
    s = tables.degree
    forms = _forms(method)
    n = (s + 2) * d
    scale = float(np.abs(system.mass).max())
    # momenta are counted in units of mass / h, so that only h^2 K / M and h^2 F / M appear
    mass, stiffness = system.mass / scale, h * h / scale * system.stiffness
    constant = np.zeros((n, n))
    linear = np.zeros((n, n))
    x, p, u = slice(0, d), slice(d, 2 * d), slice(2 * d, n)
    identity = np.eye(d)
    last = np.kron(np.eye(s)[-1:], identity)
    constant[x, x], linear[x, x] = identity, -identity
    linear[x, u] = -last
    constant[p, p], linear[p, p] = identity, -identity
    weights = tables.weights @ tables.basis[1:].T
    linear[p, x] = stiffness
    linear[p, u] = np.kron(weights[None], stiffness)
    pair = np.einsum("ni,mi->nm", tables.test_weights[:-1], tables.basis[1:])
    constant[u, x] = -np.kron(tables.test_weights[:-1].sum(axis=1)[:, None], stiffness)
    constant[u, p] = np.kron(np.eye(s)[:, :1], identity)
    constant[u, u] = np.kron(tables.mass_matrix, mass) - np.kron(pair, stiffness)
    momentum_weights = forms.force_weights.sum(axis=0)
    damping = [(order, h ** (2.0 - order) / scale * matrix.T) for order, matrix in system.damping]

    def log_determinant(z: ComplexArray) -> ComplexArray:
        matrix = constant + z[:, None, None] * linear
        samples = forms.samples(z)
        forces = forms.forces(z, tuple(order for order, _ in damping), samples)
        for (_, direction), force in zip(damping, forces, strict=True):
            rows = forms.force_weights[:-1] @ force
            matrix[:, u, u] -= _kron(rows, direction)
            total = momentum_weights @ force
            matrix[:, p, u] += z[:, None, None] * _kron(total[:, None, :], direction)
        return _log_determinant(matrix)

    return log_determinant


@dataclass(frozen=True, kw_only=True, eq=False)
class _Forms:
    """Dimensionless sample and force matrices of a method (step size 1)."""

    method: Method
    sample_matrix: Array
    carry_matrix: Array
    force_weights: Array
    basis: StageBasis | None

    def samples(self, z: ComplexArray) -> ComplexArray:
        """Samples from increments at each z, shape ``(n, m, s)``."""
        return np.asarray(self.sample_matrix.T + z[:, None, None] * self.carry_matrix.T)

    def forces(
        self, z: ComplexArray, orders: tuple[float, ...], samples: ComplexArray
    ) -> list[ComplexArray]:
        """Force of the samples for each order, shape ``(n, m, s)``."""
        if self.basis is None:
            # A(alpha) stability: the symbol keeps away from the cut along the negative axis
            symbol = symbol_at(self.method.bdf_order, z)
            factors = [symbol**order / (1.0 - z) for order in orders]
            return [np.asarray(factor[:, None, None] * samples) for factor in factors]
        if all(order == 1.0 for order in orders):
            return [samples for _ in orders]
        powers = self._symbol_powers(z, self.basis, tuple(order - 1.0 for order in orders))
        return [np.asarray(power @ samples) for power in powers]

    def _symbol_powers(
        self, z: ComplexArray, basis: StageBasis, exponents: tuple[float, ...]
    ) -> list[ComplexArray]:
        r"""Powers of the symbol between Legendre coefficients, each of shape ``(n, m, m)``.

        There :math:`\Delta(z)^{-1} = T A T^{-1} + z / (1 - z) e_1 e_1^T`: near z = 1 one large
        entry beside a matrix of moderate ones, whose small eigenvalues are not drowned in it.
        """
        tableau = runge_kutta_tableau(self.method)
        inverse = basis.to_coefficients @ tableau.A @ basis.to_values
        matrices = np.tile(inverse.astype(np.complex128), (z.size, 1, 1))
        matrices[:, 0, 0] += z / (1.0 - z)
        if matrices.shape[1] == 1:
            return [matrices**-exponent for exponent in exponents]
        values, vectors = np.linalg.eig(matrices)
        try:
            inverses = np.linalg.inv(vectors)
        except np.linalg.LinAlgError:
            inverses = np.full_like(vectors, np.inf)
        # Frobenius norms: the product bounds the condition from above
        with np.errstate(over="ignore", invalid="ignore"):
            sizes = [(np.abs(one) ** 2).sum(axis=(1, 2)) for one in (vectors, inverses)]
            poor = ~(sizes[0] * sizes[1] < LARGEST_CONDITION**2)
        if poor.any():
            inverses[poor] = 0.0
        result = []
        for exponent in exponents:
            power = (vectors * values[:, None, :] ** -exponent) @ inverses
            if poor.any():
                # eigenvalues that meet
                rest = symbol_power(tableau, exponent, z[poor])
                power[poor] = basis.to_coefficients @ rest @ basis.to_values
            result.append(np.asarray(power))
        return result


def _forms(method: Method) -> _Forms:
    tables = step_tables(method)
    rest = Scene(
        inertia=Inertia(mass=np.eye(1)),
        initial_position=np.zeros(1),
        initial_velocity=np.zeros(1),
        final_time=1.0,
    )
    memory = build_memory(rest, method, tables, 1, ())
    return _Forms(
        method=method,
        sample_matrix=memory.sample_matrix,
        carry_matrix=memory.carry_matrix,
        force_weights=memory.force_weights,
        basis=legendre_stages(tables.sample_points) if method.is_runge_kutta else None,
    )


def _kron(left: ComplexArray, right: Array) -> ComplexArray:
    n, a, b = left.shape
    c, d = right.shape
    return np.asarray(np.einsum("nij,kl->nikjl", left, right).reshape(n, a * c, b * d))


def _log_determinant(matrices: ComplexArray) -> ComplexArray:
    # rows of one size, lest the size of one of them drown the others
    sizes = np.abs(matrices).max(axis=2)
    with np.errstate(divide="ignore"):
        sign, logarithm = np.linalg.slogdet(matrices / np.where(sizes == 0, 1.0, sizes)[..., None])
        logarithm = logarithm + np.log(np.where(sizes == 0, 1.0, sizes)).sum(axis=1)
    return np.asarray(logarithm + 1j * np.angle(sign))


def _euler_determinant(system: LinearSystem, method: Baseline, h: float) -> LogFunction:
    d = system.mass.shape[0]
    scale = float(np.abs(system.mass).max())
    mass, stiffness = system.mass / scale, h * h / scale * system.stiffness
    late = method.name == "explicit-euler"

    def log_determinant(z: ComplexArray) -> ComplexArray:
        at = z[:, None, None]
        shift = at if late else np.ones_like(at)
        matrix = np.zeros((z.size, 2 * d, 2 * d), dtype=np.complex128)
        matrix[:, :d, :d] = (1.0 - at) * np.eye(d)
        matrix[:, :d, d:] = -shift * np.eye(d)
        matrix[:, d:, :d] = shift * stiffness
        matrix[:, d:, d:] = (1.0 - at) * mass
        for order, coefficient in system.damping:
            factor = h ** (2.0 - order) / scale * (1.0 - at) ** (order - 1.0)
            matrix[:, d:, d:] += shift * factor * coefficient
        return _log_determinant(matrix)

    return log_determinant


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

    system: LinearSystem
    scale: float

    def log_determinant(self, zeta: ComplexArray) -> ComplexArray:
        """Logarithm of the determinant divided by (s + c)^(2 d)."""
        s = (self.frequency(zeta))[:, None, None]
        system = self.system
        matrix = s**2 * system.mass + system.stiffness
        for order, coefficient in system.damping:
            matrix = matrix + s**order * coefficient
        return _log_determinant(matrix / (s + self.scale) ** 2)

    def frequency(self, zeta: ComplexArray) -> ComplexArray:
        """The s that belong to points of the disc."""
        return np.asarray(self.scale * (1.0 + zeta) / (1.0 - zeta))

    def radius(self, growth: float) -> float:
        """Radius of the disc that holds the zeros with Re s > `growth` on the real axis."""
        ratio = growth / self.scale
        return (1.0 - ratio) / (1.0 + ratio)


def half_plane(system: LinearSystem, step_size: float) -> HalfPlane:
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
