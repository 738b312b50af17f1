"""The numbers of a scene by name, one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar, cast

import numpy as np

from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws.prony import Exponentials
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.adjoint.variation import Variation
from fvi_cli.mathematics.arrays import Array

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """A number, vector or symmetric matrix of a scene.

    Parameters
    ----------
    name
        What it is called: ``mass``, ``stiffness``, ``initial_position``, ``initial_velocity``,
        ``damping.<index>.order`` and ``.coefficient``, ``potential.<parameter>``,
        ``laws.<index>.size``, ``.coefficient`` and the numbers of its kernel: ``.order`` and
        ``.time`` or ``.rate``, or ``.rates`` and ``.weights`` of a Prony series.
    value
        Its value, shape ``()``, ``(d,)`` or ``(d, d)``.
    family
        The scene for another value.
    """

    name: str
    value: Array
    family: Callable[[Array], Scene]

    def variations(self) -> Iterator[tuple[tuple[int, ...], Variation]]:
        """Every number in it; of a symmetric matrix those on and above the diagonal."""
        for index in np.ndindex(*self.value.shape):
            if len(index) < 2 or index[0] <= index[1]:
                one = Variation(
                    family=partial(self._with, index),
                    value=float(self.value[index]),
                    name=self.name,
                )
                yield index, one

    def _with(self, index: tuple[int, ...], number: float) -> Scene:
        changed = self.value.copy()
        changed[index] = changed[index[::-1]] = number
        return self.family(changed)

    def gathered(self, rates: dict[tuple[int, ...], float]) -> Array:
        """The derivative G in the shape of the value: the change is ``sum(G * dvalue)``."""
        found = np.zeros(self.value.shape)
        for index, rate in rates.items():
            share = 0.5 if len(index) == 2 and index[0] != index[1] else 1.0
            found[index] = found[index[::-1]] = share * rate
        return found


def entries_of(scene: Scene) -> dict[str, Entry]:
    """All numbers of a scene by name; a general Lagrangian's own ones are not among them."""
    found: list[Entry] = []

    def add(name: str, value: object, family: Callable[[Array], Scene]) -> None:
        found.append(Entry(name=name, value=np.array(value, dtype=float), family=family))

    potential = scene.potential
    if scene.lagrangian is None:
        add("mass", scene.inertia.mass, partial(_with_mass, scene))
    if isinstance(potential, QuadraticPotential):
        add("stiffness", potential.stiffness, partial(_with_stiffness, scene))
    if isinstance(potential, ExpressionPotential):
        for name, number in potential.parameters.items():
            add(f"potential.{name}", number, partial(_with_parameter, scene, potential, name))
    for index, term in enumerate(scene.damping):
        for name in ("order", "coefficient"):
            family = partial(_with_term, scene, index, name)
            add(f"damping.{index}.{name}", getattr(term, name), family)
    for index, law in enumerate(scene.laws):
        numbers: dict[str, object] = {"size": law.size, "coefficient": law.coefficient}
        if law.kernel.masses:
            rates, weights = zip(*law.kernel.masses, strict=True)
            numbers |= {"rates": rates, "weights": weights}
        else:
            numbers |= vars(law.kernel)
        for name, numeral in numbers.items():
            add(f"laws.{index}.{name}", numeral, partial(_with_law, scene, index, name))
    add("initial_position", scene.initial_position, partial(_with_position, scene))
    add("initial_velocity", scene.initial_velocity, partial(_with_velocity, scene))
    return {one.name: one for one in found}


def _with_mass(scene: Scene, value: Array) -> Scene:
    return replace(scene, inertia=Inertia(mass=value))


def _with_stiffness(scene: Scene, value: Array) -> Scene:
    return replace(scene, potential=QuadraticPotential(stiffness=value))


def _with_parameter(scene: Scene, potential: ExpressionPotential, name: str, value: Array) -> Scene:
    parameters = {**potential.parameters, name: float(value)}
    return replace(scene, potential=replace(potential, parameters=parameters))


def _with_term(scene: Scene, index: int, name: str, value: Array) -> Scene:
    term = _changed(scene.damping[index], name, value)
    return replace(scene, damping=_exchanged(scene.damping, index, term))


def _with_law(scene: Scene, index: int, name: str, value: Array) -> Scene:
    law = scene.laws[index]
    if name in ("rates", "weights"):
        masses = np.array(law.kernel.masses)
        masses[:, int(name == "weights")] = value
        law = replace(law, kernel=Exponentials(masses=tuple(map(tuple, masses.tolist()))))
    elif name in ("size", "coefficient"):
        law = _changed(law, name, value)
    else:
        law = replace(law, kernel=_changed(law.kernel, name, value))
    return replace(scene, laws=_exchanged(scene.laws, index, law))


def _changed(one: T, name: str, value: Array) -> T:
    changes: dict[str, Any] = {name: value if value.ndim else float(value)}
    return cast(T, replace(cast(Any, one), **changes))


def _exchanged(every: tuple[T, ...], index: int, one: T) -> tuple[T, ...]:
    return (*every[:index], one, *every[index + 1 :])


def _with_position(scene: Scene, value: Array) -> Scene:
    return replace(scene, initial_position=value)


def _with_velocity(scene: Scene, value: Array) -> Scene:
    return replace(scene, initial_velocity=value)
