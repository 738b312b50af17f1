"""Mistakes in configurations, each with its line and its key.

``tests/mistakes/*.yaml`` holds them: a text, or a valid one (`text` of the file) in which `write`
stands `in place of` something else, changes by ``--set``, and where something is told of it, or
remarked on where it is valid: line, column and key; `files` of all or of one stand beside it.
``pytest --renew tests/config/test_mistakes.py`` writes the places that are told now.
"""

import logging
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import yaml

from fvi_cli.config import machine, parse_config
from fvi_cli.errors import ConfigError

FILES = sorted((Path(__file__).parent.parent / "mistakes").glob("*.yaml"))


@cache
def content_of(file: Path) -> dict[str, Any]:
    # both are safe loaders; the one in C is far faster, where it is there
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return yaml.load(file.read_text(encoding="utf-8"), loader)


def text_of(mistake: dict[str, Any], content: dict[str, Any]) -> str:
    """The text with what a mistake has in place of a part of it."""
    text = content.get("text", "")
    if "in place of" not in mistake:
        return mistake.get("text", text)
    assert text.count(mistake["in place of"]) == 1
    return text.replace(mistake["in place of"], mistake["write"])


def said_of(mistake: dict[str, Any], content: dict[str, Any]) -> dict[str, list[str]]:
    """What is told of it; remarks where it is valid."""
    text, overrides = text_of(mistake, content), mistake.get("set", [])
    listener, logger = logging.Handler(logging.WARNING), logging.getLogger("fvi_cli")
    remarks: list[str] = []
    listener.emit = lambda record: remarks.append(record.getMessage())
    logger.addHandler(listener)
    try:
        with TemporaryDirectory() as folder:
            for name, written in (content.get("files", {}) | mistake.get("files", {})).items():
                (Path(folder) / name).write_text(written, encoding="utf-8")
            parse_config(text, "f.yaml", overrides=overrides, base=Path(folder))
    except ConfigError as error:
        return {"told": list(error.complaints)}
    finally:
        logger.removeHandler(listener)
    return {"remarked": remarks}


def place_of(line: str) -> str:
    """Line, column and key of a message: ``11:3 designs.Bare``; an option in place of a line."""
    found = re.match(r"(?:f\.yaml:)?(\d+:\d+|[^:]*): (?:([^ ]*?): )?", line)
    return f"{found[1]} {found[2] or ''}".strip()


def places_of(said: dict[str, list[str]]) -> dict[str, list[str]]:
    return {key: [place_of(line) for line in lines] for key, lines in said.items()}


def without_columns(told: dict[str, list[str]]) -> dict[str, list[str]]:
    return {key: sorted(re.sub(r":\d+", "", one) for one in told[key]) for key in told}


def mistakes() -> Iterator[Any]:
    for file in FILES:
        for number in range(len(content_of(file)["mistakes"])):
            yield pytest.param(file, number, id=f"{file.stem}-{number}")


@pytest.fixture(scope="module", autouse=True)
def _renewed(request):
    """Write what is told now, where that is asked for."""
    if request.config.getoption("--renew"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(machine, "machine_bytes", lambda: 8 * 10**9)
            renew()


@pytest.mark.few(240)
@pytest.mark.parametrize(("file", "number"), list(mistakes()))
def test_what_is_told_of_a_mistake(file, number, monkeypatch):
    monkeypatch.setattr(machine, "machine_bytes", lambda: 8 * 10**9)
    content = content_of(file)
    mistake = content["mistakes"][number]
    said = said_of(mistake, content)
    expected = {key: mistake[key] for key in ("told", "remarked") if key in mistake}
    assert without_columns(places_of(said)) == without_columns(expected), said


class Readable(yaml.SafeDumper):
    """Texts of several lines as they stand in files."""

    def represent_str(self, text: str) -> yaml.ScalarNode:
        style = "|" if "\n" in text else '"' if "'" in text else None
        return self.represent_scalar("tag:yaml.org,2002:str", text, style=style)


Readable.add_representer(str, Readable.represent_str)


def renew() -> None:
    for file in FILES:
        content = content_of(file)
        for one in content["mistakes"]:
            for key in ("told", "remarked"):
                one.pop(key, None)
            one.update(places_of(said_of(one, content)))
        written = yaml.dump(
            content, Dumper=Readable, sort_keys=False, allow_unicode=True, width=999
        )
        file.write_text(written, encoding="utf-8")
    content_of.cache_clear()
