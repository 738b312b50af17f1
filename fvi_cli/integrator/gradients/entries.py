"""The numbers of a scene by name, one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.laws.prony import PronyKernel
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.variation import Variation
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class GradientEntry:
    """A number, vector or symmetric matrix of a scene."""

    # its name: mass, stiffness, initial_position, initial_velocity, damping.<index>.order
    # and .coefficient, potential.<parameter>, lagrangian.<parameter>, laws.<index>.size,
    # .coefficient and the numbers of its kernel: .order and .time or .rate, or .rates and .weights
    # of a Prony series
    name: str
    value: Array  # its value, shape (), (d,) or (d, d)
    family: Callable[[Array], Scene]  # the scene for another value

    def variations(self) -> Iterator[tuple[tuple[int, ...], Variation]]:
        """Every number in it; for a symmetric matrix the numbers on and above the diagonal."""
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

    def gathered(self, rates: Mapping[tuple[int, ...], float]) -> Array:
        """The derivative G in the shape of the value: the change is ``sum(G * dvalue)``."""
        found = np.zeros(self.value.shape)
        for index, rate in rates.items():
            share = 0.5 if len(index) == 2 and index[0] != index[1] else 1.0
            found[index] = found[index[::-1]] = share * rate
        return found


def entries_of(scene: Scene) -> dict[str, GradientEntry]:
    """All numbers of a scene by name."""
    found: dict[str, GradientEntry] = {}

    def add(name: str, value: object, changes: Callable[[Array], dict[str, Any]]) -> None:
        def family(other: Array) -> Scene:
            return replace(scene, **changes(other))

        found[name] = GradientEntry(name=name, value=np.array(value, dtype=float), family=family)

    potential, lagrangian = scene.potential, scene.lagrangian
    if lagrangian is None:
        add("mass", scene.inertia.mass, lambda v: {"inertia": Inertia(mass=v)})
    else:
        for name, own in lagrangian.parameters.items():
            add(f"lagrangian.{name}", own, partial(_of_lagrangian, scene, lagrangian, name))
    if isinstance(potential, QuadraticPotential):
        stiffness = potential.stiffness
        add("stiffness", stiffness, lambda v: {"potential": QuadraticPotential(stiffness=v)})
    if isinstance(potential, ExpressionPotential):
        for name, number in potential.parameters.items():
            add(f"potential.{name}", number, partial(_of_potential, potential, name))
    for kind, names in (("damping", ("order", "coefficient")), ("laws", ("size", "coefficient"))):
        every = getattr(scene, kind)
        for index, one in enumerate(every):
            numbers = {n: (getattr(one, n), partial(_with, one, n)) for n in names}
            if isinstance(one, Law):
                kept = vars(one.kernel)
                if one.kernel.masses:
                    columns = np.transpose(one.kernel.masses)
                    kept = dict(zip(("rates", "weights"), columns, strict=True))
                numbers |= {n: (value, partial(_with_kernel, one, n)) for n, value in kept.items()}
            for name, (value, change) in numbers.items():
                exchange = partial(_exchanged, kind, every, index, change)
                add(f"{kind}.{index}.{name}", value, exchange)
    for name in ("initial_position", "initial_velocity"):
        add(name, getattr(scene, name), partial(_field, name))
    return found


def _field(name: str, value: Array) -> dict[str, Any]:
    return {name: value if value.ndim else float(value)}


def _of_potential(potential: ExpressionPotential, name: str, value: Array) -> dict[str, Any]:
    parameters = {**potential.parameters, name: float(value)}
    return {"potential": replace(potential, parameters=parameters)}


def _of_lagrangian(scene: Scene, own: Lagrangian, name: str, value: Array) -> dict[str, Any]:
    changed = replace(own, parameters={**own.parameters, name: float(value)})
    start = changed.derivatives(scene.initial_position, scene.initial_velocity, 0.0)
    return {"lagrangian": changed, "inertia": Inertia(mass=start.mass)}


def _exchanged(
    kind: str, every: tuple[Any, ...], index: int, change: Callable[[Array], Any], value: Array
) -> dict[str, Any]:
    return {kind: (*every[:index], change(value), *every[index + 1 :])}


def _with(one: Any, name: str, value: Array) -> Any:
    return replace(one, **_field(name, value))


def _with_kernel(law: Law, name: str, value: Array) -> Law:
    if name not in ("rates", "weights"):
        return replace(law, kernel=_with(law.kernel, name, value))
    masses = np.array(law.kernel.masses)
    masses[:, int(name == "weights")] = value
    return replace(law, kernel=PronyKernel(masses=tuple(map(tuple, masses.tolist()))))
