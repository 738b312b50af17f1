"""Every kind of mistake: what is said of it, and where."""

import itertools
from pathlib import Path

import pytest

from fvi_cli.config import load_config, parse_config
from fvi_cli.errors import ConfigError

PENDULUM = "name: p\nproblem: {kind: pendulum, final_time: 2.0}\nladder: {steps: [4]}\n"


def complaints_about(text: str, **options: object) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "f.yaml", **options)
    return caught.value.complaints


def test_too_many_entries_are_refused_soon():
    (line,) = complaints_about("a: [" + "1," * 60_000 + "]")
    assert "more than 50000 values" in line


def test_anchors_cannot_multiply_without_limit():
    names = "abcdefgh"
    text = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
        f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n" for old, new in itertools.pairwise(names)
    )
    (line,) = complaints_about(text)
    assert line.startswith("f.yaml:1:")
    assert "with repeated ones" in line


def test_a_file_name_that_is_no_name_needs_a_name():
    text = PENDULUM.removeprefix("name: p\n")
    assert parse_config(text, "some/where/pendulum.yaml").name == "pendulum"
    with pytest.raises(ConfigError, match=r"my file\.yaml:1:1: name: missing"):
        parse_config(text, "my file.yaml")


class TestFiles:
    def test_not_utf_8(self, tmp_path):
        path = tmp_path / "f.yaml"
        path.write_bytes(b"name: a\nx: gr\xf6sse\n")
        with pytest.raises(ConfigError, match=r"f.yaml:2:6: not UTF-8 \(byte 0xf6\)"):
            load_config(path)

    def test_a_byte_order_mark_is_harmless(self, tmp_path):
        path = tmp_path / "f.yaml"
        path.write_bytes(b"\xef\xbb\xbf" + PENDULUM.encode())
        assert load_config(path).text == PENDULUM

    def test_nothing_is_written(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        Path("bad.yaml").write_text(PENDULUM.replace("2.0", "2.0, forcing: __import__('os')"))
        with pytest.raises(ConfigError):
            load_config(Path("bad.yaml"))
        assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.yaml"]
