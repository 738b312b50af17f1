"""The generated parts of docs/reference/: ``python docs/site/reference.py`` writes them."""

from __future__ import annotations

import itertools
from collections import Counter
from pathlib import Path
from typing import Any

import typer
from keys import configuration_reference

from fvi_cli.cli.app import app
from fvi_cli.cli.command import COMMANDS
from fvi_cli.storage.fields import FIELDS

PAGES = Path(__file__).parents[1] / "reference"
BEGIN, END = "<!-- begin generated -->\n", "<!-- end generated -->\n"
COMMON = 3
"""Options of so many commands stand in one table for all."""
FORMS = {False: "number or text", True: "JSON"}


def commands() -> str:
    """Every command with its arguments, options and examples."""
    known: dict[str, Any] = typer.main.get_command(app()).commands
    options = {name: [_row(one) for one in command.params if _is_option(one)]
               for name, command in known.items()}  # fmt: skip
    count = Counter(row for rows in options.values() for row in rows)
    lines = ["", "| option of several commands | effect |", "|---|---|"]
    lines += [row for row, number in count.items() if number >= COMMON]
    for group, members in itertools.groupby(COMMANDS, key=lambda one: one.panel):
        lines += ["", f"## {group}"]
        for member in members:
            command, rows = known[member.name], options[member.name]
            arguments = [one for one in command.params if not _is_option(one)]
            usage = " ".join(["fvi", member.name, "[OPTIONS]", *map(_called, arguments)])
            lines += ["", f"### fvi {member.name}", "", f"    {usage}", "", command.help]
            helped = [f"- `{_called(one)}`: {one.help}" for one in arguments if one.help]
            own = [row for row in rows if count[row] < COMMON]
            common = [row.split("`")[1].split()[0].rstrip(",") for row in rows if row not in own]
            lines += ["", *helped] if helped else []
            lines += ["", "| option | effect |", "|---|---|", *own] if own else []
            lines += ["", f"Also: {', '.join(f'`{one}`' for one in common)}."] if common else []
    return "\n".join([*lines, "", ""])


def _is_option(parameter: Any) -> bool:
    return bool(parameter.param_type_name == "option")


def _called(argument: Any) -> str:
    name = argument.metavar or argument.name.upper()
    return f"{name}..." if argument.nargs == -1 and not name.endswith("...") else name


def _row(option: Any) -> str:
    names = ", ".join(sorted(option.opts, key=len, reverse=True))
    names += "".join(f" / {other}" for other in option.secondary_opts)
    value = "" if option.is_flag else f" {option.metavar or 'TEXT'}"
    text = option.help or ""
    if not option.is_flag and option.default not in (None, (), [], ""):
        text += f" Default: {option.default}."
    return f"| `{names}{value.replace('|', chr(92) + '|')}` | {text} |"


def files() -> str:
    """Every array and attribute of a run in a result file."""
    lines = ["", "## Arrays of a run", "", "| dataset | axes | meaning |", "|---|---|---|"]
    lines += [
        f"| `{one.name}` | {', '.join(f'`{axis}`' for axis in one.axes)} | {one.meaning} |"
        for one in FIELDS.values()
        if one.axes
    ]
    lines += ["", "`*` is a name of your own. Axes have dimension scales of the same name."]
    lines += [
        "",
        "## Attributes of a run",
        "",
        "| attribute | written as | meaning |",
        "|---|---|---|",
    ]
    lines += [
        f"| `{f.name}` | {FORMS[f.is_json]} | {f.meaning} |" for f in FIELDS.values() if not f.axes
    ]
    return "\n".join([*lines, "", ""])


def pages() -> dict[Path, str]:
    """The pages with their generated parts anew."""
    made = {PAGES / "configuration.md": configuration_reference()}
    for make in (commands, files):
        path = PAGES / f"{make.__name__}.md"
        head, _, rest = path.read_text(encoding="utf-8").partition(BEGIN)
        made[path] = head + BEGIN + make() + END + rest.partition(END)[2]
    return made


if __name__ == "__main__":
    for page, text in pages().items():
        page.write_text(text, encoding="utf-8")
