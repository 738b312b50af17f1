"""Orders of the members of a sweep, from the configuration to tables and figures."""

import csv
import dataclasses
import io
import re

import numpy as np
import pytest
from command_line import MANY

from fvi_cli.config import parse_config
from fvi_cli.plotting import draw_figures
from fvi_cli.render.runs import runs_as_text
from fvi_cli.reports import rendered
from fvi_cli.reports.kinds.orders import COLUMNS, order_report
from fvi_cli.runner.compute import run
from fvi_cli.runner.outcome import Outcome
from fvi_cli.studies.order import tables_of_members

TEXT = (
    MANY
    + """\
method: {rk: gauss, degree: [1, 2]}
ladder: {steps: [32, 48, 96, 128]}
"""
)
ONE_KEY = "sweep: {problem.damping.0.order: [0.3, 0.5, 1.0, 1.5]}\n"
TWO_KEYS = ONE_KEY.replace("}", ", problem.stiffness: [0.5, 1, 2]}")


def study_of(text):
    (outcome,) = run(parse_config(text, "many.yaml"))
    return outcome.experiment, list(outcome.finished)


@pytest.fixture(scope="module")
def one_key():
    return study_of(TEXT + ONE_KEY)


@pytest.fixture(scope="module")
def two_keys():
    return study_of(TEXT + TWO_KEYS)


def misses(tables):
    """Cases whose order on the finest steps is not twice the number of stages within 0.1."""
    return [
        (table.member.number, case.method.case)
        for table in tables
        for case in table.cases
        if not abs(case.pairwise_order(len(case.rows) - 1) - 2 * case.method.degree) <= 0.1
    ]


def test_every_member_has_the_order_of_its_method(two_keys):
    experiment, finished = two_keys
    tables = tables_of_members(experiment, finished)
    assert len(tables) == 12
    assert all(len(table.cases) == 2 and len(table.cases[0].rows) == 4 for table in tables)
    assert misses(tables) == []
    # a control: the errors of one member fall more slowly
    spoilt = [
        dataclasses.replace(one, error=one.error * one.run.n_steps**0.3)
        if one.run.member.number == 7
        else one
        for one in finished
    ]
    assert misses(tables_of_members(experiment, spoilt)) == [
        (7, case.method.case) for case in tables[7].cases
    ]


def test_a_member_has_the_table_of_an_experiment_with_that_problem(two_keys):
    experiment, finished = two_keys
    member = tables_of_members(experiment, finished)[4]
    text = TEXT.replace("order: 0.5", f"order: {member.swept['problem.damping.0.order']}")
    text = text.replace("  final", f"  stiffness: {member.swept['problem.stiffness']}\n  final")
    (alone,) = tables_of_members(*study_of(text))
    assert alone.swept == {}
    (case, _), (other, _) = alone.cases, member.cases
    assert case.rows[0].reference == other.rows[0].reference
    assert [row.error for row in case.rows] == pytest.approx([row.error for row in other.rows])
    assert case.slope == pytest.approx(other.slope)


def test_the_csv_file_has_the_swept_values_behind_the_experiment(two_keys):
    tables = tables_of_members(*two_keys)
    rows = list(csv.reader(io.StringIO(rendered(order_report("many", tables))["many.csv"])))
    names = [column.name for column in COLUMNS]
    assert rows[0] == ["experiment", "problem.damping.0.order", "problem.stiffness", *names]
    assert len(rows) == 1 + 12 * 2 * 4
    assert {tuple(row[1:3]) for row in rows[1:]} == {
        (repr(gamma), repr(k)) for gamma in (0.3, 0.5, 1.0, 1.5) for k in (0.5, 1.0, 2.0)
    }


def test_many_members_are_summed_up(two_keys, monkeypatch):
    tables = tables_of_members(*two_keys)
    text = rendered(order_report("many", tables))["many.md"]
    assert "12 members" in text
    slopes = [table.cases[1].slope for table in tables]
    assert len([line for line in text.splitlines() if line.startswith("| damping.0.order =")]) == 12
    assert f"{min(slopes):.2f}" in text
    monkeypatch.setattr("fvi_cli.reports.kinds.orders.MOST_MEMBERS", 4)
    text = rendered(order_report("many", tables))["many.md"]
    (line,) = [one for one in text.splitlines() if one.startswith("| Gauss2")][:1]
    cells = [cell.strip() for cell in line.split("|")[2:5]]
    assert cells == [f"{v:.2f}" for v in (min(slopes), np.median(slopes), max(slopes))]


def test_a_line_tells_the_median_and_the_largest_error_and_where_it_is(two_keys):
    experiment, finished = two_keys

    def lines(runs):
        text = runs_as_text([Outcome(experiment=experiment, finished=tuple(runs))])
        return [re.split("  +", line) for line in text.splitlines()[1:]]

    assert [line[:2] for line in lines(finished)] == [["Gauss1", "128"], ["Gauss2", "128"]]
    for name, n_steps, *told in lines(finished):
        own = [
            one
            for one in finished
            if (one.run.method.label, str(one.run.n_steps)) == (name, n_steps)
        ]
        errors = [one.error for one in own]
        numbers = [f"{number:.3e}" for number in (np.median(errors), max(errors))]
        assert told == ["12", *numbers, own[int(np.argmax(errors))].run.member.label, "ok"]
    spoilt = [
        dataclasses.replace(one, status="diverged", error=np.nan) if k % 96 == 0 else one
        for k, one in enumerate(finished)
    ]
    # the coarsest members of a method, of which one failed, have a line, too
    first, *others = lines(spoilt)
    assert (first[1], first[6], len(others)) == ("32", "ok: 11; diverged: 1", 2)


@pytest.mark.parametrize("study", ["one_key", "two_keys"])
def test_figures_have_names_for_a_few_members_and_the_mean_of_many(study, request):
    experiment, finished = request.getfixturevalue(study)
    experiment = dataclasses.replace(experiment, figures=("convergence", "trajectory", "path"))
    figures, reasons = draw_figures([(experiment, finished)], name="many")
    assert list(figures) == ["many-convergence", "many-trajectory"]
    assert len(reasons) == 1
    axes = figures["many-convergence"].axes[1]
    own = [one for one in finished if one.run.method == experiment.methods[1]]
    members = len({one.run.member.number for one in own})
    ladders = [line for line in axes.lines if len(line.get_xdata()) > 2]
    assert len(ladders) == members + (study == "two_keys")
    if study == "two_keys":
        errors = [one.error for one in own if one.run.n_steps == 128]
        assert ladders[-1].get_ydata()[0] == pytest.approx(np.mean(errors))


@pytest.mark.parametrize(("error", "status"), [(0.0, "floor"), (np.nan, "diverged")])
def test_members_without_an_error_have_no_figure_of_orders(one_key, error, status):
    experiment, finished = one_key
    experiment = dataclasses.replace(experiment, figures=("convergence", "trajectory"))
    spoilt = [dataclasses.replace(one, status=status, error=error) for one in finished]
    figures, reasons = draw_figures([(experiment, spoilt)], name="many")
    assert list(figures) == ["many-trajectory"]
    assert len(reasons) == 1
