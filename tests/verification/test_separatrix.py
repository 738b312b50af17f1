"""The pendulum on its separatrix, whose solution is known: what Newton leaves is amplified e^T."""

import numpy as np
import pytest
from letters import swing

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method


@pytest.mark.parametrize("n_steps", [512, 1024])
def test_newton_on_blocks_goes_on_to_round_off(n_steps):
    """x'' + sin x = 0, x(0) = 0, x'(0) = 2: x = 2 asin(tanh t). e^12 units of round-off: 4e-11.

    Single steps leave 2e-11 on any mesh. Blocks lose a few units more, in products of up to 512
    terms: 1.3e-11 to 1.4e-10, without a trend in the number of steps. Those that stop a digit
    earlier leave 8.6e-10.
    """
    scene = swing(T=12.0, x=0.0, v=2.0)
    method = Method(cq="gauss", degree=4)
    singly = mesh_of(np.linspace(0.0, 12.0, n_steps + 1))
    for steps, units in ((n_steps, 6), (singly, 1)):
        trajectory = integrate(scene, method, steps)
        exact = 2 * np.arcsin(np.tanh(trajectory.time))
        error = np.abs(trajectory.position[:, 0] - exact).max()
        assert error < units * np.exp(12.0) * np.finfo(float).eps
