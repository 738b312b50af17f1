r"""Parameters of scenes, and what they change in the equations of a run whose motion is held fixed.

A scene is its numbers by name: masses, orders, initial data, the parameters that its formulas name.
A parameter moves some of them at known rates. Formulas are differentiated by their names, exactly.
The equations depend smoothly on all other numbers, most of them linearly: their derivatives are
those of a rule of order four, at fixed motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from fvi_cli.effects.damping import MatrixForce
from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece, formula_of
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.sampled import FunctionForce, SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances import loads_along
from fvi_cli.integrator.gradients.linearised import Disturbance, LinearisedRun
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.mathematics.algebra.builder import derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression

DIFFERENCE = float(np.cbrt(np.finfo(float).eps))
"""Difference of a parameter of a function, relative to its size: h^2 is as large as eps / h."""
SPACING = 3e-4
"""Spacing of the rule relative to a number: its error h^4 / 30 times the fourth power of the
logarithm of the number of steps, and round-off eps / h, are both some 1e-12."""
CENTRAL = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}
BELOW = {0: 25 / 12, -1: -4.0, -2: 3.0, -3: -4 / 3, -4: 1 / 4}
"""Rules of order four, also from one side: motions jump where an order passes 1."""
LINEAR = {0: -1.0, 1: 1.0}
MODULI = ("size", "spring")
"""Numbers of laws, in which their forces are linear together."""

Described = tuple[Scene, Observations]
"""A scene, and the names in expressions along its motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameter:
    """Rates at which a parameter moves the numbers of a scene; those that are absent stay."""

    name: str  # in messages
    rates: Mapping[str, Array]

    def of(self, number: str) -> Any:
        """The rate of one number."""
        return self.rates.get(number, 0.0)

    def under(self, prefix: str) -> dict[str, Any]:
        """The rates of all numbers whose names begin with a prefix, by the rest of the name."""
        every = self.rates.items()
        return {name.removeprefix(prefix): one for name, one in every if name.startswith(prefix)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """A number, vector or symmetric matrix of a scene, with a parameter for each part."""

    name: str
    value: Array
    moved: Sequence[str]  # the numbers that have this value

    @property
    def indices(self) -> list[tuple[int, ...]]:
        """Indices of the parts, for a symmetric matrix on and above the diagonal."""
        every = np.ndindex(*self.value.shape)
        return [at for at in every if not self._is_symmetric or at[0] <= at[1]]

    @property
    def _is_symmetric(self) -> bool:
        return self.value.ndim == 2 and not self.name.endswith("masses")

    def parameter(self, index: tuple[int, ...]) -> Parameter:
        """The parameter that moves the part at an index."""
        rate = np.zeros(self.value.shape)
        rate[index] = 1.0
        if self._is_symmetric:
            rate[index[::-1]] = 1.0
        return Parameter(name=self.name, rates=dict.fromkeys(self.moved, rate))

    def gathered(self, derivatives: Sequence[float]) -> Array:
        """The derivative G in the shape of the value: the change is ``sum(G * dvalue)``."""
        found = np.zeros(self.value.shape)
        for index, one in zip(self.indices, derivatives, strict=True):
            found[index] = one
            if self._is_symmetric and index[0] != index[1]:
                found[index] = found[index[::-1]] = 0.5 * one
        return found


def numbers_of(scene: Scene, names: Observations | None = None) -> dict[str, Array]:
    """All numbers of a scene by name, and those that names in expressions stand for.

    ``mass``, ``stiffness``, ``potential.<parameter>``, ``lagrangian.<parameter>``,
    ``damping.<k>.order`` and ``.coefficient`` (on the deformation, where it acts on one),
    ``laws.<k>.size``, ``.spring``, ``.coefficient`` and the numbers of its kernel,
    ``initial_position``, ``initial_velocity``, ``forcing.<piece>.<component>.<parameter>``.
    """
    kind, own = _energy(scene)
    found: dict[str, Any] = {} if kind == "lagrangian" else {"mass": scene.inertia.mass}
    form = own.form if isinstance(own, QuadraticPotential) else getattr(own, "stiffness", None)
    if form is not None:
        found["stiffness"] = dense(form)
    found |= {f"{kind}.{name}": one for name, one in getattr(own, "parameters", {}).items()}
    for k, term in enumerate(scene.damping):
        found |= {f"damping.{k}.order": term.order, f"damping.{k}.coefficient": dense(term.inner)}
    for k, law in enumerate(scene.laws):
        parts: dict[str, Any] = {"size": law.size, "spring": law.spring}
        parts |= {"coefficient": dense(law.inner)}
        found |= {f"laws.{k}.{name}": o for name, o in (parts | vars(law.kernel)).items()}
    found |= {name: getattr(scene, name) for name in ("initial_position", "initial_velocity")}
    found |= {f"names.{name}": one for name, one in (names.parameters if names else {}).items()}
    for prefix, forcing in _forcings(scene, names).items():
        for place, one in _components(forcing, prefix):
            formula = formula_of(one)
            found |= {f"{place}.{name}": v for name, v in (formula.constants if formula else ())}
            # a prime marks what has no name for users
            if isinstance(one, SampledForce):
                found[f"{place}.coefficients'"] = one.coefficients
            if isinstance(one, FunctionForce):
                found[f"{place}.factor'"] = one.factor
    return {name: np.array(one, dtype=float) for name, one in found.items()}


def entries_of(scene: Scene) -> dict[str, Entry]:
    """The numbers of a scene that users may name; ``forcing.<parameter>`` in all formulas."""
    numbers, together = numbers_of(scene), dict[str, list[str]]()
    for name in numbers:
        kind, _, rest = name.partition(".")
        last = rest.rpartition(".")[2]
        if kind == "forcing" and last.isidentifier():
            together.setdefault(f"forcing.{last}", []).append(name)
        elif kind != "forcing" and (kind, last) != ("laws", "spring"):
            together[name] = [name]
    named = dict[str, str]()
    for name in together:
        if name.startswith(("potential.", "lagrangian.", "forcing.")):
            named.setdefault(name.partition(".")[2], name)
    for last, name in named.items():
        # the same name in expressions
        together[name].append(f"names.{last}")
    return {
        name: Entry(name=name, value=numbers[moved[0]], moved=moved)
        for name, moved in together.items()
        # a name that has two values in the formulas of a force is no parameter
        if len({numbers[one].tobytes() for one in moved if one in numbers}) == 1
    }


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
    if any(_form(*one) != _form(*described) for one in sides):
        raise ValueError(
            f"{name}: the scene has another form near {value:g}; what changes in formulas must be "
            "a parameter with a name"
        )
    upper, lower = (numbers_of(*one) for one in sides)
    rates = {key: (upper[key] - lower[key]) / (ends[0] - ends[1]) for key in upper}
    return Parameter(name=name, rates={key: rate for key, rate in rates.items() if rate.any()})


def _form(scene: Scene, names: Observations) -> tuple[object, ...]:
    """What must be the same in scenes that differ in numbers with names only."""
    _, own = _energy(scene)
    found: list[object] = [scene.derivative, [type(law.kernel) for law in scene.laws]]
    found += [getattr(own, part, None) for part in ("value", "gradient_system", "functions")]
    if scene.prescribed:
        found += [one.text for one in scene.prescribed.displacement.components]
    for prefix, forcing in _forcings(scene, names).items():
        found += [piece.until for piece in forcing.pieces] if forcing else [None]
        for _, one in _components(forcing, prefix):
            formula = formula_of(one)
            knots = one.knots.tobytes() if isinstance(one, SampledForce) else b""
            found += [formula and formula.system, type(one), getattr(one, "function", None), knots]
    return (*found, {name: one.shape for name, one in numbers_of(scene, names).items()})


def _energy(scene: Scene) -> tuple[str, Any]:
    if scene.lagrangian is not None:
        return "lagrangian", scene.lagrangian
    return "potential", scene.potential


def _forcings(scene: Scene, names: Observations | None) -> dict[str, Forcing | None]:
    inputs = {} if names is None else names.inputs
    return {"forcing": scene.forcing} | {f"inputs.{name}": one for name, one in inputs.items()}


def _components(forcing: Forcing | None, prefix: str) -> Iterator[tuple[str, ForceComponent]]:
    for number, piece in enumerate(forcing.pieces if forcing else ()):
        for index, component in enumerate(piece.components):
            yield f"{prefix}.{number}.{index}", component


def objection(scene: Scene, one: Parameter, *, of_forces: bool = False) -> str:
    """Why numbers of a scene, or of its forces, have no derivative by a parameter; often empty."""
    if scene.derivative == "caputo":
        return ""
    orders = [term.order for term in scene.active_damping]
    above, moves_velocity = max(orders, default=0.0) > 1.0, np.any(one.of("initial_velocity"))
    if np.any(one.of("initial_position")) and (above or scene.laws):
        return (
            f"{one.name}: a position that is not 0 at the start gives Riemann-Liouville "
            "derivatives above order 1, and laws beside them, a force that is not integrable"
        )
    if of_forces and above and (moves_velocity or scene.initial_velocity.any()):
        return (
            f"{one.name}: forces of Riemann-Liouville derivatives above order 1 with a start "
            "velocity keep an error of the first step; use caputo"
        )
    at_one = [k for k, term in enumerate(scene.damping) if term.is_integer_order]
    start = (*scene.initial_position, *scene.initial_velocity)
    if any(start) and any(one.of(f"damping.{k}.order") for k in at_one):
        return f"{one.name}: Riemann-Liouville derivatives jump where an order passes 1"
    return ""


# --- the rule of order four ---


def moved(scene: Scene, numbers: Mapping[str, Array]) -> Scene:
    """The scene with other values of numbers outside of its formulas."""
    for name, value in numbers.items():
        kind, own = _energy(scene)
        if name == "mass":
            scene = replace(scene, inertia=Inertia(mass=value))
        elif isinstance(own, QuadraticPotential) and name == "stiffness":
            scene = replace(scene, potential=QuadraticPotential(stiffness=value))
        else:
            scene = _with(scene, [kind, name] if name == "stiffness" else name.split("."), value)
    return scene


def _with(owner: Any, path: Sequence[str], value: Any) -> Any:
    """A dataclass or tuple with another value at the end of a path."""
    head, *rest = path
    if isinstance(owner, tuple):
        index = int(head)
        return (*owner[:index], _with(owner[index], rest, value), *owner[index + 1 :])
    if not hasattr(owner, head):
        return replace(owner, kernel=_with(owner.kernel, path, value))
    own = getattr(owner, head)
    if rest:
        value = _with(own, rest, value)
    elif isinstance(owner, MatrixForce) and head == "coefficient" and owner.factored:
        value = replace(owner.factored, inner=value)
    elif isinstance(own, tuple):
        value = tuple(map(tuple, value.tolist()))
    elif isinstance(own, float):
        value = float(value)
    return replace(owner, **{head: value})


def by_rule(
    scene: Scene,
    parameters: Sequence[Parameter],
    kinds: tuple[str, ...],
    values: Callable[[list[Scene]], Any],
) -> Any:
    """Derivatives ``(p, ...)`` of values of scenes, ``(k, ...)`` of k, by numbers of some kinds."""
    scenes, weights = rule_of(scene, parameters, kinds)
    return np.tensordot(weights, values(scenes), axes=1) if len(scenes) > 1 else 0.0


def rule_of(
    scene: Scene, parameters: Sequence[Parameter], kinds: tuple[str, ...]
) -> tuple[list[Scene], Array]:
    """The scene and k - 1 others; weights ``(p, k)`` from values of all to derivatives."""
    numbers, scenes, rules = numbers_of(scene), [scene], {}
    for place, one in enumerate(parameters):
        chosen = {name: rate for name, rate in one.rates.items() if name.startswith(kinds)}
        if not chosen:
            continue
        sizes = [_size(name, numbers[name]) for name in chosen]
        pairs = zip(chosen.values(), sizes, strict=True)
        step = SPACING / max(float(np.max(np.abs(r) / s)) for r, s in pairs)
        at_one = [r for name, r in chosen.items() if name.endswith("order") and numbers[name] == 1]
        rule, step = (BELOW, step * float(np.sign(at_one[0]))) if at_one else (CENTRAL, step)
        if all(name.startswith("laws.") and name.endswith(MODULI) for name in chosen):
            rule = LINEAR
        rules[place] = len(scenes), rule, step
        scenes += [
            moved(scene, {name: numbers[name] + k * step * rate for name, rate in chosen.items()})
            for k in rule
            if k
        ]
    weights = np.zeros((len(parameters), len(scenes)))
    for place, (first, rule, step) in rules.items():
        weights[place, 0] = rule.get(0, 0.0) / step
        factors = [factor / step for k, factor in rule.items() if k]
        weights[place, first : first + len(factors)] = factors
    return scenes, weights


def _size(name: str, value: Array) -> Array | float:
    """The size of a number, over which the scene depends on it smoothly."""
    size = np.abs(value)
    if name == "mass":
        # so that it stays positive definite
        return np.asarray(np.sqrt(np.outer(size.diagonal(), size.diagonal())))
    if name.endswith("order"):
        return min(float(one) for one in (size, 2.0 - size, abs(1.0 - size)) if one > 0.0)
    return np.asarray(size) if name.endswith("masses") else float(size.max()) or 1.0


# --- what parameters change while the motion is held fixed ---

MEMORY = ("damping.", "laws.", "initial_velocity")
"""Kinds of numbers on which the damping force at fixed motion depends."""


def disturbance(run: LinearisedRun, parameters: Sequence[Parameter]) -> Disturbance:
    """Effect of parameters on the equations of a run."""
    scene, steps = run.scene, run.steps
    points = (steps.stage_position, steps.velocity, steps.stage_time)
    start = (scene.initial_position, scene.initial_velocity, np.zeros(()))
    at = scene.derivatives(*(np.asarray(part)[None] for part in start))
    shape = len(parameters), steps.n_steps, run.tables.degree + 1, run.d
    loads, (position, impulse) = np.zeros(shape), np.zeros((2, len(parameters), run.d))
    for k, one in enumerate(parameters):
        loads[k] = run.loads_by(*_by_conservative(scene, one, *points))
        if (forcing := rate_of_forcing(scene.forcing, one, "forcing")) is not None:
            loads[k] += _loads_of(run, replace(scene, forcing=forcing), "of_forcing")
        position[k] = one.of("initial_position")
        velocity = np.zeros(run.d) + one.of("initial_velocity")
        impulse[k] = at.mass[0] @ velocity + at.mixed[0] @ position[k]
        impulse[k] += _by_conservative(scene, one, *start)[0]

    def damping(scenes: list[Scene]) -> Array:
        return np.array(run.forces_of(scenes, steps.velocity))

    def initial(scenes: list[Scene]) -> Array:
        return np.array([_loads_of(run, one, "of_initial_data") for one in scenes])

    force = np.zeros((len(parameters), *steps.velocity.shape))
    force -= by_rule(scene, parameters, MEMORY, damping)
    loads += run.loads_by(np.zeros_like(force), force)
    if scene.derivative != "caputo":
        loads += by_rule(scene, parameters, ("damping.", "initial_"), initial)
    return Disturbance(loads, position, impulse)


def _loads_of(run: LinearisedRun, scene: Scene, part: str) -> Array:
    """Load vectors of all steps of a run by the forces of a scene, ``(n, s + 1, d)``."""
    steps = run.steps
    of_steps = getattr(StepLoads(scene, run.method, steps.tables), part)
    found = loads_along(of_steps, steps, scene.break_points)
    zero = np.zeros((steps.n_steps, steps.tables.degree + 1, scene.dimension))
    return zero if found is None else found


def _by_conservative(
    scene: Scene, one: Parameter, x: Array, v: Array, time: Array
) -> tuple[Array, Array]:
    """Derivatives of momenta and conservative forces, ``(..., d)`` both."""
    d, (kind, own) = scene.dimension, _energy(scene)
    mass, stiffness = (np.zeros((d, d)) + one.of(name) for name in ("mass", "stiffness"))
    momentum, force = v @ mass, -x @ stiffness
    if not (rates := one.under(f"{kind}.")):
        return momentum, force
    if kind == "lagrangian":
        system, values = _rate_of(own.first, own.parameters, rates)
        found = own.evaluate(system, x, v, time, values)
        return momentum + found[..., :d], force + found[..., d:]
    system, values = _rate_of(own.gradient_system, own.parameters, rates)
    for index, value in enumerate(own.evaluate(system, x, values)):
        force[..., index] -= value
    return momentum, force


def rate_of_remainder(
    scene: Scene, one: Parameter, x: Array, v: Array, a: Array, time: Array
) -> Array:
    r"""Derivative of :math:`\partial_q L - \frac{d}{dt} \partial_v L` by names in formulas.

    Along a motion, with its accelerations; ``(n, d)``.
    """
    own = scene.lagrangian
    if own is None:
        by_names = replace(
            one, rates={f"potential.{k}": r for k, r in one.under("potential.").items()}
        )
        return _by_conservative(scene, by_names, x, v, time)[1]
    system, values = _rate_of(own.imbalance, own.parameters, one.under("lagrangian."))
    found = own.evaluate(system, x, v, time, values, a)
    return np.asarray(found[..., : own.dimension] - found[..., own.dimension :])


def rate_of_forcing(forcing: Forcing | None, one: Parameter, prefix: str) -> Forcing | None:
    """Derivative of a forcing; None if it is zero."""
    if forcing is None or not one.under(f"{prefix}."):
        return None
    every = _components(forcing, prefix)
    rates = iter([_rate_of_component(own, one.under(f"{place}.")) for place, own in every])
    pieces = [
        ForcingPiece(components=tuple(next(rates) for _ in piece.components), until=piece.until)
        for piece in forcing.pieces
    ]
    return Forcing(pieces=tuple(pieces))


def _rate_of_component(component: ForceComponent, rates: Mapping[str, Any]) -> ForceComponent:
    formula, changed = formula_of(component), None
    if formula is not None and rates:
        system, values = _rate_of(formula.system, dict(formula.constants), rates)
        known = tuple(sorted(values.items()))
        changed = Expression("the derivative of a force", ("t",), known, system=system)
    if isinstance(component, SampledForce) and rates:
        own = np.zeros_like(component.coefficients) + rates.get("coefficients'", 0.0)
        return replace(component, coefficients=own, formula=changed)
    if isinstance(component, FunctionForce) and rates:
        return replace(component, factor=float(rates.get("factor'", 0.0)), formula=changed)
    return changed or _ZERO


_ZERO = Expression.parse("0", variables=("t",))


def _rate_of(
    system: FormulaSystem, parameters: Mapping[str, Any], rates: Mapping[str, Any]
) -> tuple[FormulaSystem, dict[str, Any]]:
    """The derivative of all outputs of a program, and the values of its names."""
    names = tuple(sorted(set(rates).intersection(system.names)))
    return _rate_system(system, names), {
        **parameters,
        **{f"d{name}'": float(rates[name]) for name in names},
    }


@lru_cache(maxsize=256)
def _rate_system(system: FormulaSystem, names: tuple[str, ...]) -> FormulaSystem:
    return derivatives(system, [{name: f"d{name}'" for name in names}])[len(system.outputs) :]
