"""Files from strangers: matrices, samples and contents that declare what they like.

Valid files of every kind are changed at random, as bytes and in what they declare, and read by the
configuration that names them, in processes with limits of memory and of processor time.
"""

from __future__ import annotations

import base64
import contextlib
import io
import math
import os
import random
import resource
import struct
import tempfile
import time
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.io import mmwrite, savemat
from scipy.sparse import bsr_array, coo_array, csc_array, csr_array, dia_array, save_npz

from fvi_cli.config import load_config
from fvi_cli.errors import FviError
from fvi_cli.scenes.records.data_files import samples_as_text
from fvi_cli.scenes.structures.matrix_keys import matrix_as_text

MOST_SECONDS: Final = 2
"""Of a processor, for a file of less than a megabyte."""
MOST_BYTES: Final = 500_000_000
"""That such a file makes the program take."""

N: Final = 36
FULL: Final = 2.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)
TIMES: Final = np.array([0.25 * k for k in range(9)], dtype=np.float64)
VALUES: Final = np.array([round(math.sin(0.25 * k), 6) for k in range(9)], dtype=np.float64)
_NUMBERS: Final = (0, 1, -1, -5, 2, N, N + 1, 127, 255, 65_535, 10**9, 2**31 - 1, -(2**31))
_WORDS: Final = (
    *(b"1e999", b"nan", b"-inf", b"1_0", b"1,5", b"1D5", b"9" * 30, b"9" * 5000, b"-1", b"0", b""),
    *(
        b"1000000000",
        b"\n" * 999,
        b" " * 999,
        b"%",
        b"#",
        b'"',
        b"\x00",
        b"\xff",
        b"NPTS",
        b"=" * 99,
    ),
)
MATRIX: Final = """\
name: hostile
problem: {{kind: structure, mass: 1.0, stiffness: {source}, initial: {{}}, final_time: 1.0,
          exact: none}}
method: {{rk: gauss, degree: 1}}
ladder: {{steps: [4]}}
"""
FORCE: Final = """\
name: hostile
problem: {{kind: damped-oscillator, forcing: {source}, final_time: 2.0, exact: none}}
method: {{rk: gauss, degree: 1}}
ladder: {{steps: [4]}}
"""

Change = Callable[[random.Random], tuple[str, bytes]]
"""From chance to a configuration and the file that it names."""


@dataclass(kw_only=True)
class Read:
    """What became of the files of one kind."""

    count: int = 0
    refused: int = 0
    slowest: float = 0.0
    wrong: list[str] = field(default_factory=list)


def spoilt(content: bytes, chance: random.Random) -> bytes:
    """Bytes with bits flipped, numbers and words overwritten, stretches cut out or doubled."""
    changed = bytearray(content)
    for _ in range(chance.choice((1, 1, 1, 2, 8))):
        place = chance.randrange(len(changed) + 1)
        how = chance.randrange(6)
        if how == 0 and place < len(changed):
            changed[place] ^= 1 << chance.randrange(8)
        elif how == 1:
            form = chance.choice(("<i", "<i", ">i", "<q", "<H", "<d"))
            number = chance.choice(_NUMBERS)
            with contextlib.suppress(struct.error):
                packed = struct.pack(form, number)
                place -= place % len(packed)
                changed[place : place + len(packed)] = packed
        elif how == 2:
            changed[place : place + chance.choice((0, 1, 3, 8))] = chance.choice(_WORDS)
        elif how == 3:
            del changed[place : place + chance.choice((1, 4, 8, 64))]
        elif how == 4:
            changed[place:place] = changed[place : place + chance.choice((1, 8, 64))]
        elif chance.random() < 0.3:
            del changed[place:]
    return bytes(changed)


def _spoilt_array(values: NDArray[Any], chance: random.Random) -> NDArray[Any]:
    """An array with other entries, another length, type or shape."""
    changed = np.array(values)
    how = chance.randrange(6)
    if how < 3 and changed.size and changed.dtype.kind in "if":
        for _ in range(chance.choice((1, 2))):
            changed.flat[chance.randrange(changed.size)] = chance.choice(_NUMBERS)
    elif how == 3 and changed.ndim == 1 and changed.size:
        changed = chance.choice((changed[:-1], changed[1:], np.append(changed, changed[-1])))
    elif how == 4:
        kinds = ("<i8", "<f8", ">i4", "u1", "c16", "U3", "?", "f2", "f16")
        with contextlib.suppress(ValueError, TypeError), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            changed = changed.astype(chance.choice(kinds))
    else:
        changed = changed.reshape(chance.choice(((-1,), (1, -1), (-1, 1), (1, 1, -1))))
    return changed


def _bomb(chance: random.Random) -> bytes:
    """Zeros behind what is compressed, seldom many."""
    return bytes(chance.choices((0, 10**5, 4 * 10**7), (197, 2, 1))[0])


# --- files of every kind ----------------------------------------------------------------------


def _npz(chance: random.Random) -> tuple[str, bytes]:
    kinds: tuple[Any, ...] = (csr_array, csc_array, coo_array, dia_array, bsr_array)
    buffer = io.BytesIO()
    if chance.random() < 0.2:
        np.savez(buffer, K=FULL)
    else:
        save_npz(buffer, chance.choice(kinds)(FULL), compressed=chance.random() < 0.5)
    with np.load(io.BytesIO(buffer.getvalue())) as found:
        parts = dict(found)
    if chance.random() < 0.3:
        return MATRIX.format(source="{file: K.npz}"), spoilt(buffer.getvalue(), chance)
    name = chance.choice(list(parts))
    if chance.random() < 0.7:
        parts[name] = _spoilt_array(parts[name], chance)
    if chance.random() < 0.05:
        del parts[name]
    archive = io.BytesIO()
    how = chance.choice((*3 * (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED), zipfile.ZIP_LZMA))
    with zipfile.ZipFile(archive, "w", how) as members:
        for one, values in parts.items():
            array = io.BytesIO()
            np.save(array, values)
            content = array.getvalue()
            if one == name and chance.random() < 0.3:
                content = spoilt(content, chance)
            if one == name and how != zipfile.ZIP_LZMA:
                content += _bomb(chance)
            members.writestr(f"{one}.npy", content)
    return MATRIX.format(source="{file: K.npz}"), archive.getvalue()


def _npy(chance: random.Random) -> tuple[str, bytes]:
    buffer = io.BytesIO()
    np.save(buffer, _spoilt_array(FULL, chance) if chance.random() < 0.5 else FULL)
    return MATRIX.format(source="{file: K.npy}"), spoilt(buffer.getvalue(), chance)


def _mat(chance: random.Random) -> tuple[str, bytes]:
    buffer = io.BytesIO()
    matrix = chance.choice((FULL, csc_array(FULL), csc_array(FULL), csc_array(FULL)))
    held: dict[str, Any] = {"K": matrix}
    if chance.random() < 0.1:
        held |= {"cells": np.array([1, "a"], dtype=object), "words": "abc", "deep": {"a": FULL}}
    form = chance.choice(("5", "5", "5", "4"))
    kept: Any = buffer
    if form == "5":
        savemat(kept, held)
    else:
        savemat(kept, {"K": matrix}, format="4")
    content = buffer.getvalue()
    # the beginning is where sizes and indices are
    short = chance.choice((60, 400, len(content)))
    content = content[:128] + spoilt(content[128 : 128 + short], chance) + content[128 + short :]
    if form == "5" and chance.random() < 0.4:
        packed = zlib.compress(content[128:] + _bomb(chance))
        content = content[:128] + struct.pack("<II", 15, len(packed)) + packed
    return MATRIX.format(source="{file: K.mat, variable: K}"), content


def _mtx(chance: random.Random) -> tuple[str, bytes]:
    buffer = io.BytesIO()
    matrix = chance.choice((FULL, coo_array(FULL)))
    mmwrite(buffer, matrix, symmetry=chance.choice(("general", "symmetric")))
    return MATRIX.format(source="{file: K.mtx}"), spoilt(buffer.getvalue(), chance)


def _rows(chance: random.Random) -> tuple[str, bytes]:
    lines = "\n".join(",".join(f"{value:g}" for value in row) for row in FULL.tolist())
    return MATRIX.format(source="{file: K.csv}"), spoilt(lines.encode(), chance)


def _csv(chance: random.Random) -> tuple[str, bytes]:
    rows = "\n".join(f"{t!r},{v!r}" for t, v in zip(TIMES.tolist(), VALUES.tolist(), strict=True))
    return FORCE.format(source="{file: K.csv, column: a}"), spoilt(f"t,a\n{rows}".encode(), chance)


def _at2(chance: random.Random) -> tuple[str, bytes]:
    line = chance.choice((f"NPTS= {TIMES.size}, DT= .25 SEC", f"{TIMES.size} 0.25 NPTS, DT"))
    values = " ".join(f"{value:.6E}" for value in VALUES)
    content = f"PEER\nSomewhere\nIN UNITS OF G\n{line}\n{values}\n".encode()
    return FORCE.format(source="{file: K.at2}"), spoilt(content, chance)


def _contents(chance: random.Random) -> tuple[str, bytes]:
    if chance.random() < 0.5:
        matrix: Any = chance.choice((FULL, csr_array(FULL)))
        text = matrix_as_text(matrix)
        template, head = MATRIX, text.rpartition(" ")[0] + " "
    else:
        text, template, head = samples_as_text(TIMES, VALUES), FORCE, ""
    packed = text.removeprefix(head)
    if chance.random() < 0.7:
        inner = spoilt(zlib.decompress(base64.b64decode(packed)), chance)
        inner += _bomb(chance)
        packed = base64.b64encode(zlib.compress(inner, 9)).decode()
    else:
        packed = spoilt(packed.encode(), chance).decode("latin-1")
    if head and chance.random() < 0.3:
        head = f"{chance.choice(('dense', 'sparse'))} {chance.choice((0, 1, N, N + 1, 9_999_999))} "
    written = "".join(c if c.isprintable() and c not in "'{}" else "x" for c in head + packed)
    source = f"{{file: K.csv, column: a, content: '{written}'}}"
    if template is MATRIX:
        source = source.replace(" column: a,", "")
    return template.format(source=source), b""


KINDS: Final = MappingProxyType[str, tuple[str, Change]](
    {
        ".npz": ("K.npz", _npz),
        ".npy": ("K.npy", _npy),
        ".mat": ("K.mat", _mat),
        ".mtx": ("K.mtx", _mtx),
        "rows of a matrix": ("K.csv", _rows),
        ".csv": ("K.csv", _csv),
        ".at2": ("K.at2", _at2),
        "contents in YAML": ("K.csv", _contents),
    }
)


# --- processes with limits --------------------------------------------------------------------


def try_kind(kind: str, times: int, seed: int, each: int = 400) -> Read:
    """Read so many files of a kind; a process that dies is followed by another."""
    found = Read()
    with tempfile.TemporaryDirectory(prefix="fvi-hostile-") as name:
        folder = Path(name)
        while found.count < times:
            last = min(times, found.count + each)
            _in_a_process(folder, kind, range(found.count, last), seed, found)
    return found


def _in_a_process(folder: Path, kind: str, numbers: range, seed: int, found: Read) -> None:
    log = folder / "log"
    log.write_text("", encoding="utf-8")
    process = os.fork()
    if not process:
        code = 70
        with contextlib.suppress(BaseException):
            _read_all(folder, kind, numbers, seed, log)
            code = 0
        os._exit(code)
    _, status, _ = os.wait4(process, 0)
    ended = os.waitstatus_to_exitcode(status)
    lines = log.read_text(encoding="utf-8").splitlines()
    for line in lines:
        label, verdict, seconds, said = line.split("\t", 3)
        found.count += 1
        found.refused += verdict == "refused"
        found.slowest = max(found.slowest, float(seconds))
        if verdict == "wrong":
            found.wrong.append(f"{kind} {label} of seed {seed}: {said}")
    if len(lines) < len(numbers):
        found.wrong.append(
            f"{kind} {numbers[len(lines)]} of seed {seed}: the process ended with {ended}"
        )
        found.count += 1


def _read_all(folder: Path, kind: str, numbers: range, seed: int, log: Path) -> None:
    nothing = os.open(os.devnull, os.O_WRONLY)
    for handle in (1, 2):
        os.dup2(nothing, handle)
    warnings.simplefilter("error")
    # imports and first uses take memory of their own
    list(_verdicts(folder, kind, range(3), -1))
    size = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    # threads reserve addresses that they never use
    most = size * resource.getpagesize() + 8 * MOST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    with log.open("a", encoding="utf-8") as file:
        for line in _verdicts(folder, kind, numbers, seed):
            file.write(f"{line}\n")
            file.flush()


def _verdicts(folder: Path, kind: str, numbers: range, seed: int) -> Iterator[str]:
    """Number, verdict, seconds and what was said of every file."""
    name, change = KINDS[kind]
    for number in numbers:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            text, content = change(random.Random(f"{kind} {number} {seed}"))  # noqa: S311
        before = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        (folder / name).write_bytes(content)
        (folder / "hostile.yaml").write_text(text, encoding="utf-8")
        began = time.process_time()
        # what does not come back is ended by the system
        soft = int(began) + 10 * MOST_SECONDS
        resource.setrlimit(resource.RLIMIT_CPU, (soft, resource.RLIM_INFINITY))
        verdict, said = "accepted", ""
        try:
            load_config(folder / "hostile.yaml")
        except FviError as error:
            verdict = "refused" if "mistake of the program" not in str(error) else "wrong"
            said = str(error)
        except Exception as error:
            verdict, said = "wrong", f"{type(error).__name__}: {error}"
        seconds = time.process_time() - began
        taken = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        if seconds > MOST_SECONDS or taken > MOST_BYTES:
            said = f"{seconds:.1f} s, {taken / 1e6:.0f} MB; {verdict}: {said}"
            verdict = "wrong"
        yield f"{number}\t{verdict}\t{seconds:.3f}\t{said[:300]!a}"


def reproduced(kind: str, number: int, seed: int) -> Mapping[str, bytes]:
    """The configuration and the file of a line that says what was wrong."""
    name, change = KINDS[kind]
    text, content = change(random.Random(f"{kind} {number} {seed}"))  # noqa: S311
    return {"hostile.yaml": text.encode(), name: content}
