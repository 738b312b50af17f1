"""The page about chaos: its commands are carried out as they are shown, with fewer members."""

import csv
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from command_line import fvi, rows_of

from fvi_cli.config import parse_config

PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "chaos.md"
FENCED = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What is written by the commands of the page, one after the other."""
    blocks = FENCED.findall(PAGE.read_text(encoding="utf-8"))
    here = tmp_path_factory.mktemp("chaos")
    (text,) = (block for kind, block in blocks if kind == "yaml")
    (here / "chaos.yaml").write_text(text, encoding="utf-8")
    lines = [line for kind, block in blocks if kind == "sh" for line in block.splitlines()]
    assert len(lines) == 6
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(here)
        for line in lines:
            assert "number: 40" in line or "sweep" not in line
            program, *words = shlex.split(line.replace("number: 40", "number: 3"))
            assert program == "fvi"
            fvi(*words, code=0)
    return here


def test_the_figures_that_the_page_names_are_there(folder):
    drawn = {path.name for path in (folder / "results" / "figures").glob("*.png")}
    named = re.findall(r"(chaos-[\w-]+\.png)", PAGE.read_text(encoding="utf-8"))
    assert len(named) == 2
    assert drawn == {*named, "chaos-period-against-parameters-F.png", "chaos-ensemble-x.png"}


def test_events_happen_once_every_period_and_are_exported(folder):
    (path,) = (folder / "results" / "export" / "chaos").glob("*period*.csv")
    rows = rows_of(path)
    times = np.array([float(row["time"]) for row in rows])
    assert np.allclose(times, 2 * np.pi * np.arange(1, times.size + 1), rtol=1e-12)
    assert times.size == 19


def test_the_table_has_mean_and_deviation(folder):
    table = (folder / "results" / "tables" / "chaos-quantities-ensemble.csv").read_text()
    rows = list(csv.DictReader(table.splitlines()))
    assert len(rows) == 12
    assert {row["members"] for row in rows} == {"3"}
    first = np.linspace(0.45, 0.55, 3)
    assert float(rows[0]["mean"]) == pytest.approx(0.5, rel=1e-12)
    assert float(rows[0]["deviation"]) == pytest.approx(first.std(ddof=1), rel=1e-12)


def test_the_section_of_the_page_leaves_out_the_way_in():
    (text,) = (b for kind, b in FENCED.findall(PAGE.read_text()) if kind == "yaml")
    (experiment,) = parse_config(text, "chaos.yaml").experiments
    (figure,) = (one for one in experiment.figures if not isinstance(one, str))
    assert (figure.section, figure.after) == ("period", 50.0)
