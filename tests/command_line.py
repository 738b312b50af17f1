"""The command line, called in this process."""

import csv
from pathlib import Path

from click.testing import Result
from typer.testing import CliRunner

from fvi_cli.cli.app import app

MANY = """\
name: many
problem:
  kind: damped-oscillator
  damping: [{order: 0.5, coefficient: 0.3}]
  initial: {position: 1.0}
  final_time: 4.0
"""
"""The problem of a sweep."""
LADDER = """\
name: quick
problem:
  kind: bagley-torvik
  damping: [{order: 1.5, coefficient: 1.0}]
  forcing: 15/4*sqrt(t) + 15/8*sqrt(pi)*t + t**2.5
  initial: {position: 0.0, velocity: 0.0}
  final_time: 1.0
  exact: t**2.5
method: {bdf: [1, 2, 3], sampling: nodes, degree: 1}
ladder: {steps: [4, 8, 16, 24, 32, 48]}
"""


def configuration(
    problem: str,
    *,
    name: str = "made",
    method: str = "{rk: gauss, degree: 2}",
    steps: str = "8, 16",
    more: str = "",
) -> str:
    """The text of a configuration, of what stands in the braces of its problem and so on."""
    chosen = f"method: {method}\n" if method else ""
    return f"name: {name}\nproblem: {{{problem}}}\n{chosen}ladder: {{steps: [{steps}]}}\n{more}"


def fvi(*arguments: object, code: int | None = None) -> Result:
    """What a command answers: never a traceback, and this exit code where one is given."""
    written = [str(argument) for argument in arguments]
    result = CliRunner().invoke(app(written), written)
    assert "Traceback" not in result.output
    assert code is None or result.exit_code == code, result.output
    return result


def rows_of(path: Path) -> list[dict[str, str]]:
    """What a written table holds."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
