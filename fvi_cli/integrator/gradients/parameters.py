r"""Parameters of scenes, and what they change in the equations of a run whose motion is held fixed.

A scene is its numbers by name: masses, orders, initial data, the parameters that its formulas name.
A parameter moves some of them at known rates. Where a function makes the scenes, the rates are one
central difference of the numbers. All behind the rates is exact: formulas are differentiated by
their names, matrices and moduli enter linearly, orders have the memory :math:`I^\theta \log I`. The
numbers of the kernel of a law, and the orders of Riemann-Liouville loads, move known functions of
the time alone, which are differentiated by a rule of order four.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece, formula_of
from fvi_cli.effects.laws.law import Law, RelaxationKernel
from fvi_cli.effects.laws.prony import PronyKernel
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import (
    ExpressionPotential,
    QuadraticPotential,
)
from fvi_cli.effects.sampled import FunctionForce, SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances import loads_along
from fvi_cli.integrator.gradients.linearised import Disturbance, LinearisedRun, damped
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.mathematics.algebra.builder import derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.mathematics.expressions import Expression

DIFFERENCE = float(np.cbrt(np.finfo(float).eps))
"""Difference of a parameter of a function, relative to its size: h^2 is as large as eps / h."""
RULE = {-2: 1.0 / 12.0, -1: -2.0 / 3.0, 1: 2.0 / 3.0, 2: -1.0 / 12.0}
"""The rule of order four."""
SPACING = 1e-3
"""Its spacing, relative: its error h^4 / 30 and round-off eps / h are both some 1e-13."""

Function = Callable[[Array], Array]
Described = tuple[Scene, Observations]
"""A scene, and the names in expressions along its motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameter:
    """Rates at which a parameter moves the numbers of a scene; those that are absent stay."""

    name: str  # in messages
    rates: Mapping[str, Array]
    # rates of functions of users, whose numbers have no names: of the gradient of a ``potential``
    # and of components of forces, by their places
    functions: Mapping[str, Function] = field(default_factory=dict)

    def of(self, number: str) -> Any:
        """The rate of one number."""
        return self.rates.get(number, 0.0)

    def under(self, prefix: str) -> dict[str, Any]:
        """The rates of all numbers whose names begin with a prefix, by the rest of the name."""
        return {
            name.removeprefix(prefix): rate
            for name, rate in self.rates.items()
            if name.startswith(prefix)
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """A number, vector or symmetric matrix of a scene, with a parameter for each part."""

    value: Array
    parameter: Callable[[tuple[int, ...]], Parameter]  # that moves the part at an index

    @property
    def indices(self) -> list[tuple[int, ...]]:
        """Indices of the parts, for a symmetric matrix on and above the diagonal."""
        return [at for at in np.ndindex(*self.value.shape) if len(at) < 2 or at[0] <= at[1]]

    def gathered(self, derivatives: Sequence[float]) -> Array:
        """The derivative G in the shape of the value: the change is ``sum(G * dvalue)``."""
        found = np.zeros(self.value.shape)
        for index, one in zip(self.indices, derivatives, strict=True):
            share = 0.5 if len(index) == 2 and index[0] != index[1] else 1.0
            found[index] = found[index[::-1]] = share * one
        return found


def numbers_of(scene: Scene, names: Observations | None = None) -> dict[str, Array]:
    """All numbers of a scene by name, and those that names in expressions stand for.

    ``mass``, ``stiffness``, ``potential.<parameter>``, ``lagrangian.<parameter>``,
    ``damping.<k>.order`` and ``.coefficient`` (on the deformation, where it acts on one),
    ``laws.<k>.size``, ``.spring``, ``.coefficient`` and the numbers of its kernel,
    ``initial_position``, ``initial_velocity``, ``forcing.<piece>.<component>.<parameter>``.
    """
    own: Any = scene.potential
    kind = "potential"
    found: dict[str, Any] = {}
    if scene.lagrangian is None:
        found["mass"] = scene.inertia.mass
    else:
        own, kind = scene.lagrangian, "lagrangian"
    form = own.form if isinstance(own, QuadraticPotential) else getattr(own, "stiffness", None)
    if form is not None:
        found["stiffness"] = dense(form)
    found |= {f"{kind}.{name}": one for name, one in getattr(own, "parameters", {}).items()}
    for k, term in enumerate(scene.damping):
        found |= {f"damping.{k}.order": term.order, f"damping.{k}.coefficient": dense(term.inner)}
    for k, law in enumerate(scene.laws):
        parts = {"size": law.size, "spring": law.spring, "coefficient": dense(law.inner)}
        found |= {f"laws.{k}.{n}": one for n, one in (parts | _of_kernel(law.kernel)).items()}
    found |= {name: getattr(scene, name) for name in ("initial_position", "initial_velocity")}
    if names is not None:
        found |= {f"names.{name}": one for name, one in names.parameters.items()}
    for prefix, forcing in _forcings(scene, names).items():
        for place, component in _components(forcing, prefix):
            found |= {f"{place}.{name}": one for name, one in _of_component(component).items()}
    return {name: np.array(one, dtype=float) for name, one in found.items()}


def entries_of(scene: Scene) -> dict[str, Entry]:
    """The numbers of a scene that users may name; ``forcing.<parameter>`` in all formulas."""
    numbers, together = numbers_of(scene), dict[str, list[str]]()
    for name in numbers:
        kind, last = name.partition(".")[0], name.rpartition(".")[2]
        if kind == "forcing":
            if last.isidentifier():
                together.setdefault(f"forcing.{last}", []).append(name)
        elif (kind, last) != ("laws", "spring"):
            together[name] = [name]
    named = dict[str, str]()
    for name in together:
        if name.startswith(("potential.", "lagrangian.", "forcing.")):
            named.setdefault(name.partition(".")[2], name)
    for last, name in named.items():
        # the same name in expressions
        together[name].append(f"names.{last}")
    return {
        name: Entry(value=numbers[moved[0]], parameter=partial(_part, numbers, name, moved))
        for name, moved in together.items()
        # a name that has two values in the formulas of a force is no parameter
        if len({numbers[one].tobytes() for one in moved if one in numbers}) == 1
    }


def _part(
    numbers: Mapping[str, Array], name: str, moved: Sequence[str], index: tuple[int, ...]
) -> Parameter:
    rate = np.zeros(numbers[moved[0]].shape)
    rate[index] = rate[index[::-1]] = 1.0
    return Parameter(name=name, rates=dict.fromkeys(moved, rate))


def parameter_of(
    name: str, family: Callable[[float], Described], value: float, described: Described
) -> Parameter:
    """The parameter of a function that makes scenes, at the value of a described scene.

    Raises
    ------
    ValueError
        If scenes on both sides of the value do not exist, or differ in more than numbers with
        names.
    """
    ends = value + DIFFERENCE * (abs(value) or 1.0) * np.array([1.0, -1.0])
    sides = [family(float(end)) for end in ends]
    upper, lower = (numbers_of(*one) for one in sides)
    if any(_form(*one) != _form(*described) for one in sides):
        raise ValueError(
            f"{name}: the scene has another form near {value:g}; what changes in formulas must be "
            "a parameter with a name"
        )
    span = float(ends[0] - ends[1])
    rates = {key: (upper[key] - lower[key]) / span for key in upper}
    return Parameter(
        name=name,
        rates={key: rate for key, rate in rates.items() if rate.any()},
        functions=_rates_of_functions(_functions(*sides[0]), _functions(*sides[1]), span),
    )


def _functions(scene: Scene, names: Observations) -> dict[str, Function]:
    """Functions of users in a scene."""
    own = getattr(scene.potential, "functions", None)
    found: dict[str, Function] = {} if own is None else {"potential": own.gradient}
    for prefix, forcing in _forcings(scene, names).items():
        for place, one in _components(forcing, prefix):
            if isinstance(one, FunctionForce):
                found[place] = one.function
    return found


def _rates_of_functions(
    above: Mapping[str, Function], below: Mapping[str, Function], span: float
) -> dict[str, Function]:
    """Central differences of the functions that differ."""

    def rate(one: Function, other: Function) -> Function:
        return lambda at: (np.asarray(one(at)) - np.asarray(other(at))) / span

    return {name: rate(one, below[name]) for name, one in above.items() if one != below[name]}


def _forcings(scene: Scene, names: Observations | None) -> dict[str, Forcing | None]:
    inputs = {} if names is None else names.inputs
    return {"forcing": scene.forcing} | {f"inputs.{name}": one for name, one in inputs.items()}


def _form(scene: Scene, names: Observations) -> tuple[object, ...]:
    """What must be the same in scenes that differ in numbers with names only."""
    potential, lagrangian = scene.potential, scene.lagrangian
    formulas = None if lagrangian is None else lagrangian.first
    if isinstance(potential, ExpressionPotential):
        formulas = potential.gradient_system
    forces: list[object] = []
    for forcing in (scene.forcing, *names.inputs.values()):
        forces += [piece.until for piece in forcing.pieces] if forcing else [None]
        for _, one in _components(forcing, ""):
            own = formula_of(one)
            forces += [own and own.system, type(one)]
            forces.append(one.knots.tobytes() if isinstance(one, SampledForce) else b"")
    return (
        scene.derivative,
        formulas,
        type(getattr(potential, "functions", None)),
        [one.text for one in scene.prescribed.displacement.components] if scene.prescribed else [],
        [type(law.kernel) for law in scene.laws],
        forces,
        {name: one.shape for name, one in numbers_of(scene, names).items()},
    )


def objection(scene: Scene, one: Parameter) -> str:
    """Why a parameter of a scene has no derivative; empty if it has one."""
    if scene.derivative == "riemann-liouville" and np.any(one.of("initial_position")):
        above = [term.order for term in scene.active_damping if term.order > 1]
        if above:
            return (
                f"{one.name}: a position that is not 0 at the start gives a Riemann-Liouville "
                f"derivative of order {above[0]:g} a force that is not integrable"
            )
        if scene.laws:
            return f"{one.name}: laws have relaxed before, beside Riemann-Liouville derivatives"
    for k, term in enumerate(scene.damping if scene.derivative != "caputo" else ()):
        start = (*scene.initial_position, *scene.initial_velocity)
        if term.is_integer_order and one.of(f"damping.{k}.order") and any(start):
            return f"{one.name}: Riemann-Liouville derivatives jump where an order passes 1"
    return ""


# --- what a parameter changes while the motion is held fixed ---


def disturbance(run: LinearisedRun, parameters: Sequence[Parameter]) -> Disturbance:
    """Effect of parameters on the equations of a run.

    Raises
    ------
    ValueError
        If one has no derivative.
    """
    parts = [_disturbance(run, one) for one in parameters]
    # shapes, also without any parameter
    (n, r, d), s = run.steps.velocity.shape, run.tables.degree
    empty = [np.zeros(shape) for shape in ((0, n, s + 1, d), (0, d), (0, d), (0, n, r, d))]
    every = zip(*parts, strict=True) if parts else empty
    names = [one.name for one in fields(Disturbance)]
    return Disturbance(**dict(zip(names, map(np.array, every), strict=True)))


def _disturbance(run: LinearisedRun, one: Parameter) -> tuple[Array, Array, Array, Array]:
    """Load vectors, position and momentum at the start, and damping force by one parameter."""
    scene = run.scene
    if wrong := objection(scene, one):
        raise ValueError(wrong)
    position, velocity = scene.initial_position, scene.initial_velocity
    x = np.zeros(run.d) + one.of("initial_position")
    v = np.zeros(run.d) + one.of("initial_velocity")
    momentum, force = rates_of_forces(scene, one, *run.points)
    impulse = rates_of_forces(scene, one, position, velocity, np.zeros(()))[0]
    if x.any() or v.any():
        at_start = scene.derivatives(position[None], velocity[None], np.zeros(1))
        impulse = impulse + at_start.mass[0] @ v + at_start.mixed[0] @ x
    rates = memory_rates(run, one)
    matrices = [
        _on_coordinates(term, rate)
        for term, rate in zip(_terms(scene), rates.matrices, strict=True)
    ]
    damping = damped(run.plain_forces, matrices) + damped(rates.plain, run.coefficients)
    loads = run.loads_by(momentum, force - damping)
    if (forcing := rate_of_forcing(scene.forcing, one, "forcing")) is not None:
        loads += _loads_of(run, replace(scene, forcing=forcing), "of_forcing")
    if moves_initial_loads(scene, one):
        loads += by_initial_loads(scene, one, lambda own: _loads_of(run, own, "of_initial_data"))
    return loads, x, impulse, damping


def _loads_of(run: LinearisedRun, scene: Scene, part: str) -> Array:
    """Load vectors of all steps of a run by the forces of a scene, ``(n, s + 1, d)``."""
    steps = run.steps
    fresh = np.isin(steps.time[:-1], [0.0, *scene.break_points])
    found = loads_along(getattr(StepLoads(scene, run.method, steps.tables), part), steps, fresh)
    zero = np.zeros((steps.n_steps, steps.tables.degree + 1, scene.dimension))
    return zero if found is None else found


def rates_of_forces(
    scene: Scene, one: Parameter, position: Array, velocity: Array, time: Array
) -> tuple[Array, Array]:
    """Derivatives of momenta and conservative forces, ``(..., d)`` both."""
    d, lagrangian, potential = scene.dimension, scene.lagrangian, scene.potential
    momentum, force = np.zeros_like(velocity), np.zeros_like(position)
    if "mass" in one.rates:
        momentum = velocity @ one.rates["mass"]
    if "stiffness" in one.rates:
        force = -position @ one.rates["stiffness"]
    if "potential" in one.functions:
        force = force - one.functions["potential"](position)
    if lagrangian is not None and (moved := one.under("lagrangian.")):
        system, values = _rate_of(lagrangian.first, lagrangian.parameters, moved)
        found = lagrangian.evaluate(system, position, velocity, time, values)
        return momentum + found[..., :d], force + found[..., d:]
    if isinstance(potential, ExpressionPotential) and (moved := one.under("potential.")):
        system, values = _rate_of(potential.gradient_system, potential.parameters, moved)
        for index, value in enumerate(potential.evaluate(system, position, values)):
            force[..., index] -= value
    return momentum, force


def rate_of_remainder(
    scene: Scene,
    one: Parameter,
    position: Array,
    velocity: Array,
    acceleration: Array,
    time: Array,
) -> Array:
    r"""Derivatives of :math:`\partial_q L - \frac{d}{dt} \partial_v L` along a motion, (n, d)."""
    own = scene.lagrangian
    if own is None:
        _, force = rates_of_forces(scene, one, position, velocity, time)
        return force - acceleration @ one.rates["mass"] if "mass" in one.rates else force
    system, values = _rate_of(own.imbalance, own.parameters, one.under("lagrangian."))
    found = own.evaluate(system, position, velocity, time, values, acceleration)
    rate = found[..., : own.dimension] - found[..., own.dimension :]
    return rate - position @ one.rates["stiffness"] if "stiffness" in one.rates else rate


def rate_of_forcing(forcing: Forcing | None, one: Parameter, prefix: str) -> Forcing | None:
    """Derivative of a forcing; None if it is zero."""
    moved = [*one.rates, *one.functions]
    if forcing is None or not any(name.startswith(f"{prefix}.") for name in moved):
        return None
    rates = iter(
        [
            _rate_of_component(own, one.under(f"{place}."), one.functions.get(place))
            for place, own in _components(forcing, prefix)
        ]
    )
    pieces = [
        ForcingPiece(components=tuple(next(rates) for _ in piece.components), until=piece.until)
        for piece in forcing.pieces
    ]
    return Forcing(pieces=tuple(pieces))


def _rate_of_component(
    component: ForceComponent, rates: Mapping[str, Any], function: Function | None
) -> ForceComponent:
    if not rates and function is None:
        return _ZERO
    formula, changed = formula_of(component), None
    if formula is not None:
        own = {name: rate for name, rate in rates.items() if name in dict(formula.constants)}
        system, values = _rate_of(formula.system, dict(formula.constants), own)
        known = tuple(sorted(values.items()))
        changed = Expression("the derivative of a force", ("t",), known, system=system)
    if isinstance(component, SampledForce):
        moved = np.zeros_like(component.coefficients) + rates.get("coefficients'", 0.0)
        return replace(component, coefficients=moved, formula=changed)
    if isinstance(component, FunctionForce):
        scaled = replace(component, factor=float(rates.get("factor'", 0.0)), formula=changed)
        if function is None:
            return scaled
        acting = replace(component, function=function, formula=None)

        def both(time: Array) -> Array:
            at = {"t": time}
            return np.add(acting.evaluate(at), scaled.evaluate(at))

        return FunctionForce(function=both)
    return changed or _ZERO


_ZERO = Expression.parse("0", variables=("t",))


def _rate_of(
    system: FormulaSystem, parameters: Mapping[str, Any], rates: Mapping[str, Any]
) -> tuple[FormulaSystem, dict[str, Any]]:
    """The derivative of all outputs of a program, and the values of its names."""
    names = tuple(sorted(set(rates).intersection(system.names)))
    moving = {f"d{name}'": float(rates[name]) for name in names}
    return _rate_system(system, names), {**parameters, **moving}


@lru_cache(maxsize=256)
def _rate_system(system: FormulaSystem, names: tuple[str, ...]) -> FormulaSystem:
    return derivatives(system, [{name: f"d{name}'" for name in names}])[len(system.outputs) :]


def _components(forcing: Forcing | None, prefix: str) -> Iterator[tuple[str, ForceComponent]]:
    for number, piece in enumerate(forcing.pieces if forcing else ()):
        for index, component in enumerate(piece.components):
            yield f"{prefix}.{number}.{index}", component


def _of_component(component: ForceComponent) -> dict[str, Any]:
    """Its numbers; a prime marks what has no name for users."""
    own = formula_of(component)
    found: dict[str, Any] = dict(own.constants) if own is not None else {}
    if isinstance(component, SampledForce):
        found["coefficients'"] = component.coefficients
    if isinstance(component, FunctionForce):
        found["factor'"] = component.factor
    return found


# --- the memory ---


class MemoryRates(NamedTuple):
    """Changes of damping terms and laws, one after the other, by a parameter."""

    matrices: list[Array]  # of their matrices, on deformations, those of laws times their size
    plain: Array  # of their forces without matrices, (f, n, m, d), at fixed motion


def memory_rates(run: LinearisedRun, one: Parameter) -> MemoryRates:
    """What a parameter changes in the terms and laws of a scene along a motion."""
    scene, count = run.scene, len(run.coefficients)
    start = np.zeros(run.d) + one.of("initial_velocity")
    plain, matrices = run.plain_by_start(start), []
    for k, term in enumerate(scene.damping):
        if order := one.of(f"damping.{k}.order"):
            plain[k] -= order * run.plain_forces[count + k]
        matrices.append(np.zeros(term.inner.shape) + one.of(f"damping.{k}.coefficient"))
    for k, law in enumerate(scene.laws):
        matrices.append(
            law.size * (np.zeros(law.inner.shape) + one.of(f"laws.{k}.coefficient"))
            + one.of(f"laws.{k}.size") * dense(law.inner)
        )
        if rule := kernel_rule(law.kernel, one.under(f"laws.{k}.")):
            factors, kernels = zip(*rule, strict=True)
            plain[len(scene.damping) + k] += np.tensordot(factors, run.forces_of(kernels), axes=1)
    return MemoryRates(matrices, plain)


def kernel_rule(
    kernel: RelaxationKernel, rates: Mapping[str, Any]
) -> list[tuple[float, RelaxationKernel]]:
    """Factors and kernels whose sum is the derivative of a kernel; empty if nothing moves it."""
    numbers = _of_kernel(kernel)
    moved = {name: rate for name, rate in rates.items() if name in numbers}
    # in parts of the distance to where a kernel ends to be one
    sizes = [
        np.abs(rate / np.minimum(numbers[name], 1.0 - numbers[name] if name == "order" else np.inf))
        for name, rate in moved.items()
    ]
    if not moved:
        return []
    step, found = SPACING / max(float(np.max(size)) for size in sizes), []
    for place, factor in RULE.items():
        changed = {name: numbers[name] + place * step * rate for name, rate in moved.items()}
        found.append((factor / step, _kernel_with(kernel, {**numbers, **changed})))
    return found


def _of_kernel(kernel: RelaxationKernel) -> dict[str, Any]:
    if kernel.masses:
        return dict(zip(("rates", "weights"), np.transpose(kernel.masses), strict=True))
    return {name: one for name, one in vars(kernel).items() if isinstance(one, float)}


def _kernel_with(kernel: Any, numbers: Mapping[str, Any]) -> RelaxationKernel:
    if kernel.masses:
        pairs = np.transpose([numbers["rates"], numbers["weights"]])
        return PronyKernel(masses=tuple(map(tuple, pairs.tolist())))
    changed: RelaxationKernel = replace(kernel, **{k: float(one) for k, one in numbers.items()})
    return changed


def symbol_rates(scene: Scene, one: Parameter, s: ComplexArray) -> list[tuple[ComplexArray, Array]]:
    """Pairs of a function of s and a matrix whose products add up to the change of T(s)."""
    unit = np.ones_like(s)
    found: list[tuple[Any, Any]] = [(s * s, one.of("mass")), (unit, one.of("stiffness"))]
    for k, term in enumerate(scene.damping):
        power = term.symbol(s)  # type: ignore[arg-type]
        moved = _on_coordinates(term, one.of(f"damping.{k}.coefficient"))
        found += [(power, moved), (power * np.log(s), one.of(f"damping.{k}.order") * term.matrix)]
    for k, law in enumerate(scene.laws):
        own = s * np.array([law.kernel.transform(at) for at in s.tolist()])
        rate = np.zeros_like(s)
        for factor, kernel in kernel_rule(law.kernel, one.under(f"laws.{k}.")):
            rate += factor * law.size * s * np.array([kernel.transform(at) for at in s.tolist()])
        moved = law.size * _on_coordinates(law, one.of(f"laws.{k}.coefficient"))
        found += [(own, one.of(f"laws.{k}.size") * law.matrix + moved), (rate, law.matrix)]
    return [(factor, matrix) for factor, matrix in found if np.any(matrix)]


def _terms(scene: Scene) -> tuple[FractionalDamping | Law, ...]:
    return (*scene.damping, *scene.laws)


def _on_coordinates(term: FractionalDamping | Law, inner: Any) -> Any:
    """A matrix on the deformation of a term as one on the coordinates."""
    if term.factored is None:
        return np.zeros(term.form.shape) + inner
    rows = dense(term.factored.rows)
    return rows.T @ (np.zeros(term.inner.shape) + inner) @ rows


# --- Riemann-Liouville derivatives of the initial data ---


def moves_initial_loads(scene: Scene, one: Parameter) -> bool:
    """Whether the loads of the initial data may depend on a parameter."""
    moved = ("initial_", "damping.")
    return scene.derivative != "caputo" and any(name.startswith(moved) for name in one.rates)


def by_initial_loads(scene: Scene, one: Parameter, values: Callable[[Scene], Array]) -> Array:
    """Derivatives of values that depend on orders, matrices and initial data, smoothly in all."""
    numbers, sizes = numbers_of(scene), [0.0]
    for name, rate in one.rates.items():
        if name.startswith(("initial_", "damping.")):
            size = np.abs(numbers[name]).max() or 1.0
            if name.endswith(".order"):
                size = min(size, abs(1.0 - size), 2.0 - size)
            sizes.append(float(np.abs(rate).max() / size))
    step = SPACING / (max(sizes) or 1.0)

    def shifted(number: float) -> Scene:
        terms = []
        for k, term in enumerate(scene.damping):
            inner = dense(term.inner) + number * one.of(f"damping.{k}.coefficient")
            changed: Any = (
                inner if term.factored is None else replace(term.factored, inner=inner, whole=None)
            )
            order = term.order + float(number * one.of(f"damping.{k}.order"))
            terms.append(replace(term, order=order, coefficient=changed))
        initial = {
            name: getattr(scene, name) + number * one.of(name)
            for name in ("initial_position", "initial_velocity")
        }
        return replace(scene, damping=tuple(terms), **initial)

    return np.asarray(
        sum(factor / step * values(shifted(place * step)) for place, factor in RULE.items())
    )
