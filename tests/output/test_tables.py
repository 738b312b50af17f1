"""Order tables say what the runs say, in four forms, and notice when the files say otherwise."""

import csv
import dataclasses
import io
import json
import math
import os
import random
import re
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from letters import spring
from spread import SEED

from fvi_cli import reports
from fvi_cli.errors import StorageError
from fvi_cli.integrator.method import AnyMethod, Baseline, Method, RuleSpecification
from fvi_cli.integrator.method_names import method_names
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.reports.document import (
    Bullets,
    CodeSpan,
    Grid,
    Heading,
    Paragraph,
    split_wide,
    without_numbers,
)
from fvi_cli.reports.kinds.order_summary import order_entry, short_titles
from fvi_cli.reports.kinds.orders import COLUMNS, order_report
from fvi_cli.reports.writers import forms
from fvi_cli.reports.writers.latex import escape_latex, to_latex
from fvi_cli.reports.writers.text import escape_markdown, show, to_markdown, to_text
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.norms import round_up
from fvi_cli.studies.order import OrderCase, OrderRow, OrderTable, order_table

BDF1, BDF2 = (Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in (1, 2))
GAUSS3 = Method(cq="gauss", degree=3, start="graded")
STEPS = (2, 4, 8, 16)

NAMES = tuple(column.name for column in COLUMNS)


def finished(
    run: Run,
    error: float,
    *,
    status: str = "ok",
    floor: float = 1e-13,
    expected_order: float = 2.0,
    remarks: tuple[str, ...] = (),
    message: str = "",
    reference: str = "expression",
    seconds: float = 0.0,
) -> FinishedRun:
    time = np.linspace(0.0, 1.0, run.n_steps + 1)
    return FinishedRun(
        run=run,
        trajectory=Trajectory(
            time=time,
            position=time[:, None],
            n_steps=run.n_steps,
            step_size=run.step_size,
            remarks=remarks,
            message=message,
            setup_seconds=seconds,
            stepping_seconds=seconds,
        ),
        error=error,
        floor=floor,
        status=status,
        expected_order=expected_order,
        reference=reference,
    )


def experiment(
    methods: Sequence[AnyMethod] = (BDF1, BDF2),
    *,
    name: str = "made-up",
    equation: str = "x'' + x = t**2*sin(t)",
    steps: Sequence[int] = STEPS,
    claims: dict[str, float] | None = None,
    expect: dict[str, str] | None = None,
) -> Experiment:
    scene = spring(T=1.0, v=1.0)
    return Experiment(
        name=name,
        problem=Problem(kind="bagley-torvik", scene=scene, equation=equation),
        problem_specification={},
        methods=tuple(methods),
        steps=tuple(steps),
        claims=claims or {},
        expect=expect or {},
    )


def powers(run: Run) -> FinishedRun:
    """BDF1 has order 1, everything else order 2, with round constants."""
    order = 1 if run.method == BDF1 else 2
    return finished(run, 2.0 ** (-order * math.log2(run.n_steps)), expected_order=float(order))


def rendered(name: str, made: Sequence[OrderTable]) -> dict[str, str]:
    """The text of every form, by suffix."""
    texts = reports.rendered(order_report(name, made))
    return {file.removeprefix(f"{name}."): text for file, text in texts.items()}


def write(directory: Path, *made: OrderTable) -> list[Path]:
    return reports.write(directory, order_report("made-up", made))


def compare(directory: Path, *made: OrderTable) -> list[str]:
    return reports.compare(directory, order_report("made-up", made))


def table_of(
    make: Callable[[Run], FinishedRun] = powers, described: Experiment | None = None
) -> OrderTable:
    described = described or experiment()
    return order_table(described, [make(run) for run in described.runs()])


# --- CSV ------------------------------------------------------------------------------------------

GOLDEN_CSV = """\
experiment,case,cq,sampling,degree,quadrature,start,gamma,norm,n_steps,step_size,error,\
pairwise_order,used_in_fit,slope,fit_residual,expected_order,predicted,status
made-up,bdf2-nodes-s1-gauss1-none,bdf2,nodes,1,gauss1,none,,max,2,0.5,0.25,nan\
,yes,SLOPE,RESIDUAL,2.0,unknown,ok
made-up,bdf2-nodes-s1-gauss1-none,bdf2,nodes,1,gauss1,none,,max,4,0.25,0.0625,\
2.0,yes,SLOPE,RESIDUAL,2.0,unknown,ok
made-up,bdf2-nodes-s1-gauss1-none,bdf2,nodes,1,gauss1,none,,max,8,0.125,nan,nan\
,no,SLOPE,RESIDUAL,2.0,unknown,diverged
"""


def one_case(*rows: OrderRow, **changes: object) -> OrderTable:
    case = OrderCase(method=BDF2, rows=rows)
    return dataclasses.replace(
        OrderTable(
            experiment="made-up",
            equation="x'' = 0",
            gamma="",
            reference="expression",
            norm="max",
            final_time=1.0,
            cases=(case,),
        ),
        **changes,
    )


def row(n_steps: int, error: float, **changes: object) -> OrderRow:
    made = OrderRow(
        n_steps=n_steps,
        step_size=1.0 / n_steps,
        error=error,
        floor=1e-13,
        status="ok" if math.isfinite(error) else "diverged",
        predicted="unknown",
        expected_order=2.0,
    )
    return dataclasses.replace(made, **changes)


SMALL = one_case(row(2, 0.25), row(4, 0.0625), row(8, math.nan))


def test_a_small_table_as_csv_letter_by_letter():
    (case,) = SMALL.cases
    expected = GOLDEN_CSV.replace("SLOPE", f"{case.slope!r}")
    expected = expected.replace("RESIDUAL", f"{case.fit_residual!r}")
    assert rendered("made-up", [SMALL])["csv"] == expected


def test_the_csv_has_one_row_for_every_run_and_numbers_that_read_back():
    made = table_of(lambda run: finished(run, math.pi * 10.0**-run.n_steps))
    text = rendered("made-up", [made])["csv"]
    rows = list(csv.DictReader(io.StringIO(text)))
    assert tuple(rows[0]) == NAMES
    assert [(r["case"], int(r["n_steps"])) for r in rows] == [
        (method.case, n) for method in (BDF1, BDF2) for n in STEPS
    ]
    # to the last bit
    assert [float(r["error"]) for r in rows] == 2 * [math.pi * 10.0**-n for n in STEPS]
    assert [float(r["slope"]) for r in rows] == [c.slope for c in made.cases for _ in c.rows]
    assert "\r" not in text
    assert "float64" not in text


def test_numbers_of_numpy_are_written_like_those_of_python():
    plain, numpy = (one_case(row(2, kind(0.1))) for kind in (float, np.float64))
    assert rendered("a", [plain]) == rendered("a", [numpy])


# --- JSON -----------------------------------------------------------------------------------------

METHODS: tuple[AnyMethod, ...] = (
    BDF1,
    GAUSS3,
    Baseline(name="explicit-euler"),
    Method(cq="lobatto-iiic", degree=2),
    Method(
        cq="bdf3",
        degree=2,
        quadrature=RuleSpecification(rule="lobatto", points=4),
        sampling="nodes",
        start="weights",
        start_exponents=(2.5, 3.0),
        forcing_quadrature="projected",
        history="direct",
    ),
)


def test_json_has_the_rows_of_the_csv_form_and_tells_what_they_mean():
    made = table_of(
        lambda run: finished(run, math.inf if run.n_steps == 2 else 0.1, remarks=("a", "b")),
        experiment([BDF2]),
    )
    content = json.loads(rendered("made-up", [made])["json"])
    sheet = content["sheets"]["runs"]
    assert tuple(sheet["columns"])[: len(NAMES)] == NAMES
    assert all(sheet["columns"].values())
    assert [row["n_steps"] for row in sheet["rows"]] == list(STEPS)
    first, second, *_ = sheet["rows"]
    assert (first["error"], first["pairwise_order"], first["used_in_fit"]) == ("inf", None, False)
    assert (second["error"], second["floor"], second["remarks"]) == (0.1, 1e-13, "a; b")
    (told,) = content["sheets"]["experiments"]["rows"]
    assert told["equation"] == "x'' + x = t**2*sin(t)"


@given(error=st.floats(allow_nan=True, allow_infinity=True), words=st.text())
def test_json_loses_neither_bits_nor_letters(error, words):
    made = one_case(row(2, error, message=words), equation=words)
    # strict: other readers know neither NaN nor Infinity
    text = rendered("made-up", [made])["json"]
    content = json.loads(text, parse_constant=lambda name: pytest.fail(name))
    (read,) = content["sheets"]["runs"]["rows"]
    found = read["error"]
    assert repr(math.nan if found is None else float(found)) == repr(error)
    assert read["message"] == words
    assert content["sheets"]["experiments"]["rows"][0]["equation"] == words


# --- what people read -----------------------------------------------------------------------------

GOLDEN_MARKDOWN = """\
# Orders of convergence: made-up

Entries: the least-squares slope of log(error) against log(h) over all rows that can be used, \
then the order between the two finest of them. Where the two disagree, the slope is not \
asymptotic. One number alone comes from two rows. Errors are measured in the maximum norm over \
components and grid points. A star marks methods that failed on some step sizes.

| problem | gamma | N      |   BDF2 |
| ------- | ----- | ------ | -----: |
| made-up | -     | 2 to 8 | 2.00\\* |

- \\* made-up: BDF2 diverged in 1 of 3 rows.

Methods:

- BDF2: degree 1, 1 Gauss point, damping sampled at the nodes, no start correction, forcing by the \
rule of the action, case `bdf2-nodes-s1-gauss1-none`

## made-up

Equation: `x'' = 0`; T = 1. Errors in the maximum norm over components and grid points, against \
the exact solution, an expression of the configuration; floor 1e-13.

|        N |     h |       BDF2 | order |
| -------: | ----: | ---------: | ----: |
|        2 |   0.5 |   2.50e-01 |       |
|        4 |  0.25 |   6.25e-02 |  2.00 |
|        8 | 0.125 | (diverged) |       |
|    slope |       |            |  2.00 |
| residual |       |            |     - |
| expected |       |            |     2 |

- Rows in parentheses are not used for orders; floor: round-off, or ten times the error of the \
reference; errors below 1000 floors are given as that bound, in full in the CSV form.
"""

GOLDEN_TABULAR = r"""{\footnotesize\setlength{\tabcolsep}{4pt}
\begin{tabular}{@{}rrrr@{}}
\toprule
N & h & BDF2 & order \\
\midrule
$2$ & $0.5$ & $2.50\cdot10^{-1}$ &  \\
$4$ & $0.25$ & $6.25\cdot10^{-2}$ & $2.00$ \\
$8$ & $0.125$ & (diverged) &  \\
\midrule
slope &  &  & $2.00$ \\
residual &  &  & - \\
expected &  &  & $2$ \\
\bottomrule
\end{tabular}
\par\medskip}"""


def test_a_small_table_as_markdown_letter_by_letter():
    assert rendered("made-up", [SMALL])["md"] == GOLDEN_MARKDOWN


def test_a_small_table_as_latex_letter_by_letter():
    texts = rendered("made-up", [SMALL])
    assert GOLDEN_TABULAR in texts["made-up-text.tex"]
    # bare, for a table environment of its own size and caption
    bare = GOLDEN_TABULAR.partition("\n")[2].removesuffix("\\par\\medskip}")
    assert texts["made-up-runs.tex"] == bare


@pytest.mark.parametrize("name", ["text", "a/../b", "$x$ %", "ü", ""])
def test_every_table_has_a_file_of_its_own_whatever_its_name(name):
    grids = [Grid(header=("n",), rows=((f"{k}",),), text_columns=0, name=name) for k in range(2)]
    files = forms("made", [*grids, Grid(header=("m",), rows=(("7",),), name="other")])
    tables = [file for file in files if file.endswith(".tex") and file != "made-text.tex"]
    assert len(tables) == 3
    assert all(re.fullmatch(r"made(-[A-Za-z0-9]+)*\.tex", file) for file in tables)
    assert "made-other.tex" in tables
    for file in tables:
        assert files[file].startswith("\\begin{tabular}")
        assert files[file].endswith("\\end{tabular}\n")


def markdown_tables(text: str) -> list[list[list[str]]]:
    """Cells of every table, the line below the header left out."""
    found: list[list[list[str]]] = []
    before = ""
    for line in text.split("\n"):
        if line.startswith("|"):
            if not before.startswith("|"):
                found.append([])
            found[-1].append([cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]])
        before = line
    for table in found:
        rule = table.pop(1)
        assert all(re.fullmatch("-+:?", cell) for cell in rule)
        assert len(rule) == len(table[0])
    return found


def test_the_summary_has_the_layout_of_the_paper_with_its_orders_beside_ours():
    claims = {"bdf1": 1.0, "bdf2": 2.0}
    made = [
        table_of(powers, experiment(name=f"table-9-{name}", claims=claims))
        for name in ("oscillator", "torvik")
    ]
    text = rendered("table-9", made)["md"]
    assert markdown_tables(text)[0] == [
        ["problem", "gamma", "N", "BDF1", "stated", "BDF2", "stated"],
        ["oscillator", "-", "2 to 16", "1.00, 1.00", "1", "2.00, 2.00", "2"],
        ["torvik", "-", "2 to 16", "1.00, 1.00", "1", "2.00, 2.00", "2"],
    ]
    # nothing to remark: every order is met
    assert "pre-asymptotic" not in text
    assert "measured 1" not in text


def bent(run: Run) -> FinishedRun:
    """Order 2 that becomes 1 on the finest step."""
    error = {2: 1.0, 4: 0.25, 8: 0.0625, 16: 0.03125}[run.n_steps]
    return finished(run, error, expected_order=1.0)


def test_stated_orders_that_are_not_met_or_not_asymptotic_are_told():
    made = table_of(bent, experiment([BDF2], claims={"bdf2": 2.0}))
    (case,) = made.cases
    assert case.slope == pytest.approx(1.7)
    text = rendered("made-up", [made])["md"]
    assert (
        "- made-up, BDF2: stated 2, measured 1.70; the slope 1.70 is pre-asymptotic: the order "
        "between N = 8 and 16 is 1.00, 1 is expected for small steps."
    ) in text
    # within 0.06 of what is stated: only the second half
    near = table_of(bent, experiment([BDF2], claims={"bdf2": 1.75}))
    text = rendered("made-up", [near])["md"]
    assert "measured" not in text.partition("##")[0].replace("Errors are measured", "")
    assert "the slope 1.70 is pre-asymptotic" in text
    # without a claim there is nothing to correct
    assert "asymptotic:" not in rendered("made-up", [table_of(bent)])["md"]


def test_the_summary_tells_where_the_interpolation_of_a_force_sets_the_order():
    limit = "forcing: the interpolation of a of f.csv allows order 2 at most"

    def summary(*expected: float, remark: str = limit) -> str:
        rows = [
            row(2**k, 4.0**-k, expected_order=order, remarks=(remark,))
            for k, order in enumerate(expected, 1)
        ]
        return rendered("made-up", [one_case(*rows)])["md"].partition("Methods:")[0]

    assert f"- made-up, BDF2: {limit}." in summary(2.0, 2.0, 2.0)
    mixed = summary(2.0, 2.0, 4.5)
    assert "- made-up, BDF2: expected order 2 at N = 2, 4; 4.5 at N = 8; where samples" in mixed
    # controls: an order that the method itself sets, and another remark
    assert "made-up, BDF2" not in summary(1.0, 1.0, 1.0)
    assert "made-up, BDF2" not in summary(2.0, 2.0, 4.5, remark="start series below t^8")


def test_a_slope_that_misses_the_finest_order_is_pre_asymptotic_though_none_is_expected():
    def unknown(run: Run) -> FinishedRun:
        return dataclasses.replace(bent(run), expected_order=math.nan)

    made = table_of(unknown, experiment([BDF2], claims={"bdf2": 1.7}))
    text = rendered("a", [made])["md"]
    assert "pre-asymptotic: the order between N = 8 and 16 is 1.00." in text


def test_a_slope_that_misses_the_expected_order_is_pre_asymptotic_though_pairs_agree():
    def straight(run: Run) -> FinishedRun:
        return finished(run, run.n_steps**-1.78, expected_order=1.5)

    made = table_of(straight, experiment([BDF2], claims={"bdf2": 1.78}))
    assert "the slope 1.78 is pre-asymptotic" in rendered("a", [made])["md"]


@pytest.mark.parametrize("expected", [4.2, 5.0, 5.8, 6.0, 6.4, 8.0])
def test_an_order_unlike_the_expected_one_is_pointed_out_on_either_side(expected):
    def straight(run: Run) -> FinishedRun:
        return finished(run, run.n_steps**-5.9, expected_order=expected)

    text = rendered("a", [table_of(straight, experiment([BDF2]))])["md"]
    sentence = f"is 5.90, not yet the {expected:.3g} that is expected for small steps"
    assert (f"- BDF2: the order between N = 8 and 16 {sentence}." in text) == (
        abs(expected - 5.9) > 0.3
    )


@pytest.mark.parametrize("seed", range(20))
def test_a_bound_is_rounded_upwards(seed):
    draw = random.Random(f"{os.environ[SEED]} {seed}")
    bound = 10.0 ** draw.uniform(-300, 300)
    shown = float(round_up(bound))
    assert bound * (1 - 1e-11) <= shown <= 1.1 * bound
    # round-off of a product is no reason for the next digit
    short = float(f"{draw.uniform(1.0, 9.9):.1f}e-{draw.randint(1, 20)}")
    assert float(round_up(1000.0 * (short / 1000.0))) == short


def test_another_bound_of_the_same_errors_is_no_difference(tmp_path):
    """Floors by a refined run have other digits on other machines; words have not."""

    def near(floor: float) -> OrderTable:
        def make(run: Run) -> FinishedRun:
            return finished(run, 1e-10 * (run.n_steps == 16) + 1.0 / run.n_steps**9, floor=floor)

        return table_of(make, experiment([BDF2], steps=(2, 4, 8, 16)))

    stored = order_report("made-up", [near(1.3e-13)])
    assert "(below 1.3e-10)" in reports.rendered(stored)["made-up.md"]
    reports.write(tmp_path, stored)
    assert reports.compare(tmp_path, order_report("made-up", [near(1.6e-13)])) == []
    for name in ("made-up.md", "made-up-runs.tex"):
        path = tmp_path / name
        path.write_text(path.read_text().replace("(below", "(above"))
        assert reports.compare(tmp_path, stored)
        path.write_text(path.read_text().replace("(above", "(below"))


def test_rounding_to_the_nearest_gives_no_bound():
    """The control."""
    assert float(f"{2.31e-10:.1e}") < 2.31e-10 < float(round_up(2.31e-10)) == 2.4e-10


def blowing_up(run: Run) -> FinishedRun:
    """BDF2 diverges on two steps and reaches the floor on one; nothing is expected of BDF1."""
    if run.method == BDF1:
        return finished(run, 1.0 / run.n_steps, expected_order=math.nan)
    error, status = {
        2: (0.5, "ok"),
        4: (3e25, "diverged"),
        8: (math.nan, "failed"),
        16: (1e-15, "floor"),
    }[run.n_steps]
    return finished(run, error, status=status, message="Newton stopped" if run.n_steps == 8 else "")


def test_no_row_is_dropped_and_what_is_not_used_is_marked():
    made = table_of(blowing_up, experiment(expect={"bdf2": "unstable"}))
    text = rendered("made-up", [made])["md"]
    summary, detail = markdown_tables(text)
    assert summary[1][-2:] == ["1.00, 1.00", r"diverged\*"]
    assert [line[:2] + line[4:] for line in detail[1:5]] == [
        ["2", "0.5", "5.00e-01", ""],
        ["4", "0.25", "(diverged)", ""],
        ["8", "0.125", "(failed)", ""],
        ["16", "0.0625", "(below 1.0e-10)", ""],
    ]
    assert detail[5][-1] == "-"
    assert "- BDF2: the configuration expects failures." in text
    assert "- BDF2: N = 8: Newton stopped." in text
    assert r"- \* made-up: BDF2 diverged in 1 of 4 rows; BDF2 failed in 1 of 4 rows." in text


def test_the_reader_is_told_equation_reference_norm_and_floor():
    def refined(run: Run) -> FinishedRun:
        floor = 1e-12 * run.n_steps
        reference = "refined run (Gauss4, graded, N = 256, estimated error 1.0e-14)"
        return finished(run, 0.1, floor=floor, reference=reference)

    described = dataclasses.replace(experiment(), norm="l2")
    text = rendered("made-up", [table_of(refined, described)])["md"]
    assert (
        "Equation: `x'' + x = t**2*sin(t)`; T = 1. Errors in the l2 norm over the grid, weighted "
        "by h, against a refined run (Gauss4, graded, N = 256, estimated error 1.0e-14); floor "
        "2e-12 to 2e-11."
    ) in text


def test_remarks_are_told_once_with_the_steps_and_methods_they_are_about():
    def remarked(run: Run) -> FinishedRun:
        remarks = ("start series below t^8",)
        if run.n_steps < 8 and run.method == GAUSS3:
            remarks = (f"no start series: less than 4 steps of {run.step_size:g}",)
        order = 2.5 if run.n_steps < 8 else 6.0
        return finished(run, 0.1, remarks=remarks, expected_order=order)

    text = rendered("a", [table_of(remarked, experiment([BDF1, BDF2, GAUSS3]))])["md"]
    assert "- BDF1; BDF2: every N: start series below t^8." in text
    assert "- Gauss3: N = 8, 16: start series below t^8." in text
    assert (
        "- Gauss3: N = 2, 4: no start series: less than 4 steps of 0.5 (numbers of N = 2)." in text
    )
    assert "- BDF1; BDF2; Gauss3: expected order 2.5 at N = 2, 4; 6 at N = 8, 16." in text


def test_predictions_of_instability_are_shown():
    made = one_case(row(2, 0.25), row(4, 0.0625, predicted="unstable"))
    assert "- BDF2: predicted unstable at N = 4." in rendered("a", [made])["md"]


@pytest.mark.parametrize(
    ("rows", "entry"),
    [
        ([row(2, 0.25), row(4, 0.0625), row(8, 0.015625)], "2.00, 2.00"),
        ([row(n, n**-2.0 if n in (2, 8, 32) else 1e-12) for n in (2, 4, 8, 16, 32)], "2.00"),
        ([row(2, 0.25), row(4, 0.0625)], "2.00"),
        ([row(2, 0.25)], "error 2.5e-01"),
        ([row(2, 0.25), row(4, 1e-15, status="floor")], "floor"),
        ([row(2, math.nan), row(4, math.nan)], "diverged*"),
        ([row(2, math.nan)], "diverged*"),
        ([row(2, 0.0)], "floor"),
        ([row(2, 0.1, status="floor", floor=0.0)], "-"),
    ],
)
def test_an_entry_says_how_much_there_is_to_go_by(rows, entry):
    (case,) = one_case(*rows).cases
    assert order_entry(case) == entry


def test_names_of_methods():
    mixed = [
        Method(cq="gauss", degree=3),
        Method(cq="lobatto-iiic", degree=3),
        Method(cq="radau-iia", degree=2),
        Baseline(name="explicit-euler"),
        BDF2,
    ]
    assert [name.label for name in method_names(mixed).values()] == [
        "Gauss3",
        "Lobatto IIIC 4",
        "Radau IIA 2",
        "explicit Euler",
        "BDF2",
    ]
    both = [BDF2, Method(cq="bdf4", degree=2, sampling="points")]
    assert [name.label for name in method_names(both).values()] == ["BDF2 nodes", "BDF4 points"]
    # samples at nodes are the paper's; where all are at points, that is said as well
    points = [Method(cq=f"bdf{p}", degree=2, sampling="points") for p in (3, 4)]
    assert [name.label for name in method_names(points).values()] == ["BDF3 points", "BDF4 points"]


def test_methods_of_one_family_are_told_apart_by_what_differs():
    def bdf3(**changes: object) -> Method:
        return Method(**{"cq": "bdf3", "sampling": "nodes", "degree": 2, **changes})

    corrected = [
        bdf3(start="weights", start_exponents=(2.5,)),
        bdf3(),
        bdf3(degree=1),
        bdf3(quadrature=RuleSpecification(points=5)),
    ]
    names = method_names(corrected)
    assert [name.label for name in names.values()] == [
        "BDF3, degree 2, 2 Gauss, weights t^2.5",
        "BDF3, degree 2, 2 Gauss, plain",
        "BDF3, degree 1, 1 Gauss, plain",
        "BDF3, degree 2, 5 Gauss, plain",
    ]
    # the rule follows from the degree: one of them is enough
    two = method_names([bdf3(), bdf3(degree=1)])
    assert [name.label for name in two.values()] == ["BDF3, degree 2", "BDF3, degree 1"]
    # whatever differs, no two share a name
    every = [*METHODS, *corrected, bdf3(history="direct"), bdf3(history="exponentials")]
    labels = [name.label for name in method_names(every).values()]
    assert len(set(labels)) == len(labels)


def test_problems_in_rows_unless_methods_fill_no_rectangle():
    degrees = [Method(cq=f"bdf{p}", degree=s, sampling="nodes") for p in (1, 2, 3) for s in (1, 2)]
    text = rendered("a", [table_of(powers, experiment(degrees))])["md"]
    summary = markdown_tables(text)[0]
    assert summary[0] == ["problem", "method", "gamma", "N", "BDF1", "BDF2", "BDF3"]
    assert [line[1] for line in summary[1:]] == ["degree 1", "degree 2"]
    # BDF3 of degree 1 left out
    ragged = rendered("a", [table_of(powers, experiment(degrees[:-2] + degrees[-1:]))])["md"]
    summary = markdown_tables(ragged)[0]
    assert summary[0] == ["method", "made-up"]
    assert len(summary) == 1 + 5


def test_experiments_with_other_methods_have_a_summary_of_their_own():
    made = [
        table_of(powers, experiment(name="a")),
        table_of(powers, experiment([GAUSS3], name="b")),
        table_of(powers, experiment(name="c")),
    ]
    first, second, *_ = markdown_tables(rendered("x", made)["md"])
    assert [line[0] for line in first[1:]] == ["a", "c"]
    assert [line[0] for line in second[1:]] == ["b"]


@pytest.mark.parametrize(
    ("name", "titles", "short"),
    [
        ("table-1", ["table-1-a", "table-1-b"], ["a", "b"]),
        ("full-order", ["full-a", "full-b"], ["a", "b"]),
        ("full-order", ["full-a", "other"], ["full-a", "other"]),
        ("torvik", ["torvik-1-2", "torvik-3-2"], ["torvik-1-2", "torvik-3-2"]),
        ("torvik-3-2", ["torvik-3-2"], ["torvik-3-2"]),
        ("table", ["table", "table-a"], ["table", "table-a"]),
    ],
)
def test_titles_lose_what_they_repeat_and_no_more(name, titles, short):
    made = [dataclasses.replace(SMALL, experiment=title) for title in titles]
    assert list(short_titles(name, made).values()) == short


def test_what_is_not_finished_yet_is_said():
    empty = order_table(experiment(), [])
    texts = rendered("made-up", [empty])
    assert texts["md"].count("No run is finished.") == 2
    assert texts["csv"].count("\n") == 1
    described = experiment()
    some = order_table(described, [powers(run) for run in described.runs()[:-1]])
    detail = markdown_tables(rendered("a", [some])["md"])[1]
    assert detail[4][-2:] == ["not computed", ""]


def test_the_terminal_gets_the_summary_in_columns():
    text = to_text(order_report("made-up", [table_of()]).summary)
    assert re.search(r"^made-up +- +2 to 16 +1\.00, 1\.00 +2\.00, 2\.00$", text, re.MULTILINE)
    assert "5.00e-01" not in text
    assert "case" not in text


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_tables_are_folded_into_its_width(monkeypatch):
    monkeypatch.setenv("COLUMNS", "50")
    monkeypatch.setenv("TERM", "xterm")
    methods = [
        Method(cq=f"bdf{p}", degree=s, sampling="nodes") for p in range(1, 7) for s in (1, 2)
    ]
    blocks = order_report("made-up", [table_of(powers, experiment(methods))]).summary
    terminal, file = Terminal(), io.StringIO()
    show(blocks, terminal)
    lines = re.sub("\x1b\\[[0-9;]*m", "", terminal.getvalue()).splitlines()
    assert max(map(len, lines)) <= 50
    assert all(any(f"BDF{p}" in line for line in lines) for p in range(1, 7))
    # elsewhere not
    show(blocks, file)
    assert file.getvalue() == to_text(blocks) + "\n"
    assert max(map(len, file.getvalue().splitlines())) > 50


# --- grids, escaping ------------------------------------------------------------------------------


def test_a_wide_grid_is_split_between_groups_and_repeats_its_keys():
    header = ("N", *(f"{letter}{k}" for letter in "abcde" for k in (1, 2)))
    grid = Grid(
        header=header,
        rows=(tuple(str(k) for k in range(11)),),
        summary_rows=(header,),
        groups=(2,) * 5,
    )
    parts = split_wide(grid, widest=4 + 8 * 5)
    # balanced: three and two groups, not four and one
    assert [part.header for part in parts] == [
        ("N", "a1", "a2", "b1", "b2", "c1", "c2"),
        ("N", "d1", "d2", "e1", "e2"),
    ]
    assert parts[1].rows == (("0", "7", "8", "9", "10"),)
    assert parts[1].summary_rows == (parts[1].header,)
    assert split_wide(grid, widest=1000) == [grid]
    # too narrow for anything: every group by itself, nothing lost
    assert len(split_wide(grid, widest=1)) == 5


@pytest.mark.parametrize("wrong", [{"rows": (("1",),)}, {"groups": (2,)}])
def test_a_grid_with_the_wrong_number_of_columns_is_refused(wrong):
    with pytest.raises(ValueError, match="columns"):
        Grid(header=("a", "b"), **{"rows": (), **wrong})


HOSTILE = "a_b*c|d`e<f>&g#h$i%j^k~l{m}n\\o[p]\nq"


def test_hostile_words_are_letters_in_markdown():
    escaped = escape_markdown(HOSTILE)
    assert re.sub(r"\\(.)", r"\1", escaped) == HOSTILE.replace("\n", " ")
    grid = Grid(header=("a", "b"), rows=((HOSTILE, "1"),))
    text = to_markdown([grid, Paragraph(words=(CodeSpan("a`b``c"), HOSTILE))])
    (cells,) = markdown_tables(text)
    assert len(cells[1]) == 2
    assert "``` a`b``c ```" in text


def unescaped(text: str) -> str:
    """LaTeX without what stands for one letter."""
    text = re.sub(r"\\text(backslash|asciicircum|asciitilde)\{\}", "", text)
    return re.sub(r"\\[{}$&#%_]|\{\\char96\}", "", text)


def test_hostile_words_are_letters_in_latex():
    escaped = escape_latex(HOSTILE)
    assert escaped == (
        r"a\_b*c$|$d{\char96}e$<$f$>$\&g\#h\$i\%j\textasciicircum{}k\textasciitilde{}l\{m\}n"
        r"\textbackslash{}o[p] q"
    )
    assert escape_latex("ü and γ") == "ü and U+03B3"


def test_a_bracket_is_no_argument_of_the_end_of_a_row():
    text = to_latex([Grid(header=("[a]", "b"), rows=(("[1pt]", "2"),), text_columns=2)])
    assert "\n{}[a] & b" in text
    assert "\n{}[1pt] & 2" in text


def check_latex(text: str) -> int:
    """Balanced braces, dollars and environments, every row of every table as long as declared."""
    bare = unescaped(text)
    depth = 0
    for letter in bare:
        depth += {"{": 1, "}": -1}.get(letter, 0)
        assert depth >= 0
    assert depth == 0
    open_environments: list[str] = []
    for verb, name in re.findall(r"\\(begin|end)\{([a-z]+)\}", bare):
        if verb == "begin":
            open_environments.append(name)
        else:
            assert open_environments.pop() == name
    assert open_environments == []
    for line in bare.splitlines():
        assert line.count("$") % 2 == 0, line
    tables = re.findall(r"\\begin\{(?:tabular|longtable)\}(.*?)\\end\{", bare, re.DOTALL)
    for table in tables:
        head, *lines = table.strip().splitlines()
        columns = re.fullmatch(r"(?:\[l\])?\{@\{\}((?:[lr]|>\{.*?\}p\{\d+em\})*)@\{\}\}", head)[1]
        count = len(re.findall(r"[lr]|>\{.*?\}p\{\d+em\}", columns))
        for line in lines:
            if not re.match(r"\\(\w+rule|end\w+)", line):
                assert line.endswith(r" \\")
                assert line.count("&") == count - 1, line
    assert set(re.findall(r"\\([a-zA-Z]+)", bare)) <= KNOWN_COMMANDS
    return len(tables)


KNOWN_COMMANDS = {
    *("input", "usepackage", "setlength", "parindent", "tabcolsep", "raggedright", "begin", "end"),
    *("section", "subsection", "footnotesize", "item", "texttt", "par", "smallskip", "medskip"),
    *("toprule", "midrule", "bottomrule", "endhead", "endfoot", "endlastfoot", "multicolumn"),
    *(
        "arraybackslash",
        "allowbreak",
        "textsuperscript",
        "cdot",
        "sum",
        "mu",
        "gamma",
        "sin",
        "backslash",
        "sim",
    ),
}


def test_latex_is_balanced_and_its_tables_have_the_columns_they_declare():
    hostile = dataclasses.replace(SMALL, equation=HOSTILE, reference=HOSTILE)
    remarked = one_case(row(2, 0.25, message=HOSTILE, remarks=("[1] of", HOSTILE)))
    made = [SMALL, hostile, remarked, table_of(blowing_up)]
    latex = [text for file, text in rendered("a", made).items() if file.endswith("tex")]
    assert sum(map(check_latex, latex)) >= 2 * 3
    # controls: a brace too many, a column too few
    with pytest.raises(AssertionError):
        check_latex(to_latex([Paragraph(words="a")]).replace("a\\par", "{a\\par"))
    with pytest.raises(AssertionError):
        check_latex(GOLDEN_TABULAR.replace("rrrr", "rrr"))


@given(st.text())
def test_any_words_make_balanced_latex_and_one_line_of_markdown(words):
    blocks = [
        Heading(level=1, words=words),
        Bullets(items=(words, (CodeSpan(words),))),
        Grid(header=(words, "n"), rows=((words, words),)),
    ]
    check_latex(to_latex(blocks))
    assert len(markdown_tables(to_markdown(blocks[2:]))[0][1]) == 2


def test_many_methods_stay_within_the_page():
    methods = [
        Method(cq=f"bdf{p}", degree=s, sampling="nodes") for p in range(1, 7) for s in (1, 2)
    ]
    made = table_of(lambda run: finished(run, 1e25, status="diverged"), experiment(methods))
    texts = rendered("a", [made])
    assert sum(check_latex(text) for file, text in texts.items() if file.endswith("tex")) > 2
    for line in texts["md"].splitlines():
        if line.startswith("|"):
            assert len(line) <= 170
    # and nothing is lost: every method has its errors once
    details = markdown_tables(texts["md"])[1:]
    assert sum(line.count("(diverged)") for t in details for line in t) == 12 * 4
    assert all(line[0] == t[k][0] for t in details for k, line in enumerate(details[0]))


# --- files ----------------------------------------------------------------------------------------


def test_all_files_are_written_and_nothing_else_is_left(tmp_path):
    directory = tmp_path / "results" / "tables"
    for _ in range(2):
        paths = write(directory, SMALL)
    suffixes = [".csv", ".md", ".tex", ".tex", ".tex", ".json"]
    assert [path.suffix for path in paths] == suffixes
    assert sorted(directory.iterdir()) == sorted(paths)
    assert {path.read_bytes().decode() for path in paths} == set(
        rendered("made-up", [SMALL]).values()
    )
    assert {path.stat().st_mode & 0o444 for path in paths} == {
        (tmp_path / "results").stat().st_mode & 0o444
    }


def test_a_write_that_fails_leaves_the_old_file_whole(tmp_path, monkeypatch):
    write(tmp_path, SMALL)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("fvi_cli.storage.atomic.os.fsync", full)
    with pytest.raises(StorageError, match=r"made-up\.csv: cannot be written: No space"):
        write(tmp_path, table_of())
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


# --- check ----------------------------------------------------------------------------------------


def altered(made: OrderTable, case: int, at: int, **changes: object) -> OrderTable:
    """The table with one row changed."""
    old = made.cases[case]
    rows = list(old.rows)
    rows[at] = dataclasses.replace(rows[at], **changes)
    cases = list(made.cases)
    cases[case] = dataclasses.replace(old, rows=tuple(rows))
    return dataclasses.replace(made, cases=tuple(cases))


def compared(
    stored: Sequence[OrderTable],
    fresh: Sequence[OrderTable],
    edited: Callable[[str], str] = lambda text: text,
) -> list[str]:
    """What differs between written tables, of which the CSV form is edited, and others."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), *stored)
        table = Path(folder) / "made-up.csv"
        table.write_text(edited(table.read_text()), newline="")
        for ending in ("tex", "json"):
            (Path(folder) / f"made-up.{ending}").unlink()
        return [line.removeprefix(f"{folder}/made-up.") for line in compare(Path(folder), *fresh)]


def differences(stored: OrderTable, fresh: OrderTable) -> list[str]:
    one_way = compared([stored], [fresh])
    # what differs differs whichever is stored
    assert bool(one_way) == bool(compared([fresh], [stored]))
    return one_way


BASE = table_of()


def test_what_is_the_same_is_up_to_date_and_timings_do_not_count(tmp_path):
    assert compared([BASE], [BASE]) == []
    slow = table_of(lambda run: dataclasses.replace(powers(run), trajectory=_slow(run)))
    write(tmp_path, BASE)
    assert compare(tmp_path, slow) == []


def _slow(run: Run) -> Trajectory:
    return dataclasses.replace(powers(run).trajectory, setup_seconds=9.0, stepping_seconds=99.0)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"error": 0.25 * 1.0011}, "error: 0.250275 is stored, now 0.25"),
        ({"error": math.nan}, "error: nan is stored"),
        ({"status": "floor"}, "status: 'floor' is stored, now 'ok'"),
        ({"predicted": "unstable"}, "predicted: 'unstable' is stored"),
        ({"expected_order": 1.5}, "expected_order: 1.5 is stored"),
        ({"expected_order": math.nan}, "expected_order: nan is stored"),
        ({"step_size": 0.2501}, "step_size: 0.2501 is stored"),
    ],
)
def test_every_change_of_a_row_is_told_with_its_place(changes, told):
    lines = differences(altered(BASE, 0, 1, **changes), BASE)
    assert f"csv: made-up: bdf1-nodes-s1-gauss1-none: n_steps = 4: {told}" in "\n".join(lines)


def test_another_remark_is_told():
    lines = differences(altered(BASE, 0, 1, remarks=("no start series",)), BASE)
    assert any(line.startswith("md: line") and "no start series" in line for line in lines)


@pytest.mark.parametrize("changes", [{"error": 0.25 * 1.0009}, {"floor": 2e-13}])
def test_changes_that_mean_nothing_are_not_told(changes):
    assert differences(altered(BASE, 0, 1, **changes), BASE) == []


def test_numbers_in_remarks_and_references_may_differ():
    def remarked(number: str) -> OrderTable:
        made = altered(BASE, 0, 1, remarks=(f"less than 4 steps of {number}",))
        return dataclasses.replace(made, reference=f"refined run (estimated error {number})")

    assert differences(remarked("1.1e-16"), remarked("0.3")) == []
    assert without_numbers("N = 128, 1.1e-16, t^0.5") == "N = #, #, t^#"


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"norm": "l2"}, "norm"),
        ({"gamma": "0.5"}, "gamma"),
        ({"equation": "x = 0"}, "Equation: `x = 0`"),
        ({"reference": "closed form"}, "closed form"),
        ({"final_time": 2.0}, "T = 2"),
        ({"experiment": "another"}, "another: bdf1-nodes-s1-gauss1-none: n_steps = 2: stored, but"),
        ({"cases": BASE.cases[:1]}, "bdf2-nodes-s1-gauss1-none: n_steps = 2: not stored"),
        ({"cases": BASE.cases[::-1]}, "order"),
    ],
)
def test_every_change_of_a_table_is_told(changes, told):
    lines = differences(dataclasses.replace(BASE, **changes), BASE)
    assert told in "\n".join(lines)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"claim": 1.0}, "stated"),
        ({"expected_failure": True}, "expects failures"),
        ({"rows": BASE.cases[0].rows[:-1]}, "n_steps = 16: not stored"),
    ],
)
def test_every_change_of_a_case_is_told(changes, told):
    case = dataclasses.replace(BASE.cases[0], **changes)
    lines = compared([dataclasses.replace(BASE, cases=(case, BASE.cases[1]))], [BASE])
    assert told in "\n".join(lines)


@pytest.mark.parametrize("slope", [1.011, math.nan])
def test_another_slope_is_told(slope):
    stored = f",{BASE.cases[0].slope!r},"
    lines = compared([BASE], [BASE], lambda text: text.replace(stored, f",{slope},"))
    assert len([line for line in lines if "slope" in line]) == len(STEPS)


def test_a_slope_that_does_not_belong_to_its_rows_is_told_whatever_the_floor():
    made = near_the_floor(1.0)
    slope = f",{made.cases[0].slope!r},"
    lines = compared([made], [made], lambda text: text.replace(slope, ",7.0,"))
    told = [line for line in lines if "slope: 7.0 is stored; its own rows give" in line]
    assert len(told) == len(STEPS)


def near_the_floor(factor: float) -> OrderTable:
    """The finest error is 1500 floors; round-off may have changed it."""

    def make(run: Run) -> FinishedRun:
        last = run.n_steps == STEPS[-1]
        error = powers(run).error * (factor if last else 1.0)
        floor = powers(run).error / 1500 if last else 1e-13
        return finished(run, error, floor=floor, expected_order=powers(run).expected_order)

    return table_of(make)


def test_errors_near_the_floor_may_differ_and_the_slopes_through_them():
    one, other = near_the_floor(1.0), near_the_floor(1.3)
    assert abs(one.cases[0].slope - other.cases[0].slope) > 0.01
    assert differences(one, other) == []
    # below 1000 floors it is used for no slope, which tells nothing either
    below = near_the_floor(0.6)
    assert not below.cases[0].rows[-1].used_in_fit
    assert math.isnan(below.cases[0].pairwise_order(len(STEPS) - 1))
    assert differences(one, below) == []
    told = "used_in_fit: True is stored; its own rows give False"
    assert told in "\n".join(compared([below], [one], lambda text: text.replace(",no,", ",yes,")))
    # control: an error above 2000 floors in one of the two is reliable
    assert "error" in "\n".join(differences(one, near_the_floor(2.1)))
    # control: the errors of the others are compared all the same
    changed = altered(one, 0, 0, error=0.5 * 1.1)
    assert "n_steps = 2: error: 0.55 is stored, now 0.5" in "\n".join(differences(changed, one))


def test_how_far_a_run_diverged_is_not_compared_but_that_it_did_is():
    one = table_of(blowing_up)
    far = table_of(lambda run: replace_error(blowing_up(run), 3e25, 7e31))
    assert differences(one, far) == []
    assert "status" in "\n".join(differences(one, altered(one, 1, 1, status="failed")))


def replace_error(run: FinishedRun, old: float, new: float) -> FinishedRun:
    return dataclasses.replace(run, error=new) if run.error == old else run


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_bytes().decode()
    assert old in text
    path.write_bytes(text.replace(old, new, 1).encode())


@pytest.mark.parametrize(
    ("form", "old", "new", "told"),
    [
        ("csv", ",0.25,0.25,", ",0.25,0.251,", "error: 0.251 is stored, now 0.25"),
        ("csv", ",1.0,yes,", ",1.1,yes,", "pairwise_order: 1.1 is stored; its own rows give 1.0"),
        ("csv", ",yes,", ",no,", "used_in_fit: False is stored, now True"),
        ("csv", ",yes,", ",maybe,", "used_in_fit: 'maybe' is stored, now True"),
        ("csv", ",0.25,0.25,", ",0.25,a,", "error: 'a' is stored, now 0.25"),
        ("csv", ",0.25,0.25,", ",0.25,0.25,,", "20 fields"),
        ("csv", ",status", ",state", "columns"),
        ("md", "2.50e-01", "2.51e-01", "2.51e-01"),
        ("tex", "toprule", "midrule", "midrule"),
        ("md", "T = 1", "T = 2", "T = 2"),
        ("json", '"error": 0.25', '"error": 0.26', "error: 0.26 is stored, now 0.25"),
        ("json", "{", "", "cannot be read"),
        ("json", '"format": 2', '"format": 1', "format: 1 is not 2"),
    ],
)
def test_a_change_of_any_file_is_told(tmp_path, form, old, new, told):
    write(tmp_path, BASE)
    path = tmp_path / f"made-up.{form}"
    edit(path, old, new)
    lines = compare(tmp_path, BASE)
    assert any(line.startswith(f"{path}: ") and told in line for line in lines), lines


def test_a_change_of_a_table_in_a_file_of_its_own_is_told(tmp_path):
    write(tmp_path, BASE)
    path = tmp_path / "made-up-runs.tex"
    edit(path, r"\cdot", r"\times")
    (line,) = compare(tmp_path, BASE)
    assert line.startswith(f"{path}: ")
    assert r"\\times" in line


def test_a_row_that_is_cut_off_is_told(tmp_path):
    write(tmp_path, BASE)
    path = tmp_path / "made-up.csv"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))
    (line,) = compare(tmp_path, BASE)
    assert line == f"{path}: made-up: bdf2-nodes-s1-gauss1-none: n_steps = 16: not stored"


def test_what_stands_twice_is_told(tmp_path):
    write(tmp_path, BASE)
    path = tmp_path / "made-up.csv"
    path.write_text(path.read_text() + path.read_text().splitlines()[-1] + "\n")
    assert compare(tmp_path, BASE) == [f"{path}: 1 rows are given twice"]


def test_files_that_agree_are_left_as_they_are(tmp_path):
    write(tmp_path, BASE)
    (tmp_path / "made-up.tex").unlink()
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    written = write(tmp_path, altered(BASE, 0, 1, error=0.25 * 1.0001))
    assert {path: path.read_bytes() for path in before} == before
    assert all(path.is_file() for path in written)
    # control: what does not agree is replaced
    write(tmp_path, altered(BASE, 0, 1, error=0.25 * 1.01))
    assert (tmp_path / "made-up.csv").read_bytes() != before[tmp_path / "made-up.csv"]


@pytest.mark.parametrize("form", ["csv", "md"])
def test_a_missing_file_is_told_and_nothing_is_written(tmp_path, form):
    write(tmp_path, BASE)
    path = tmp_path / f"made-up.{form}"
    path.unlink()
    before = sorted(tmp_path.iterdir())
    assert compare(tmp_path, BASE) == [f"{path}: missing"]
    assert sorted(tmp_path.iterdir()) == before
    assert len(compare(tmp_path / "nowhere", BASE)) == 2
    assert not (tmp_path / "nowhere").exists()
