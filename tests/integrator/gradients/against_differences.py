"""Derivatives by all numbers of a scene beside central differences of whole runs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.gradient import gradient_of
from fvi_cli.integrator.gradients.parameters import Parameter, entries_of, moved, parameter_of
from fvi_cli.integrator.gradients.quantity import Quantity
from fvi_cli.integrator.method import Method, as_method
from fvi_cli.integrator.observe.request import Observations, names_of
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.scenes.problem import Problem


def changes(scene: Scene, *names: str) -> list[Parameter]:
    """Every number of a scene, or those that have these names."""
    entries = entries_of(scene)
    chosen = [entries[name] for name in names or entries]
    return [one.parameter(index) for one in chosen for index in one.indices]


def by_function(
    family: Callable[..., Scene | Problem],
    method: str,
    steps: AnySteps,
    quantity: Quantity,
    values: Mapping[str, float],
) -> dict[str, float]:
    """Derivatives by the arguments of a function that makes scenes, which expressions may name."""

    def described(**own: float) -> tuple[Scene, Observations]:
        made = family(**own)
        if isinstance(made, Problem):
            return made.scene, made.names
        return made, Observations(coordinates=names_of(made), parameters=own)

    def with_one(name: str, value: float) -> tuple[Scene, Observations]:
        return described(**{**values, name: value})

    scene, names = described(**values)
    every = [
        parameter_of(name, partial(with_one, name), value, (scene, names))
        for name, value in values.items()
    ]
    _, found = gradient_of(scene, as_method(method), steps, quantity, every, names)
    return dict(zip(values, found.tolist(), strict=True))


def changed(scene: Scene, name: str, value: np.ndarray) -> Scene:
    """The scene with another value under a name."""
    kind, _, last = name.partition(".")
    if kind not in ("potential", "lagrangian"):
        return moved(scene, {name: value})
    own: Any = getattr(scene, kind)
    own = replace(own, parameters={**own.parameters, last: float(value)})
    if kind == "potential":
        return replace(scene, potential=own)
    at = own.derivatives(scene.initial_position, scene.initial_velocity, 0.0)
    return replace(scene, lagrangian=own, inertia=Inertia(mass=at.mass))


def misses(
    scene: Scene,
    method: Method,
    steps: AnySteps,
    quantity: Quantity,
    of: Callable[[Scene], float],
    names: Sequence[str] = (),
) -> np.ndarray:
    """How far derivatives are from differences of `of`, by how far these may be wrong."""
    entries = entries_of(scene)
    value, found = gradient_of(scene, method, steps, quantity, changes(scene, *names))
    np.testing.assert_allclose(value, of(scene), rtol=1e-12)
    rows = []
    for name in names or entries:
        for index in entries[name].indices:
            at = entries[name].value

            def moved(shift: float, name=name, index=index, at=at) -> float:
                value = at.copy()
                value[index] += 0.5 * shift
                value[index if name.endswith("masses") else index[::-1]] += 0.5 * shift
                return of(changed(scene, name, value))

            h = 2e-3 * max(abs(at[index]), 0.1)
            if name.endswith("order"):
                h = min(h, 0.01 * at[index])
            coarse, fine = ((moved(e) - moved(-e)) / (2 * e) for e in (h, h / 2))
            rows.append(((4 * fine - coarse) / 3, abs(fine - coarse)))
    expected, spread = np.array(rows).T
    return np.abs(found - expected) / (1e-3 * spread + 2e-8 * np.abs(expected).max())
