"""Recurrences carry what the force sees of near lags: it acts as the lags themselves."""

import numpy as np
import pytest
from letters import spring
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.engine import recurrence
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.recurrence import Recurrence
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import engine_for, mesh_for
from fvi_cli.mathematics.convergence import NOISE, UNIT

COUNT = 64
"""Steps of a block: as many as there are near lags."""
STRONG = 8 * NOISE * UNIT
"""Combinations that act so much, relative to the strongest, are more than round-off."""
BOUND = 2 * NOISE * UNIT


def drawn(bdf_order: int, degree: int, terms: int) -> tuple[Engine, float]:
    """The engine of a spring with drawn orders of damping, and its step."""
    rng = np.random.default_rng([bdf_order, degree, terms])
    orders = rng.uniform(0.1, 1.9, terms)
    n_steps, end = int(2 ** rng.uniform(13, 20)), rng.uniform(0.5, 50.0)
    damping = [
        FractionalDamping(order=order, coefficient=[[rng.uniform(0.1, 1.0)]]) for order in orders
    ]
    scene = spring(T=end, k=rng.uniform(0.5, 5.0), x=1.0, damping=damping)
    sampling = "nodes" if degree == 1 else "points"
    method = Method(cq=f"bdf{bdf_order}", degree=degree, sampling=sampling)
    return engine_for([scene], method, mesh_for(scene, method, n_steps)), end / n_steps


def error_of(seen: np.ndarray, force: np.ndarray) -> float:
    """Force that is lost where lags are projected on these combinations, relative to all."""
    projected = (force.astype(np.longdouble) @ seen.T) @ seen
    return float(np.linalg.norm((force - projected).astype(float), 2) / np.linalg.norm(force, 2))


@spread(bdf_order=[1, 2, 3, 4], degree=[1, 2, 3], terms=[1, 2, 3])
def test_the_reduced_force_is_that_of_all_lags(bdf_order, degree, terms):
    engine, h = drawn(bdf_order, degree, terms)
    made = Recurrence(engine, h, COUNT)
    lags = engine.damping.memory.n_lags * degree
    force = made._memory_force()[:, :lags]
    n_sums = engine.n_states - lags
    seen = made._seen[: len(made._seen) - n_sums, :lags]
    assert len(seen) < lags
    np.testing.assert_allclose(seen @ seen.T, np.eye(len(seen)), atol=BOUND)
    assert error_of(seen, force) < BOUND
    # the combinations stand in the order of what they cause
    strong = int((np.linalg.norm(force @ seen.T, axis=0) > STRONG * np.linalg.norm(force, 2)).sum())
    assert error_of(seen[: strong - 1], force) > STRONG / 2


@pytest.mark.parametrize(("bdf_order", "degree"), [(2, 1), (3, 2), (4, 2)])
def test_a_motion_by_reduced_lags_is_that_by_all(monkeypatch, bdf_order, degree):
    engine, h = drawn(bdf_order, degree, 2)
    reduced = Recurrence._seen_by

    def motion(seen_by) -> np.ndarray:
        with monkeypatch.context() as patch:
            patch.setattr(recurrence.Recurrence, "_seen_by", seen_by)
            x, _, _ = Recurrence(engine, h, COUNT).run(engine.start(), 40, None)
        return x

    def without_the_first(self, force):
        return reduced(self, force)[1:]

    every = motion(lambda self, force: np.eye(force.shape[1]))
    assert np.abs(motion(reduced) - every).max() < 1e-13
    assert np.abs(motion(without_the_first) - every).max() > 1e-10
