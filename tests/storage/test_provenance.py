"""Identity of runs, and what is said of versions and commits."""

import dataclasses

import pytest
from command_line import configuration

from fvi_cli.config import parse_config
from fvi_cli.integrator.method import Baseline, Method, RuleSpecification
from fvi_cli.storage import digests
from fvi_cli.storage.digests import identity_of
from fvi_cli.studies.experiment import Run

TEXT = configuration(
    "kind: damped-oscillator, mass: 1.0, stiffness: 1.0, damping: [{order: 0.5, "
    "coefficient: 1.0}], initial: {position: 1.0, velocity: 0.0}, final_time: 1.0",
    name="quick",
    method="{bdf: 2, sampling: nodes, degree: 1}",
    steps="4, 8",
)


def run_of(*overrides, text=TEXT):
    return parse_config(text, "quick.yaml", overrides=overrides).experiments[0].runs()[0]


MATTERS = [
    "problem.mass=2.0", "problem.stiffness=1.0000000000000002", "problem.damping.0.order=0.25",
    "problem.damping.0.coefficient=0.5", "problem.initial.position=0.5",
    "problem.initial.velocity=-1.0", "problem.final_time=2.0", "problem.forcing=t",
    "problem.derivative=riemann-liouville", "method.bdf=1", "method.sampling=points",
    "method.degree=2", "method.quadrature=lobatto", "method.start={weights: [1.5]}",
    "method.forcing_quadrature=exact", "ladder.steps=[8, 16]",
    "store={every: 2}",
]  # fmt: skip
DOES_NOT = [
    "name=slow", "expect={bdf2: unstable}", "ladder.steps=[4, 16, 32]",
    "method.bdf=[2, 3]", "problem.stiffness=1", "report={norm: l2}",
    "report={norm: final}", "figures=[phase]", "units={time: s}",
]  # fmt: skip


def test_all_identities_differ():
    found = {identity_of(run_of(override)) for override in [*MATTERS, "problem.stiffness=1.0"]}
    assert len(found) == len(MATTERS) + 1


def test_identity_changes_with_the_solution_that_is_given():
    undamped = ["problem.damping=[]"]
    assert identity_of(run_of(*undamped, "problem.exact=cos(t)")) != identity_of(run_of(*undamped))


@pytest.mark.parametrize("override", DOES_NOT)
def test_identity_stays_with_what_does_not(override):
    assert identity_of(run_of(override)) == identity_of(run_of())


def test_identity_ignores_the_layout_of_the_text():
    text = TEXT.replace("\n", "  # why\n")
    assert identity_of(run_of(text=text)) == identity_of(run_of())


def test_identity_changes_with_the_solver(monkeypatch):
    before = identity_of(run_of())
    monkeypatch.setattr(digests, "SOLVER_VERSION", digests.SOLVER_VERSION + 1)
    assert identity_of(run_of()) != before


OTHER_VALUES = {
    "cq": "bdf3",
    "degree": 1,
    "quadrature": RuleSpecification(rule="lobatto", points=3),
    "sampling": "nodes",
    "start": "none",
    "start_exponents": (0.5, 1.5),
    "forcing_quadrature": "exact",
}


@pytest.mark.parametrize("field", dataclasses.fields(Method), ids=lambda field: field.name)
def test_every_field_of_a_method_matters(field):
    method = Method(cq="bdf2", degree=2, start="weights", start_exponents=(0.5,))
    changes = {field.name: OTHER_VALUES[field.name]}
    if field.name == "start":
        changes["start_exponents"] = ()
    experiment = run_of().experiment
    one, other = (
        Run(experiment=experiment, method=m, n_steps=4)
        for m in (method, dataclasses.replace(method, **changes))
    )
    assert identity_of(one) != identity_of(other)
    again = Run(experiment=experiment, method=dataclasses.replace(method), n_steps=4)
    assert identity_of(again) == identity_of(one)


def test_baselines_have_identities_of_their_own():
    experiment = run_of().experiment
    found = {
        identity_of(Run(experiment=experiment, method=Baseline(name=name), n_steps=4))
        for name in ("explicit-euler", "implicit-euler")
    }
    assert len(found) == 2
    assert all(len(one) == 64 and set(one) <= set("0123456789abcdef") for one in found)
