"""Every number that people read is compared: a falsified digit of any table is found."""

import dataclasses
import math
import re
from pathlib import Path

import pytest

import fvi_cli as fvi
from fvi_cli import reports
from fvi_cli.reports.kinds.fit import fit_report
from fvi_cli.reports.kinds.quantities import quantities_report
from fvi_cli.reports.kinds.stability import stability_report
from fvi_cli.reports.kinds.vibration import mode_report, response_report
from fvi_cli.reports.table import Report, Value, Within

NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?")

CHAIN = {
    "kind": "structure",
    "mass": [[1.0, 0.0], [0.0, 2.0]],
    "stiffness": [[3.0, -1.0], [-1.0, 1.5]],
    "damping": [{"order": 0.6, "coefficient": 0.05}],
    "initial": {"position": [1.0, 0.0]},
    "final_time": 6.0,
    "exact": "none",
}
CONFIG = {
    "name": "chain",
    "problem": CHAIN,
    "method": {"rk": "gauss", "degree": 3},
    "ladder": {"steps": [32]},
    "quantities": {"pull": "2*x1 - x2", "speed": "vx2"},
    "events": {"rest": {"when": "vx1"}},
}


def _modes() -> Report:
    return mode_report("chain", fvi.modes(CONFIG))


def _response() -> Report:
    return response_report(
        "chain", fvi.response(CONFIG, frequency="0.05:0.5:40", force=["x1"], at=["x1", "x2"])
    )


def _quantities() -> Report:
    return quantities_report("chain", [one for run in fvi.run(CONFIG) for one in run.finished])


def _stability() -> Report:
    methods = [{"bdf": [2, 5], "sampling": "nodes", "degree": 1}]
    config = {"name": "chain", "problem": CHAIN, "method": methods, "ladder": {"steps": [8, 64]}}
    return stability_report("chain", fvi.stability(config))


def _fit() -> Report:
    return fit_report("fit-decay", fvi.fit("fit-decay"))


REPORTS = {
    "modes": _modes,
    "response": _response,
    "quantities": _quantities,
    "stability": _stability,
    "fit": _fit,
}


def _with_number(text: str, found: re.Match[str], number: str) -> str:
    return text[: found.start()] + number + text[found.end() :]


def _other_digit(word: str, place: int) -> str:
    digits = [k for k, letter in enumerate(word.partition("e")[0]) if letter.isdigit()]
    k = digits[place]
    return word[:k] + str((int(word[k]) + 4) % 10) + word[k + 1 :]


def _check_latex(page: Path, folder: Path, report: Report) -> None:
    text = page.read_text()
    for one in re.finditer(r"\$(-?\d+\.\d+)(?=\$|\\cdot)", text):
        number = one.group(1)
        page.write_text(text[: one.start(1)] + _other_digit(number, 0) + text[one.end(1) :])
        assert reports.compare(folder, report) != [], number
    page.write_text(text)


def _of_another_machine(report: Report) -> Report:
    """The report on rows whose numbers are off by less than their columns permit."""
    return report.on(
        [
            dataclasses.replace(
                sheet,
                rows=tuple(
                    {
                        **row,
                        **{
                            column.name: _rounded_otherwise(row[column.name], column.compared)
                            for column in sheet.columns
                            if column.name not in sheet.keys
                        },
                    }
                    for row in sheet.rows
                ),
            )
            for sheet in report.sheets
        ]
    )


def _rounded_otherwise(value: Value, rule: Within | None) -> Value:
    if not isinstance(value, float) or rule is None or not math.isfinite(value):
        return value
    return value + 0.5 * max(rule.relative * abs(value), rule.absolute)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=pytest.mark.slow if one == "fit" else ()) for one in REPORTS],
)
def test_a_falsified_digit_is_found_and_other_machines_are_not(name: str, tmp_path: Path) -> None:
    report = REPORTS[name]()
    reports.write(tmp_path, report)
    assert reports.compare(tmp_path, report) == []
    page = tmp_path / f"{report.name}.md"
    text = page.read_text()
    found = list(NUMBER.finditer(text))
    assert len(found) >= 5

    def is_stale(match: re.Match[str], number: str) -> bool:
        page.write_text(_with_number(text, match, number))
        return reports.compare(tmp_path, report) != []

    for one in found:
        word = one.group()
        assert is_stale(one, _other_digit(word, 0)), word
        sign = word[1:] if word[0] == "-" else f"-{word.lstrip('+')}"
        if float(word) and not text[: one.start()].endswith("-"):
            assert is_stale(one, sign), word
    # of LaTeX too, in which powers of ten are written out
    page.write_text(text)
    pages = sorted(tmp_path.glob("*.tex"))
    assert len(pages) >= 2
    for one in pages:
        _check_latex(one, tmp_path, report)
    # the control, without which everything would be stale
    other = tmp_path / "other"
    reports.write(other, _of_another_machine(report))
    assert (other / f"{report.name}.csv").read_text() != (
        tmp_path / f"{report.name}.csv"
    ).read_text()
    assert reports.compare(other, report) == []
