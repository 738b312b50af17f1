"""Members of a sweep, computed together: the same numbers as alone, whatever becomes of others."""

import numpy as np
import pytest
from command_line import MANY, configuration

from fvi_cli.config import parse_config
from fvi_cli.runner.executors.batches import batches_of
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.executor import InProcess
from fvi_cli.runner.executors.jobs import Job, jobs_of
from fvi_cli.runner.executors.processes import LocalProcesses
from fvi_cli.studies.reference import find_reference, find_references
from fvi_cli.studies.study import execute

OSCILLATORS = (
    MANY
    + """\
method: [{rk: gauss, degree: 2}, {bdf: 2, sampling: nodes}]
ladder: {steps: [16, 32]}
sweep: {problem.damping.0.order: [0.5, 1.5], problem.stiffness: [1, 2, 3]}
"""
)
PENDULUMS = configuration(
    "kind: pendulum, damping: [{order: 0.5, coefficient: 0.3}], initial: {position: 1.0}, "
    "final_time: 2.0",
    name="many",
    steps="16, 32",
    more="sweep: {problem.initial.position: [0.5, 1.0, 2.0], problem.omega: [1, 2]}\n",
)


def experiment(text, *overrides):
    return parse_config(text, "many.yaml", overrides=overrides).experiments[0]


@pytest.mark.few(1)
@pytest.mark.parametrize("text", [OSCILLATORS, PENDULUMS])
def test_a_batch_gives_what_every_run_gives_alone(text):
    (first, *_) = batches_of(experiment(text).runs())
    together = execute_job(Job(runs=first))
    assert [one.run for one in together] == list(first)
    for run, one in zip(first, together, strict=True):
        alone = execute(run)
        scale = np.abs(alone.trajectory.position).max()
        np.testing.assert_allclose(
            one.trajectory.position, alone.trajectory.position, rtol=0, atol=1e-12 * scale
        )
        assert one.error == pytest.approx(alone.error, rel=1e-6, abs=1e-11)
        assert (one.status, one.predicted) == (alone.status, alone.predicted)
        assert one.expected_order == alone.expected_order
        assert one.reference == alone.reference
    # a control: members differ from each other
    finals = {float(one.trajectory.position[-1, 0]) for one in together}
    assert len(finals) == len(first)


def test_batches_hold_every_run_once_and_share_method_and_steps():
    runs = experiment(OSCILLATORS).runs()
    batches = batches_of(runs)
    assert len(batches) == 4
    assert {run for batch in batches for run in batch} == set(runs)
    assert sum(map(len, batches)) == len(runs) == 24
    for batch in batches:
        assert len({(run.method, run.n_steps) for run in batch}) == 1


def test_a_member_that_blows_up_leaves_the_others_alone():
    text = OSCILLATORS.replace("ladder: {steps: [16, 32]}", "ladder: {steps: [16]}")
    stiff = text.replace("stiffness: [1, 2, 3]", "damping.0.coefficient: [0.1, 300]")
    stiff = stiff.replace("[0.5, 1.5]", "[1.5]")
    paper = experiment(stiff).methods[1]
    runs = [run for run in experiment(stiff).runs() if run.method.case == paper.case]
    (batch,) = batches_of(runs)
    found = execute_job(Job(runs=batch))
    assert [finished.status for finished in found] == ["ok", "diverged"]
    said = [any("predicted unstable" in one for one in run.trajectory.remarks) for run in found]
    assert said == [False, True]


def test_references_of_members_are_those_that_they_have_alone():
    problems = [member.problem for member in experiment(PENDULUMS).members]
    times = np.linspace(0, 2, 33)
    for problem, together in zip(problems, find_references(problems), strict=True):
        alone = find_reference(problem)
        assert together.source.split(",")[0] == alone.source.split(",")[0]
        np.testing.assert_allclose(together.values(times), alone.values(times), atol=1e-12)


@pytest.mark.slow
def test_processes_give_the_same_members():
    jobs = jobs_of(experiment(OSCILLATORS).runs())
    found = {}
    for executor in (InProcess(), LocalProcesses(workers=2)):
        for batch in executor.compute(jobs, execute_job):
            for one in batch.finished:
                place = (one.run.method.case, one.run.n_steps, one.run.member.number)
                found.setdefault(place, []).append(one.trajectory.position)
    assert len(found) == 24
    for here, there in found.values():
        np.testing.assert_array_equal(here, there)
