"""Methods of other packages, to compare with ours; used only if they are installed."""

from __future__ import annotations

import importlib
import importlib.util
import itertools
import time
from collections.abc import Callable

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.baselines.results import baseline_trajectory
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.method import Baseline
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array

Rate = Callable[[float, Array], Array]

PEER_LIMITS = (
    "pycaputo solves systems of Caputo equations of orders up to 1, one derivative per component: "
    "a scene with one damping term, written as such a system of three times its size; its history "
    "is a sum over the whole past in every step"
)
"""Remark for the reader of a comparison."""


def peers_objection() -> str:
    """Why the package of the peers cannot be used; empty where it can."""
    if importlib.util.find_spec("pycaputo") is None:
        return "pycaputo is not installed; `pip install 'fvi-cli[peers]'` installs it"
    try:
        importlib.import_module("pycaputo.stepping")
        importlib.import_module("pycaputo.derivatives")
    except ImportError as error:
        return f"pycaputo is too old or not complete ({error}); version 0.10 is needed"
    return ""


def peer_objection(scene: Scene, method: Baseline) -> str:
    """Why `method` is not made for `scene`, or not installed; empty if it can be used."""
    terms = scene.active_damping
    if len(terms) != 1:
        return f"{method.name} takes scenes with one damping term, not {len(terms)}"
    if scene.derivative != "caputo":
        return f"{method.name} takes Caputo derivatives only"
    return peers_objection()


def integrate_peer(scene: Scene, method: Baseline, n_steps: int) -> Trajectory:
    r"""The scene as a system of Caputo equations, by a method of pycaputo with fixed steps.

    Below order 1 the unknowns are x, :math:`D^\gamma x` and v with derivatives of orders
    :math:`\gamma, 1 - \gamma, 1`; above it x, v and :math:`D^\gamma x` with orders
    :math:`1, \gamma - 1, 2 - \gamma`; for order 1 they are x and v. ``pycaputo-pece`` corrects
    once; ``pycaputo-trapezoidal`` is implicit and gets the exact Jacobian.
    """
    controllers = importlib.import_module("pycaputo.controller")
    derivatives = importlib.import_module("pycaputo.derivatives")
    methods = importlib.import_module("pycaputo.fode.caputo")
    stepping = importlib.import_module("pycaputo.stepping")
    began = time.perf_counter()
    (term,) = scene.active_damping
    d = scene.dimension
    orders, start, rate, jacobian, rate_index = _system(scene, term)
    common = {
        "ds": tuple(derivatives.CaputoDerivative(order) for order in orders for _ in range(d)),
        "control": controllers.make_fixed_controller(
            # round-off may end it one step early: one more step is requested and not used
            scene.final_time / n_steps,
            tstart=0.0,
            nsteps=n_steps + 1,
        ),
        "source": rate,
        "y0": (start,),
    }
    if method.name == "pycaputo-pece":
        stepper = methods.PECE(**common, corrector_iterations=1)
    else:
        stepper = methods.Trapezoidal(**common, source_jac=jacobian)
    ready = time.perf_counter()
    states: list[Array] = []
    failure: Failure | None = None
    with np.errstate(over="ignore", invalid="ignore"):
        try:
            # without dtinit the length of the first step is estimated, even with a fixed
            # controller, and all later points miss the grid
            events = stepping.evolve(stepper, dtinit=scene.final_time / n_steps)
            for event in itertools.islice(events, n_steps + 1):
                states.append(np.array(event.y, dtype=float))
                if not np.isfinite(states[-1]).all():
                    step = len(states) - 2
                    failure = Failure.not_finite(step, (step + 1) * scene.final_time / n_steps)
                    break
        except (ArithmeticError, AssertionError, AttributeError, ValueError) as error:
            # an implicit equation without a solution comes as an assertion there
            failure = Failure(f"{type(error).__name__} after step {len(states) - 1}: {error}")
    everything = np.array(states or [start])
    done = everything.shape[0] - 1
    return baseline_trajectory(
        scene,
        everything[:, :d],
        everything[:, rate_index],
        n_steps,
        failure=failure,
        # every component's sum over the past, in every step
        operations=len(orders) * d * done * (done + 1) // 2,
        began=began,
        ready=ready,
        remarks=(PEER_LIMITS,),
    )


def _system(
    scene: Scene, term: FractionalDamping
) -> tuple[tuple[float, ...], Array, Rate, Rate, slice]:
    """Orders of the blocks, start, right-hand side, its Jacobian, and where the velocity is."""
    d = scene.dimension
    inverse_mass = np.linalg.inv(scene.inertia.mass)
    rest, gamma = np.zeros(d), term.order
    first, second, third = slice(0, d), slice(d, 2 * d), slice(2 * d, 3 * d)
    if term.is_integer_order:
        orders: tuple[float, ...] = (1.0, 1.0)
        start = np.concatenate((scene.initial_position, scene.initial_velocity))
        blocks, damped, velocity = 2, second, second
    elif gamma < 1:
        orders = (gamma, 1 - gamma, 1.0)
        start = np.concatenate((scene.initial_position, rest, scene.initial_velocity))
        blocks, damped, velocity = 3, second, third
    else:
        orders = (1.0, gamma - 1, 2 - gamma)
        start = np.concatenate((scene.initial_position, scene.initial_velocity, rest))
        blocks, damped, velocity = 3, third, second
    size = blocks * d
    last = slice(size - d, size)
    # every block is the derivative of the one before; the last is the equation of motion
    matrix = np.eye(size, k=d)
    matrix[last, damped] -= inverse_mass @ term.matrix

    def rate(at: float, y: Array) -> Array:
        value = matrix @ y
        if scene.forcing is not None:
            value[last] += inverse_mass @ scene.forcing(np.asarray(at, dtype=float))
        if scene.potential is not None:
            value[last] -= inverse_mass @ scene.potential.gradient(y[first])
        return value

    def jacobian(at: float, y: Array) -> Array:
        value = matrix.copy()
        if scene.potential is not None:
            value[last, first] -= inverse_mass @ scene.potential.hessian(y[first])
        return value

    return orders, start, rate, jacobian, velocity
