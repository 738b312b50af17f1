"""What commands have in common they do alike."""

import pytest
from command_line import fvi

from fvi_cli.cli import exits
from fvi_cli.cli.app import COMMANDS

QUICK = ("bagley-torvik-1-2", "--set", "ladder.steps=[4, 8]")


@pytest.mark.few(2)
@pytest.mark.parametrize("command", ["run", "convergence", "plot"])
def test_a_dry_run_writes_nothing(command, tmp_path):
    result = fvi(command, *QUICK, "--dry-run", "--output", str(tmp_path))
    assert result.exit_code == 0
    assert "memory" in result.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "is_kept"),
    [
        ({"fresh": False}, True),
        ({"fresh": False, "check": True}, False),
        ({"fresh": False, "dry_run": True}, False),
        ({}, False),  # cost, stability: no runs are stored
    ],
)
def test_runs_are_called_stored_only_where_they_are(options, is_kept, capsys):
    def interrupted(**options: bool) -> int:
        raise KeyboardInterrupt

    with pytest.raises(exits.typer.Exit) as ended:
        exits.guarded(interrupted)(**options)
    assert ended.value.exit_code == exits.INTERRUPTED
    assert ("finished runs are stored" in capsys.readouterr().err) == is_kept


def test_the_commands_that_can_ignore_stored_runs_are_those_that_store_them():
    with_fresh = {one.name for one in COMMANDS if "fresh" in one.shared}
    assert with_fresh == {"run", "convergence", "plot", "quantities"}
