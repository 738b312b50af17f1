"""Pages of docs/ say what the program does: they are compared, run, or made by it."""

import json
import re
import runpy
from pathlib import Path

import pytest
import typer
import yaml
from command_line import fvi as here
from typer.testing import CliRunner

from fvi_cli.cli.app import app
from fvi_cli.config import parse_config

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = {
    path.relative_to(DOCS).as_posix(): path.read_text(encoding="utf-8")
    for path in DOCS.rglob("*.md")
}
WITH_README = PAGES | {
    f"../{name}": (ROOT / name).read_text(encoding="utf-8")
    for name in ("README.md", "CONTRIBUTING.md")
}
COMMANDS = typer.main.get_command(app()).commands
FENCED = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_the_generated_reference_is_up_to_date(monkeypatch):
    # if it is not: python docs/site/reference.py
    monkeypatch.syspath_prepend(DOCS / "site")
    generated = runpy.run_path(str(DOCS / "site" / "reference.py"))["pages"]()
    assert len(generated) == 3
    for path, text in generated.items():
        assert PAGES[path.relative_to(DOCS).as_posix()] == text, path


@pytest.mark.parametrize("page", sorted(WITH_README))
def test_what_is_linked_is_there(page):
    for link in re.findall(r"\]\((?!http)([^)]+)\)", WITH_README[page]):
        path, _, place = link.partition("#")
        target = (DOCS / page).parent / path if path else DOCS / page
        assert target.exists(), link
        if place:
            headings = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            assert place in {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in headings}


@pytest.mark.parametrize("page", sorted(WITH_README))
def test_commands_that_are_shown_exist(page):
    lines = [
        line for kind, text in FENCED.findall(WITH_README[page]) if kind == "sh" for line in [text]
    ]
    shown = re.findall(r"`(fvi [^`]+)`", WITH_README[page]) + "".join(lines).splitlines()
    for line in shown:
        program, _, rest = line.partition(" ")
        if program != "fvi":
            continue
        words = rest.split()
        options = {word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        if words[0].startswith("-"):
            known = {"--help", "--version", "--install-completion", "--show-completion"}
        else:
            assert words[0] in {*COMMANDS, "COMMAND"}, line
            known = {o for p in COMMANDS[words[0]].params for o in p.opts + p.secondary_opts}
        assert options <= known, line


LONG = ("how-to/chaos.md", 5)
"""A cloud of fifty motions."""
PYTHON = [
    pytest.param(
        page,
        number,
        id=f"{page}-{number}",
        marks=[pytest.mark.slow] if (page, number) == LONG else [],
    )
    for page, text in sorted(WITH_README.items())
    for number, (kind, block) in enumerate(FENCED.findall(text))
    # one needs a cluster; the tutorial's follow its steps
    if kind == "python" and "dask_jobqueue" not in block and page != "tutorial.md"
]


@pytest.mark.few(8)
@pytest.mark.parametrize(("page", "number"), PYTHON)
def test_examples_run(page, number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, block = FENCED.findall(WITH_README[page])[number]
    exec(compile(block, f"{page}, block {number}", "exec"), {"__name__": "example"})
    assert list(tmp_path.iterdir()) == []


def test_configurations_that_are_shown_are_valid():
    shown = [
        text
        for page in PAGES.values()
        for kind, text in FENCED.findall(page)
        if kind == "yaml" and not text.startswith("# yaml-language-server")
    ]
    assert shown
    # what shows no problem is a part of the shipped example
    head = (ROOT / "configs" / "fit-response.yaml").read_text().partition("\nfit:")[0] + "\n"
    for text in shown:
        if text.startswith("fit:"):
            assert parse_config(head + text, "shown.yaml", base=ROOT).experiments
        else:
            # files stand beside the configuration, or below the folder of the program
            base = ROOT if "configs/" in text else ROOT / "configs"
            assert parse_config(text, "shown.yaml", base=base).experiments


def cells(page: str, header: str) -> list[list[str]]:
    """The rows of the table with this header, words stripped."""
    _, found, after = PAGES[page].partition(f"{header}\n")
    assert found, header
    lines = after.split("\n\n")[0].splitlines()[1:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_a_new_configuration_may_come_with_its_schema(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert here("new", "first").stdout.split() == ["first.yaml"]
    made = here("new", "second", "--schema")
    assert made.stdout.split() == ["second.yaml", "fvi.schema.json"]
    modeline = (tmp_path / "second.yaml").read_text(encoding="utf-8").splitlines()[0]
    assert modeline in dict(FENCED.findall(PAGES["how-to/inputs.md"]))["yaml"]
    schema = tmp_path / modeline.partition("$schema=")[2]
    assert "$defs" in json.loads(schema.read_text(encoding="utf-8"))
    for name in ("first", "second"):
        assert here("check", f"{name}.yaml").exit_code == 0


@pytest.mark.parametrize(
    ("typed", "proposed"),
    [
        ("fvi sta", {"stability"}),
        ("fvi run damped", {"damped-oscillator", "damped-oscillator-comparison"}),
        ("fvi plot damped-oscillator ken", set()),
        ("fvi cost cost-pend", {"cost-pendulum"}),
    ],
)
def test_the_shell_completes(typed, proposed):
    words = typed.split(" ")
    environment = {
        "_FVI_COMPLETE": "complete_bash",
        "COMP_WORDS": typed,
        "COMP_CWORD": str(len(words) - 1),
    }
    done = CliRunner().invoke(app(), [], prog_name="fvi", env=environment)
    assert set(done.stdout.split()) == proposed


def test_the_citation_is_complete():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert citation["version"] == re.search(r"^## (\S+) - \d{4}", changes, re.MULTILINE)[1]
    assert citation["preferred-citation"]["url"] in (ROOT / "README.md").read_text(encoding="utf-8")
