"""Defaults and combinations of methods, and what is resolved."""

import json

import pytest

from fvi_cli.config import parse_config
from fvi_cli.integrator.method import Method, method_named

FRAME = """\
problem: {{kind: pendulum, final_time: 1.0}}
method: {}
ladder: {{steps: [4, 8]}}
"""


def methods(text: str) -> tuple[object, ...]:
    (experiment,) = parse_config(FRAME.format(text), "example.yaml").experiments
    return experiment.methods


# one row of the table of defaults after the other
DEFAULTS = {
    "{bdf: 1}": "bdf1-points-s1-gauss1-none",
    "{bdf: 2}": "bdf2-points-s1-gauss1-none",
    "{bdf: 3}": "bdf3-points-s2-gauss2-none",
    "{bdf: 4}": "bdf4-points-s2-gauss2-none",
    "{bdf: 5}": "bdf5-points-s3-gauss3-none",
    "{bdf: 6}": "bdf6-points-s3-gauss3-none",
    "{bdf: 4, sampling: nodes}": "bdf4-nodes-s1-gauss1-none",
    "{bdf: 4, sampling: nodes, degree: 3}": "bdf4-nodes-s3-gauss3-none",
    "{rk: gauss}": "gauss-s3-graded",
    "{rk: lobatto-iiic}": "lobatto-iiic-s3-none",
    "{degree: 2, start: none}": "gauss-s2-none",
    "{}": "gauss-s3-graded",
    "{baseline: implicit-euler}": "implicit-euler",
    "{bdf: 2, quadrature: lobatto}": "bdf2-points-s1-lobatto2-none",
    "{bdf: 2, sampling: nodes, quadrature: {rule: gauss, points: 4}}": "bdf2-nodes-s1-gauss4-none",
    "{bdf: 3, sampling: nodes, start: {weights: [2.5, 3]}}": "bdf3-nodes-s1-gauss1-weights-2p5-3",
}


@pytest.mark.parametrize("text", DEFAULTS)
def test_defaults_of_a_method_that_is_given_in_part(text):
    (method,) = methods(text)
    assert method.case == DEFAULTS[text]
    is_exact = text.startswith("{bdf") and method.sampling == "points"
    assert getattr(method, "forcing_quadrature", "") in ("", "exact" if is_exact else "galerkin")


def test_without_methods_the_default_is_gauss_of_degree_3():
    text = FRAME.replace("method: {}\n", "").format()
    (experiment,) = parse_config(text, "example.yaml").experiments
    assert experiment.methods == (Method(cq="gauss", degree=3, start="graded"),)


def test_lists_are_combined_and_the_order_is_that_of_the_keys():
    found = methods("[{degree: [1, 2], bdf: [1, 2], sampling: nodes}, {baseline: explicit-euler}]")
    assert [m.case for m in found] == [
        "bdf1-nodes-s1-gauss1-none",
        "bdf1-nodes-s2-gauss2-none",
        "bdf2-nodes-s1-gauss1-none",
        "bdf2-nodes-s2-gauss2-none",
        "explicit-euler",
    ]


def test_every_default_is_filled_in(kept):
    (resolved,) = parse_config(FRAME.format("{bdf: 2}"), "example.yaml").resolved["experiments"]
    kept("defaults.json", json.dumps(resolved, indent=1) + "\n")


MESHES = "name: m\nproblem: {kind: duffing, exact: none, final_time: 1}\n"


def test_a_mesh_may_be_graded():
    text = MESHES + "ladder: {steps: [8, 16], grading: 2.5}\nmethod: {rk: gauss}\n"
    config = parse_config(text, "f.yaml")
    (experiment,) = config.experiments
    assert (experiment.grading, experiment.steps) == (2.5, (8, 16))
    assert config.resolved["experiments"][0]["ladder"] == {"steps": [8, 16], "grading": 2.5}
    (equal,) = parse_config(text.replace(", grading: 2.5", ""), "f.yaml").experiments
    assert equal.grading == 1.0


@pytest.mark.parametrize(
    "name",
    [
        *("gauss3", "Gauss 2", "bdf1", "BDF-6", "lobatto-iiic3"),
        *("explicit_euler", "gauss2-none", "bdf4-nodes"),
    ],
)
def test_a_name_says_the_same_in_a_configuration_as_in_python(name):
    assert methods(name) == (method_named(name),)
