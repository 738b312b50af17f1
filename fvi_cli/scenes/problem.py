"""A scene, or a derivative to take, together with what is known of its solution."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A scene, its kind and its exact solution where one is known."""

    kind: str  # name of the kind, for example ``damped-oscillator``
    scene: Scene  # the effects and initial data
    # position at times of shape ``(n,)`` as ``(n, d)``; None when it is not known
    exact: Callable[[Array], Array] | None = None
    # where `exact` comes from, such as ``expression``, ``closed form`` or ``unknown``; without it
    # why there is none
    exact_source: str = "unknown"
    exact_error: float = 0.0  # what round-off leaves of its position at most, a length
    equation: str = ""  # the equation of motion in plain text
    coordinates: tuple[str, ...] = ()  # names of the d coordinates; empty: they have none
    # what drives it by the name that expressions know it by, with one component; None: nothing
    inputs: Mapping[str, Forcing | None] = field(default_factory=dict)
    # numbers that expressions know by name: parameters, and what the kind adds (``mass_1``)
    numbers: Mapping[str, float] = field(default_factory=dict)
    # quantities that need no formula, such as ``base_shear``: formulas of all these names
    ready: Mapping[str, Expression] = field(default_factory=dict)

    @property
    def final_time(self) -> float:
        """T: the solution is sought on [0, T]."""
        return self.scene.final_time

    @property
    def dimension(self) -> int:
        """d: the number of degrees of freedom."""
        return self.scene.dimension


@dataclass(frozen=True, kw_only=True, eq=False)
class DerivativeProblem:
    r"""The Caputo derivative of a known function, to measure convolution quadrature alone."""

    scene: ClassVar[None] = None  # it has no motion
    dimension: ClassVar[int] = 1
    coordinates: ClassVar[tuple[str, ...]] = ()
    inputs: ClassVar[Mapping[str, Forcing | None]] = {}
    numbers: ClassVar[Mapping[str, float]] = {}
    ready: ClassVar[Mapping[str, Expression]] = {}
    # f less f(0), for orders above 1 less f'(0) t, at times of shape ``(n,)``
    function: Callable[[Array], Array]
    order: float  # order of the derivative, in (0, 2)
    final_time: float  # the derivative is taken on [0, T]
    exact: Callable[[Array], Array]  # the derivative at times of shape ``(n,)`` as ``(n, 1)``
    kind: str = "fractional-derivative"
    exact_source: str = "closed form"
    equation: str = ""


AnyProblem = Problem | DerivativeProblem
