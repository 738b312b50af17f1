"""``--json``: one document on standard output, nothing else, with the keys that docs promise."""

import json
import re
from pathlib import Path

import pytest
from command_line import fvi as command
from spread import spread

from fvi_cli.config import shipped_configs
from fvi_cli.runner.compute import plan

DOCS = Path(__file__).parents[2] / "docs" / "reference" / "python.md"
QUICK = ("bagley-torvik-1-2", "--set", "ladder.steps=[4, 8]")


def document(*arguments: str, code: int = 0) -> dict:
    result = command(*arguments)
    assert result.exit_code == code, result.output
    found = json.loads(result.stdout, parse_constant=pytest.fail)
    assert found.pop("format") == 1
    return found


def promised(head: str) -> set[str]:
    """The keys that the page names for one command."""
    page = DOCS.read_text(encoding="utf-8")
    (line,) = re.findall(rf"^\| `{re.escape(head)}` \|(.*)\|$", page, re.MULTILINE)
    return set(re.findall(r"`(\w+)`", line))


def test_a_run_and_what_is_stored_of_it(tmp_path):
    made = document("run", *QUICK, "--json", "-o", str(tmp_path))
    assert made["files"] == [(tmp_path / "bagley-torvik-1-2.h5").as_posix()]
    assert set(made) | set(made["runs"][0]) > promised("run --json")
    shown = document("show", made["files"][0], "--json")
    assert set(shown) | set(shown["runs"][0]) > promised("show --json")
    for key in ("case", "n_steps", "error", "status"):
        assert [run[key] for run in shown["runs"]] == [run[key] for run in made["runs"]]
    planned = document("run", *QUICK, "--dry-run", "--json", "-o", str(tmp_path))
    assert set(planned) | set(planned["tasks"][0]) == promised("--dry-run --json")
    assert {run["action"] for run in planned["tasks"]} == {"reuse"}


REPORTS = {  # what each command is asked, a table of its document, and whether it can be checked
    ("modes", "sandwich-beam"): ("modes", True),
    ("response", "sandwich-beam", "--frequency", "0.1:1:5", "--force", "x1"): ("peaks", True),
    ("stability", *QUICK): ("runs", True),
    ("convergence", *QUICK): ("runs", True),
    ("cost", *QUICK, "--set", "method={bdf: [1, 2]}", "--set", "claims={}"): ("runs", False),
}


@spread(few=1, arguments=list(REPORTS))
def test_reports_are_documents_of_the_rows_of_their_tables(arguments, tmp_path):
    sheet, is_checked = REPORTS[arguments]
    made = document(*arguments, "--json", "-o", str(tmp_path))
    assert isinstance(made[sheet], list)
    assert all(Path(file).is_file() for file in made["files"])
    planned = document(*arguments, "--dry-run", "--json", "-o", str(tmp_path))
    (rows,) = planned.values()
    assert {row["experiment"] for row in rows}
    if is_checked:
        again = document(*arguments, "--check", "--json", "-o", str(tmp_path))
        assert again.pop("differences") == []
        assert again == {name: rows for name, rows in made.items() if name != "files"}


def test_a_check_lists_experiments():
    good = document("check", "bagley-torvik-1-2", "accuracy", "--json")
    rows = good["experiments"]
    assert set(good) | set(rows[0]) == promised("check --json")
    assert rows[0]["experiment"] == "bagley-torvik-1-2"
    assert len(rows) > 2
    bad = command("check", *QUICK, "--set", "probelm=1", "--json", code=2)
    assert "did you mean 'problem'" in bad.stderr


LONG_PLANS = ("full-order", "ensemble", "response-spectrum")


@pytest.mark.few(8)
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow if n in LONG_PLANS else ()) for n in shipped_configs()],
)
def test_every_shipped_configuration_can_be_run(name, tmp_path):
    """None is refused, though some are predicted to blow up."""
    assert {one.action for one in plan(name, output=tmp_path)} == {"compute"}
