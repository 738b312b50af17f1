"""Another machine's round-off makes no stored result stale, and no file is written for it.

Errors below 1e-10 are stood in for by themselves times a factor drawn from [1/2, 2], which is more
than other processors and libraries do. Every comparison has its control: an error of about 1e-6
that is off by one per cent is found (three in a figure, which has three digits).
"""

from __future__ import annotations

import itertools
import json
import math
import random
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from shown_numbers import differences_of_texts

from fvi_cli import reports
from fvi_cli.plotting import compare_drawn
from fvi_cli.reports.hard_cases import compare_reports, report_from_json
from fvi_cli.studies.order import (
    NEAR_FLOOR,
    OrderCase,
    OrderRow,
    OrderTable,
    fit_slope,
    is_usable,
    near_floor,
    pairwise_order,
)

ROOT = Path(__file__).parents[1]
TABLES = ROOT / "results" / "tables"
ORDER_TABLES = [
    path.stem
    for path in sorted(TABLES.glob("*.json"))
    if not path.stem.endswith(("-cost", "-stability"))
]
FIGURES = sorted((ROOT / "results" / "figures").glob("*.json"))
SMALL = 1e-10

Change = Callable[[float], float]
RowChange = Callable[[OrderRow], OrderRow]


def round_off(seed: int) -> Change:
    draw = random.Random(seed)
    return lambda error: error * draw.uniform(0.5, 2.0) if 0 < abs(error) < SMALL else error


def wrong_by_a_hundredth(nearest: float) -> Change:
    return lambda error: 1.01 * error if error == nearest else error


def stored(name: str) -> list[OrderTable]:
    return reports.from_json((TABLES / f"{name}.json").read_text(encoding="utf-8"))


def errors_by(change: Change) -> RowChange:
    return lambda row: _row(row, change(row.error))


def changed(tables: list[OrderTable], change: RowChange) -> list[OrderTable]:
    """The tables that these rows give."""
    return [
        replace(table, cases=tuple(_case(case, change) for case in table.cases)) for table in tables
    ]


def _case(case: OrderCase, change: RowChange) -> OrderCase:
    rows = tuple(change(row) for row in case.rows)
    used = [row for row in rows if row.used_in_fit]
    slope, residual = fit_slope([r.n_steps for r in used], [r.error for r in used])
    pairs = [
        replace(
            row,
            pairwise_order=float("nan")
            if row.is_near_floor or before.is_near_floor
            else pairwise_order(before.error, row.error, before.n_steps, row.n_steps),
        )
        for before, row in itertools.pairwise(rows)
    ]
    return replace(case, rows=(*rows[:1], *pairs), slope=slope, fit_residual=residual)


def _row(row: OrderRow, error: float) -> OrderRow:
    status = row.status
    if status in ("ok", "floor"):
        status = "floor" if error < row.floor else "ok"
    used = is_usable(status, error, row.floor)
    return replace(row, error=error, status=status, used_in_fit=used)


def near_one_millionth(errors: list[float]) -> float:
    positive = [error for error in errors if 0 < error < math.inf]
    return min(positive, key=lambda error: abs(math.log(error / 1e-6)))


def test_the_tables_are_there() -> None:
    assert {"table-1", "table-2", "full-order"} <= set(ORDER_TABLES)
    assert len(FIGURES) > 10


@pytest.mark.parametrize("name", ORDER_TABLES)
def test_the_stored_rows_follow_from_their_errors(name: str) -> None:
    # else what is changed below would be a change of the rules as well
    assert repr(changed(stored(name), errors_by(lambda error: error))) == repr(stored(name))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ORDER_TABLES)
def test_nothing_is_stale_or_written_for_round_off(name: str, seed: int, tmp_path: Path) -> None:
    for path in TABLES.glob(f"{name}.*"):
        shutil.copy(path, tmp_path)
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in tmp_path.iterdir()}
    tables = changed(stored(name), errors_by(round_off(seed)))
    assert reports.compare_with_tables(tmp_path, name, tables) == []
    assert len(reports.write_tables(tmp_path, name, tables)) == 4
    after = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in tmp_path.iterdir()}
    assert after == before
    # the control
    errors = [row.error for table in tables for case in table.cases for row in case.rows]
    wrong = changed(stored(name), errors_by(wrong_by_a_hundredth(near_one_millionth(errors))))
    assert any("error" in line for line in reports.compare_with_tables(tmp_path, name, wrong))
    reports.write_tables(tmp_path, name, wrong)
    assert all(path.stat().st_mtime_ns > time for path, (_, time) in before.items())


@pytest.mark.parametrize("name", ORDER_TABLES)
def test_what_is_printed_is_the_same_on_every_machine(name: str) -> None:
    draw = round_off(1)

    def row_of(row: OrderRow) -> OrderRow:
        # a row beside the limit is printed on one machine and not on another
        is_beside = NEAR_FLOOR / 2 < row.error / row.floor < 2 * NEAR_FLOOR if row.floor else False
        return row if is_beside else _row(row, draw(row.error))

    tables = changed(stored(name), row_of)
    for form in ("md", "tex"):
        made = reports.rendered(name, tables)[form]
        shown = (TABLES / f"{name}.{form}").read_text(encoding="utf-8")
        assert differences_of_texts(shown, made) == []


def test_rows_of_the_tables_of_the_paper_are_all_used() -> None:
    for name in ("table-1", "table-2"):
        rows = [row for table in stored(name) for case in table.cases for row in case.rows]
        assert len(rows) == 72
        assert all(row.used_in_fit for row in rows)
        # far from the limit of what is used
        assert not any(near_floor(row.error, 1000 * row.floor) for row in rows)


def _drawn(figure: dict, change: Change) -> dict:
    """The drawn numbers with errors changed, which stand on logarithmic axes."""
    made = json.loads(json.dumps(figure))
    for panel in made["panels"]:
        for line in panel["lines"] if panel["y"]["scale"] == "log" else []:
            if "y" in line:
                line["y"] = [None if y is None else change(y) for y in line["y"]]
    return made


@pytest.mark.parametrize("path", FIGURES, ids=lambda path: path.stem)
def test_no_figure_is_stale_for_round_off(path: Path) -> None:
    if path.stem.endswith("-cost"):
        pytest.skip("costs are never the same twice")
    drawn = json.loads(path.read_text(encoding="utf-8"))
    seen: list[float] = []
    assert compare_drawn(drawn, _drawn(drawn, lambda error: seen.append(error) or error)) == []
    for seed in range(3):
        assert compare_drawn(drawn, _drawn(drawn, round_off(seed))) == []
    # the control: three digits are drawn, of which the last may differ
    if any(1e-7 < error < 1e-5 for error in seen):
        nearest = near_one_millionth(seen)
        wrong = _drawn(drawn, lambda error: 1.03 * error if error == nearest else error)
        assert compare_drawn(drawn, wrong)


def test_no_hard_case_is_stale_for_round_off() -> None:
    report = report_from_json((ROOT / "results" / "hard-cases.json").read_text(encoding="utf-8"))
    for seed in range(3):
        change = round_off(seed)
        findings = tuple(replace(f, measured=change(f.measured)) for f in report.findings)
        assert list(compare_reports(report, replace(report, findings=findings))) == []
