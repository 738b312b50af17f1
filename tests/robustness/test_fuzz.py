"""Inputs from strangers: no traceback, no hang, nothing is executed, nothing written elsewhere."""

import contextlib
import faulthandler
import os
import random
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command_line import fvi
from commands import QUICK

from benchmarks.robustness import mutated
from fvi_cli.config import parse_config
from fvi_cli.errors import ConfigError
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.expressions import Expression

SECONDS = 5
POINT = {"t": np.array([0.0, 0.5]), "x": np.array([0.25, -1.0])}

# --- what must not happen -------------------------------------------------------------------------


class Guard:
    """Notes what a process does beside computing, while it is told to."""

    SUSPICIOUS = ("os.system", "os.exec", "os.fork", "subprocess.Popen", "socket.connect")

    def __init__(self):
        self.seen, self.is_exec_a_crime = None, True
        sys.addaudithook(self.note)

    def note(self, event, arguments):
        if self.seen is None:
            return
        if (
            event.startswith(self.SUSPICIOUS)
            or (event == "exec" and self.is_exec_a_crime)
            or (event == "open" and self.writes(arguments))
        ):
            self.seen.append((event, str(arguments)[:200]))

    @staticmethod
    def writes(arguments):
        path, _, flags = arguments
        is_writing = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        return is_writing and not str(path).startswith(str(Path.cwd() / "results"))

    @contextlib.contextmanager
    def watching(self, seconds=SECONDS, is_exec_a_crime=True):
        def too_long(number, frame):
            raise TimeoutError(f"more than {seconds} s")

        before = signal.signal(signal.SIGALRM, too_long)
        signal.setitimer(signal.ITIMER_REAL, seconds)
        # a library that does not come back hears no alarm
        faulthandler.dump_traceback_later(60, exit=True)
        self.seen, self.is_exec_a_crime = [], is_exec_a_crime
        try:
            yield
        finally:
            seen, self.seen = self.seen, None
            faulthandler.cancel_dump_traceback_later()
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
        assert not seen


@pytest.fixture(scope="session")
def guard():
    return Guard()


def test_the_guard_notices(guard, tmp_path):
    for crime in (
        lambda: exec("1"),
        lambda: (tmp_path / "x").write_text(""),
        lambda: os.system("true"),
    ):
        with pytest.raises(AssertionError), guard.watching():
            crime()
    with pytest.raises(TimeoutError), guard.watching(seconds=0.01):
        time.sleep(1)
    with guard.watching(seconds=1):
        time.sleep(0.01)


# --- configurations -------------------------------------------------------------------------------


def try_configurations(guard, count, seed):
    chance = random.Random(seed)
    refused = 0
    for _ in range(count):
        text = mutated(QUICK, chance)
        try:
            with guard.watching():
                parse_config(text, "f.yaml")
        except ConfigError as error:
            refused += 1
            for line in error.complaints:
                assert line.startswith(("f.yaml:", "... and ")), (text, line)
                assert line.isprintable(), (text, line)
    # both happen
    assert 0 < refused < count


def test_texts_with_changes(guard):
    try_configurations(guard, 100, 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 5))
def test_many_texts_with_changes(guard, seed):
    try_configurations(guard, 2500, seed)


# --- expressions ----------------------------------------------------------------------------------

_ATOMS = """
t x pi gamma e 0 1 2.5 1e308 1e-320 1j 0x1F 10**10 9**9**9 t**t ** * / // % + - ( ) [ ] { } , .
: = == < > | & ^ ~ @ sin( cos( exp( log( sqrt( gamma( abs( sin cos exp( and or not if else
lambda __import__ ('os') .__class__ .mro() 'a' "b" f'{t}' t.real None True await yield print
open eval
"""
ATOMS = _ATOMS.split()
NESTED = ["(" * 5000, "-" * 5000, "t+" * 5000 + "t", "2**" * 300 + "2", "sin(" * 500, "1" * 5000]


def try_expressions(guard, count, seed):
    chance = random.Random(seed)
    refused = 0
    texts = [*NESTED] + [
        chance.choice(("", " ")).join(chance.choice(ATOMS) for _ in range(chance.randrange(1, 12)))
        for _ in range(count)
    ]
    for text in texts:
        with guard.watching(), np.errstate(all="ignore"):
            try:
                expression = Expression(text=text, variables=("t", "x"))
                expression.evaluate(POINT)
            except (ExpressionError, ArithmeticError):
                refused += 1
    assert 0 < refused < len(texts)


def test_expressions_of_any_words(guard):
    try_expressions(guard, 400, 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 5))
def test_many_expressions_of_any_words(guard, seed):
    try_expressions(guard, 5000, seed)


# --- result files ---------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "quick.yaml").write_text(QUICK)
    arguments = ["run", "quick.yaml", "-q", "--set", "ladder.steps=[4, 8]"]
    fvi(*arguments, code=0)
    # what is imported at the first time is no execution of what stands in a file
    for command in ("show", "convergence"):
        fvi(command, "results/quick.h5", code=0)
    return tmp_path


def damaged(content, chance):
    """The bytes of a file, cut off, overwritten in places, or with a stretch of zeros."""
    changed = bytearray(content)
    how = chance.randrange(3)
    if how == 0:
        return changed[: chance.randrange(len(changed))]
    for _ in range(chance.choice((1, 1, 2, 8, 64))):
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    if how == 2:
        begin = chance.randrange(len(changed))
        end = min(len(changed), begin + chance.randrange(200))
        changed[begin:end] = bytes(end - begin)
    return changed


def try_files(guard, folder, count, seed):
    chance = random.Random(seed)
    path = folder / "results" / "quick.h5"
    content = path.read_bytes()
    codes = set()
    for _ in range(count):
        path.write_bytes(damaged(content, chance))
        command = chance.choice(("show", "show", "convergence", "run"))
        source = "quick.yaml" if command == "run" else "results/quick.h5"
        # the library that parses commands evaluates their annotations
        with guard.watching(is_exec_a_crime=False):
            result = fvi(command, source)
        codes.add(result.exit_code)
        assert result.exit_code in (0, 2), result.output
        assert "Traceback" not in result.output
        assert "unexpected" not in result.output
        if result.exit_code == 2:
            assert "quick.h5: " in result.output, result.output
    assert 2 in codes
    assert sorted(p.name for p in folder.iterdir()) == ["quick.yaml", "results"]


def test_files_with_damage(guard, folder):
    try_files(guard, folder, 25, 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 5))
def test_many_files_with_damage(guard, folder, seed):
    try_files(guard, folder, 1000, seed)
