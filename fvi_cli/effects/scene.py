"""The scene: a list of effects with initial data."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.lagrangian import Derivatives, Lagrangian
from fvi_cli.effects.laws import Law
from fvi_cli.effects.matrices import Form, is_semidefinite, is_sparse, times
from fvi_cli.effects.potential import (
    LinearPotential,
    Potential,
    QuadraticPotential,
    checked_potential,
    with_stiffness,
)
from fvi_cli.effects.prescribed import PrescribedMotion
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array, set_arrays

Derivative = Literal["caputo", "riemann-liouville"]


def dampers_of(given: object, name: str) -> tuple[FractionalDamping | Law, ...]:
    """Damping terms and laws as they are given by an argument; refuses what is no list of them."""
    words = "it must be a list, such as [fvi.FractionalDamping(order=0.5, coefficient=1.0)]; got"
    if not isinstance(given, Iterable):
        raise ArgumentError(name, f"{words} {type(given).__name__}")
    found = []
    for one in given:
        if not isinstance(one, FractionalDamping | Law):
            raise ArgumentError(name, f"{words} a list that holds {type(one).__name__}")
        found.append(one)
    return tuple(found)


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    r"""The effects and initial data of a motion q(t) in R^d on [0, T].

    .. math:: M q'' + \sum_j \mu_j D^{\gamma_j} q + \sum_i A_i\, g_i\, k_i * q' + \nabla V(q)
              = f(t), \quad q(0)=q_0, q'(0)=v_0

    Absent effects are not computed.

    Raises
    ------
    ValueError
        For sizes that do not match, values that are not finite,
        and Riemann-Liouville derivatives of an order above 1 or of laws with q0 != 0.
    """

    inertia: Inertia  # with a Lagrangian: its mass matrix at the start
    initial_position: Array  # q0 and v0, shape (d,)
    initial_velocity: Array
    final_time: float  # T > 0
    potential: Potential | None = None  # any object with the functions of Potential
    damping: tuple[FractionalDamping, ...] = ()  # laws among them go to `laws`
    forcing: Forcing | None = None
    # caputo: D acts on q - q0 (on q - q0 - v0 t for orders above 1); riemann-liouville: on q,
    # the same with the loads of the initial data
    derivative: Derivative = "caputo"
    # in place of inertia and potential, where the mass matrix is not constant: d/dt L_v - L_q
    # stands for M q'' + grad V(q)
    lagrangian: Lagrangian | None = None
    # laws have relaxed before t = 0; their relaxed moduli become part of the potential
    laws: tuple[Law, ...] = ()
    # c - f q of a constant force f in `forcing`: counted as energy, not as work of the forcing
    linear_potential: LinearPotential | None = None
    # a given motion of the one coordinate: then only the forces are computed
    prescribed: PrescribedMotion | None = None
    coordinates: tuple[str, ...] = ()  # names of the coordinates in expressions, if given

    def __post_init__(self) -> None:
        d = self.inertia.dimension
        for name in ("initial_position", "initial_velocity"):
            value = np.atleast_1d(np.asarray(getattr(self, name), dtype=float))
            if value.shape != (d,) or not np.isfinite(value).all():
                raise ArgumentError(name, f"{d} finite numbers are needed, got {value.tolist()}")
            set_arrays(self, **{name: value})
        end = float(self.final_time)
        if not 0 < end < math.inf:
            raise ArgumentError("final_time", f"{end!r} is not allowed; it must be positive")
        object.__setattr__(self, "final_time", end)
        if self.lagrangian is not None and self.potential is not None:
            raise ArgumentError("potential", "a Lagrangian holds the potential energy already")
        if self.potential is not None:
            checked = checked_potential(self.potential, self.initial_position)
            object.__setattr__(self, "potential", checked)
        self._check_effects()
        if self.derivative not in get_args(Derivative):
            raise ArgumentError(
                "derivative", f"{self.derivative!r} is not one of {', '.join(get_args(Derivative))}"
            )
        is_singular = self.derivative != "caputo" and np.any(self.initial_position != 0)
        if is_singular and (self.laws or self.acts_above_order_1):
            raise ArgumentError(
                "derivative",
                "riemann-liouville with a position that is not 0 at the start gives no integrable "
                "force by orders above 1, and none by laws, which have relaxed before; use caputo",
            )
        self._relax()

    def _check_effects(self) -> None:
        """Refuse effects of another size."""
        forces = (*dampers_of(self.damping, "damping"), *dampers_of(self.laws, "laws"))
        for name, is_law in (("damping", False), ("laws", True)):
            terms = tuple(one for one in forces if isinstance(one, Law) is is_law)
            object.__setattr__(self, name, terms)
        effects: list[Any] = [self.potential, self.linear_potential, self.lagrangian, self.forcing]
        for effect in (*effects, *self.damping, *self.laws):
            if effect is not None and effect.dimension != self.dimension:
                words = f"{type(effect).__name__} has {effect.dimension} components, the mass"
                raise ValueError(f"{words} {self.dimension}")
        if self.forcing is not None and (words := self.forcing.objection(self.final_time)):
            raise ArgumentError("forcing", words)

    def _relax(self) -> None:
        """Take the relaxed moduli of the laws into the potential or the Lagrangian."""
        for law in self.laws:
            if law.relaxed and self.lagrangian is not None:
                object.__setattr__(self, "lagrangian", self.lagrangian.stiffened(law.stiffness))
            elif law.relaxed:
                object.__setattr__(self, "potential", with_stiffness(self.potential, law.stiffness))
        object.__setattr__(self, "laws", tuple(law.without_stiffness() for law in self.laws))

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return self.inertia.dimension

    @property
    def active_damping(self) -> tuple[FractionalDamping, ...]:
        """The damping terms that do something (coefficient not zero)."""
        return tuple(term for term in self.damping if term.is_active)

    @property
    def active_laws(self) -> tuple[Law, ...]:
        """The relaxation laws that do something."""
        return tuple(law for law in self.laws if law.is_active)

    @property
    def active_forces(self) -> tuple[FractionalDamping | Law, ...]:
        """All damping terms and laws that do something."""
        return (*self.active_damping, *self.active_laws)

    @property
    def initial_loads(self) -> tuple[tuple[float, Array], ...]:
        r"""Powers e and vectors c of the forces c t**e of the initial data, e from -1 to 0.

        Riemann-Liouville derivatives are those of Caputo and
        :math:`q_0 t^{-\gamma} / \Gamma(1 - \gamma)` for orders below 1,
        :math:`v_0 t^{1 - \gamma} / \Gamma(2 - \gamma)` above, where :math:`q_0 = 0`.
        """
        if self.derivative == "caputo":
            return ()
        loads = []
        for term in self.active_damping:
            if term.is_integer_order:
                continue
            start = self.initial_position if term.order < 1 else self.initial_velocity
            order = term.order % 1.0
            load = -times(start, term.form) / math.gamma(1.0 - order)
            if load.any():
                loads.append((-order, load))
        return tuple(loads)

    def initial_force(
        self, time: Array, take: Callable[[Array], Array] = lambda load: load
    ) -> Array:
        """The sum of :attr:`initial_loads` at times ``(n,)``, ``(n, d)``; infinite at t = 0.

        `take` is a linear map of every vector ``(d,)``: its values are summed in place of them.
        """
        total = np.zeros((time.size, take(self.initial_position).size))
        for power, whole in self.initial_loads:
            load = take(whole)
            acted = load != 0
            with np.errstate(all="ignore"):
                total[:, acted] += time[:, None] ** power * load[acted]
        return total

    @property
    def acts_above_order_1(self) -> bool:
        """Whether derivatives of an order above 1 act."""
        return any(term.order > 1 for term in self.active_damping)

    @property
    def is_sparse(self) -> bool:
        """Whether mass or stiffness is sparse; then neither is converted to a dense matrix."""
        forms: list[Form] = [self.inertia.form]
        if isinstance(self.potential, QuadraticPotential):
            forms.append(self.potential.form)
        return any(map(is_sparse, forms))

    @property
    def is_linear(self) -> bool:
        """Whether the equations of motion are linear in q."""
        if self.lagrangian is not None:
            return False
        return self.potential is None or isinstance(self.potential, QuadraticPotential)

    @property
    def stiffness(self) -> Array:
        """K of a quadratic potential with all its zeros, ``(d, d)``; 0 where there is none."""
        if isinstance(self.potential, QuadraticPotential):
            return self.potential.stiffness
        return np.zeros((self.dimension, self.dimension))

    @property
    def is_dissipative(self) -> bool:
        r"""Whether it is linear, and its stiffness and dampings are positive semi-definite.

        Then nothing grows: for Re s > 0 every term of
        :math:`s M + \sum_j s^{\gamma_j - 1} D_j + K / s` has a positive semi-definite Hermitian
        part, and that of the first term is definite. The check keeps sparse matrices sparse.
        """
        forms = [term.form for term in self.active_forces]
        if isinstance(self.potential, QuadraticPotential):
            forms.append(self.potential.form)
        return self.is_linear and all(map(is_semidefinite, forms))

    @property
    def break_points(self) -> tuple[float, ...]:
        """Times in (0, T) at which the forcing, or a given motion, is not smooth."""
        if self.prescribed is not None:
            breaks = self.prescribed.break_points
            return breaks[: bisect.bisect_left(breaks, self.final_time)]
        if self.forcing is None:
            return ()
        return tuple(t for t in self.forcing.break_points if 0 < t < self.final_time)

    def momentum(self, position: Array, velocity: Array, time: Array | float) -> Array:
        """The derivative of L by v; M v where energies separate."""
        if self.lagrangian is not None:
            return self.lagrangian.forces(position, velocity, time)[0]
        return np.asarray(times(velocity, self.inertia.form))

    def velocity(self, position: Array, momentum: Array, time: Array | float) -> Array:
        """The velocity that belongs to a momentum."""
        if self.lagrangian is not None:
            return self.lagrangian.velocity(position, momentum, time)
        return self.inertia.velocity(momentum)

    def energy(self, position: Array, momentum: Array, time: Array | float) -> Array:
        """Hamiltonian p M^-1 p / 2 + V(q) without forcing, shapes ``(..., d)`` to ``(...)``."""
        if self.lagrangian is not None:
            return self.lagrangian.energy(position, self.velocity(position, momentum, time), time)
        total = 0.5 * np.einsum("...i,...i->...", momentum, self.inertia.velocity(momentum))
        for one in (self.potential, self.linear_potential):
            if one is not None:
                total = total + one.energy(position)
        return np.asarray(total)

    def derivatives(self, position: Array, velocity: Array, time: Array) -> Derivatives:
        """All first and second derivatives of L in q and v."""
        if self.lagrangian is not None:
            return self.lagrangian.derivatives(position, velocity, time)
        shape = (*position.shape, self.dimension)
        force, stiffness = np.zeros_like(position), np.zeros(shape)
        if self.potential is not None:
            force, stiffness = -self.potential.gradient(position), -self.potential.hessian(position)
        return Derivatives(
            momentum=self.momentum(position, velocity, time),
            force=force,
            mass=np.broadcast_to(self.inertia.mass, shape),
            mixed=np.zeros(shape),
            stiffness=stiffness,
        )
