"""No mode is lost: random structures against all eigenvalues of a polynomial in a root of s."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from oracles.eigenvalues import Term, Zener, oscillating_modes, unpolished_modes
from scipy.sparse import csr_array
from spread import few_of

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws.cole_cole import fractional_maxwell
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.registry import build_problem
from fvi_cli.studies.vibration import modes, sector
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness
from fvi_cli.studies.vibration.modes import ModeTable, find_modes
from fvi_cli.studies.vibration.region import region_of_all_modes

ORDERS = [Fraction(n, 5) for n in range(1, 10)] + [Fraction(1, 2), Fraction(3, 2), Fraction(1)]


def structure(mass: Array, terms: list[Term]) -> Scene:
    """The scene of a mass and the terms of the oracle."""
    stiffness = sum((form for order, form in terms if order == 0), np.zeros_like(mass))
    damping: list[FractionalDamping] = []
    laws: list[Law] = []
    for order, form in terms:
        if isinstance(order, Zener):
            laws.append(
                fractional_maxwell(
                    order=float(order.order), time=order.time, modulus=1.0, coefficient=form
                )
            )
        elif order:
            damping.append(FractionalDamping(order=float(order), coefficient=form))
    return Scene(
        inertia=Inertia(mass=mass),
        potential=QuadraticPotential(stiffness=stiffness),
        damping=tuple(damping),
        laws=tuple(laws),
        initial_position=np.zeros(len(mass)),
        initial_velocity=np.zeros(len(mass)),
        final_time=1.0,
    )


def drawn(seed: int) -> tuple[Array, list[Term]]:
    """A structure with dampers between any two places, in any units; some are fed."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(1, 5))
    unit_of_time, unit_of_mass = 10.0 ** rng.uniform(-9, 9, 2)
    mass = np.diag(rng.uniform(0.3, 3.0, d)) * unit_of_mass
    ends = rng.standard_normal((d, d))
    stiffness = ends @ np.diag(10.0 ** rng.uniform(-2, 2, d)) @ ends.T
    if rng.random() < 0.1:
        # free to move
        stiffness -= np.linalg.eigvalsh(stiffness)[0] * np.eye(d)
    if rng.random() < 0.1:
        stiffness -= 0.5 * np.diag(np.diagonal(stiffness))
    terms: list[Term] = [(Fraction(0), stiffness * unit_of_mass / unit_of_time**2)]
    orders = rng.permutation(len(ORDERS))[: int(rng.integers(1, 3))]
    for index in orders.tolist():
        order, along = ORDERS[index], rng.standard_normal((d, int(rng.integers(1, d + 1))))
        size = 10.0 ** rng.uniform(-3, 3) * (-1.0 if rng.random() < 0.1 else 1.0)
        form = size * along @ along.T * unit_of_mass * unit_of_time ** (float(order) - 2)
        terms.append((order, form))
    if rng.random() < 0.2:
        along = rng.standard_normal((d, 1))
        form = 10.0 ** rng.uniform(-3, 3) * along @ along.T * unit_of_mass / unit_of_time**2
        law = Zener(
            order=Fraction(int(rng.integers(1, 5)), 5), time=unit_of_time * rng.uniform(0.1, 10)
        )
        terms.append((law, form))
    return mass, terms


def expected_modes(mass: Array, terms: list[Term], largest_ratio: float = 0.995) -> list[complex]:
    """The oracle's, without slow ones that round-off of a singular stiffness makes."""
    (_, stiffness), *_ = terms
    rate = np.sqrt(np.linalg.norm(stiffness) / np.linalg.norm(mass))
    found = oscillating_modes(mass, terms, largest_ratio=largest_ratio)
    is_singular = np.linalg.cond(stiffness) > 1e13
    return [s for s in found if not is_singular or abs(s) > 1e-6 * rate]


def agree(table: ModeTable | None, expected: list[complex]) -> bool:
    """Whether the modes within the sector are the expected ones, each once."""
    if table is None:
        return not expected
    found = [m.frequency for m in table.modes if abs(m.damping_ratio) < 0.9949]
    wanted = [s for s in expected if abs(s.real) < 0.9949 * abs(s)]
    if not table.is_complete or len(found) != len(wanted):
        return False
    return all(min(abs(s - one) for one in found) < 1e-7 * abs(s) for s in wanted)


def found_modes(scene: Scene) -> ModeTable | None:
    try:
        return find_modes(scene, 100)
    except ValueError:
        return None


@few_of(1, 80, "block")
def test_all_modes_of_random_structures_are_found(block):
    for seed in range(5 * block, 5 * block + 5):
        mass, terms = drawn(seed)
        expected = expected_modes(mass, terms)
        table = found_modes(structure(mass, terms))
        assert agree(table, expected), (seed, expected, table)


def test_starts_without_damping_lose_modes_and_the_count_says_so(monkeypatch):
    # the control: what the search adds is needed, and its absence does not pass for completeness
    monkeypatch.setattr(modes._Search, "look_in", lambda *_: None)
    monkeypatch.setattr(modes._Search, "stiffened", lambda *_: [])
    lost = 0
    for seed in range(10):
        mass, terms = drawn(seed)
        expected = expected_modes(mass, terms)
        table = found_modes(structure(mass, terms))
        if table is not None and len(table.modes) < len(expected):
            lost += 1
            assert not table.is_complete
    assert lost >= 2


def test_the_region_holds_all_modes_whatever_is_found():
    for seed in range(8):
        mass, terms = drawn(seed)
        stiffness = DynamicStiffness(structure(mass, terms))
        region, _ = region_of_all_modes(stiffness, largest_ratio=0.995)
        for s in expected_modes(mass, terms, largest_ratio=0.99):
            assert region.holds(s), (seed, s, region)


@few_of(2, 12)
def test_modes_of_bodies_that_nothing_holds_are_found(seed):
    rng = np.random.default_rng(seed)
    d = int(rng.integers(2, 5))
    # springs and dampers between neighbours alone
    ends = np.eye(d)[:, 1:] - np.eye(d)[:, :-1]
    stiffness, damping = (ends @ np.diag(one) @ ends.T for one in rng.uniform(0.3, 3.0, (2, d - 1)))
    mass = np.diag(rng.uniform(0.3, 3.0, d))
    terms: list[Term] = [(Fraction(0), stiffness), (ORDERS[seed % len(ORDERS)], 0.1 * damping)]
    expected = expected_modes(mass, terms)
    assert len(expected) == d - 1
    table = found_modes(structure(mass, terms))
    assert agree(table, expected)
    assert table.reach == "faster"  # of the slowest nothing is known


@pytest.mark.parametrize(
    ("stiffness", "damping", "order", "expected"),
    [
        ([[1.0]], [[10.0]], 0.5, [-2.2522 + 4.1440j]),
        ([[2.0, -1.0], [-1.0, 2.0]], [[8.0, 0.0], [0.0, 0.0]], 0.6,
         [-0.029907 + 1.393097j, -2.5616 + 3.7095j]),
    ],
)  # fmt: skip
def test_strongly_damped_modes_are_found(stiffness, damping, order, expected):
    mass = np.eye(len(stiffness))
    terms: list[Term] = [
        (Fraction(0), np.array(stiffness)),
        (Fraction(order).limit_denominator(10), np.array(damping)),
    ]
    table = find_modes(structure(mass, terms), 4)
    assert table.is_complete
    assert [mode.frequency for mode in table.modes] == pytest.approx(expected, abs=1e-4)


def sparse_chain(seed: int) -> tuple[Array, list[Term]]:
    """A chain of more bodies than are looked at as a whole, with dampers between some of them."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(42, 62))
    springs = 10.0 ** rng.uniform(-1, 1, d + 1)
    if rng.random() < 0.2:
        springs[[0, -1]] = 0.0
    stiffness = np.diag(springs[:-1] + springs[1:])
    stiffness -= np.diag(springs[1:-1], 1) + np.diag(springs[1:-1], -1)
    damping, sign = np.zeros((d, d)), -1.0 if rng.random() < 0.2 else 1.0
    for place in rng.integers(0, d - 1, rng.integers(1, 6)).tolist():
        pair = np.ix_((place, place + 1), (place, place + 1))
        damping[pair] += sign * 10.0 ** rng.uniform(-2, 2.5) * np.array([[1, -1], [-1, 1]])
    order = (Fraction(1, 2), Fraction(1), Fraction(3, 2))[seed % 3]
    return np.diag(rng.uniform(0.5, 2.0, d)), [(Fraction(0), stiffness), (order, damping)]


def missing_in_chain(seed: int) -> list[complex]:
    """Modes nearest to a frequency, or lowest, that are not found though none is said to miss."""
    mass, terms = sparse_chain(seed)
    near = None if seed % 2 else 0.3
    scene = structure(mass, terms)
    scene = replace(
        scene,
        inertia=Inertia(mass=csr_array(mass)),
        potential=QuadraticPotential(stiffness=csr_array(terms[0][1])),
    )
    table = find_modes(scene, 8, near=near)
    centre = 2 * np.pi * (near or 0.0)
    every = [
        s
        for s in unpolished_modes(mass, terms)
        if s.imag > 1e-4 * abs(s) > 1e-8 and abs(s.real) < 0.995 * abs(s)
    ]
    nearest = sorted(every, key=lambda s: abs(abs(s) - centre))[:8]
    found = [mode.frequency for mode in table.modes]
    lost = [s for s in nearest if min(abs(s - one) for one in found) > 1e-3 * abs(s)]
    assert table.counted is None or table.reach == "around"
    return lost if table.is_complete else [*lost, complex("nan")]


@few_of(1, 30, "block")
def test_modes_of_large_structures_are_found_where_they_are_asked_for(block):
    for seed in range(2 * block, 2 * block + 2):
        assert not missing_in_chain(seed), seed


def test_whole_turns_of_slower_modes_would_pass_unseen(monkeypatch):
    # the control: few steps around an arc that many slower modes lie within
    monkeypatch.setattr(sector, "_first_parts", lambda *_: np.linspace(0.0, 1.0, 9))
    monkeypatch.setattr(DynamicStiffness, "number_below", lambda *_: 0)
    assert any(missing_in_chain(seed) for seed in (0, 2, 6, 8, 10))


@pytest.mark.parametrize("seed", range(8))
def test_repeated_frequencies_with_one_damper(seed):
    """It damps one combination of the shapes of a frequency and leaves the others undamped."""
    rng = np.random.default_rng([12, seed])
    size = int(rng.integers(3, 7))
    axes = np.linalg.qr(rng.standard_normal((size, size)))[0]
    squares = rng.choice([1.0, 4.0, 9.0], size)
    acts = " + ".join(f"{one:.3f}*x{k}" for k, one in enumerate(rng.uniform(0.2, 2.0, size), 1))
    order, coefficient = rng.uniform(0.2, 1.8), rng.uniform(0.05, 0.6)
    problem = {
        "kind": "structure",
        "mass": np.eye(size).tolist(),
        "stiffness": (0.5 * (axes * squares @ axes.T + (axes * squares @ axes.T).T)).tolist(),
        "damping": [{"order": order, "coefficient": coefficient, "acts_on": [acts]}],
        "initial": {"position": [0.0] * size},
        "final_time": 1.0,
    }
    table = find_modes(build_problem(problem).scene, 50)
    assert len(table.modes) == size
    assert table.is_complete
    damped = sum(mode.damping_ratio > 1e-9 for mode in table.modes)
    assert damped == np.unique(squares).size


def test_a_mode_that_equals_the_bound_of_all_modes():
    problem = {
        "kind": "structure",
        "mass": np.eye(2).tolist(),
        "stiffness": [[187.5, -87.5], [-87.5, 187.5]],
        "initial": {"position": [0.0, 0.0]},
        "final_time": 1.0,
    }
    table = find_modes(build_problem(problem).scene, 10)
    expected = [10.0, np.sqrt(275.0)]
    assert [one.frequency.imag for one in table.modes] == pytest.approx(expected, rel=1e-13)
