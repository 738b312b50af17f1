"""Calls from Python that are refused, as their files show them: what is written, and what is said.

``tests/calls/*.txt`` have statements behind ``>>>`` and ``...``, and below each the error that it
raises; nothing stands below those that are right. ``pytest --renew`` writes what is said now; read
the difference.
"""

import re
from pathlib import Path

import pytest
from test_sessions import differences

CALLS = sorted((Path(__file__).parent / "calls").glob("*.txt"))


def statements_of(text: str) -> tuple[str, list[tuple[str, str]]]:
    """What stands before the statements, and these as they stand, with what is said."""
    head, *parts = re.split(r"^(?=>>> )", text, flags=re.MULTILINE)
    found = []
    for part in parts:
        (written,) = re.findall(r"\A>>> .*\n(?:\.\.\. .*\n)*", part)
        found.append((written, part.removeprefix(written).strip()))
    return head, found


def said_of(written: str, names: dict[str, object]) -> str:
    statement = re.sub(r"^(>>>|\.\.\.) ", "", written, flags=re.MULTILINE)
    try:
        exec(compile(statement, "call", "exec"), names)
    except Exception as error:
        # but for the place in memory
        return re.sub(r"0x[0-9a-f]+", "0x", f"{type(error).__name__}: {error}")
    return ""


@pytest.mark.parametrize("path", CALLS, ids=lambda path: path.stem)
def test_a_call_is_answered_as_its_file_shows(path, request, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    head, statements = statements_of(path.read_text(encoding="utf-8"))
    found = [(written, shown, said_of(written, names)) for written, shown in statements]
    if request.config.getoption("--renew"):
        path.write_text(
            head + "".join(f"{written}{said}\n" if said else written for written, _, said in found),
            encoding="utf-8",
        )
        return
    for written, shown, said in found:
        assert differences(shown, said) == [], written


def test_another_word_and_another_number_are_seen():
    """The control."""
    (call,) = statements_of(">>> int('a')\n... \nValueError: 1 is no number\n")[1]
    assert call[1] == "ValueError: 1 is no number"
    assert said_of(call[0], {}) == "ValueError: invalid literal for int() with base 10: 'a'"
    assert differences(call[1], call[1].replace("1", "2")) != []
    assert differences(call[1], "") != []
    assert said_of(">>> int(1)\n", {}) == ""
