"""Pages of docs/ say what the program does: they are compared, run, or made by it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import typer
import yaml
from typer.testing import CliRunner

from fvi_cli.cli import app
from fvi_cli.config import configuration_reference, json_schema, shipped_configs
from fvi_cli.output.export import FORMATS
from fvi_cli.scenes.registry import EQUATIONS

ROOT = Path(__file__).parents[1]
PAGES = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md")}
COMMANDS = typer.main.get_command(app).commands
FENCED = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_the_reference_of_keys_is_up_to_date() -> None:
    # if it is not: fvi schema --markdown > docs/configuration.md
    assert PAGES["configuration.md"] == configuration_reference()
    printed = CliRunner().invoke(app, ["schema", "--markdown"])
    assert printed.stdout == configuration_reference()


def test_the_reference_names_every_key_of_the_schema() -> None:
    def keys(schema: object) -> set[str]:
        if isinstance(schema, list):
            return set().union(*map(keys, schema))
        if not isinstance(schema, dict):
            return set()
        found = schema.get("properties", {})
        return set(found).union(*map(keys, schema.values()))

    cells = re.findall(r"^\| `([^`]+)` \|", configuration_reference(), re.MULTILINE)
    named = {part.removesuffix("[]") for cell in cells for part in cell.split(".")}
    assert keys(json_schema()) - named == {"kind", "experiments"}
    assert all(f"\n### {kind}\n" in configuration_reference() for kind in EQUATIONS)


@pytest.mark.parametrize("page", sorted(PAGES))
def test_what_is_linked_is_there(page: str) -> None:
    for link in re.findall(r"\]\((?!http)([^)]+)\)", PAGES[page]):
        path, _, place = link.partition("#")
        target = ROOT / "docs" / path if path else ROOT / "docs" / page
        assert target.exists(), link
        if place:
            headings = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            assert place in {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in headings}


@pytest.mark.parametrize("page", sorted(PAGES))
def test_commands_that_are_shown_exist(page: str) -> None:
    lines = [line for kind, text in FENCED.findall(PAGES[page]) if kind == "sh" for line in [text]]
    shown = re.findall(r"`(fvi [^`]+)`", PAGES[page]) + "".join(lines).splitlines()
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


def test_a_new_configuration_comes_with_its_schema(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    made = CliRunner().invoke(app, ["new", "first"])
    assert made.stdout.split() == ["first.yaml"]
    assert "fvi.schema.json" in made.stderr
    modeline = (tmp_path / "first.yaml").read_text(encoding="utf-8").splitlines()[0]
    assert modeline in dict(FENCED.findall(PAGES["editors.md"]))["yaml"]
    assert (tmp_path / modeline.partition("$schema=")[2]).is_file()
    schema = tmp_path / "fvi.schema.json"
    assert schema.read_text(encoding="utf-8") == CliRunner().invoke(app, ["schema"]).stdout
    # it is there already; then an older one; then a file of somebody else
    assert "schema" not in CliRunner().invoke(app, ["new", "second"]).output
    schema.write_text(json.dumps({"title": json_schema()["title"]}), encoding="utf-8")
    assert "fvi.schema.json" in CliRunner().invoke(app, ["new", "third"]).stderr
    assert "$defs" in json.loads(schema.read_text(encoding="utf-8"))
    schema.write_text("mine", encoding="utf-8")
    assert "schema" not in CliRunner().invoke(app, ["new", "fourth"]).output
    assert schema.read_text(encoding="utf-8") == "mine"
    for name in ("first", "second", "third", "fourth"):
        assert CliRunner().invoke(app, ["check", f"{name}.yaml"]).exit_code == 0


@pytest.mark.parametrize(
    ("typed", "proposed"),
    [
        ("fvi sta", {"stability"}),
        ("fvi run --allow", {"--allow-unstable"}),
        ("fvi run damped", {"damped-oscillator", "damped-oscillator-comparison"}),
        ("fvi plot damped-oscillator ken", set()),
        ("fvi cost cost-pend", {"cost-pendulum"}),
        ("fvi new mine --kind ", set(EQUATIONS)),
        ("fvi export some.h5 --to ", set(FORMATS)),
    ],
)
def test_the_shell_completes(typed: str, proposed: set[str]) -> None:
    words = typed.split(" ")
    environment = {
        "_FVI_COMPLETE": "complete_bash",
        "COMP_WORDS": typed,
        "COMP_CWORD": str(len(words) - 1),
    }
    done = CliRunner().invoke(app, [], prog_name="fvi", env=environment)
    assert set(done.stdout.split()) == proposed


def test_every_shipped_configuration_is_proposed() -> None:
    from fvi_cli.commands.completion import shipped_names

    assert shipped_names("") == list(shipped_configs())


def test_the_citation_is_complete() -> None:
    from fvi_cli import __version__

    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["version"] == __version__
    assert citation["preferred-citation"]["url"] in (ROOT / "README.md").read_text(encoding="utf-8")
