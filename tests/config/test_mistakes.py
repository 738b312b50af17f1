"""Mistakes in configurations, with all that is said of each, word by word and with its place.

``tests/mistakes/*.yaml`` holds them: a text, or a valid one (`text` of the file) in which `write`
stands `in place of` something else, changes by ``--set``, and what is told; `files` of all or of
one stand beside it. Where the words change
on purpose, ``pytest --renew tests/config/test_mistakes.py`` writes what is told now; read the
difference.
"""

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
    return yaml.safe_load(file.read_text(encoding="utf-8"))


def text_of(mistake: dict[str, Any], valid: str) -> str:
    """The text with the mistake."""
    if "in place of" not in mistake:
        return mistake.get("text", valid)
    assert valid.count(mistake["in place of"]) == 1
    return valid.replace(mistake["in place of"], mistake["write"])


def told_of(mistake: dict[str, Any], content: dict[str, Any]) -> list[str]:
    """What is said of it."""
    text, overrides = text_of(mistake, content.get("text", "")), mistake.get("set", [])
    with TemporaryDirectory() as folder:
        for name, written in (content.get("files", {}) | mistake.get("files", {})).items():
            (Path(folder) / name).write_text(written, encoding="utf-8")
        with pytest.raises(ConfigError) as caught:
            parse_config(text, NAME.removesuffix(":"), overrides=overrides, base=Path(folder))
    return [line.removeprefix(NAME) for line in caught.value.complaints]


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
    assert told_of(mistake, content) == mistake["told"]


def test_there_are_mistakes_in_every_file_and_the_texts_around_them_are_others():
    assert len(FILES) > 10
    for file in FILES:
        found = [
            (text_of(one, content_of(file).get("text", "")), f"{one.get('set')}{one.get('files')}")
            for one in content_of(file)["mistakes"]
        ]
        assert len(set(found)) == len(found) > 4, file


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
            one["told"] = told_of(one, content)
        written = yaml.dump(
            content, Dumper=Readable, sort_keys=False, allow_unicode=True, width=999
        )
        file.write_text(written, encoding="utf-8")
    content_of.cache_clear()
