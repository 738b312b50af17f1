"""Everything that the README shows is run or compared."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest
from command_line import fvi
from shown_numbers import differences_of_texts

from fvi_cli.scenes.registry import KINDS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CI = (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def first_commands():
    return blocks("sh")[0].splitlines()


def test_the_two_commands_stand_at_the_top_and_start_from_nothing():
    run, test = first_commands()
    for command in (run, test):
        create, install, *uses = command.split(" && ")
        assert create == "python3 -m venv .venv"
        assert install.startswith(".venv/bin/pip install ")
        assert uses
        assert all(use.startswith(".venv/bin/") for use in uses)
    # the first is tried in pieces below, the second is what CI runs
    assert re.search(r"sed -n '/\^python3 -m venv \.\*pytest/p' README\.md", CI)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert any(r.startswith("pytest-xdist") for r in extras["optional-dependencies"]["test"])
    assert "fvi" in extras["scripts"]


def test_the_first_command_says_nothing_that_the_program_does_not_know(tmp_path):
    _, _, *uses = first_commands()[0].split(" && ")
    for use in uses:
        program, *arguments = shlex.split(use)
        assert program == ".venv/bin/fvi"
        result = fvi(*arguments, "--dry-run", "--output", str(tmp_path))
        assert result.exit_code == 0, result.output
        assert len(result.stdout.splitlines()) > 40
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def carry_out(text, folder):
    """Save configurations, call the commands, compare what is shown of their output."""
    printed = ""
    for before, kind, block in re.findall(
        r"((?:[^`\n]|`[^`\n]*`|\n(?!```))*)\n```(\w+)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL
    ):
        if kind == "yaml":
            name = re.findall(r"[Ss]ave (?:this )?as `([\w-]+\.yaml)`", before)[-1]
            (folder / name).write_text(block, encoding="utf-8")
        elif kind == "sh":
            printed = ""
            for command in block.splitlines():
                program, *arguments = shlex.split(command)
                assert program == "fvi"
                result = fvi(*arguments)
                assert result.exit_code == 0, result.output
                printed += result.stdout
        elif kind == "text":
            first = block.split("\n")[0].split()
            at = next(k for k, line in enumerate(printed.splitlines()) if line.split() == first)
            shown = printed.splitlines()[at : at + len(block.splitlines())]
            assert differences_of_texts(block, "\n".join(shown)) == []
        elif kind == "python":
            # text of our own; a process for it would import everything once more
            exec(compile(block, "a page", "exec"), {"__name__": "example"})


def test_the_problem_of_ones_own_does_what_is_said_of_it(in_a_folder):
    section = README[README.index("## A problem of your own") : README.index("## What it can do")]
    assert len(blocks("yaml")[0].splitlines()) == 10
    carry_out(section, in_a_folder)
    results = in_a_folder / "results"
    assert {one.suffix for one in (results / "tables").glob("my-oscillator.*")} == (
        {".csv", ".md", ".tex"}
    )
    assert list((results / "figures").glob("my-oscillator*.png"))
    assert "write `accuracy: {tolerance: 1e-8}` in place of `method` and `ladder`" in section
    lines = [line for line in blocks("yaml")[0].splitlines() if not line.startswith("method")]
    other = "\n".join([*lines[:-1], "accuracy: {tolerance: 1e-8}", ""])
    (in_a_folder / "other.yaml").write_text(other, encoding="utf-8")
    assert fvi("check", "other.yaml").exit_code == 0


def test_the_tutorial_does_what_it_shows(in_a_folder):
    tutorial = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    carry_out(tutorial, in_a_folder)
    results = in_a_folder / "results"
    assert (results / "figures" / "my-swings-quantities.png").is_file()
    assert (results / "my-swing.h5").is_file()


PAPER = (ROOT / "docs/explanation/paper.md").read_text(encoding="utf-8")
ORDERS = (ROOT / "docs/explanation/orders.md").read_text(encoding="utf-8")
NAMED_TABLES = [
    pytest.param(text, name, id=name)
    for text in (PAPER, ORDERS)
    for name in re.findall(r"<!-- begin results/tables/(\S+)\.md -->", text)
]


def test_the_tables_of_the_paper_are_shown():
    assert {"table-1", "table-2", "full-order"} < {one.id for one in NAMED_TABLES}


@pytest.mark.parametrize(("text", "name"), NAMED_TABLES)
def test_the_tables_are_those_in_results(text, name):
    path = f"results/tables/{name}.md"
    _, _, after = text.partition(f"<!-- begin {path} -->\n\n")
    shown, mark, _ = after.partition(f"\n\n<!-- end {path} -->\n")
    assert mark
    table = (ROOT / path).read_text(encoding="utf-8")
    # the orders, without the details
    assert differences_of_texts(shown, table[table.index("\n| ") + 1 :].split("\n\n")[0]) == []


def test_the_comparison_is_that_of_the_benchmark():
    measured = (ROOT / "results/peers.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (fvi \S+|pycaputo \S+) \| (.*) \|$", README, re.MULTILINE)
    assert len(rows) == 5
    for method, cells in rows:
        one, other = cells.split(" | ")[:2], cells.split(" | ")[2:]
        for problem, pair in (("oscillator", one), ("pendulum", other)):
            row = " | ".join([f"{problem}, order 1/2", method, "1024", *pair])
            assert f"| {row} |" in measured


def test_every_kind_of_problem_has_its_place_among_the_scenes():
    page = (ROOT / "docs/reference/scenes.md").read_text(encoding="utf-8")
    named = set(re.findall(r"^## ([a-z-]+)$", page, re.MULTILINE))
    assert named | {"fractional-derivative"} == set(KINDS)
