"""Identity of runs, and what is said of versions and commits."""

import dataclasses
import json
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import pytest
from command_line import configuration

from fvi_cli.config import parse_config
from fvi_cli.integrator.method import Baseline, Method, RuleSpecification
from fvi_cli.storage import digests, provenance
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
    "allow_unstable=true", "name=slow", "expect={bdf2: unstable}", "ladder.steps=[4, 16, 32]",
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


# --- origin ---------------------------------------------------------------------------------------


def git(folder, *arguments):
    subprocess.run(
        ["git", "-c", "user.name=a", "-c", "user.email=a@b", *arguments],
        cwd=folder,
        check=True,
        capture_output=True,
    )


@pytest.fixture
def package(tmp_path):
    """A checkout with a package in it."""
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "Begin")
    provenance.checkout.cache_clear()
    yield folder
    provenance.checkout.cache_clear()


def test_a_clean_and_a_dirty_checkout(package, monkeypatch):
    # a hook sets these; they must not lead elsewhere
    monkeypatch.setenv("GIT_DIR", "/nonexistent")
    commit, dirty = provenance.checkout(package)
    assert len(commit) == 40
    assert dirty == "no"
    (package / "__init__.py").write_text("changed = 1\n")
    provenance.checkout.cache_clear()
    assert provenance.checkout(package) == (commit, "yes")


def test_results_do_not_make_a_checkout_dirty(package):
    results = package.parent / "results"
    results.mkdir()
    (results / "table.csv").write_text("")
    assert provenance.checkout(package)[1] == "no"
    (package.parent / "other.py").write_text("")
    provenance.checkout.cache_clear()
    assert provenance.checkout(package)[1] == "yes"


def test_outside_of_a_checkout_and_without_git_both_are_unknown(package, tmp_path, monkeypatch):
    # an installed copy inside somebody's checkout is not that checkout's
    copy = package.parent / "site-packages" / "package"
    copy.mkdir(parents=True)
    (copy / "__init__.py").write_text("")
    assert provenance.checkout(copy) == ("unknown", "unknown")
    monkeypatch.setenv("PATH", str(tmp_path))
    provenance.checkout.cache_clear()
    assert provenance.checkout(package) == ("unknown", "unknown")


def test_origin_is_in_universal_time_and_names_nothing_private():
    origin = provenance.origin()
    created = datetime.fromisoformat(origin["created"])
    assert created.utcoffset() == UTC.utcoffset(None)
    assert abs((datetime.now(UTC) - created).total_seconds()) < 60
    assert origin["git_dirty"] in ("yes", "no", "unknown")
    told = json.dumps([origin, provenance.package_versions(), provenance.platform_name()])
    assert str(Path(provenance.__file__).parents[2]) not in told
