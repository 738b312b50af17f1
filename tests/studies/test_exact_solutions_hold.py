"""References where closed forms cancel, against Volterra's equation, and wrong solutions."""

import os
from dataclasses import replace

import numpy as np
import pytest
from oracles.linear_response import match_scene
from oracles.volterra import solve_volterra

from fvi_cli.config import parse_config
from fvi_cli.scenes.registry import build_problem
from fvi_cli.studies import reference
from fvi_cli.studies.reference import find_reference

SEED = int(os.environ.get("FVI_TEST_SEED", "1"))


def problem(order, **keys):
    damping = [{"order": order, "coefficient": keys.pop("coefficient", 0.3)}]
    start = keys.pop("initial", {"position": 0.0})
    given = {"stiffness": 2.0, "final_time": 10.0, "initial": start} | keys
    return build_problem({"kind": "damped-oscillator", "damping": damping, **given})


def by_collocation(one, force, breaks=()):
    scene = one.scene
    terms = [(term.order, term.matrix) for term in scene.damping]
    stiffness = scene.potential.stiffness[0, 0]
    return solve_volterra(
        1.0,
        terms,
        lambda x: stiffness * x,
        lambda x: np.full((*x.shape, 1), stiffness),
        force,
        scene.initial_position,
        scene.initial_velocity,
        scene.final_time,
        breaks=breaks,
        longest_step=scene.final_time / 20,
    ).position


def steep(rng):
    power, order = rng.integers(16, 31), rng.uniform(0.2, 1.8)
    one = problem(order, forcing=f"(1 - t/5)**{power}")
    return one, by_collocation(one, lambda t: (1 - t[:, None] / 5) ** power)


def struck(rng):
    width, order = 10.0 ** rng.uniform(-10, -7), rng.uniform(0.2, 0.95)
    pieces = [{"until": width, "value": 1 / width}, {"value": 0}]
    one = problem(order, forcing={"pieces": pieces}, initial={"position": 0.1})
    moved = problem(order, initial={"position": 0.1, "velocity": 1.0})
    return one, by_collocation(moved, None)


def repelled(rng):
    order, stiffness = rng.uniform(0.008, 0.05), -rng.uniform(0.05, 0.3)
    keys = {"stiffness": stiffness, "coefficient": 3.0, "forcing": "1"}
    one = problem(order, initial={"position": 1.0}, **keys)
    return one, by_collocation(one, lambda t: np.ones((t.size, 1)))


def inertial(rng):
    order, size = 2.0 - 10.0 ** rng.uniform(-14, -9), rng.uniform(0.1, 2.0)
    one = problem(order, coefficient=size, initial={"position": 1.0, "velocity": 0.5})
    rate = np.sqrt(2.0 / (1.0 + size))
    return one, lambda t: (np.cos(rate * t) + 0.5 / rate * np.sin(rate * t))[:, None]


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("draw", "tolerance"),
    [(steep, 1e-10), (struck, 2e-6), (repelled, 1e-9), (inertial, 3e-8)],
)
def test_references_hold_where_closed_forms_cancel(draw, tolerance):
    rng = np.random.default_rng([SEED, 25])
    for _ in range(3):
        one, oracle = draw(rng)
        found, times = find_reference(one), np.linspace(0.0, 10.0, 51)
        expected = oracle(times)
        scale = np.abs(expected).max()
        assert np.abs(found.at(times) - expected).max() <= tolerance * scale, (one, found.source)
        assert found.error <= 1e-10 * scale


def with_exact(one):
    """The problem with its exact solution."""
    return replace(one, exact=match_scene(one.scene).position, exact_source="expression")


def test_a_wrong_exact_solution_is_left_for_a_refined_run(monkeypatch):
    calls = []
    own = reference.integrate_members
    monkeypatch.setattr(
        reference, "integrate_members", lambda *a, **k: calls.append(a[2]) or own(*a, **k)
    )
    right = with_exact(problem(0.5, initial={"position": 1.0}))
    assert find_reference(right).source == right.exact_source
    assert calls == list(reference.CHECK_STEPS)
    wrong = replace(right, exact=lambda t: right.exact(t) * (1.0 + 1e-4 * t[:, None]))
    found = find_reference(wrong)
    assert "the exact solution differs" in found.source
    times = np.linspace(0.0, 10.0, 51)
    assert np.abs(found.at(times) - right.exact(times)).max() < 1e-11


def test_members_are_held_against_an_exact_solution_only_where_it_is_one(monkeypatch):
    text = """\
name: members
problem:
  kind: damped-oscillator
  damping: [{order: 0.6, coefficient: 0.3}]
  initial: {position: 1.0}
  final_time: 5.0
method: {rk: gauss, degree: 2}
ladder: {steps: [20]}
sweep: {problem.stiffness: [1.5, 2.5]}
"""
    runs = parse_config(text, "members.yaml").experiments[0].runs()
    right, other = (with_exact(run.problem) for run in runs)
    wrong = replace(other, exact=lambda t: other.exact(t) * (1.0 + 1e-4 * t[:, None]))
    given = property(lambda run: (right, wrong)[run.member.number])
    monkeypatch.setattr(type(runs[0]), "problem", given)
    kept, found = reference.refined_references(runs)
    assert kept is None
    times = runs[1].times
    assert np.abs(found.at(times) - other.exact(times)).max() < 1e-11
