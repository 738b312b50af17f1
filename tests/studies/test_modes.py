"""No mode is lost: drawn structures against all eigenvalues of a polynomial in a root of s."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from oracles.eigenvalues import Term, Zener, oscillating_modes, unpolished_modes
from scipy.sparse import csr_array
from spread import few_of

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws import Law, fractional_maxwell
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.vibration import modes
from fvi_cli.studies.vibration.modes import ModeTable, find_modes

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


def any_structure(seed: int) -> tuple[Array, list[Term]]:
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


def drawn(seed: int) -> tuple[Array, list[Term]]:
    """A structure of any kind, or with repeated or close frequencies, or with strong dampers."""
    kind = ("any", "repeated", "close", "strong")[seed % 4]
    if kind == "any":
        return any_structure(seed)
    rng = np.random.default_rng([77, seed])
    d = int(rng.integers(2, 6))
    axes = np.linalg.qr(rng.standard_normal((d, d)))[0]
    squares = 10.0 ** rng.uniform(-1, 1, d) if kind == "strong" else rng.choice([1.0, 4.0, 9.0], d)
    if kind == "close":
        squares *= 1.0 + 10.0 ** rng.uniform(-9, -1) * rng.standard_normal(d)
    stiffness = axes * squares @ axes.T
    terms: list[Term] = [(Fraction(0), 0.5 * (stiffness + stiffness.T))]
    size = 10.0 ** (rng.uniform(1, 3) if kind == "strong" else rng.uniform(-3, 0.5))
    for index in rng.permutation(len(ORDERS))[: int(rng.integers(1, 3))].tolist():
        along = rng.standard_normal((d, int(rng.integers(1, d))))
        terms.append((ORDERS[index], size * along @ along.T))
    return np.eye(d), terms


def expected_modes(mass: Array, terms: list[Term]) -> list[complex]:
    """The oracle's, without slow ones that round-off of a singular stiffness makes."""
    (_, stiffness), *_ = terms
    rate = np.sqrt(np.linalg.norm(stiffness) / np.linalg.norm(mass))
    is_singular = np.linalg.cond(stiffness) > 1e13
    found = oscillating_modes(mass, terms, largest_ratio=0.994)
    return [s for s in found if not is_singular or abs(s) > 1e-6 * rate]


def found_modes(scene: Scene) -> ModeTable | None:
    try:
        return find_modes(scene, 100)
    except ValueError:
        return None


def judge(seed: int) -> str:
    """``right``; ``not complete`` where the table says so; or ``wrong``."""
    mass, terms = drawn(seed)
    table, expected = found_modes(structure(mass, terms)), expected_modes(mass, terms)
    if table is None:
        return "wrong" if expected else "right"
    for mode in table.modes:
        near = [s for s in expected if abs(s - mode.frequency) < 1e-6 * abs(s)]
        if near:
            expected.remove(near[0])
        elif abs(mode.damping_ratio) < 0.994:
            expected.append(mode.frequency)
    if not table.is_complete:
        return "not complete"
    return "wrong" if expected else "right"


@few_of(1, 60, "block")
def test_no_mode_of_drawn_structures_is_lost_or_wrong(block):
    verdicts = [judge(seed) for seed in range(10 * block, 10 * block + 10)]
    assert "wrong" not in verdicts, (block, verdicts)
    assert verdicts.count("not complete") <= 1


def test_without_the_search_modes_are_lost_and_the_count_says_so(monkeypatch):
    monkeypatch.setattr(modes, "_find_missing", lambda *_: None)
    verdicts = [judge(seed) for seed in range(0, 40, 4)]
    assert "wrong" not in verdicts
    assert verdicts.count("not complete") >= 2


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
    table = find_modes(structure(mass, terms), 100)
    assert table.is_complete
    assert [mode.frequency for mode in table.modes] == pytest.approx(expected, rel=1e-7)
    assert len(expected) == d - 1


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
    """Modes nearest to a frequency, or lowest, that are lost though none is said to miss."""
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
    return lost if table.is_complete else []


@few_of(1, 30, "block")
def test_modes_of_large_structures_are_found_or_said_to_miss(block):
    for seed in range(2 * block, 2 * block + 2):
        assert not missing_in_chain(seed), seed
