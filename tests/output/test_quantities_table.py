"""Tables of quantities and events: what the command writes, and that a check can fail."""

import math
import re
from pathlib import Path

import pytest
from command_line import configuration, rows_of
from command_line import fvi as command

import fvi_cli as fvi
from fvi_cli.config import parse_config
from fvi_cli.reports.kinds.quantities import quantities_report

TEXT = configuration(
    "kind: pendulum, damping: [{order: 0.5, coefficient: 0.3}], initial: {position: 1.0}, "
    "final_time: 6.0, exact: none",
    name="asked",
    method="{rk: gauss, degree: [3, 4]}",
    steps="40",
    more="quantities: {torque: dx, a: ax}\n"
    "events: {bottom: {when: x, direction: falling}, end: {when: x + 0.4, stop: true}}\n",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("asked")
    (place / "asked.yaml").write_text(TEXT)
    return place


def _fvi(folder: Path, *options: str) -> tuple[int, str]:
    arguments = ["quantities", str(folder / "asked.yaml"), "-q", "--output", str(folder), *options]
    found = command(*arguments)
    return found.exit_code, found.output


def test_tables_hold_what_was_observed(folder):
    code, text = _fvi(folder)
    assert code == 0, text
    rows = rows_of(folder / "tables/asked-quantities.csv")
    (outcome,) = fvi.recall(folder / "asked.h5")
    observed = outcome.finished[1].trajectory.observed
    own = [row for row in rows if row["case"] == "gauss-s4-graded"]
    assert [row["quantity"] for row in own] == ["torque", "a"]
    assert float(own[0]["peak"]) == observed.extents["torque"].peak
    assert float(own[0]["rms"]) == observed.extents["torque"].rms
    events = rows_of(folder / "tables/asked-quantities-events.csv")
    assert [(row["event"], row["count"]) for row in events[:2]] == [("bottom", "1"), ("end", "1")]
    assert float(events[1]["last"]) == outcome.finished[0].trajectory.time[-1]
    assert "torque" in text


def test_a_check_holds_until_something_changes(folder):
    _fvi(folder)
    assert _fvi(folder, "--check")[0] == 0
    code, text = _fvi(folder, "--check", "--set", "problem.initial.position=1.1")
    assert code == 3
    assert "peak" in text


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("how", "exact", "known"),
    [
        ("ladder: {steps: [6, 12]}\n", "", "peak_error"),
        ("ladder: {steps: [6, 12]}\n", ", exact: none", "peak_error"),
        ("ladder: {steps: [12]}\n", "", "error"),
        ("accuracy: {tolerance: 1.0e-5}\n", "", "peak_error"),
    ],
)
def test_errors_stand_beside_peaks_wherever_they_are_known(tmp_path, how, exact, known):
    text = configuration(
        "kind: pendulum, damping: [{order: 0.5, coefficient: 0.3}], initial: {position: 1.0}, "
        f"final_time: 6.0{exact}",
        name="known",
        method="{rk: gauss, degree: 3}" if "ladder" in how else "",
        more="quantities: {torque: dx}\n",
    ).replace("ladder: {steps: [8, 16]}\n", how)
    (tmp_path / "known.yaml").write_text(text)
    table = command("quantities", tmp_path / "known.yaml", "-o", tmp_path, code=0).output
    rows = rows_of(tmp_path / "tables/known-quantities.csv")
    written = (tmp_path / "tables/known-quantities.md").read_text()
    for words in (table, written):
        lines = [line for line in words.splitlines() if "torque" in line]
        # a table in two blocks has the names of its rows in both
        assert len(lines) in (len(rows), 2 * len(rows))
        assert ("error of position" in words) == (known == "error")
        for line, row in zip(lines, rows, strict=False):
            for name in ("error", "peak_error"):
                assert (f" {float(row[name]):.1e} " in line) == (name == known)


def test_runs_that_fail_are_named_in_every_table(tmp_path):
    # a repelling cubic force: the motion becomes infinite
    text = configuration(
        "kind: duffing, stiffness: -1.0, cubic_stiffness: -1.0, initial: {position: 0.5}, "
        "final_time: 10.0, exact: none",
        name="lost",
        method="{rk: gauss, degree: 2}",
        steps="1000",
        more="quantities: {v: dx}\nevents: {e: {when: sin(40*t)}}\n",
    )
    for name, status in (("lost", "failed"), ("found", "ok")):
        path = tmp_path / f"{name}.yaml"
        until = "10.0" if status == "failed" else "1.0"
        path.write_text(text.replace("lost", name).replace("10.0", until))
        command("quantities", str(path), "-o", str(tmp_path), code=int(status == "failed"))
        for kind in ("quantities", "quantities-events"):
            assert {
                row["status"] for row in rows_of(tmp_path / "tables" / f"{name}-{kind}.csv")
            } == {status}
        shown = (tmp_path / "tables" / f"{name}-quantities.md").read_text(encoding="utf-8")
        assert shown.count("failed") == (2 if status == "failed" else 0)


DRIVEN = configuration(
    "kind: duffing, damping: [{order: 0.5, coefficient: 0.2}], forcing: cos(t), "
    "initial: {position: 1.0}, final_time: 20.0, exact: none",
    name="driven",
    method="gauss3",
    steps="30, 60, 180",
    more="quantities: {speed: abs(vx), a: ax}\noutput: {step: 0.1}\n",
)


def errors_and_peaks(text: str) -> dict[tuple[int, str], tuple[float, float]]:
    (outcome,) = fvi.run(parse_config(text, "a"))
    rows = quantities_report("a", outcome.finished).sheets[0].rows
    return {(one["n_steps"], one["quantity"]): (one["peak_error"], one["peak"]) for one in rows}


@pytest.mark.few(1)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-7])
def test_errors_of_peaks_are_near_those_that_a_far_finer_run_finds(tolerance):
    truth = errors_and_peaks(DRIVEN.replace("30, 60, 180", "600"))
    peaks = {name: peak for (_, name), (error, peak) in truth.items()}
    # a single run says nothing of its errors
    assert all(math.isnan(error) for error, _ in truth.values())
    ladder = errors_and_peaks(DRIVEN)
    assert len(ladder) == 6
    for (steps, name), (error, peak) in ladder.items():
        true = abs(peak - peaks[name])
        assert true <= 1.2 * error
        assert steps == 180 or error <= 1.5 * true
    given = errors_and_peaks(
        re.sub(r"(?m)^method:.*\n|^ladder:.*$", "", DRIVEN)
        + f"accuracy: {{tolerance: {tolerance}}}\n"
    )
    for (_, name), (error, peak) in given.items():
        # accelerations between points have a lower order than positions
        assert abs(peak - peaks[name]) <= error < 3e2 * tolerance


def test_designs_and_members_have_errors_of_their_own_ladders():
    (outcome,) = fvi.run(parse_config(DRIVEN + "designs: {a: {}, b: {problem.damping: []}}", "a"))
    report = quantities_report("a", outcome.finished)
    of_runs = {
        (one["design"], one["quantity"]): one["peak_error"]
        for one in report.sheets[0].rows
        if one["n_steps"] == 180
    }
    for row in report.sheets[-1].rows:
        assert row["peak_speed_error"] == of_runs[row["design"], "speed"] > 0
    assert of_runs["a", "speed"] != of_runs["b", "speed"]
