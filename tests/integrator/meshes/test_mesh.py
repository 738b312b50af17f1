"""Meshes as values: points, shares, and what cannot be built."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from spread import spread

from fvi_cli.integrator.meshes.mesh import (
    Mesh,
    Stretch,
    graded_mesh,
    mesh_of,
    steps_of_parts,
    uniform_mesh,
)

Array = np.ndarray


def points(mesh: Mesh) -> Array:
    """All points, each from the beginning of its stretch as the march has them."""
    found = [np.zeros(1)]
    for one in mesh.stretches:
        own = one.begin + one.step_size * np.arange(1, one.n_steps + 1)
        own[-1] = one.end
        found.append(own)
    return np.concatenate(found)


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


@spread(breaks=[(0.333,), (0.25, 0.26), (1e-9,), (0.1, 0.2, 0.999)], grading=[1.0, 2.0, 3.5])
def test_break_points_off_the_grid_are_points(breaks, grading):
    mesh = graded_mesh(1.0, 40, grading, breaks)
    at = points(mesh)
    assert mesh.n_steps == mesh.n_reported == at.size - 1 == 40
    assert at[0] == 0.0
    assert at[-1] == 1.0
    assert (np.diff(at) > 0).all()
    assert fresh(mesh) == [0.0, *breaks]
    assert set(breaks) <= set(at)


@given(
    ends=st.lists(st.floats(1e-3, 100.0), min_size=1, max_size=6, unique=True),
    extra=st.integers(0, 300),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_steps_are_shared_out_by_length(ends, extra):
    edges = (0.0, *sorted(ends))
    n_steps = len(ends) + extra
    counts = steps_of_parts(edges, n_steps)
    assert sum(counts) == n_steps
    assert min(counts) >= 1
    lengths = np.diff(edges)
    shares = n_steps * lengths / lengths.sum()
    # no part has a step more than its share but for parts that would have none
    raised = [count == 1 and share < 1 for count, share in zip(counts, shares, strict=True)]
    for count, share, is_raised in zip(counts, shares, raised, strict=True):
        assert is_raised or count < share + 1
    if not any(raised):
        assert np.abs(np.array(counts) - shares).max() < 1


@pytest.mark.parametrize("grading", [1.0, 1.5, 2.0, 7.0])
def test_graded_points_are_powers(grading):
    at = points(graded_mesh(5.0, 32, grading))
    assert np.allclose(at, 5.0 * (np.arange(33) / 32) ** grading, rtol=1e-14, atol=0)


def test_a_graded_mesh_begins_anew_behind_a_break_point():
    at = points(graded_mesh(4.0, 24, 3.0, (1.0,)))
    counts = steps_of_parts((0.0, 1.0, 4.0), 24)
    behind = 1.0 + 3.0 * (np.arange(counts[1] + 1) / counts[1]) ** 3
    assert np.allclose(at[counts[0] :], behind, rtol=1e-14, atol=0)


def test_a_mesh_goes_through_given_points():
    times = np.array([0.0, 1e-6, 0.3, 0.30001, 2.0])
    mesh = mesh_of(times, (0.3,))
    assert np.array_equal(points(mesh), times)
    assert mesh.n_reported == mesh.n_steps == 4
    assert mesh.shortest_step == 1e-6
    assert fresh(mesh) == [0.0, 0.3]


def stretch(begin: float, end: float, n_steps: int, step_size: float) -> Stretch:
    return Stretch(begin=begin, end=end, n_steps=n_steps, step_size=step_size)


def test_stretches_are_joined_without_gaps():
    mesh = graded_mesh(2.0, 50, 4.0, (0.77,))
    for one, following in itertools.pairwise(mesh.stretches):
        assert one.end == following.begin
