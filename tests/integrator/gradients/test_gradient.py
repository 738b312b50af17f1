"""Derivatives of runs: against extended precision, differences, and each other."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import mpmath
import numpy as np
import pytest
from letters import spring, swing

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.formula import MotionAt
from fvi_cli.integrator.gradients.gradient import (
    gradient_of,
    run_steps,
    sensitivities,
)
from fvi_cli.integrator.gradients.linearised import Disturbance, LinearisedRun, damped
from fvi_cli.integrator.gradients.quantity import (
    Quantity,
    acceleration_at,
    misfit,
    position_at,
    quantity_at,
    smoothed_peak,
    velocity_at,
)
from fvi_cli.integrator.gradients.variation import Variation
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import graded_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.observations.observer import Observer
from fvi_cli.integrator.observations.request import Observations, names_of
from fvi_cli.integrator.observations.second_runs import forces_along
from fvi_cli.scenes.data import duffing, kepler

GAUSS8 = Method(cq="gauss", degree=8, start="none")
FINE = AdaptiveSteps(tolerance=1e-10)
TIME = 3.7

# orders and coefficients of the terms
DAMPINGS = {
    "below 1": [(0.5, 0.4)],
    "small": [(0.05, 0.7)],
    "above 1": [(1.5, 0.6)],
    "near 2": [(1.9, 0.3)],
    "viscous": [(1.0, 0.3)],
    "on both sides of 1": [(0.3, 0.5), (1.7, 0.2)],
    "three": [(0.7, 0.2), (1.0, 0.1), (1.2, 0.4)],
}


def oscillator(values: dict[str, float], n_terms: int) -> Scene:
    """M x'' + sum mu D^gamma x + K x = 0."""
    terms = [(values[f"order {i}"], values[f"coefficient {i}"]) for i in range(n_terms)]
    start = {"x": values["position"], "v": values["velocity"]}
    return spring(*terms, T=4.0, m=values["mass"], k=values["stiffness"], **start)


def variations(family: Callable[[dict[str, float]], Scene], values: dict[str, float]) -> list[Any]:
    return [
        Variation(family=lambda v, name=name: family({**values, name: v}), value=value, name=name)
        for name, value in values.items()
    ]


def values_of(terms: list[tuple[float, float]]) -> dict[str, float]:
    values = {"mass": 1.3, "stiffness": 2.0, "position": 1.0, "velocity": 0.5}
    for index, (order, coefficient) in enumerate(terms):
        values |= {f"order {index}": order, f"coefficient {index}": coefficient}
    return values


@cache
def in_extended_precision(name: str, order: int = 0) -> dict[str, float]:
    """Derivatives of x(TIME) or x''(TIME), by inverting the transform of the derivative, 40 digits.

    Under ``value`` the number itself.
    """
    terms = DAMPINGS[name]
    values = values_of(terms)
    with mpmath.workdps(40):
        m, k, x0, v0 = (
            mpmath.mpf(values[n]) for n in ("mass", "stiffness", "position", "velocity")
        )

        def parts(s: Any) -> tuple[Any, Any]:
            # Caputo: the transform of D^g x is s^g X - s^(g-1) x0 - [g > 1] s^(g-2) v0
            below = m * s**2 + k
            above = m * (s * x0 + v0)
            for g, c in terms:
                below += c * s ** mpmath.mpf(g)
                above += c * start(s, g)
            return above, below

        def start(s: Any, g: float) -> Any:
            order = mpmath.mpf(g)
            return s ** (order - 1) * x0 + (s ** (order - 2) * v0 if g > 1 else 0)

        def rate(what: str, s: Any) -> Any:
            # what the initial data add to the transform of x'' does not depend on other numbers
            start = {"position": s, "velocity": 1, "value": s * x0 + v0}.get(what, 0)
            return s**2 * rate_of_x(what, s) - start if order else rate_of_x(what, s)

        def rate_of_x(what: str, s: Any) -> Any:
            above, below = parts(s)
            x = above / below
            if what == "value":
                return x
            if what == "mass":
                return (s * x0 + v0 - s**2 * x) / below
            if what == "stiffness":
                return -x / below
            if what in ("position", "velocity"):
                power = 1 if what == "position" else 2
                total = m * s ** (2 - power)
                for g, c in terms:
                    if power == 1 or g > 1:
                        total += c * s ** (mpmath.mpf(g) - power)
                return total / below
            kind, index = what.split()
            g, c = terms[int(index)]
            own = (start(s, g) - s ** mpmath.mpf(g) * x) / below
            return own if kind == "coefficient" else c * mpmath.log(s) * own

        return {
            what: float(
                mpmath.invertlaplace(
                    lambda s, what=what: rate(what, s), TIME, method="talbot", degree=60
                )
            )
            for what in (*values, "value")
        }


@pytest.mark.parametrize("name", DAMPINGS)
def test_against_forty_digits(name):
    values = values_of(DAMPINGS[name])
    family = partial(oscillator, n_terms=len(DAMPINGS[name]))
    found = gradient_of(family(values), GAUSS8, FINE, position_at(TIME), variations(family, values))
    expected = in_extended_precision(name)
    for one, what in zip(found.derivatives, values, strict=True):
        assert one == pytest.approx(expected[what], rel=1e-9), what
    # the run itself aside, one system for every step
    assert found.step_solves == found.n_steps


@pytest.mark.parametrize("name", ["small", "near 2", "viscous", "on both sides of 1"])
def test_accelerations_and_forces_against_forty_digits(name):
    values = values_of(DAMPINGS[name])
    family = partial(oscillator, n_terms=len(DAMPINGS[name]))
    # what an order changes is singular at the start even where the motion is smooth
    steps, changes = graded_mesh(4.0, 60, 6.0), variations(family, values)
    position, acceleration = in_extended_precision(name), in_extended_precision(name, 2)
    force = {
        what: values["mass"] * acceleration[what]
        + values["stiffness"] * position[what]
        + {"mass": acceleration["value"], "stiffness": position["value"]}.get(what, 0.0)
        for what in values
    }
    for quantity, expected in (
        (acceleration_at(TIME), acceleration),
        (quantity_at("dx", TIME), force),
    ):
        found = gradient_of(family(values), GAUSS8, steps, quantity, changes)
        for one, what in zip(found.derivatives, values, strict=True):
            assert one == pytest.approx(expected[what], rel=1e-9), what
        assert found.step_solves == found.n_steps
        # the acceleration of another damping would be seen
        wrong = in_extended_precision("below 1", 2)
        assert found.derivatives[0] != pytest.approx(wrong["mass"], rel=1e-3)


PENDULUM = {"omega": 1.2, "order": 0.6, "coefficient": 0.3, "angle": 2.0, "rate": 0.4}


def pendulum(values: dict[str, float]) -> Scene:
    return swing(
        (values["order"], values["coefficient"]),
        T=6.0,
        omega=values["omega"],
        x=values["angle"],
        v=values["rate"],
        forcing="0.3*sin(2*t)",
    )


DUFFING = {"mass": 1.1, "cubic": 1.5, "order": 1.4, "coefficient": 0.4, "position": 1.2}


def hardening(values: dict[str, float]) -> Scene:
    return duffing(
        mass=values["mass"],
        cubic_stiffness=values["cubic"],
        damping=[FractionalDamping(order=values["order"], coefficient=values["coefficient"])],
        initial_position=values["position"],
        initial_velocity=0.3,
        final_time=5.0,
    )


JOINTS = {"gravity": 2.0, "order": 0.5, "coefficient": 0.3, "angle": 1.0}


def two_rods(values: dict[str, float]) -> Scene:
    """A mass matrix that depends on the position."""
    return fvi.build_problem(
        {
            "kind": "double-pendulum",
            "lengths": [1.0, 0.8],
            "gravity": values["gravity"],
            "damping": [
                {
                    "order": values["order"],
                    "coefficient": [[0.3, 0.0], [0.0, values["coefficient"]]],
                }
            ],
            "initial": {"position": [values["angle"], -0.5], "velocity": [0.2, 0.0]},
            "final_time": 2.0,
        }
    ).scene


LATE = {"order": 0.4, "coefficient": 0.5, "position": 0.7, "stiffness": 3.0}


def riemann_liouville(values: dict[str, float]) -> Scene:
    term = values["order"], values["coefficient"]
    start = {"x": values["position"], "v": 0.2}
    return spring(term, T=3.0, k=values["stiffness"], derivative="riemann-liouville", **start)


ZENER = {"order": 0.6, "time": 0.4, "unrelaxed": 5.0, "relaxed": 2.0, "springpot": 0.3}


def standard_solid(values: dict[str, float]) -> Scene:
    """A law beside a springpot."""
    return fvi.build_problem(
        {
            "kind": "damped-oscillator",
            "stiffness": 1.0,
            "damping": [
                {
                    "law": "zener",
                    "order": values["order"],
                    "time": values["time"],
                    "relaxed": values["relaxed"],
                    "unrelaxed": values["unrelaxed"],
                    "coefficient": 1.0,
                },
                {"order": 0.3, "coefficient": values["springpot"]},
            ],
            "initial": {"position": 1.0, "velocity": 0.5},
            "final_time": 3.0,
        },
        search=False,
    ).scene


TWO = {"attraction": 1.3, "order": 0.5, "coefficient": 0.05, "x": 1.0}


def orbit(values: dict[str, float]) -> Scene:
    return kepler(
        attraction=values["attraction"],
        damping=[
            FractionalDamping(order=values["order"], coefficient=values["coefficient"] * np.eye(2))
        ],
        initial_position=[values["x"], 0.1],
        initial_velocity=[0.1, 1.0],
        final_time=3.0,
    )


SCENES = {
    "pendulum": (pendulum, PENDULUM),
    "duffing": (hardening, DUFFING),
    "double pendulum": (two_rods, JOINTS),
    "riemann-liouville": (riemann_liouville, LATE),
    "kepler": (orbit, TWO),
    "zener": (standard_solid, ZENER),
}


def differences(value: Callable[[dict[str, float]], float], values: dict[str, float]) -> np.ndarray:
    """Derivatives by central differences of order four."""
    found = []
    for what, at in values.items():
        h = 4e-4 * at
        coarse, fine = (
            (value({**values, what: at + e}) - value({**values, what: at - e})) / (2 * e)
            for e in (h, h / 2)
        )
        found.append((4 * fine - coarse) / 3)
    return np.array(found)


def of_everything(names: Sequence[str]) -> str:
    """An expression of accelerations, damping forces, velocities and positions."""
    first, last = names[0], names[-1]
    return f"a{last} - 0.3*d{first}*{last} + v{last}**2*{first}*cos(t)"


@pytest.mark.parametrize("name", SCENES)
def test_expressions_against_central_differences(name, monkeypatch):
    family, values = SCENES[name]
    steps = graded_mesh(family(values).final_time, 12, 2.0)
    method = Method(cq="gauss", degree=3, start="none")
    times = np.array([0.0, 0.9, 2.0] if name != "riemann-liouville" else [0.3, 0.9, 2.0])
    soft = smoothed_peak("", times, sharpness=6.0)
    quantity = replace(soft, of=of_everything)

    def value(changed: dict[str, float]) -> float:
        # damping forces by the engine, which the adjoint has from its own memory
        scene = family(changed)
        done = run_steps(scene, method, steps)
        forces = partial(forces_along, [scene], [method], [done])
        motion = DenseMotion(scenes=(scene,), steps=(done,), shapes=(done,), find_forces=forces)
        asked = Observations(coordinates=names_of(scene))
        expression = quantity.expression(asked, scene)
        assert expression is not None
        return soft.value(Observer(motion, [asked]).along(expression)(*motion.located(0, times)))

    def derivatives() -> Any:
        return gradient_of(family(values), method, steps, quantity, variations(family, values))

    found, expected = derivatives(), differences(value, values)
    assert found.value == pytest.approx(value(values), rel=1e-13)
    np.testing.assert_allclose(found.derivatives, expected, rtol=2e-8, atol=1e-8)
    # without what the motion does to the damping force it is another number
    monkeypatch.setattr(MotionAt, "spread_force", lambda self, by: np.zeros((12, 3, by.shape[1])))
    assert np.abs(derivatives().derivatives - expected).max() > 1e-3


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("method", ["gauss", "radau-iia", "lobatto-iiic"])
def test_forwards_and_backwards_are_transposed(name, method):
    family, values = SCENES[name]
    scene = family(values)
    solver = Method(cq=method, degree=3, start="none")
    done = run_steps(scene, solver, 16)
    run = LinearisedRun(scene, solver, done)
    n, r, d = done.velocity.shape
    generator = np.random.default_rng(5)

    def random(*shape: int) -> Any:
        return generator.standard_normal(shape)

    s = done.tables.degree
    change = Disturbance(
        loads=random(2, n, s + 1, d),
        position=random(2, d),
        momentum=random(2, d),
        damping=random(2, n, r, d),
    )
    tangent = run.tangent(change)
    by_position, by_velocity = random(n + 1, d), random(n, r, d)
    forwards = np.einsum("nd,pnd->p", by_position, tangent.position)
    forwards += np.einsum("nrd,pnrd->p", by_velocity, tangent.velocity)
    backwards = run.adjoint(by_position, by_velocity).along(change)
    scale = np.abs(by_position).sum() * np.abs(tangent.position).max()
    scale += np.abs(by_velocity).sum() * np.abs(tangent.velocity).max()
    np.testing.assert_allclose(forwards, backwards, rtol=0, atol=1e-13 * scale)
    # of the damping force as well, and of single terms
    by_force, by_terms = random(n, r, d), random(len(run.coefficients), n, r, d)
    plain = tangent.plain_forces
    changed = change.damping + damped(plain, run.coefficients)
    forwards += np.einsum("nrd,pnrd->p", by_force, changed)
    forwards += np.einsum("fnrd,fpnrd->p", by_terms, plain)
    backwards = run.adjoint(by_position, by_velocity, by_force, by_terms).along(change)
    scale += np.abs(by_force).sum() * np.abs(changed).max()
    scale += np.abs(by_terms).sum() * np.abs(plain).max()
    np.testing.assert_allclose(forwards, backwards, rtol=0, atol=1e-13 * scale)


ORDERS_OF_DAMPERS = ([(1.5, 0.3)], [(0.5, 0.4)], [(1.5, 0.3), (0.5, 0.4)], [(1.8, 0.2), (1.2, 0.1)])


@pytest.mark.parametrize("terms", ORDERS_OF_DAMPERS)
def test_the_force_of_one_damper_by_initial_data(terms):
    """A start velocity counts once: in what derivatives of orders above 1 subtract, or not."""
    method, quantity = Method(cq="gauss", degree=3, start="none"), quantity_at("force_1", 1.7)

    def family(values: dict[str, float]) -> Scene:
        return spring(*terms, T=3.0, m=1.3, k=2.0, x=values["x"], v=values["v"])

    def value(changed: dict[str, float]) -> float:
        return gradient_of(family(changed), method, 40, quantity, []).value

    values = {"x": 0.5, "v": 0.7}
    found = gradient_of(family(values), method, 40, quantity, variations(family, values))
    np.testing.assert_allclose(found.derivatives, differences(value, values), rtol=1e-8)


def test_both_ways_and_a_misfit():
    times = np.linspace(0.2, 5.9, 23)
    data = np.cos(times)
    quantity = misfit(times, data, deviation=0.3)
    changes = variations(pendulum, PENDULUM)
    scene = pendulum(PENDULUM)
    backwards = gradient_of(scene, GAUSS8, 12, quantity, changes)
    forwards = sensitivities(scene, GAUSS8, 12, times, changes)
    left = (forwards.position[:, 0] - data) / 0.3
    assert backwards.value == pytest.approx(0.5 * left @ left, rel=1e-14)
    expected = left @ forwards.by_position[:, 0] / 0.3
    np.testing.assert_allclose(backwards.derivatives, expected, rtol=1e-11)
    # complex steps give the same as slopes
    by_steps = Quantity(times=times, value=lambda x, v: 0.5 * (((x[:, 0] - data) / 0.3) ** 2).sum())
    again = gradient_of(scene, GAUSS8, 12, by_steps, changes)
    np.testing.assert_allclose(again.derivatives, backwards.derivatives, rtol=1e-12)


def test_fifty_parameters_take_two_runs():
    springs = {f"spring {i}": 1.0 + 0.1 * i for i in range(25)}
    dampers = {f"damper {i}": 0.1 + 0.01 * i for i in range(25)}

    def chain(values: dict[str, float]) -> Scene:
        given = list(values.values())
        stiffness = np.diag(given[:25]) + 0.2 * np.eye(25)
        term = 0.5, np.diag(given[25:])
        return spring(term, T=2.0, m=np.eye(25), k=stiffness, x=np.ones(25))

    values = springs | dampers
    method = Method(cq="gauss", degree=2, start="none")
    found = gradient_of(chain(values), method, 8, velocity_at(2.0, 3), variations(chain, values))
    assert found.n_steps + found.step_solves <= 4 * found.n_steps
    # masses apart from each other: only its own spring and damper count
    assert np.flatnonzero(np.abs(found.derivatives) > 1e-15).tolist() == [3, 28]


def test_numbers_of_a_scene_by_name():
    scene = spring(
        (0.6, [[0.4, -0.1], [-0.1, 0.2]]),
        T=3.0,
        m=[[2.0, 0.3], [0.3, 1.0]],
        k=[[3.0, -1.0], [-1.0, 2.0]],
        x=[1.0, 0.0],
    )
    found = fvi.gradient(scene, "gauss4-none", 12, fvi.position_at(2.5, 1))
    assert set(found.derivatives) == {
        "mass",
        "stiffness",
        "damping.0.order",
        "damping.0.coefficient",
        "initial_position",
        "initial_velocity",
    }
    for whole in ("mass", "stiffness", "damping.0.coefficient"):
        assert found[whole].shape == (2, 2)
        np.testing.assert_allclose(found[whole], found[whole].T)
    # a common factor of all forces changes nothing, and the motion is linear in the initial data
    entries = fvi.gradient(
        lambda factor: spring(
            (0.6, factor * scene.damping[0].coefficient),
            T=3.0,
            m=factor * scene.inertia.mass,
            k=factor * scene.potential.stiffness,
            x=[1.0, 0.0],
        ),
        "gauss4-none",
        12,
        fvi.position_at(2.5, 1),
        {"factor": 1.0},
    )
    assert abs(entries["factor"]) < 1e-13
    together = (
        np.sum(found["mass"] * scene.inertia.mass)
        + np.sum(found["stiffness"] * scene.potential.stiffness)
        + np.sum(found["damping.0.coefficient"] * scene.damping[0].coefficient)
    )
    assert abs(together) < 1e-12 * np.abs(found["mass"]).sum()
    assert found["initial_position"] @ [1.0, 0.0] == pytest.approx(found.value, rel=1e-12)
    with pytest.raises(ValueError, match=r"parameters: 'mu' is not one of mass, stiffness"):
        fvi.gradient(scene, "gauss4-none", 12, fvi.position_at(2.5), ["mu"])
    with pytest.raises(ValueError, match="give the arguments of the function"):
        fvi.gradient(lambda k: scene, "gauss4-none", 12, fvi.position_at(2.5), ["k"])
    swinging = fvi.gradient(pendulum(PENDULUM), "gauss4-none", 12, fvi.velocity_at(2.5))
    by_hand = gradient_of(
        pendulum(PENDULUM),
        Method(cq="gauss", degree=4, start="none"),
        12,
        velocity_at(2.5),
        variations(pendulum, PENDULUM),
    )
    np.testing.assert_allclose(
        [float(swinging[name]) for name in ("potential.omega", "damping.0.order")],
        by_hand.derivatives[:2],
        rtol=1e-9,
    )


def test_what_has_no_derivatives():
    with pytest.raises(ValueError, match="has no polynomials to keep"):
        gradient_of(pendulum(PENDULUM), Method(cq="bdf2", degree=1), 8, position_at(1.0), [])
    with pytest.raises(ValueError, match="the run goes from 0 to 6"):
        gradient_of(pendulum(PENDULUM), GAUSS8, 8, position_at(7.0), [])
    with pytest.raises(ValueError, match="times: finite numbers"):
        position_at(float("nan"))


def test_a_smoothed_peak():
    """Close above the peak, with the derivative of the value at its time where it is one time."""
    scene, mesh = pendulum(PENDULUM), graded_mesh(6.0, 24, 2.0)
    observed = fvi.integrate(scene, "gauss8", mesh, quantities={"a": "ax"}).observed
    peak = observed.extents["a"].peak
    times = np.linspace(0.0, 6.0, 61)
    soft = fvi.gradient(scene, "gauss8", mesh, fvi.smoothed_peak("ax", times, sharpness=80.0))
    assert 0.99 * peak < soft.value < 61 ** (1 / 80) * peak
    at = observed.extents["a"].peak_time
    alone = fvi.smoothed_peak("ax", [at, 0.5 * at], sharpness=400.0)
    one = fvi.gradient(scene, "gauss8", mesh, alone, ["damping.0.order", "potential.omega"])
    other = fvi.gradient(scene, "gauss8", mesh, fvi.acceleration_at(at), list(one.derivatives))
    assert one.value == pytest.approx(peak, rel=1e-6)
    for name in one.derivatives:
        assert one[name] == pytest.approx(np.sign(other.value) * other[name], rel=1e-9)
    for wrong in (1.0, 0.0, float("nan")):
        with pytest.raises(ValueError, match="sharpness"):
            fvi.smoothed_peak("ax", times, sharpness=wrong)


FRAME = {
    "name": "shaken",
    "problem": {
        "kind": "frame",
        "storeys": 2,
        "stiffness": [30.0, 20.0],
        "dampers": [{"order": 0.5, "coefficient": 0.8}],
        "ground_acceleration": "3*exp(-t)*sin(4*t)",
        "final_time": 3.0,
    },
    "method": {"rk": "gauss", "degree": 8},
    "ladder": {"steps": [16]},
    "quantities": {"drift": "x2 - x1", "felt": "ax2 + ground_acceleration", "heat": "work_1"},
}


def test_quantities_of_an_experiment():
    (experiment,) = fvi.load(FRAME).experiments
    changed = {**FRAME, "output": {"times": [1.3]}}
    (outcome,) = fvi.run(changed)
    stored = outcome.finished[0].trajectory.observed.quantities
    names = ["damping.0.order", "stiffness"]
    for name in ("drift", "felt"):
        found = fvi.gradient(experiment, "gauss8", 16, fvi.quantity_at(name, 1.3), names)
        assert found.value == pytest.approx(float(stored[name][0]), rel=1e-9)

        def of(order: float, name: str = name) -> Any:
            dampers = [{"order": order, "coefficient": 0.8}]
            return fvi.build_problem({**FRAME["problem"], "dampers": dampers})

        text = FRAME["quantities"][name]
        again = fvi.gradient(of, "gauss8", 16, fvi.quantity_at(text, 1.3), {"order": 0.5})
        assert again["order"] == pytest.approx(float(found["damping.0.order"]), rel=1e-9)
    with pytest.raises(ValueError, match=r"work_1 adds up .* here: t, x1, x2, .*, dx2"):
        fvi.gradient(experiment, "gauss8", 16, fvi.quantity_at("heat", 1.3), names)
    bouncing = {**FRAME, "impacts": {"wall": {"when": "x1 + 0.05"}}}
    (experiment,) = fvi.load(bouncing).experiments
    with pytest.raises(ValueError, match="impacts: a motion that bounces has no derivatives"):
        fvi.gradient(experiment, "gauss8", 16, fvi.quantity_at("drift", 1.3), names)


def test_parameters_in_expressions():
    """Energies have the numbers of the scene in them, also where these stand for themselves."""

    def swinging(omega: float, x: float) -> Scene:
        return pendulum({**PENDULUM, "omega": omega, "angle": x})

    # the argument x is the angle at the start, the x in an expression that of the time
    energy = "vx**2/2 + omega**2*(1 - cos(x))"
    given = {"omega": 1.2, "x": 2.0}
    found = fvi.gradient(swinging, "gauss8", 24, fvi.quantity_at(energy, 2.5), given)
    named = fvi.gradient(
        pendulum(PENDULUM), "gauss8", 24, fvi.quantity_at(energy, 2.5), ["potential.omega"]
    )
    assert found["omega"] == pytest.approx(float(named["potential.omega"]), rel=1e-9)
    sides = [
        fvi.integrate(
            swinging(1.2 + h, 2.0),
            "gauss8",
            24,
            quantities={"e": energy},
            output=[2.5],
            parameters={"omega": 1.2 + h},
        ).observed.quantities["e"][0]
        for h in (1e-4, -1e-4)
    ]
    assert found["omega"] == pytest.approx((sides[0] - sides[1]) / 2e-4, rel=1e-6)


def test_expressions_without_derivatives():
    scene = pendulum(PENDULUM)
    for wrong, said in (
        ("work_1", "work_1 adds up"),
        ("y", "quantity: .*unknown name 'y'"),
        ("1/(x - x)", "not finite at these times"),
    ):
        with pytest.raises(ValueError, match=said):
            fvi.gradient(scene, "gauss8", 24, fvi.quantity_at(wrong, 1.0))
    with pytest.raises(ValueError, match=r"component: 1 is not one of 0 to 0"):
        fvi.gradient(scene, "gauss8", 24, fvi.acceleration_at(1.0, 1))
    with pytest.raises(ValueError, match="not finite at these times"):
        fvi.gradient(riemann_liouville(LATE), "gauss8", 24, fvi.acceleration_at(0.0))
