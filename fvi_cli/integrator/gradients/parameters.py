r"""Parameters of scenes, and what they change in the equations of a run whose motion is held fixed.

A scene is its numbers by name: masses, orders, initial data, the parameters that its formulas name.
A parameter moves some of them at known rates. Formulas are differentiated by their names, exactly.
The equations depend smoothly on all other numbers, most of them linearly: their derivatives are
those of a rule of order four, at fixed motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fvi_cli.effects.damping import MatrixForce
from fvi_cli.effects.forcing import ForcingPiece
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.mathematics.arrays import Array

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

    def of(self, number: str, *shape: int) -> Array:
        """The rate of one number of a shape."""
        return np.zeros(shape) + self.rates.get(number, 0.0)

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
        return [at for at in every if at <= self._mirrored(at)]

    def _mirrored(self, index: tuple[int, ...]) -> tuple[int, ...]:
        """The index of the equal part of a symmetric matrix, else the same."""
        return index if self.name.endswith("masses") else index[::-1]

    def parameter(self, index: tuple[int, ...]) -> Parameter:
        """The parameter that moves the part at an index, and its mirror image, by 1 together."""
        rate = np.zeros(self.value.shape)
        rate[index] += 0.5
        rate[self._mirrored(index)] += 0.5
        return Parameter(name=self.name, rates=dict.fromkeys(self.moved, rate))

    def gathered(self, derivatives: Sequence[float]) -> Array:
        """The derivative G in the shape of the value: the change is ``sum(G * dvalue)``."""
        found = np.zeros(self.value.shape)
        for index, one in zip(self.indices, derivatives, strict=True):
            found[index] = found[self._mirrored(index)] = one
        return found


def numbers_of(scene: Scene, names: Observations | None = None) -> dict[str, Array]:
    """All numbers of a scene by name, and those that names in expressions stand for.

    ``mass``, ``stiffness``, ``potential.<parameter>``, ``lagrangian.<parameter>``,
    ``damping.<k>.order`` and ``.coefficient`` (on the deformation, where it acts on one),
    ``laws.<k>.size``, ``.spring``, ``.coefficient`` and the numbers of its kernel,
    ``initial_position``, ``initial_velocity``, ``forcing.<piece>.<component>.<parameter>``.
    """
    kind, own = energy_of(scene)
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
    for place, piece in _pieces(scene, names):
        # a prime marks what has no name for users
        found[f"{place}.weights'"] = piece.weights
        for index, one in enumerate(piece.components):
            if isinstance(one, SampledForce):
                found[f"{place}.{index}.coefficients'"] = one.coefficients
            found |= {f"{place}.{index}.{name}": v for name, v in getattr(one, "constants", ())}
    return {name: np.array(one, dtype=float) for name, one in found.items()}


def entries_of(scene: Scene, names: Observations | None = None) -> dict[str, Entry]:
    """The numbers of a scene that users may name; ``forcing.<parameter>`` in all formulas."""
    numbers, together = numbers_of(scene, names), dict[str, list[str]]()
    for name in numbers:
        kind, _, rest = name.partition(".")
        last = rest.rpartition(".")[2]
        if kind in ("potential", "lagrangian"):
            together[name] = [f"names.{last}", name]
        elif kind in ("forcing", "inputs"):
            if last.isidentifier():
                together.setdefault(f"forcing.{last}", [f"names.{last}"]).append(name)
        elif kind != "names" and (kind, last) != ("laws", "spring"):
            together[name] = [name]
    return {
        name: Entry(name=name, value=numbers[moved[-1]], moved=moved)
        for name, moved in together.items()
        # a name that has two values in formulas is no parameter
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
    sides, form = [family(float(end)) for end in ends], _form(*described)
    if any(_form(*one) != form for one in sides):
        raise ValueError(
            f"{name}: the scene has another form near {value:g}; what changes in formulas must be "
            "a parameter with a name"
        )
    upper, lower = (numbers_of(*one) for one in sides)
    rates = {key: (upper[key] - lower[key]) / (ends[0] - ends[1]) for key in upper}
    return Parameter(name=name, rates={key: rate for key, rate in rates.items() if rate.any()})


def _form(scene: Scene, names: Observations) -> tuple[object, ...]:
    """What must be the same in scenes that differ in numbers with names only."""
    _, own = energy_of(scene)
    found: list[object] = [scene.derivative, *(type(law.kernel) for law in scene.laws)]
    found += [getattr(own, part, None) for part in ("value", "gradient_system", "functions")]
    found += scene.break_points
    if scene.prescribed:
        moving = scene.prescribed.displacement.components
        found += [getattr(one, "text", None) for one in moving]
    for place, piece in _pieces(scene, names):
        found.append(place)
        for one in piece.components:
            found += [getattr(one, part, None) for part in ("system", "function")]
            found.append(one.knots.tobytes() if isinstance(one, SampledForce) else b"")
    return (*found, {name: one.shape for name, one in numbers_of(scene, names).items()})


def energy_of(scene: Scene) -> tuple[str, Any]:
    """The Lagrangian of a scene, else its potential, with the beginning of the names of numbers."""
    if scene.lagrangian is not None:
        return "lagrangian", scene.lagrangian
    return "potential", scene.potential


def _pieces(scene: Scene, names: Observations | None) -> Iterator[tuple[str, ForcingPiece]]:
    """Pieces of the forcing and of inputs in expressions, with the beginning of their names."""
    inputs = {} if names is None else names.inputs
    every = {"forcing": scene.forcing} | {f"inputs.{name}": one for name, one in inputs.items()}
    for prefix, forcing in every.items():
        for number, piece in enumerate(forcing.pieces if forcing else ()):
            yield f"{prefix}.{number}", piece


def moved(scene: Scene, numbers: Mapping[str, Array]) -> Scene:
    """The scene with other values of numbers outside of its formulas."""
    for name, value in numbers.items():
        kind, own = energy_of(scene)
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
        if at_one and scene.derivative != "caputo" and scene.initial_position.any():
            raise ValueError(
                f"{one.name}: Riemann-Liouville derivatives jump where an order passes 1"
            )
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
