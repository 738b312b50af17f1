"""The controller of step sizes alone, fed with estimates that are known functions of the size."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from letters import in_pieces, spring
from spread import spread

from fvi_cli.effects.forcing import Forcing
from fvi_cli.integrator.meshes.controller import (
    FIRST_STEP,
    SHORTEST_STEP,
    SMOOTH_FIRST_STEP,
    AdaptiveSteps,
    StepController,
)


def controller(
    tolerance: float = 1e-6,
    *,
    breaks: tuple[float, ...] = (),
    singular: bool = True,
    samples: list[float] | None = None,
    **more,
) -> StepController:
    parts = [part for one in breaks for part in ("1", one)]
    force = in_pieces(*parts, "0") if breaks else None
    if samples is not None:
        force = Forcing.from_samples(samples, np.ones(len(samples)))
    damping = [(0.5, 1.0)] if singular else []
    scene = spring(*damping, T=8.0, x=1.0, forcing=force)
    return StepController(AdaptiveSteps(tolerance=tolerance, **more), scene, stages=4)


def steps(one: StepController, estimate: Callable[[float, float], float]) -> list[float]:
    """Ends of the accepted steps."""
    ends = [0.0]
    while not one.is_finished and not one.is_stuck:
        size = one.propose()
        assert size > 0
        before = one.time
        if one.judge(size, estimate(before, size)):
            ends.append(one.time)
        else:
            assert one.time == before
        assert len(ends) + one.rejected < 20_000
    return ends


def of_order(order: float, scale: float = 1.0) -> Callable[[float, float], float]:
    return lambda _, size: scale * size**order


@spread(breaks=[(), (1.0,), (0.1234, 0.12345, 7.999)], tolerance=[1e-3, 1e-9])
def test_break_points_and_the_end_are_met_exactly(breaks, tolerance):
    one = controller(tolerance, breaks=breaks)
    ends = steps(one, of_order(5.0))
    assert {*breaks, 8.0} <= set(ends)
    assert (np.diff(ends) > 0).all()
    assert one.is_finished
    # behind each of them it is as careful as at the start
    for begin in (0.0, *breaks):
        at = ends.index(begin)
        assert ends[at + 1] - begin <= FIRST_STEP * 8.0 * (1 + 1e-9)


def test_samples_are_points_without_a_fresh_start():
    knots = [0.0, 1.0, 3.0, 8.0]
    ends = steps(controller(1e-3, samples=knots), of_order(5.0))
    assert set(knots) <= set(ends)
    assert ends[ends.index(3.0) + 1] - 3.0 > 0.1


@pytest.mark.parametrize("order", [3.0, 5.0, 8.0])
def test_the_estimate_is_kept_at_the_tolerance(order):
    """Steady steps are as long as the tolerance allows, up to the rounding and the safety."""
    sizes = np.diff(steps(controller(1e-6), of_order(order, 4.0)))
    allowed = (1e-6 / 4.0) ** (1.0 / order)
    assert sizes.max() <= allowed
    assert np.median(sizes[20:]) > 0.4 * allowed


def test_a_rejected_step_is_counted_and_tried_shorter():
    one = controller(singular=False)
    size = one.propose()
    assert FIRST_STEP * 8.0 < size <= SMOOTH_FIRST_STEP * 8.0
    assert not one.judge(size, 1.0)
    assert one.rejected == 1
    assert one.propose() < size
    assert one.judge(one.propose(), 1e-9)
    assert one.rejected == 1


@pytest.mark.parametrize("estimate", [math.inf, math.nan])
def test_steps_that_cannot_be_solved_are_rejected_until_it_is_stuck(estimate):
    one = controller()
    ends = steps(one, lambda time, size: estimate if time + size > 2.0 else 1e-12)
    assert one.is_stuck
    assert not one.is_finished
    assert ends[-1] < 2.0
    assert 2.0 - ends[-1] < 1e-8
    assert one.rejected > 10


def test_the_shortest_step_is_taken_whatever_it_errs():
    """A jump nobody told of: no step over it is good enough, the shortest one is done."""
    one = controller(singular=False)
    ends = np.array(steps(one, lambda time, size: 1.0 if time < 2.0 <= time + size else 1e-12))
    assert one.rejected > 5
    assert one.is_finished
    crossing = int(np.searchsorted(ends, 2.0)) - 1
    assert ends[crossing + 1] - ends[crossing] <= 2.0 * SHORTEST_STEP * 8.0


def test_no_step_is_longer_than_asked_for():
    sizes = np.diff(steps(controller(1.0, max_step=0.1), of_order(5.0)))
    assert sizes.max() <= 0.1
    assert np.diff(steps(controller(1.0), of_order(5.0))).max() > 0.5
    with pytest.raises(ValueError, match="max_step"):
        AdaptiveSteps(tolerance=1.0, max_step=0.0)


@spread(order=[2.5, 3.0], tolerance=[1e-6, 1e-10], scale=[1.0, 100.0])
def test_steps_grow_quickly_where_the_order_is_lower(order, tolerance, scale):
    """Where errors are like h^order, with less than m + 1 = 5."""
    allowed, estimate = (tolerance / scale) ** (1.0 / order), of_order(order, scale)
    one, count = controller(tolerance), 0
    while (size := one.propose()) < 0.4 * allowed:
        assert one.judge(size, estimate(one.time, size))
        count += 1
    assert one.rejected == 0
    assert count <= math.log(allowed / controller(tolerance).propose(), 8.0) + 1
