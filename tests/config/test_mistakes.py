"""Mistakes in configurations, with all that is said of each, word by word and with its place.

``tests/mistakes/*.yaml`` holds them: a text, or a valid one (`text` of the file) in which `write`
stands `in place of` something else, changes by ``--set``, and what is told of it, or remarked on
where it is valid; `files` of all or of one stand beside it. What is told may say what to write:
`mended` has this in place of something of the text, or as what is ``set``, and is valid. Where the
words change on purpose, ``pytest --renew tests/config/test_mistakes.py`` writes what is told now;
read the difference.
"""

import logging
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import yaml

from fvi_cli.config import memory, parse_config
from fvi_cli.errors import ConfigError

FILES = sorted((Path(__file__).parent.parent / "mistakes").glob("*.yaml"))
NAME = "f.yaml:"


@cache
def content_of(file: Path) -> dict[str, Any]:
    # both are safe loaders; the one in C is far faster, where it is there
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return yaml.load(file.read_text(encoding="utf-8"), loader)


def changed(text: str, change: dict[str, Any]) -> str:
    """The text with what a mistake, or the mending of one, has in place of a part of it."""
    if "in place of" not in change:
        return change.get("text", text)
    assert text.count(change["in place of"]) == 1
    return text.replace(change["in place of"], change["write"])


def text_of(mistake: dict[str, Any], content: dict[str, Any]) -> str:
    return changed(content.get("text", ""), mistake)


def said_of(
    mistake: dict[str, Any], content: dict[str, Any], mended: dict[str, Any] | None = None
) -> dict[str, list[str]]:
    """What is told of it, or of what is mended in it; remarks where it is valid."""
    text = changed(text_of(mistake, content), mended or {})
    overrides = (mended or mistake).get("set", [])
    listener, logger = logging.Handler(logging.WARNING), logging.getLogger("fvi_cli")
    remarks: list[str] = []
    listener.emit = lambda record: remarks.append(record.getMessage())
    logger.addHandler(listener)
    try:
        with TemporaryDirectory() as folder:
            for name, written in (content.get("files", {}) | mistake.get("files", {})).items():
                (Path(folder) / name).write_text(written, encoding="utf-8")
            source = NAME.removesuffix(":")
            parse_config(text, source, overrides=overrides, base=Path(folder))
    except ConfigError as error:
        return {"told": [line.removeprefix(NAME) for line in error.complaints]}
    finally:
        logger.removeHandler(listener)
    return {"remarked": [line.removeprefix(NAME) for line in remarks]}


def mistakes() -> Iterator[Any]:
    for file in FILES:
        for number in range(len(content_of(file)["mistakes"])):
            yield pytest.param(file, number, id=f"{file.stem}-{number}")


@pytest.fixture(scope="module", autouse=True)
def _renewed(request):
    """Write what is told now, where that is asked for."""
    if request.config.getoption("--renew"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(memory, "machine_bytes", lambda: 8 * 10**9)
            renew()


@pytest.mark.parametrize(("file", "number"), list(mistakes()))
def test_what_is_told_of_a_mistake(file, number, monkeypatch):
    monkeypatch.setattr(memory, "machine_bytes", lambda: 8 * 10**9)
    content = content_of(file)
    mistake = content["mistakes"][number]
    said = said_of(mistake, content)
    assert said == {key: mistake[key] for key in ("told", "remarked") if key in mistake}
    if mended := mistake.get("mended"):
        assert "remarked" in said_of(mistake, content, mended)
        for written in mended.get("set", [mended.get("write")]):
            assert any(written in line for line in said["told"]), written


def test_every_mistake_stands_once_in_its_file():
    for file in FILES:
        found = [
            (text_of(one, content_of(file)), f"{one.get('set')}{one.get('files')}")
            for one in content_of(file)["mistakes"]
        ]
        assert len(set(found)) == len(found), file


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
            one.update(said_of(one, content))
        written = yaml.dump(
            content, Dumper=Readable, sort_keys=False, allow_unicode=True, width=999
        )
        file.write_text(written, encoding="utf-8")
    content_of.cache_clear()
