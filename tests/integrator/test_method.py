"""Methods name themselves, and know their order."""

import math

import pytest

from fvi_cli.integrator.method import Baseline, Method, RuleSpecification, method_columns


@pytest.mark.parametrize(
    ("method", "case"),
    [
        (Method(cq="bdf2", degree=1, sampling="nodes"), "bdf2-nodes-s1-gauss1-none"),
        (Method(cq="gauss", degree=3, start="graded"), "gauss-s3-graded"),
        (Method(cq="bdf4", degree=2, forcing_quadrature="exact"), "bdf4-points-s2-gauss2-none"),
        (Method(cq="bdf3", degree=2, sampling="nodes", start="weights", start_exponents=(2.5,)),
         "bdf3-nodes-s2-gauss2-weights-2p5"),
        (Method(cq="bdf1", degree=2, quadrature=RuleSpecification(rule="lobatto", points=3)),
         "bdf1-points-s2-lobatto3-none-galerkin"),
        (Method(cq="lobatto-iiic", degree=2), "lobatto-iiic-s2-none"),
        (Baseline(name="explicit-euler"), "explicit-euler"),
    ],
)  # fmt: skip
def test_cases(method, case):
    assert method.case == case
    assert set(method_columns(method)) == {"cq", "sampling", "degree", "quadrature", "start"}


def test_orders_on_smooth_data():
    assert Method(cq="bdf6", degree=2, sampling="nodes").order == 2
    assert Method(cq="bdf6", degree=2).order == 4
    assert Method(cq="gauss", degree=3).order == 6
    assert math.isnan(Method(cq="lobatto-iiic", degree=3).order)
