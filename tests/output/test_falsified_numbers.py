"""Every number that people read is compared: a falsified digit of any table is found."""

import re
from pathlib import Path

import pytest

import fvi_cli as fvi
from fvi_cli import reports
from fvi_cli.reports.kinds.fit import fit_report
from fvi_cli.reports.kinds.quantities import quantities_report
from fvi_cli.reports.kinds.stability import stability_report
from fvi_cli.reports.kinds.vibration import mode_report, response_report
from fvi_cli.reports.table import Report

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
        "chain", fvi.response(CONFIG, over="frequency=0.05:0.5:40", force=["x1"], at=["x1", "x2"])
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


def _shown_without_comparison(report: Report) -> set[str]:
    """Numbers of columns that round-off or random data decide."""
    return {
        form.format(row[column.name])
        for sheet in report.sheets
        for row in sheet.rows
        for column in sheet.columns
        if column.compared is None and isinstance(row[column.name], int | float)
        for form in (f"{{:{column.form}}}", "{:.0e}")
    }


def _with_number(text: str, found: re.Match[str], number: str) -> str:
    return text[: found.start()] + number + text[found.end() :]


def _other_digit(word: str, place: int) -> str:
    digits = [k for k, letter in enumerate(word.partition("e")[0]) if letter.isdigit()]
    k = digits[place]
    return word[:k] + str((int(word[k]) + 4) % 10) + word[k + 1 :]


def _check_latex(page: Path, folder: Path, report: Report) -> None:
    text = page.read_text()
    shown = list(re.finditer(r"\$(-?\d+\.\d+)(?=\$|\\cdot)", text))
    for one in shown:
        number = one.group(1)
        page.write_text(text[: one.start(1)] + _other_digit(number, 0) + text[one.end(1) :])
        is_rough = any(
            column.compared is None and f"{row[column.name]:{column.form}}".startswith(number)
            for sheet in report.sheets
            for column in sheet.columns
            for row in sheet.rows
            if isinstance(row[column.name], float)
        )
        assert (reports.compare(folder, report) == []) == is_rough, number
    page.write_text(text)


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=pytest.mark.slow if one == "fit" else ()) for one in REPORTS],
)
def test_a_falsified_digit_is_found_and_a_last_one_may_differ(name: str, tmp_path: Path) -> None:
    report = REPORTS[name]()
    reports.write(tmp_path, report)
    assert reports.compare(tmp_path, report) == []
    page = tmp_path / f"{report.name}.md"
    text = page.read_text()
    free = _shown_without_comparison(report)
    found = [one for one in NUMBER.finditer(text) if one.group() not in free]
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
    _check_latex(tmp_path / f"{report.name}.tex", tmp_path, report)
    # other machines: the control, without which everything would be stale
    for one in found:
        head, mark, exponent = one.group().partition("e")
        if "." in head and head[-1] in "12345678":
            near = head[:-1] + str(int(head[-1]) + 1)
            assert not is_stale(one, near + mark + exponent), one.group()
