"""Derivatives by all numbers of a scene beside central differences."""

from collections.abc import Callable, Sequence

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.entries import entries_of
from fvi_cli.integrator.gradients.gradient import gradient_of
from fvi_cli.integrator.gradients.quantity import Quantity
from fvi_cli.integrator.gradients.variation import Variation
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import AnySteps


def changes(scene: Scene, *names: str) -> list[Variation]:
    """Of every number of a scene, or of those that have these names."""
    entries = entries_of(scene)
    return [one for name in names or entries for _, one in entries[name].variations()]


def misses(
    scene: Scene,
    method: Method,
    steps: AnySteps,
    quantity: Quantity,
    of: Callable[[Scene], float],
    names: Sequence[str] = (),
) -> np.ndarray:
    """How far derivatives are from differences of `of`, by how far these may be wrong."""
    by = changes(scene, *names)
    found = gradient_of(scene, method, steps, quantity, by)
    np.testing.assert_allclose(found.value, of(scene), rtol=1e-12)
    rows = []
    for change in by:
        at, h = change.value, 2e-3 * max(abs(change.value), 0.1)
        if change.name.endswith("order"):
            h = min(h, 0.01 * at)
        coarse, fine = (
            (of(change.family(at + e)) - of(change.family(at - e))) / (2 * e) for e in (h, h / 2)
        )
        rows.append(((4 * fine - coarse) / 3, abs(fine - coarse)))
    expected, spread = np.array(rows).T
    return np.abs(found.derivatives - expected) / (1e-3 * spread + 2e-8 * np.abs(expected).max())
