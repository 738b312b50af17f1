"""Order tables say what the runs say, in every form; ``kept/`` has their pages as they are read."""

import csv
import io
import math
import os
import random
import re
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_runs import BDF1, BDF2, STEPS, made_run, one_case, powers, rendered, row, table_of
from spread import SEED

from fvi_cli.integrator.method import Method
from fvi_cli.reports.kinds.orders import COLUMNS
from fvi_cli.reports.table import Grid
from fvi_cli.reports.write import to_latex
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.norms import round_up
from fvi_cli.studies.order import OrderTable

GAUSS3 = Method(cq="gauss", degree=3, start="graded")
DEGREES = [Method(cq=f"bdf{p}", degree=s, sampling="nodes") for p in range(1, 7) for s in (1, 2)]
SMALL = one_case(row(2, 0.25), row(4, 0.0625), row(8, math.nan))

# --- pages, of which each experiment is named after what it shows ---------------------------------


def bent(run: Run, expected: float = 1.0) -> FinishedRun:
    """Slope 1.7: order 2 that becomes 1 on the finest step."""
    error = {2: 1.0, 4: 0.25, 8: 0.0625, 16: 0.03125}[run.n_steps]
    return made_run(run, error, order_smooth=expected)


def blowing_up(run: Run) -> FinishedRun:
    """BDF2 diverges on two steps and reaches the floor on one; nothing is expected of BDF1."""
    if run.method == BDF1:
        return made_run(run, 1.0 / run.n_steps, order_smooth=math.nan)
    error, status = {
        2: (0.5, "ok"),
        4: (3e25, "diverged"),
        8: (math.nan, "failed"),
        16: (1e-15, "floor"),
    }[run.n_steps]
    message = "Newton stopped" if run.n_steps == 8 else ""
    return made_run(run, error, status=status, message=message)


def refined(run: Run) -> FinishedRun:
    reference = "reference run (Gauss4, graded, N = 256, estimated error 1.0e-14)"
    return made_run(run, 0.1 / run.n_steps, floor=1e-12 * run.n_steps, reference=reference)


def remarked(run: Run) -> FinishedRun:
    remarks = ("start series below t^8",)
    if run.n_steps < 8 and run.method == GAUSS3:
        remarks = (f"no start series: less than 4 steps of {run.step_size:g}",)
    return made_run(run, 0.1 / run.n_steps, remarks=remarks, order_smooth=6.0)


ENTRIES = {
    "three": [row(2, 0.25), row(4, 0.0625), row(8, 0.015625)],
    "no two beside each other": [
        row(n, n**-2.0 if n in (2, 8, 32) else 1e-12) for n in (2, 4, 8, 16, 32)
    ],
    "two": [row(2, 0.25), row(4, 0.0625)],
    "one": [row(2, 0.25)],
    "one above the floor": [row(2, 0.25), row(4, 1e-15, status="floor")],
    "all diverged": [row(2, math.nan), row(4, math.nan)],
    "one, diverged": [row(2, math.nan)],
    "no error": [row(2, 0.0)],
    "no floor": [row(2, 0.1, status="floor", floor=0.0)],
}
PAGES: dict[str, Sequence[OrderTable]] = {
    "small": [SMALL],
    "stated": [table_of(bent, BDF2, name="not met", claims={"bdf2": 2.0})],
    "troubles": [
        table_of(blowing_up, name="blowing up", expect={"bdf2": "unstable"}),
        table_of(refined, name="refined reference", norm="l2"),
    ],
    "nothing": [table_of(count=0)],
    "unfinished": [table_of(name="nothing", count=0), table_of(name="all but one run", count=7)],
    "remarks": [table_of(remarked, BDF1, BDF2, GAUSS3)],
    "entries": [one_case(*rows, name=name) for name, rows in ENTRIES.items()],
    "degrees": [table_of(powers, *DEGREES[:6])],
    "other-methods": [table_of(name="a"), table_of(powers, GAUSS3, name="b"), table_of(name="c")],
}


@pytest.mark.parametrize("name", PAGES)
def test_pages_are_as_they_are_kept(name, kept):
    kept(f"{name}.md", rendered(name, PAGES[name])["md"])


def test_a_small_table_as_csv_and_latex(kept):
    texts = rendered("small", [SMALL])
    for form in ("csv", "tex"):
        kept(f"small.{form}", texts[form])


@given(words=st.text())
def test_whatever_the_words_a_row_of_latex_keeps_its_columns(words):
    (row,) = re.findall(r"\\midrule\n(.*) \\\\\n\\bottomrule", to_latex([one_row(words)]))
    assert len(re.findall(r"(?<!\\)&", row)) == 1
    assert len(re.findall(r"(?<!\\)[{]", row)) == len(re.findall(r"(?<!\\)[}]", row))


def one_row(words: str) -> Grid:
    return Grid(header=("a", "b"), rows=((words, words),))


def test_another_number_and_another_word_are_seen_in_what_is_kept(kept, request):
    """The control."""
    if request.config.getoption("--renew"):
        pytest.skip("it would be kept")
    text = rendered("small", [SMALL])["csv"]
    for old, new in (("0.0625", "0.0626"), ("diverged", "failed")):
        with pytest.raises(AssertionError):
            kept("small.csv", text.replace(old, new))


@pytest.mark.parametrize("seed", range(20))
def test_a_bound_is_rounded_upwards(seed):
    draw = random.Random(f"{os.environ[SEED]} {seed}")
    bound = 10.0 ** draw.uniform(-300, 300)
    shown = float(round_up(bound))
    assert bound * (1 - 1e-11) <= shown <= 1.1 * bound
    # round-off of a product is no reason for the next digit
    short = float(f"{draw.uniform(1.0, 9.9):.1f}e-{draw.randint(1, 20)}")
    assert float(round_up(1000.0 * (short / 1000.0))) == short
    # the control: rounding to the nearest gives no bound
    assert float(f"{2.31e-10:.1e}") < 2.31e-10 < float(round_up(2.31e-10)) == 2.4e-10


# --- numbers --------------------------------------------------------------------------------------


def test_the_csv_has_one_row_for_every_run_and_numbers_that_read_back():
    made = table_of(lambda run: made_run(run, math.pi * 10.0**-run.n_steps))
    text = rendered("made-up", [made])["csv"]
    rows = list(csv.DictReader(io.StringIO(text)))
    assert list(rows[0]) == ["experiment", *(column.name for column in COLUMNS)]
    assert [(r["case"], int(r["n_steps"])) for r in rows] == [
        (method.case, n) for method in (BDF1, BDF2) for n in STEPS
    ]
    # to the last bit
    assert [float(r["error"]) for r in rows] == 2 * [math.pi * 10.0**-n for n in STEPS]
    assert [float(r["slope"]) for r in rows] == [c.slope for c in made.cases for _ in c.rows]
    assert "\r" not in text
    assert rendered("a", [table_of(count=0)])["csv"].count("\n") == 1
    plain, numpy = (one_case(row(2, kind(0.1))) for kind in (float, np.float64))
    assert rendered("a", [plain]) == rendered("a", [numpy])
