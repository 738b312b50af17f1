"""Short names of options, the variable of the environment, and the help."""

import pytest
from command_line import fvi
from typer.testing import CliRunner

from fvi_cli.cli.app import COMMANDS, GROUPS, app

QUICK = (
    "bagley-torvik-1-2",
    *("--set", "ladder.steps=[4]", "--set", "method={bdf: 1}", "--set", "claims={}", "-q"),
)


@pytest.mark.parametrize(
    ("options", "variable"), [(("-o", "here"), "there"), ((), "here"), (("--output", "here"), "")]
)
def test_the_folder_is_an_option_or_a_variable(options, variable, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    environment = {"FVI_OUTPUT": variable} if variable else {}
    done = CliRunner(env=environment).invoke(app(["run"]), ["run", *QUICK, *options, "-j", "1"])
    assert done.exit_code == 0, done.output
    assert [path.name for path in tmp_path.iterdir()] == ["here"]
    assert (tmp_path / "here" / "bagley-torvik-1-2.h5").is_file()


def test_summaries_are_whole_on_a_screen_of_80_columns():
    shown = fvi("--help").stdout
    assert max(map(len, shown.splitlines())) <= 80
    words = " ".join(shown.split())
    for command in COMMANDS:
        assert command.summary.endswith(".")
        assert command.summary in words
    assert "..." not in words.replace("[ARGS]...", "")


def test_short_help_lists_commands_in_groups_and_shows_examples():
    words = fvi("-h", code=0).stdout
    places = [words.index(f"\n{title}:\n") for title in GROUPS]
    assert places == sorted(places)
    for name in ("run", "convergence", "plot", "cost", "fit"):
        shown = fvi(name, "-h", code=0).stdout
        assert f"  fvi {name} " in shown.partition("Examples:")[2]
    clusters = fvi("run", "-h").stdout.partition("Options for clusters:")[2]
    assert {"--dask", "--shard", "--wait"} <= set(clusters.split())
    assert "Examples" not in fvi("merge", "-h", code=0).stdout
