"""A scene, or a derivative to compute, together with its exact solution if that is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.observe.dampers import damper_values
from fvi_cli.integrator.observe.request import Observations, known_names, names_of
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A scene, its kind and its exact solution where one is known."""

    kind: str  # name of the kind, for example ``damped-oscillator``
    scene: Scene  # the effects and initial data
    # position at times of shape ``(n,)`` as ``(n, d)``; None when it is not known
    exact: Callable[[Array], Array] | None = None
    # source of `exact`, ``expression``; or why there is none: ``unknown``, or ``none`` as asked for
    exact_source: str = "unknown"
    equation: str = ""  # the equation of motion in plain text
    coordinates: tuple[str, ...] = ()  # names of the d coordinates; empty: they have no names
    # inputs with one component by their names in expressions; None: the input is zero
    inputs: Mapping[str, Forcing | None] = field(default_factory=dict)
    # numbers by their names in expressions: parameters, and those of the kind (``mass_1``)
    numbers: Mapping[str, float] = field(default_factory=dict)
    # built-in quantities, such as ``base_shear``, by name, as formulas in all these names
    ready: Mapping[str, Expression] = field(default_factory=dict)

    def with_parameters(self, given: Mapping[str, float]) -> Problem:
        """The problem with further numbers.

        Raises
        ------
        ArgumentError
            If a name cannot be one, or means something else in formulas.
        """
        ready = (*self.numbers, *self.inputs, *self.ready, *damper_values(self.scene))
        try:
            Expression.parse("0", (*known_names(self.coordinates, ready), *given))
        except ExpressionError as error:
            raise ArgumentError("parameters", error.message) from None
        return replace(self, numbers={**self.numbers, **given})

    @property
    def names(self) -> Observations:
        """The names that expressions along the motion may hold."""
        return Observations(
            coordinates=self.coordinates or names_of(self.scene),
            parameters=self.numbers,
            ready=self.ready,
            inputs=self.inputs,
        )

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
    r"""The Caputo derivative of a known function, to measure convolution quadrature by itself."""

    scene: ClassVar[None] = None  # it has no motion
    dimension: ClassVar[int] = 1
    coordinates: ClassVar[tuple[str, ...]] = ()
    inputs: ClassVar[Mapping[str, Forcing | None]] = {}
    numbers: ClassVar[Mapping[str, float]] = {}
    ready: ClassVar[Mapping[str, Expression]] = {}
    # f(t) - f(0), for orders above 1 also less f'(0) t, at times of shape ``(n,)``
    function: Callable[[Array], Array]
    order: float  # order of the derivative, in (0, 2)
    final_time: float  # the derivative is taken on [0, T]
    exact: Callable[[Array], Array]  # the derivative at times of shape ``(n,)`` as ``(n, 1)``
    kind: str = "fractional-derivative"
    exact_source: str = "expression"
    equation: str = ""


AnyProblem = Problem | DerivativeProblem
