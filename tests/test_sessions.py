"""Sessions with the command line, as their files show them: what is typed, and what is answered.

``tests/sessions/*.txt`` begin with the files of their folder, each behind ``--- name``; then come
lines ``$ command`` with what stands on standard output, behind ``!`` what stands on standard error,
and behind ``=`` an exit code that is not 0. Besides ``fvi`` there are ``ls`` (all files below a
folder), ``cat``, ``edit FILE OLD NEW``, and ``| grep WORD``. ``pytest --renew`` writes what is
answered now; read the difference.
"""

import re
import shlex
from pathlib import Path

import command_line
import pytest

SESSIONS = sorted((Path(__file__).parent / "sessions").glob("*.txt"))
CHANGING = (
    # times, sizes, digests, and where the package is
    (re.compile(r"\b[\d.]+(?:e[+-]?\d+)? (s|ms|MB|KB|GB)\b"), r"# \1"),
    (re.compile(r",(ok|failed|diverged|floor|refused),[\d.e-]+,"), r",\1,#,"),
    (re.compile(r"\b[0-9a-f]{40,64}\b"), "#"),
    (re.compile(r"@[0-9a-f]{8}\b"), "@#"),
    (re.compile(r"\d{4}-\d\d-\d\dT[\d:+]+"), "#"),
    (re.compile(r"\S*/(?:shipped_)?configs/"), "configs/"),
    (re.compile(r" +"), " "),
    (re.compile(r"-{3,}"), "-"),
)
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.]*\w)")
ROUND_OFF = 1e-12


def answer(command: str) -> str:
    """What a command of a session answers, as its file shows it."""
    command, _, wanted = command.partition(" | grep ")
    name, *arguments = shlex.split(command)
    lines: list[str] = []
    if name == "fvi":
        done = command_line.fvi(*arguments)
        lines = done.stdout.splitlines()
        lines += [f"! {line}".rstrip() for line in done.stderr.splitlines()]
        lines += [f"= {done.exit_code}"] if done.exit_code else []
    elif name == "ls":
        found = Path(arguments[0]).rglob("*")
        lines = sorted(p.as_posix() for p in found if p.is_file())
    elif name == "cat":
        lines = Path(arguments[0]).read_text(encoding="utf-8").splitlines()
    else:
        assert name == "edit"
        path, old, new = Path(arguments[0]), *(one.replace("\\n", "\n") for one in arguments[1:])
        text = path.read_text(encoding="utf-8")
        assert old in text, f"{path} has no {old!r}"
        path.write_text(text.replace(old, new), encoding="utf-8")
    lines = [line.rstrip() for line in lines if wanted.strip('"') in line]
    # no line of an answer begins like a command
    return "".join(f"{line}\n" for line in lines).replace("\n$ ", "\n\\$ ")


def commands_of(text: str) -> tuple[str, dict[str, str], list[tuple[str, str]]]:
    """What stands before the commands, the files in it, and the commands with their answers."""
    head, *parts = re.split(r"^\$ ", text, flags=re.MULTILINE)
    names = re.split(r"^--- (.*)\n", head, flags=re.MULTILINE)[1:]
    files = dict(zip(names[::2], (text.rstrip() + "\n" for text in names[1::2]), strict=True))
    return head, files, [tuple(part.split("\n", 1)) for part in parts]


def differences(shown: str, made: str) -> list[str]:
    """Lines that differ by more than what changes from day to day and the last digits."""
    texts = []
    for text in (shown, made):
        for pattern, mark in CHANGING:
            text = pattern.sub(mark, text)
        texts.append([line.strip() for line in text.splitlines() if line.strip()])
    if len(texts[0]) != len(texts[1]):
        return [f"{shown!r} is shown, {made!r} is made"]
    return [f"{a} is shown, {b} is made" for a, b in zip(*texts, strict=True) if not is_same(a, b)]


def is_same(shown: str, made: str) -> bool:
    if NUMBER.sub("#", shown) != NUMBER.sub("#", made):
        return False
    for a, b in zip(NUMBER.findall(shown), NUMBER.findall(made), strict=True):
        one, other = float(a), float(b)
        is_count = a.lstrip("-").isdigit()
        close = abs(one - other) <= 0.011 * abs(one) or max(abs(one), abs(other)) < ROUND_OFF
        if a != b and (is_count or not close):
            return False
    return True


@pytest.mark.few(5)
@pytest.mark.parametrize("path", SESSIONS, ids=lambda path: path.stem)
def test_a_session_is_answered_as_its_file_shows(path, tmp_path, monkeypatch, request):
    monkeypatch.chdir(tmp_path)
    head, files, commands = commands_of(path.read_text(encoding="utf-8"))
    for name, content in files.items():
        Path(name).write_text(content, encoding="utf-8")
    answers = [(command, answer(command)) for command, _ in commands]
    if request.config.getoption("--renew"):
        kept = [
            (shown if differences(shown, made) == [] else made).rstrip() + "\n"
            for (_, shown), (_, made) in zip(commands, answers, strict=True)
        ]
        asked = [command for command, _ in commands]
        made = "\n".join(f"$ {one}\n{text}" for one, text in zip(asked, kept, strict=True))
        path.write_text(head + made, encoding="utf-8")
        return
    for (command, shown), (_, made) in zip(commands, answers, strict=True):
        assert differences(shown, made) == [], command


def test_another_answer_is_seen():
    """The control."""
    shown = "BDF1    4        0.25       1.983e-01  ok\n! quick: 8 runs\n"
    for same in (shown, shown.replace("    ", "  "), shown.replace("1.983", "1.984")):
        assert differences(shown, same) == []
    for old, new in (("1.983", "2.983"), ("4  ", "5  "), ("8 runs", "9 runs"), ("! ", "")):
        assert differences(shown, shown.replace(old, new)) != []
