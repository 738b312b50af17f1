"""A tolerance is kept on random scenes, and costs little more than the best choice by hand.

The table of all of them: ``pytest -m slow -s tests/verification/test_accuracy_scenes.py``.
"""

from __future__ import annotations

import numpy as np
import pytest
from accuracy_scenes import (
    HEADING,
    examine,
    linear_tasks,
    nonlinear_tasks,
    search,
    truth_of,
)

MOST_TIMES = 4.0


def assert_kept(finding) -> None:
    """True error below estimate below tolerance, as far as the reference can tell."""
    assert finding.reached.verdict == "ok", finding.line()
    assert finding.reached.estimate <= finding.task.tolerance, finding.line()
    assert finding.true_error <= finding.reached.estimate + finding.reference_error, finding.line()
    assert finding.is_kept, finding.line()


@pytest.mark.parametrize("task", linear_tasks(12, 7) + nonlinear_tasks(6, 8), ids=lambda t: t.name)
def test_tolerances_are_kept(task):
    assert_kept(examine(task, with_cost=False))


def test_the_truth_tells_runs_that_miss_the_tolerance():
    from fvi_cli.integrator.integrate import integrate

    for task in linear_tasks(5, 7) + nonlinear_tasks(2, 8):
        reached = search(task)
        truth, _ = truth_of(task, reached.n_steps)
        base = reached.n_steps
        while base % 2 == 0:
            base //= 2
        coarse = integrate(task.scene, reached.method, base)
        assert coarse.status == "ok"
        assert truth(coarse) > task.tolerance


@pytest.mark.slow
def test_tolerances_are_kept_at_a_fair_price_on_eighty_scenes(capsys):
    findings = []
    with capsys.disabled():
        print(f"\n{HEADING}")  # noqa: T201
        for task in linear_tasks(50, 1) + nonlinear_tasks(30, 2):
            finding = examine(task, with_cost=True)
            findings.append(finding)
            print(finding.line(), flush=True)  # noqa: T201
        done = [one for one in findings if one.reached.verdict == "ok"]
        ratios = np.array([one.ratio for one in done])
        kept = sum(one.is_kept for one in done)
        print(  # noqa: T201
            f"kept {kept} of {len(done)}, refused {len(findings) - len(done)}; times the best "
            f"choice by hand: median {np.median(ratios):.2f}, 9 of 10 below "
            f"{np.quantile(ratios, 0.9):.2f}, worst {ratios.max():.2f}"
        )
    assert len(done) >= 60
    for finding in done:
        assert_kept(finding)
    for finding in findings:
        assert finding.reached.verdict == "ok" or "below the floor" in finding.reached.message
    # a ratio of two times in one process
    assert np.median(ratios) <= MOST_TIMES
