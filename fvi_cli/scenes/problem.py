"""A scene together with what is known of its solution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A scene, its kind and its exact solution where one is known.

    Parameters
    ----------
    kind
        Name of the kind, for example ``damped-oscillator``.
    scene
        The effects and initial data.
    exact
        Position at times of shape ``(n,)`` as ``(n, d)``; None when it is not known.
    exact_source
        Where `exact` comes from: ``expression``, ``closed form``, or ``unknown``.
    equation
        The equation of motion in plain text.
    """

    kind: str
    scene: Scene
    exact: Callable[[Array], Array] | None = None
    exact_source: str = "unknown"
    equation: str = ""
