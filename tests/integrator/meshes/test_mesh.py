"""Meshes as values: points, shares, and what cannot be built."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from spread import spread

from fvi_cli.integrator.meshes.mesh import (
    Mesh,
    graded_mesh,
    mesh_of,
    misplaced_break_point,
    share_steps,
    uniform_mesh,
)


def fresh(mesh: Mesh) -> list[float]:
    """Times at which the motion may be singular."""
    return [one.begin for one in mesh.stretches if one.is_fresh]


@pytest.mark.parametrize("n_steps", [1, 3, 7, 1000])
def test_equal_steps_are_one_stretch(n_steps):
    mesh = uniform_mesh(3.0, n_steps)
    assert len(mesh.stretches) == 1
    assert mesh.n_steps == mesh.n_reported == n_steps
    assert mesh.shortest_step == 3.0 / n_steps
    assert mesh.final_time == 3.0
    assert fresh(mesh) == [0.0]


def test_break_points_on_the_grid_leave_the_steps_equal():
    # 0.1 * 3 is not 0.3 in binary numbers
    mesh = uniform_mesh(1.0, 10, (0.1 * 3, 0.7))
    assert {one.step_size for one in mesh.stretches} == {0.1}
    assert [one.n_steps for one in mesh.stretches] == [3, 4, 3]
    assert fresh(mesh) == [0.0, 0.1 * 3, 0.7]
    assert not misplaced_break_point((0.1 * 3, 0.7), 1.0, 10)
    assert not misplaced_break_point((0.1 * 3,), 1.0, 10**6)  # number 300,000 but for round-off
    assert "t = 0.7 inside a step" in misplaced_break_point((0.5, 0.7), 1.0, 8)


@spread(breaks=[(0.333,), (0.25, 0.26), (1e-9,), (0.1, 0.2, 0.999)], grading=[1.0, 2.0, 3.5])
def test_break_points_off_the_grid_are_points(breaks, grading):
    mesh = graded_mesh(1.0, 40, grading, breaks)
    assert mesh.n_steps == mesh.n_reported == mesh.times.size - 1 == 40
    assert mesh.times[0] == 0.0
    assert mesh.times[-1] == 1.0
    assert (np.diff(mesh.times) > 0).all()
    assert fresh(mesh) == [0.0, *breaks]
    assert set(breaks) <= set(mesh.times)


@given(
    ends=st.lists(st.floats(1e-3, 100.0), min_size=1, max_size=6, unique=True),
    extra=st.integers(0, 300),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_steps_are_shared_out_by_length(ends, extra):
    edges = np.array([0.0, *sorted(ends)])
    n_steps = len(ends) + extra
    counts = share_steps(edges, n_steps)
    assert counts.sum() == n_steps
    assert counts.min() >= 1
    shares = n_steps * np.diff(edges) / edges[-1]
    if shares.min() >= 1:
        assert np.abs(counts - shares).max() <= 1


@pytest.mark.parametrize("grading", [1.0, 1.5, 2.0, 7.0])
def test_graded_points_are_powers_behind_every_break_point(grading):
    mesh = graded_mesh(5.0, 32, grading, (1.0,))
    counts = share_steps((0.0, 1.0, 5.0), 32)
    first, second = ((np.arange(n + 1) / n) ** grading for n in counts)
    assert np.allclose(mesh.times, [*first[:-1], *(1.0 + 4.0 * second)], rtol=1e-14, atol=0)


def test_a_mesh_goes_through_given_points():
    times = np.array([0.0, 1e-6, 0.3, 0.30001, 2.0])
    mesh = mesh_of(times, (0.3,))
    assert np.array_equal(mesh.times, times)
    assert mesh.n_reported == mesh.n_steps == 4
    assert mesh.shortest_step == 1e-6
    assert fresh(mesh) == [0.0, 0.3]


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: mesh_of([0.0, 1.0, 0.5]), "increase from 0"),
        (lambda: mesh_of([0.1, 1.0]), "increase from 0"),
        (lambda: mesh_of([0.0, 1.0, 2.0], (1.5,)), "t = 1.5 lies inside of a step"),
        (lambda: graded_mesh(1.0, 10, 0.5), "1 to 20"),
        (lambda: graded_mesh(1.0, 10**6, 20.0, (0.5,)), "smaller grading"),
        (lambda: uniform_mesh(1.0, 1, (0.5,)), "at least one step each"),
    ],
)
def test_what_is_no_mesh_is_refused(build, words):
    with pytest.raises(ValueError, match=words):
        build()
