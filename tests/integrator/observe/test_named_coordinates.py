"""A formula evaluates only the coordinates that it names."""

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

import fvi_cli as fvi
from fvi_cli.mathematics.expressions import Expression

D, STEPS, FINAL_TIME = 60, 120, 2.0
NEIGHBOURS = np.eye(D, k=1) + np.eye(D, k=-1)
FIRST = np.zeros((D, D))
FIRST[0, 0] = 2.0


def structure(mass: NDArray[np.float64]) -> fvi.Scene:
    """A chain with a springpot at its first mass, shaken by a record of straight lines."""
    times = np.linspace(0.0, FINAL_TIME, 100)
    record = np.random.default_rng(7).normal(size=100)
    return fvi.Scene(
        inertia=fvi.Inertia(mass=mass),
        potential=fvi.QuadraticPotential(stiffness=400.0 * (2.0 * np.eye(D) - NEIGHBOURS)),
        damping=[fvi.FractionalDamping(order=0.5, coefficient=FIRST)],
        forcing=fvi.Forcing.from_samples(times, *np.outer(mass.sum(axis=0), record)),
        initial_position=np.zeros(D),
        initial_velocity=np.linspace(0.0, 1.0, D),
        final_time=FINAL_TIME,
    )


MASSES = {"diagonal": np.diag(1.0 + np.arange(D) % 3), "full": 2.0 * np.eye(D) + 0.5 * NEIGHBOURS}


@pytest.mark.parametrize("mass", list(MASSES))
def test_accelerations_of_a_few_coordinates_fulfil_the_equation_of_motion(mass):
    scene, row = structure(MASSES[mass]), MASSES[mass][1]
    names = [f"x{k}" for k in range(1, 5)]
    wanted = {name: name for name in (*names, *(f"a{one}" for one in names), "dx2")}
    seen = fvi.integrate(scene, "gauss2", STEPS, quantities=wanted)
    found = seen.observed.quantities
    x1, x2, x3 = (found[name] for name in names[:3])
    inertia = sum(row[k] * found[f"ax{k + 1}"] for k in range(4))
    rest = found["dx2"] - 400.0 * (2.0 * x2 - x1 - x3) + scene.forcing(seen.time)[:, 1]
    # at t = 0 as well: the record begins there
    np.testing.assert_allclose(inertia, rest, rtol=0, atol=1e-12 * np.abs(rest).max())


def test_accelerations_of_nonlinear_scenes_and_of_initial_loads_too():
    names = [f"x{k}" for k in range(1, 8)]
    energy = " + ".join(f"({b} - {a})**4/4" for a, b in itertools.pairwise(names))
    first = np.zeros((7, 7))
    first[0, 0] = 2.0
    scene = fvi.Scene(
        inertia=fvi.Inertia(mass=np.diag(np.arange(1.0, 8.0))),
        potential=fvi.ExpressionPotential(
            coordinates=tuple(names),
            energy_expression=Expression.parse(energy, variables=tuple(names)),
        ),
        damping=[fvi.FractionalDamping(order=0.5, coefficient=first)],
        initial_position=np.linspace(1.0, -0.5, 7),
        initial_velocity=np.zeros(7),
        final_time=FINAL_TIME,
        derivative="riemann-liouville",
    )
    asked = {"a": "ax7", "b": "ax1", "d": "dx1", **{name: name for name in names}}
    run = fvi.integrate(scene, "gauss3", 60, quantities=asked)
    found = run.observed.quantities
    last = -((found["x7"] - found["x6"]) ** 3)
    assert np.abs(7.0 * found["a"] - last).max() < 1e-13
    rest = found["d"] + (found["x2"] - found["x1"]) ** 3
    assert np.abs(found["b"][1:] - rest[1:]).max() < 1e-12
    # what the initial position adds is infinite at the start
    assert found["b"][0] == -np.inf
