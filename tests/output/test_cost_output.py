"""Costs as tables, page and picture."""

import dataclasses
import functools
import json
import math
import re
from itertools import pairwise

import numpy as np
import pytest
from command_line import LADDER, configuration, fvi
from cost_tables import GAUSS, committed_tables, row, table
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from spread import spread

from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.plotting.ladders import cost as cost_plots
from fvi_cli.plotting.ladders.cost import cost_figure, cost_figures
from fvi_cli.plotting.looks import BASELINE_COLOURS
from fvi_cli.render.cost import write_page
from fvi_cli.reports import rendered
from fvi_cli.reports.kinds.cost import cost_report
from fvi_cli.runner import cost as cost_runner
from fvi_cli.studies import cost
from fvi_cli.studies.cost import CostCase, CostTable

# as the design of the command promises them


def measured(*, memory: bool = True) -> CostTable:
    counts = (10, 20, 40, 80, 160)
    rows = {
        Method(cq="gauss", degree=3, start="graded"): [
            row(n, n**-6.0, 1e-3 + 1e-6 * n) for n in counts
        ],
        Method(cq="bdf6", degree=1, sampling="nodes"): [row(10, math.inf, 1e-3, "diverged")],
        Baseline(name="gruenwald-letnikov"): [row(n, 1 / n, 1e-4 * n) for n in counts],
    }
    if not memory:
        rows = {
            method: [dataclasses.replace(one, history_operations=0) for one in own]
            for method, own in rows.items()
        }
    return table(*(CostCase(method=method, rows=tuple(own)) for method, own in rows.items()))


@pytest.mark.parametrize("ending", [".csv", "-summary.csv", ".md", ".json"])
def test_costs_are_written_as_they_are_kept(ending, kept):
    """Guesses apart from what was reached, no row dropped, and no number that is none."""
    kept(f"cost{ending}", rendered(cost_report("one", [measured()]))[f"one-cost{ending}"])


def test_every_table_of_a_cost_has_a_file_of_its_own():
    files = rendered(cost_report("one", [measured()]))
    tables = [text for name, text in files.items() if re.search(r"-runs-\d\.tex$", name)]
    assert len(tables) > 1
    assert all(text.startswith(r"\begin{tabular}") for text in tables)
    assert all(text.endswith("\\end{tabular}\n") for text in tables)


@functools.cache
def drawn() -> Figure:
    """The figure of what was measured; not to be changed."""
    return cost_figure(measured())


class TestFigure:
    def test_methods_are_told_apart_without_colour_and_baselines_are_grey(self):
        axes = drawn().axes[0]
        curves = [line for line in axes.lines if not str(line.get_label()).startswith("_")]
        broad = curves.pop()
        assert broad.get_label() == "least of all runs"
        assert len({(line.get_marker(), line.get_linestyle()) for line in curves}) == 2
        found = [to_hex(line.get_color()) in BASELINE_COLOURS for line in curves]
        assert found == [False, True]
        left, right = axes.get_xlim()
        assert left > right

    def test_work_is_drawn_where_there_is_memory(self):
        assert len(drawn().axes) == 2
        assert len(cost_figure(measured(memory=False)).axes) == 1

    @spread(few=1, name=["cost-paper", "cost-pendulum", "cost-step-forced"])
    def test_the_broad_line_lies_behind_the_runs_that_no_other_beats(self, name):
        for one in committed_tables(name):
            for panel, axes in enumerate(cost_figure(one).axes):
                lines = {
                    line.get_label(): line for line in axes.lines if line.get_label()[0] != "_"
                }
                front = lines.pop("least of all runs").get_xydata()
                runs = np.concatenate([line.get_xydata() for line in lines.values()])
                assert {*map(tuple, front)} <= {*map(tuple, runs)}
                beaten = [
                    ((runs <= run).all(axis=1) & (runs < run).any(axis=1)).any() for run in front
                ]
                assert not any(beaten)
                # the control: most other runs are beaten
                assert sum((front < run).all(axis=1).any() for run in runs) > len(runs) / 2
                if panel == 0:
                    self.check_lines(one, lines, front)

    def check_lines(self, one, lines, front):
        """Of every method its own best runs; marks and full lines where it is the quickest."""
        quick = {tuple(run) for run in front}
        lines.pop("for a tolerance")
        widths = {line.get_label(): line.get_linewidth() for line in lines.values()}
        for line in lines.values():
            runs = [tuple(run) for run in line.get_xydata()]
            # more accurate for more time
            assert all(a[0] > b[0] and a[1] < b[1] for a, b in pairwise(runs))
            is_thin = widths[line.get_label()] < max(widths.values())
            assert is_thin == quick.isdisjoint(runs)
        assert len(set(widths.values())) == 2
        assert sum(len(line.get_xydata()) for line in lines.values()) < sum(
            len(case.rows) for case in one.cases
        )

    @spread(few=1, name=["cost-paper", "cost-pendulum", "cost-step-forced"])
    def test_panels_end_at_the_same_errors_and_the_broad_line_at_the_least(self, name):
        for one in committed_tables(name):
            ends = [
                {
                    line.get_label(): line.get_xdata()[-1]
                    for line in axes.lines
                    if line.get_label()[0] != "_" and line.get_label() != "for a tolerance"
                }
                for axes in cost_figure(one).axes
            ]
            broad = [own.pop("least of all runs") for own in ends]
            assert broad == [min(own.values()) for own in ends]
            assert all(own.items() <= ends[0].items() for own in ends)
            assert len({*ends[0].values()}) > 3  # the control

    def test_what_is_exact_by_chance_is_named_and_not_drawn(self):
        table = measured()
        slow = table.cases[2]
        lucky = dataclasses.replace(
            slow, rows=tuple(dataclasses.replace(r, error=1e-16, status="floor") for r in slow.rows)
        )
        figure = cost_figure(dataclasses.replace(table, cases=(table.cases[0], lucky)))
        labels = [line.get_label() for line in figure.axes[0].lines]
        assert "Grünwald-Letnikov" not in labels
        assert figure.legends[0].get_title().get_text().endswith("not drawn: Grünwald-Letnikov")
        assert "Grünwald" not in drawn().legends[0].get_title().get_text()

    def test_every_experiment_has_its_figure(self, monkeypatch):
        monkeypatch.setattr(cost_plots, "cost_figure", lambda table: drawn())
        first, second = (dataclasses.replace(measured(), experiment=name) for name in "ab")
        assert list(cost_figures("both", [first, second])) == ["a-cost", "b-cost"]
        assert list(cost_figures("both", [first])) == ["both-cost"]


TEXT = configuration(
    "kind: bagley-torvik, damping: [{order: 0.5, coefficient: 1.0}], "
    "initial: {position: 1.0, velocity: 0.0}, final_time: 1.0",
    name="small",
    method="[{rk: gauss, degree: 2}, {baseline: product-integration}]",
    steps="4, 8, 16",
)

# the damping of order 3/2 is too much for BDF6 on the nodes
FAILING = (
    LADDER.replace("quick", "small").partition("method")[0]
    + """\
method:
  - {rk: gauss, degree: 2}
  - {bdf: 6, sampling: nodes, degree: 1}
ladder: {steps: [8, 16, 32]}
"""
)


class TestCommand:
    @pytest.fixture(autouse=True)
    def _quick(self, monkeypatch, tmp_path):
        monkeypatch.setattr(cost, "ENOUGH_SECONDS", 0.0)
        monkeypatch.setattr(cost, "SEARCHES", 1)
        monkeypatch.setattr(cost_runner, "TOLERANCES", (1e-3,))
        monkeypatch.chdir(tmp_path)
        (tmp_path / "small.yaml").write_text(TEXT)

    def run(self, *arguments: str):
        return fvi("cost", *arguments)

    def test_tables_and_figure(self, tmp_path):
        result = self.run("small.yaml")
        assert result.exit_code == 0, result.output
        results = tmp_path / "results"
        written = {path.relative_to(results).as_posix() for path in results.glob("*/*")}
        parts = re.compile(r"tables/small-cost-small(-runs|-tolerances|)-\d\.tex")
        bare = {name for name in written if parts.fullmatch(name)}
        assert {parts.fullmatch(name)[1] for name in bare} == {"", "-runs", "-tolerances"}
        assert {name for name in written - bare if name.startswith("tables/")} == {
            *(f"tables/small-cost.{suffix}" for suffix in ("csv", "md", "json")),
            "tables/small-cost-text.tex",
            "tables/small-cost-summary.csv",
            "tables/small-cost-tolerances.csv",
        }
        assert {one for one in written if one.startswith("figures/")} == {"figures/small-cost.png"}
        # what is said to be written is written
        printed = [line for line in result.stdout.splitlines() if line.startswith("results/")]
        assert sorted(f"results/{name}" for name in written) == sorted(printed)
        sheets = json.loads((results / "tables/small-cost.json").read_text())["sheets"]
        assert {len(sheets["runs"]["rows"]), len(sheets["summary"]["rows"])} == {6, 2}
        assert "one more digit" in result.stdout
        assert (tmp_path / "results/tables/small-cost.csv").read_text().count("\n") == 7

    def test_dry_run_writes_nothing(self, tmp_path):
        result = self.run("small.yaml", "--dry-run")
        assert result.exit_code == 0
        assert Baseline(name="product-integration").label in result.stdout
        assert not (tmp_path / "results").exists()

    def test_a_failure_that_nobody_expected(self, tmp_path):
        bad = FAILING.replace("name: small", "name: bad")
        (tmp_path / "bad.yaml").write_text(bad)
        result = self.run("bad.yaml")
        assert result.exit_code == 1
        assert "refused" in result.stderr
        # the others are measured and written all the same
        assert (tmp_path / "results/tables/bad-cost.csv").read_text().count(",ok") == 3

    def test_what_has_no_price_is_told_at_once(self, tmp_path):
        swept = TEXT.replace("small", "swept") + "sweep: {problem.stiffness: [1.0, 2.0]}\n"
        (tmp_path / "swept.yaml").write_text(swept)
        derivative = (
            "name: derivative\nmethod: {bdf: 2}\nladder: {steps: [4]}\nproblem: "
            "{kind: fractional-derivative, order: 0.5, function: t**2, final_time: 1.0}\n"
        )
        (tmp_path / "derivative.yaml").write_text(derivative)
        result = self.run("small.yaml", "swept.yaml", "derivative.yaml")
        assert result.exit_code == 2
        assert "swept: costs are measured for one scene" in result.stderr
        assert not (tmp_path / "results").exists()

    def test_the_page_shows_every_configuration(self, tmp_path):
        path = write_page(tmp_path, {"one": [measured()]})
        text = path.read_text()
        assert "## one" in text
        assert "one more digit" in text
        assert "![Error against time and work, one-cost](figures/one-cost.png)" in text


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("counts", [1, 2])
def test_few_runs_have_a_figure_of_full_size(counts):
    rows = tuple(row(10 * 2**k, 1e-5 / 4**k, 0.03) for k in range(counts))
    figure = cost_figure(table(CostCase(method=GAUSS, rows=rows)))
    figure.draw_without_rendering()
    for axes in figure.axes:
        extent = axes.get_window_extent()
        assert extent.height > 0.5 * figure.dpi
        assert extent.width > 2.0 * figure.dpi
        assert all(0 <= text.get_position()[0] <= 1 for text in axes.texts)
