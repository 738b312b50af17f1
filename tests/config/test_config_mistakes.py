"""Every kind of mistake: what is said of it, and where."""

import itertools
from pathlib import Path

import pytest

from fvi_cli.config import load_config, parse_config
from fvi_cli.errors import ConfigError

VALID = """\
name: example
problem:
  kind: bagley-torvik
  mass: 1.0
  stiffness: 1.0
  damping: [{order: 1.5, coefficient: 1.0}]
  derivative: caputo
  forcing: 1 + t
  initial: {position: 1.0, velocity: 1.0}
  final_time: 1.0
  exact: t + 1
method:
  - {bdf: [1, 2], sampling: nodes, degree: 1}
ladder: {steps: [2, 4, 8]}
report: {norm: max}
expect: {bdf2: unstable}
"""
PENDULUM = "name: p\nproblem: {kind: pendulum, final_time: 2.0}\nladder: {steps: [4]}\n"
DERIVATIVE = (
    "name: d\nproblem: {kind: fractional-derivative, order: 0.5, function: t**2, final_time: 1.0, "
    "exact: t}\nmethod: {bdf: 1}\nladder: {steps: [4]}\n"
)


def complaints_about(text: str, **options: object) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "f.yaml", **options)
    return caught.value.complaints


def test_the_configuration_in_which_mistakes_are_made_is_valid():
    assert [parse_config(text, "f.yaml").name for text in (VALID, PENDULUM, DERIVATIVE)] == [
        "example",
        "p",
        "d",
    ]


def test_a_text_that_is_too_large_is_refused():
    (line,) = complaints_about("#" * 1_000_001)
    assert line.startswith("f.yaml:1:1: more than 1000000 characters: too large")


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


def test_names_of_experiments_differ_also_where_case_is_ignored():
    one = (
        "  - {{name: {}, problem: {{kind: pendulum, final_time: 1}}, ladder: {{steps: 4}}, "
        "method: {{bdf: 1}}}}\n"
    )
    text = "experiments:\n" + one.format("first") + one.format("First")
    (line,) = complaints_about(text)
    assert line == "f.yaml:3:12: experiments.1.name: 'First' is the name of experiments.0 already"
    assert len(parse_config(text.replace("First", "second"), "f.yaml").experiments) == 2


def test_a_file_name_that_is_no_name_needs_a_name():
    text = PENDULUM.removeprefix("name: p\n")
    assert parse_config(text, "some/where/pendulum.yaml").name == "pendulum"
    (line,) = complaints_about_named(text, "my file.yaml")
    assert line.startswith("my file.yaml:1:1: name: missing")


def complaints_about_named(text: str, source: str) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, source)
    return caught.value.complaints


def test_at_most_a_hundred_complaints_are_printed():
    text = VALID + "".join(f"unknown{i}: 1\n" for i in range(150))
    lines = complaints_about(text)
    assert len(lines) == 101
    assert lines[-1] == "... and 50 more"


class TestFiles:
    def test_not_utf_8(self, tmp_path):
        path = tmp_path / "f.yaml"
        path.write_bytes(b"name: a\nx: gr\xf6sse\n")
        with pytest.raises(ConfigError, match=r"f.yaml:2:6: not UTF-8 \(byte 0xf6\)"):
            load_config(path)

    def test_utf_16(self, tmp_path):
        path = tmp_path / "f.yaml"
        path.write_bytes(VALID.encode("utf-16"))
        with pytest.raises(ConfigError, match=r"f.yaml:1:1: not UTF-8"):
            load_config(path)

    def test_too_large(self, tmp_path):
        path = tmp_path / "f.yaml"
        path.write_bytes(b"#" * 1_000_001)
        with pytest.raises(ConfigError, match=r"f.yaml:1:1: more than 1000000 characters"):
            load_config(path)

    def test_a_byte_order_mark_is_harmless(self, tmp_path):
        path = tmp_path / "f.yaml"
        path.write_bytes(b"\xef\xbb\xbf" + VALID.encode())
        assert load_config(path).text == VALID

    @pytest.mark.parametrize("name", ["missing.yaml", "."])
    def test_not_readable(self, tmp_path, name):
        with pytest.raises(ConfigError, match="cannot be read"):
            load_config(tmp_path / name)

    def test_nothing_is_written(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        Path("good.yaml").write_text(VALID)
        Path("bad.yaml").write_text(VALID.replace("1 + t", "__import__('os').mkdir('x')"))
        load_config(Path("good.yaml"))
        with pytest.raises(ConfigError):
            load_config(Path("bad.yaml"))
        assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.yaml", "good.yaml"]
