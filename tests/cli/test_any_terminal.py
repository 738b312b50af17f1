"""What is printed can be printed on any terminal: signs that it lacks are escaped."""

import io
import re
import sys

import pytest
from command_line import fvi

from fvi_cli.__main__ import main

CONFIG = """\
problem: {kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0}
method: {bdf: 1}
ladder: {steps: [4]}
name: x
"""


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "utf-8"])
@pytest.mark.parametrize("name", ["γ", "\udcff", "ü"])
def test_names_of_files_are_printed(tmp_path, monkeypatch, encoding, name):
    monkeypatch.chdir(tmp_path)
    try:
        (tmp_path / f"{name}.yaml").write_text(CONFIG)
    except (OSError, UnicodeError):
        pytest.skip("no file of that name on this system")
    out, err = io.BytesIO(), io.BytesIO()
    for stream, buffer in (("stdout", out), ("stderr", err)):
        wrapped = io.TextIOWrapper(buffer, encoding=encoding, errors="strict")
        monkeypatch.setattr(sys, stream, wrapped)
    for words, code in ((("check", f"{name}.yaml"), 0), (("check", f"{name}-.yaml"), 2)):
        monkeypatch.setattr(sys, "argv", ["fvi", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == code
    sys.stdout.flush()
    sys.stderr.flush()
    found, told = out.getvalue(), err.getvalue()
    monkeypatch.undo()
    printed = name.encode(encoding, "backslashreplace") + b".yaml: valid, 1 experiment, 1 run"
    assert found.startswith(printed)
    assert b"unexpected" not in told


class Terminal(io.TextIOWrapper):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("columns", [1, 30, 80, 200])
def test_titles_are_wrapped_between_words(monkeypatch, columns):
    printed = fvi("list").stdout
    out = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", Terminal(out, encoding="utf-8"))
    monkeypatch.setattr(sys, "argv", ["fvi", "list"])
    monkeypatch.setenv("COLUMNS", str(columns))
    with pytest.raises(SystemExit):
        main()
    sys.stdout.flush()
    shown = out.getvalue().decode()
    parts = re.compile(r"[^\s-]+")  # no word is broken but at its hyphens
    assert parts.findall(shown) == parts.findall(printed)
    longest = max(map(len, shown.splitlines()))
    assert longest <= columns or columns < 80
    # the control: elsewhere nothing is wrapped
    assert longest < max(map(len, printed.splitlines())) or columns > 80
