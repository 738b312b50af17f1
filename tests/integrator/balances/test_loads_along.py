"""Load vectors along a run whose force is zero for some of the time."""

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.integrator.balances import loads_along
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.structures import linear_oscillator


def test_a_force_that_is_zero_at_first():
    pieces = [
        ForcingPiece(components=(Expression.parse(text, ("t",)),), until=until)
        for text, until in (("0", 1.0), ("2", 2.0), ("0", np.inf))
    ]
    scene = linear_oscillator(final_time=3.0, forcing=Forcing(pieces=tuple(pieces)))
    method = Method(cq="gauss", degree=2, start="none")
    steps = integrate(scene, method, 12, with_steps=True).steps
    fresh = np.isin(steps.time[:-1], [0.0, *scene.break_points])
    found = loads_along(StepLoads(scene, method, steps.tables).of_forcing, steps, fresh)
    impulses = found.sum(axis=1)[:, 0]
    expected = np.where((steps.time[:-1] >= 1.0) & (steps.time[:-1] < 2.0), 2.0, 0.0)
    np.testing.assert_allclose(impulses, expected * steps.step_size, atol=1e-15)
