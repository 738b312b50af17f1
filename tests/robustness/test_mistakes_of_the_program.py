"""An exception that nobody expected is the result of its run, and of no other."""

from pathlib import Path

import pytest
from command_line import configuration, fvi

from fvi_cli.studies import cost, stability_study

CONFIG = configuration(
    "kind: damped-oscillator, damping: [{order: 0.5, coefficient: 0.3}], stiffness: 4.0, "
    "initial: {position: 1.0, velocity: 0.0}, final_time: 1.0",
    name="small",
    method="{rk: gauss, degree: [1, 2], start: none}",
    steps="4, 8",
)


FILES = {"small.yaml": CONFIG}
pytestmark = pytest.mark.usefixtures("folder")


def breaking(real, at):
    """`real`, which cannot do what `at` says."""

    def broken(*args, **kwargs):
        if at(*args):
            raise ZeroDivisionError("nobody thought of that")
        return real(*args, **kwargs)

    return broken


def test_in_the_midst_of_costs(monkeypatch):
    at = lambda run: run.method.degree == 2 and run.n_steps == 4  # noqa: E731
    monkeypatch.setattr(cost, "execute", breaking(cost.execute, at))
    monkeypatch.setattr("fvi_cli.runner.cost.TOLERANCES", (1e-3,))
    result = fvi("cost", "small.yaml", code=1)
    (line,) = [line for line in result.stderr.splitlines() if "unexpected Zero" in line]
    assert line.startswith("small Gauss2, N=4: failed (unexpected ZeroDivisionError")
    assert "nobody thought of that; this is a mistake of the program, please report it" in line
    (table,) = Path("results").rglob("small-cost.csv")
    assert [row.count("failed") for row in table.read_text().splitlines()[1:]] == [0, 0, 1, 0]
    assert "1 runs failed" in result.stderr


def test_in_the_midst_of_stability(monkeypatch):
    at = lambda scene, method, n_steps: method.degree == 2 and n_steps == 4  # noqa: E731
    real = stability_study.predict_stability
    monkeypatch.setattr(stability_study, "predict_stability", breaking(real, at))
    result = fvi("stability", "--no-observe", "small.yaml", code=1)
    (line,) = [line for line in result.stderr.splitlines() if "unexpected Zero" in line]
    assert line.startswith("small Gauss2, N=4: unexpected ZeroDivisionError")
    assert "this is a mistake of the program, please report it" in line
    assert result.stdout.startswith("Stability: small")
