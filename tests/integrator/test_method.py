"""Methods check themselves and name themselves."""

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


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"cq": "bdf7", "degree": 1}, "bdf7"),
        ({"cq": "bdf1", "degree": 0}, "degree: 0"),
        ({"cq": "bdf1", "degree": 21}, "1 to 20"),
        ({"cq": "bdf1", "degree": 1, "sampling": "middle"}, "nodes, points"),
        ({"cq": "gauss", "degree": 2, "sampling": "nodes"}, "own points"),
        ({"cq": "gauss", "degree": 2, "start": "weights"}, "BDF only"),
        ({"cq": "gauss", "degree": 2, "quadrature": RuleSpecification(points=3)},
         "own rule, gauss2"),
        ({"cq": "bdf1", "degree": 1, "quadrature": RuleSpecification(rule="radau", points=2)},
         "gauss, lobatto"),
        ({"cq": "bdf1", "degree": 3, "quadrature": RuleSpecification(points=1)},
         "too weak for degree 3"),
        ({"cq": "bdf1", "degree": 1, "start_exponents": (2.5,)}, "only start: weights"),
    ],
)  # fmt: skip
def test_what_makes_no_method_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        Method(**fields)


def test_rules_and_baselines_check_themselves():
    with pytest.raises(ValueError, match="lobatto takes 2 to 64"):
        RuleSpecification(rule="lobatto", points=1)
    with pytest.raises(ValueError, match="explicit-euler"):
        Baseline(name="leapfrog")


def test_orders_on_smooth_data():
    assert Method(cq="bdf6", degree=2, sampling="nodes").classical_order == 2
    assert Method(cq="bdf6", degree=2).classical_order == 4
    assert Method(cq="gauss", degree=3).classical_order == 6
    assert Method(cq="radau-iia", degree=3).classical_order == 5
    assert Method(cq="lobatto-iiic", degree=3).classical_order == 6
