"""From a plain mapping (what a configuration says) to a problem."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.directions import Directions
from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.effects.scene import Derivative, Scene
from fvi_cli.mathematics.expressions import NUMPY_FUNCTIONS, Expression
from fvi_cli.mathematics.power_series import SeriesError, expand
from fvi_cli.scenes.chains import chain, frame, string
from fvi_cli.scenes.lagrangian import check_names, double_pendulum, lagrangian_scene
from fvi_cli.scenes.linear_response import match_scene
from fvi_cli.scenes.named import linear_oscillator, pendulum
from fvi_cli.scenes.nonlinear import duffing, kepler
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem, Problem
from fvi_cli.scenes.samples import sampled_component

Array = NDArray[np.float64]

SERIES_CUTOFF = 48.0

EQUATIONS: Mapping[str, str] = {
    "damped-oscillator": "M x'' + sum mu D^gamma x + K x = f(t)",
    "bagley-torvik": "M x'' + sum mu D^gamma x + K x = f(t)",
    "pendulum": "x'' + sum mu D^gamma x + omega^2 sin x = f(t)",
    "duffing": "mass x'' + sum mu D^gamma x + stiffness x + cubic_stiffness x^3 = f(t)",
    "kepler": "q'' + sum mu D^gamma q + attraction q/|q|^3 = f(t), q = (x, y)",
    "chain": "mass x_i'' + (stiffness + sum c D^gamma) (2 x_i - x_(i-1) - x_(i+1)) + sum mu "
    "D^gamma x_i = f_i(t)",
    "frame": "mass_i x_i'' + s_i - s_(i+1) + sum mu D^gamma x_i = -mass_i a(t), s_i = (stiffness_i "
    "+ sum c D^gamma) (x_i - x_(i-1))",
    "string": "u_tt + sum mu D^gamma u - sum eta D^gamma u_ss = wave_speed^2 u_ss in sine modes "
    "x1, x2, ...",
    "double-pendulum": "two rods, angles theta1, theta2 from the vertical; the joints turn "
    "against c D^gamma of theta1 and of theta2 - theta1",
    "lagrangian": "d/dt dL/dv - dL/dq + sum mu D^gamma q = f(t)",
    "fractional-derivative": "y = D^gamma f (Caputo)",
}

SIZE_KEYS: Mapping[str, str] = {"chain": "masses", "frame": "storeys", "string": "modes"}
"""Where a scene says how many coordinates it has."""

FIXED_SIZES: Mapping[str, int] = {"pendulum": 1, "duffing": 1, "kepler": 2, "double-pendulum": 2}
"""Numbers of coordinates of scenes that cannot have another."""


def build_problem(specification: Mapping[str, Any]) -> AnyProblem:
    """The problem that a resolved ``problem`` mapping describes.

    Parameters
    ----------
    specification
        JSON values under the keys of the configuration's ``problem``.

    Raises
    ------
    ValueError
        ``key.path: what is wrong``, relative to ``problem``.
    """
    kind = specification["kind"]
    if kind == "fractional-derivative":
        return _derivative_problem(specification)
    if kind not in EQUATIONS:
        raise ValueError(f"kind: {kind!r} is not one of {', '.join(EQUATIONS)}")
    scene = _scene(kind, specification)
    exact, source = _exact(specification.get("exact", "auto"), scene)
    return Problem(
        kind=kind, scene=scene, exact=exact, exact_source=source, equation=EQUATIONS[kind]
    )


def build_scene(specification: Mapping[str, Any]) -> Scene:
    """The scene alone, without a search for its exact solution, which takes longer.

    Raises
    ------
    ValueError
        As :func:`build_problem`; also for ``fractional-derivative``, which is no scene.
    """
    kind = specification["kind"]
    if kind not in EQUATIONS or kind == "fractional-derivative":
        raise ValueError(f"kind: {kind!r} is not the name of a scene")
    return _scene(kind, specification)


def _scene(kind: str, specification: Mapping[str, Any]) -> Scene:
    initial = specification.get("initial", {})
    position = initial.get("position", 0.0)
    velocity = initial.get("velocity", 0.0)
    dimension = _dimension(kind, specification, position)
    names = coordinate_names(kind, dimension)
    if kind == "lagrangian":
        names = tuple(str(name) for name in specification["coordinates"])
        check_names(names, specification.get("parameters", {}))
    common: dict[str, Any] = {
        "final_time": float(specification["final_time"]),
        "damping": [
            _damping(entry, index, names)
            for index, entry in enumerate(specification.get("damping", ()))
        ],
        "initial_position": _vector(position, dimension),
        "initial_velocity": _vector(velocity, dimension),
        "derivative": cast(Derivative, specification.get("derivative", "caputo")),
    }
    own: dict[str, Any] = {
        key: specification[key] for key in _OWN_KEYS.get(kind, ()) if key in specification
    }
    if kind == "frame":
        acceleration = build_forcing(
            specification.get("ground_acceleration", 0),
            1,
            "ground_acceleration",
            final_time=common["final_time"],
        )
        return frame(
            ground_acceleration=acceleration, dampers=_dampers(specification), **own, **common
        )
    common["forcing"] = build_forcing(
        specification.get("forcing", 0), dimension, final_time=common["final_time"]
    )
    if kind == "chain":
        return chain(dampers=_dampers(specification), **own, **common)
    if kind == "lagrangian":
        return lagrangian_scene(**own, **common)
    if kind == "double-pendulum":
        return double_pendulum(joints=_dampers(specification, "joints"), **own, **common)
    if kind == "string":
        pluck = specification.get("pluck")
        return string(
            pluck=None if pluck is None else (float(pluck["at"]), float(pluck["height"])),
            internal_damping=_dampers(specification, "internal_damping"),
            **own,
            **common,
        )
    if kind in _BUILDERS:
        return _BUILDERS[kind](**own, **common)
    return linear_oscillator(
        mass=_matrix(specification.get("mass", 1.0), dimension),
        stiffness=_matrix(specification.get("stiffness", 1.0), dimension),
        **common,
    )


_BUILDERS: Mapping[str, Callable[..., Scene]] = {
    "pendulum": pendulum,
    "duffing": duffing,
    "kepler": kepler,
}
_OWN_KEYS: Mapping[str, tuple[str, ...]] = {
    "pendulum": ("omega",),
    "duffing": ("mass", "stiffness", "cubic_stiffness"),
    "kepler": ("attraction",),
    "chain": ("masses", "mass", "stiffness", "ends"),
    "frame": ("storeys", "mass", "stiffness"),
    "double-pendulum": ("masses", "lengths", "gravity"),
    "lagrangian": ("coordinates", "lagrangian", "parameters"),
    "string": ("modes", "wave_speed", "length"),
}


def coordinate_names(kind: str, dimension: int) -> tuple[str, ...]:
    """Names of the coordinates of a scene, as ``acts_on`` knows them."""
    if kind == "kepler":
        return ("x", "y")
    if kind == "double-pendulum":
        return ("theta1", "theta2")
    if dimension == 1:
        return ("x",)
    return tuple(f"x{index}" for index in range(1, dimension + 1))


def _dimension(kind: str, specification: Mapping[str, Any], position: object) -> int:
    """What the kind says; otherwise the largest size of any entry, which the others must fit."""
    if kind in FIXED_SIZES:
        return FIXED_SIZES[kind]
    if kind == "lagrangian":
        return len(specification["coordinates"])
    if kind in SIZE_KEYS:
        return int(specification[SIZE_KEYS[kind]])
    entries = [position, *(specification.get(key, 1.0) for key in ("mass", "stiffness"))]
    return max(int(np.atleast_1d(np.asarray(entry)).shape[0]) for entry in entries)


def _matrix(value: object, dimension: int) -> Array:
    matrix = np.asarray(value, dtype=float)
    return matrix * np.eye(dimension) if matrix.ndim == 0 else matrix


def _vector(value: object, dimension: int) -> Array:
    vector = np.atleast_1d(np.asarray(value, dtype=float))
    return np.full(dimension, vector[0]) if np.shape(np.asarray(value)) == () else vector


def _damping(
    entry: Mapping[str, Any], index: int, coordinates: tuple[str, ...]
) -> FractionalDamping:
    acts_on = entry.get("acts_on")
    try:
        if acts_on is None:
            coefficient = _matrix(entry["coefficient"], len(coordinates))
        else:
            directions = Directions.from_text([str(text) for text in acts_on], coordinates)
            coefficient = directions.matrix(entry["coefficient"])
        return FractionalDamping(order=float(entry["order"]), coefficient=coefficient)
    except ValueError as error:
        raise ValueError(f"damping.{index}.{error}") from None


def _dampers(
    specification: Mapping[str, Any], key: str = "dampers"
) -> tuple[tuple[float, float], ...]:
    return tuple(
        (float(entry["order"]), float(entry["coefficient"])) for entry in specification.get(key, ())
    )


def build_forcing(
    value: object, dimension: int, key: str = "forcing", *, final_time: float = math.inf
) -> Forcing | None:
    """A force from what stands under its key; None when it is 0.

    Parameters
    ----------
    value
        An expression or ``{file: ..., column: ...}``, a list of such, or ``{pieces: [...]}``.
    dimension
        Number d of components.
    key
        What messages call it.
    final_time
        T; samples must reach so far.

    Raises
    ------
    ValueError
        ``<key>...: what is wrong``.
    """
    if isinstance(value, Mapping) and "pieces" in value:
        pieces = []
        for index, piece in enumerate(value["pieces"]):
            pieces.append(
                ForcingPiece(
                    components=_expressions(
                        piece["value"], dimension, f"{key}.pieces.{index}.value", ("t",)
                    ),
                    until=float(piece.get("until", math.inf)),
                )
            )
        return Forcing(pieces=tuple(pieces))
    components = _components(value, dimension, key, final_time)
    if all(_is_zero(component) for component in components):
        return None
    return Forcing(pieces=(ForcingPiece(components=components),))


def _components(
    value: object, dimension: int, key: str, final_time: float
) -> tuple[ForceComponent, ...]:
    if isinstance(value, Mapping):
        return (_sampled(value, key, final_time),) * dimension
    if not isinstance(value, list | tuple) or not any(isinstance(v, Mapping) for v in value):
        return _expressions(value, dimension, key, ("t",))
    if len(value) != dimension:
        raise ValueError(f"{key}: {len(value)} entries for {dimension} degrees of freedom")
    components: list[ForceComponent] = []
    for index, entry in enumerate(value):
        place = f"{key}.{index}"
        if isinstance(entry, Mapping):
            components.append(_sampled(entry, place, final_time))
        else:
            components += _expressions([entry], 1, place, ("t",))
    return tuple(components)


def _sampled(specification: Mapping[str, Any], key: str, final_time: float) -> SampledForce:
    try:
        return sampled_component(specification, final_time)
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from None


def _is_zero(component: ForceComponent) -> bool:
    if isinstance(component, SampledForce):
        return component.formula is None and not component.coefficients.any()
    return component.is_constant and component.evaluate({}, NUMPY_FUNCTIONS) == 0


def _expressions(
    value: object, dimension: int, place: str, variables: tuple[str, ...]
) -> tuple[Expression, ...]:
    entries: Sequence[object] = value if isinstance(value, list | tuple) else [value] * dimension
    if len(entries) != dimension:
        raise ValueError(f"{place}: {len(entries)} entries for {dimension} degrees of freedom")
    expressions = []
    for entry in entries:
        try:
            expressions.append(Expression.parse(str(entry), variables=variables))
        except ValueError as error:
            raise ValueError(f"{place}: {error}") from None
    return tuple(expressions)


def _exact(value: object, scene: Scene) -> tuple[Callable[[Array], Array] | None, str]:
    if value == "auto":
        solution = match_scene(scene)
        return (None, "unknown") if solution is None else (solution.position, solution.source)
    components = _expressions(value, scene.dimension, "exact", ("t",))
    piece = ForcingPiece(components=components)
    return piece.evaluate, "expression"


def _derivative_problem(specification: Mapping[str, Any]) -> DerivativeProblem:
    order = float(specification["order"])
    (function,) = _expressions(specification["function"], 1, "function", ("t",))
    final_time = float(specification["final_time"])
    if not 0 < order < 2:
        raise ValueError(f"order: {order!r} is not allowed; it must lie in (0, 2)")
    given = specification.get("exact", "auto")
    if given == "auto":
        exact = _termwise_derivative(function, order, final_time)
        source = "power series, term by term"
    else:
        exact = ForcingPiece(components=_expressions(given, 1, "exact", ("t",))).evaluate
        source = "expression"
    return DerivativeProblem(
        function=ForcingPiece(components=(function,)).evaluate,
        order=order,
        final_time=final_time,
        exact=exact,
        exact_source=source,
        equation=f"D^{order:g} of {function.text}",
    )


def _termwise_derivative(
    function: Expression, order: float, final_time: float
) -> Callable[[Array], Array]:
    """Caputo derivative of a function by its expansion at 0, where that converges up to T.

    Raises
    ------
    ValueError
        If the function has no such expansion, or its terms do not become small on [0, T].
    """
    try:
        series = expand(function, SERIES_CUTOFF).without_initial_terms(order)
        derivative = series.fractional_derivative(order)
    except SeriesError as error:
        raise ValueError(f"exact: auto needs an expansion of the function: {error}") from None
    if derivative.exponents.size and derivative.exponents[0] < 0:
        raise ValueError("exact: the derivative is not bounded at 0; it cannot be measured there")
    sizes = np.abs(derivative.coefficients) * final_time**derivative.exponents
    last = sizes[derivative.exponents > SERIES_CUTOFF - order - 6.0]
    if last.sum() > 1e-16 * sizes.sum() or sizes.max(initial=0.0) > 100 * abs(
        float(derivative(np.array(final_time)))
    ):
        raise ValueError(
            f"exact: the expansion of {function.text!r} does not converge on [0, {final_time:g}] "
            "fast enough; give the derivative as an expression"
        )
    return lambda time: derivative(time)[:, None]
