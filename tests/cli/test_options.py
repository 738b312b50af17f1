"""Short names of options, the variable of the environment, and the help."""

import pytest
from typer.testing import CliRunner

from fvi_cli.cli.app import app

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
