"""The far past of backward differences as exponentials, against the weights themselves."""

import numpy as np
import pytest
from spread import spread

from fvi_cli.integrator.memory.lags import NEAR_LAGS, lag_exponentials
from fvi_cli.mathematics.bdf import difference_weights

ORDERS = (0.02, 0.5, 1.0, 1.5, 1.98)


def far_weights(bdf_order: int, n_weights: int, lags: np.ndarray) -> np.ndarray:
    found = lag_exponentials(bdf_order, ORDERS, n_weights - 1)
    return found.factors @ np.exp(-np.outer(found.rates, lags))


@spread(few=3, bdf_order=range(1, 7), n_weights=[300, 4096, 2**20])
def test_every_weight_behind_the_near_lags(bdf_order, n_weights):
    near = NEAR_LAGS[bdf_order]
    lags = np.unique(np.geomspace(near, n_weights - 1, 300).astype(int))
    found = far_weights(bdf_order, n_weights, lags)
    for order, values in zip(ORDERS, found, strict=True):
        if order == 1.0:
            assert not values.any()
            continue
        exact = difference_weights(bdf_order, order, n_weights)[lags]
        assert np.abs(values / exact - 1.0).max() < 1e-13


@pytest.mark.parametrize("bdf_order", [2, 5, 6])
def test_nearer_lags_have_parts_that_the_exponentials_leave_out(bdf_order):
    """The control: the other zeros of the symbol are seen there."""
    lag = np.array([NEAR_LAGS[bdf_order] // 8])
    found = far_weights(bdf_order, 4096, lag)[1]
    exact = difference_weights(bdf_order, ORDERS[1], 4096)[lag]
    assert np.abs(found / exact - 1.0).max() > 1e-9
