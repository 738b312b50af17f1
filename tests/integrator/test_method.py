"""Methods have names both ways, and know their order."""

import math

import pytest

from fvi_cli.integrator.method import (
    Baseline,
    Method,
    RuleSpecification,
    make_method,
    method_named,
)

METHODS = [
    (Method(cq="bdf2", degree=1, sampling="nodes"), "bdf2-nodes-s1-gauss1-none", "BDF2 (nodes)"),
    (Method(cq="gauss", degree=3, start="graded"), "gauss-s3-graded", "Gauss3"),
    (Method(cq="gauss", degree=3), "gauss-s3-none", "Gauss3 (start none)"),
    (
        Method(cq="bdf4", degree=2, forcing_quadrature="exact"),
        "bdf4-points-s2-gauss2-none",
        "BDF4 (degree 2)",
    ),
    (
        Method(cq="bdf2", degree=1),
        "bdf2-points-s1-gauss1-none-galerkin",
        "BDF2 (galerkin forcing)",
    ),
    (
        Method(
            cq="bdf3",
            degree=2,
            quadrature=RuleSpecification(points=5),
            sampling="nodes",
            start="weights",
            start_exponents=(2.5, 3.0),
        ),
        "bdf3-nodes-s2-gauss5-weights-2p5-3",
        "BDF3 (nodes, degree 2, 5 Gauss points, weights t^2.5, t^3)",
    ),
    (
        Method(cq="bdf1", degree=2, quadrature=RuleSpecification(rule="lobatto", points=3)),
        "bdf1-points-s2-lobatto3-none-galerkin",
        "BDF1 (degree 2, 3 Lobatto points, galerkin forcing)",
    ),
    (Method(cq="lobatto-iiic", degree=2), "lobatto-iiic-s2-none", "Lobatto IIIC (degree 2)"),
    (Baseline(name="explicit-euler"), "explicit-euler", "explicit Euler"),
]


@pytest.mark.parametrize(("method", "case", "label"), METHODS)
def test_a_method_has_a_name_in_files_and_one_for_readers(method, case, label):
    assert (method.case, method.label) == (case, label)
    assert make_method(method.keys) == method


@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("gauss3", METHODS[1][0]),
        ("Gauss 3-none", METHODS[2][0]),
        ("BDF2-nodes", METHODS[0][0]),
        ("bdf_4", METHODS[3][0]),
        ("lobatto-iiic2", METHODS[7][0]),
        ("explicit_euler", METHODS[8][0]),
    ],
)
def test_a_method_has_a_short_name(name, method):
    assert method_named(name) == method


def test_orders_on_smooth_data():
    assert Method(cq="bdf6", degree=2, sampling="nodes").order == 2
    assert Method(cq="bdf6", degree=2).order == 4
    assert Method(cq="gauss", degree=3).order == 6
    assert math.isnan(Method(cq="lobatto-iiic", degree=3).order)
