"""Buildings by lists of storeys: dampers of any law in some of them, Rayleigh's damping."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from scipy.sparse import csr_array, diags_array

import fvi_cli as fvi
from fvi_cli.effects.matrices import dense
from fvi_cli.scenes.registry import build_problem, build_scene

RNG = np.random.default_rng(290)
LAWS = (
    {"order": 0.7, "coefficient": 0.8},
    {"law": "zener", "order": 0.6, "time": 0.3, "relaxed": 0.5, "unrelaxed": 4.0},
    {"law": "maxwell", "order": 0.4, "time": 0.2, "modulus": 3.0, "coefficient": 1.5},
    {"law": "prony", "moduli": [1.0, 2.0], "times": [0.1, 0.5], "relaxed": 0.25},
    {"law": "kelvin-voigt", "stiffness": 2.0, "coefficient": 0.6},
)


def shear(values):
    """The matrix of sum k_i (x_i - x_(i-1))^2, entry by entry."""
    matrix = np.zeros((len(values), len(values)))
    for storey, k in enumerate(values):
        matrix[storey, storey] += k
        if storey:
            matrix[storey - 1, storey - 1] += k
            matrix[storey - 1, storey] -= k
            matrix[storey, storey - 1] -= k
    return matrix


def frame(**keys):
    return {
        "kind": "frame",
        "ground_acceleration": "sin(3*t)",
        "final_time": 2.0,
        "exact": "none",
        **keys,
    }


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.get("law", "springpot"))
def test_a_damper_in_a_storey_is_a_term_on_the_drift_of_that_storey(law):
    masses, stiffnesses = RNG.uniform(1, 3, 4).tolist(), RNG.uniform(20, 60, 4).tolist()
    for storey, drift in ((1, "x1"), (3, "x3 - x2")):
        building = build_scene(
            frame(masses=masses, stiffnesses=stiffnesses, dampers=[{"storey": storey, **law}])
        )
        same = build_scene(
            {
                "kind": "structure",
                "mass": np.diag(masses).tolist(),
                "stiffness": shear(stiffnesses).tolist(),
                "damping": [{**law, "acts_on": [drift]}],
                "ground_acceleration": "sin(3*t)",
                "final_time": 2.0,
            }
        )
        one, other = (fvi.integrate(scene, "gauss3", 64) for scene in (building, same))
        assert np.abs(one.position - other.position).max() < 1e-12 * np.abs(one.position).max()
        elsewhere = build_scene(
            frame(masses=masses, stiffnesses=stiffnesses, dampers=[{"storey": 2, **law}])
        )
        moved = fvi.integrate(elsewhere, "gauss3", 64).position
        assert np.abs(one.position - moved).max() > 1e-4 * np.abs(moved).max()


def test_a_damper_without_a_storey_stands_in_every_one():
    everywhere = build_scene(frame(storeys=3, dampers=[LAWS[1]]))
    each = build_scene(frame(storeys=3, dampers=[{"storey": k, **LAWS[1]} for k in (1, 2, 3)]))
    one, other = (fvi.integrate(scene, "gauss3", 48).position for scene in (everywhere, each))
    assert np.abs(one - other).max() < 1e-12 * np.abs(one).max()


def damping_ratios(problem):
    """Ratios of all modes by frequency, of the eigenvalues of the first-order system."""
    scene = problem.scene
    mass, stiffness = dense(scene.inertia.form), dense(scene.potential.form)
    (term,) = scene.damping
    size = len(mass)
    first_order = np.block(
        [
            [np.zeros((size, size)), np.eye(size)],
            [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, dense(term.form))],
        ]
    )
    values = scipy.linalg.eigvals(first_order)
    upper = sorted((s for s in values if s.imag > 0), key=abs)
    return np.array([-s.real / abs(s) for s in upper])


@pytest.mark.parametrize("kind", ["frame", "structure"])
def test_rayleigh_damping_has_the_ratios_that_are_given(kind):
    for modes in ([1, 3], [2, 5], [4, 1]):
        masses, stiffnesses = RNG.uniform(1, 3, 6), RNG.uniform(20, 60, 6)
        ratio = float(RNG.uniform(0.01, 0.05))
        ratios = [ratio, ratio * 1.1]
        keys = frame(masses=masses.tolist(), stiffnesses=stiffnesses.tolist())
        if kind == "structure":
            given = {"mass": np.diag(masses).tolist(), "stiffness": shear(stiffnesses).tolist()}
            keys = {"kind": "structure", "final_time": 1.0, **given}
        keys["rayleigh"] = {"ratios": ratios, "modes": modes}
        found = damping_ratios(build_problem(keys))
        assert found[np.array(modes) - 1] == pytest.approx(ratios, rel=1e-9)
        others = np.delete(found, np.array(modes) - 1)
        assert np.abs(others - ratios[0]).min() > 1e-6


def test_rayleigh_damping_of_sparse_matrices_is_that_of_dense_ones():
    storeys = 430
    stiffnesses = RNG.uniform(20, 60, storeys)
    keys = frame(storeys=storeys, stiffness=stiffnesses.tolist())
    keys["rayleigh"] = {"ratios": [0.02, 0.03], "modes": [1, 4]}
    (term,) = build_scene(keys).damping
    assert hasattr(term.form, "toarray")
    squares = scipy.linalg.eigh(shear(stiffnesses), eigvals_only=True)
    first, second = np.sqrt(squares[[0, 3]])
    system = 0.5 * np.array([[1 / first, first], [1 / second, second]])
    a, b = np.linalg.solve(system, [0.02, 0.03])
    expected = a * np.eye(storeys) + b * shear(stiffnesses)
    assert np.abs(dense(term.form) - expected).max() < 1e-9 * np.abs(expected).max()


def test_modes_of_a_large_free_structure_are_no_base_of_ratios():
    n = 500
    free = diags_array(
        [-np.ones(n - 1), np.r_[1.0, 2 * np.ones(n - 2), 1.0], -np.ones(n - 1)], offsets=[-1, 0, 1]
    )
    with pytest.raises(ValueError, match="two different ones above 0 are needed"):
        fvi.structure(
            mass=csr_array(diags_array(np.ones(n))),
            stiffness=csr_array(free),
            rayleigh={"ratios": [0.02, 0.05]},
            final_time=1.0,
        )


def test_storeys_of_dampers_in_python_and_forces_beside_the_ground():
    damper = fvi.fractional_zener(order=0.6, time=0.3, relaxed=0.5, unrelaxed=4.0)
    data = {"storeys": 3, "final_time": 2.0, "ground_acceleration": "sin(3*t)"}
    own = fvi.frame(**data, dampers=[replace(damper, storeys=(2,))])
    known = build_scene(frame(storeys=3, dampers=[{"storey": 2, **LAWS[1]}]))
    one, other = (fvi.integrate(scene, "gauss3", 48).position for scene in (own, known))
    assert np.array_equal(one, other)
    push = {"forcing": ["t", "0", "cos(t)"]}
    given = (data | push, data, data | push | {"ground_acceleration": "0"})
    both, shaken, pushed = (fvi.integrate(fvi.frame(**one), "gauss3", 48).position for one in given)
    assert np.abs(both - shaken - pushed).max() < 1e-13
