"""``python -m benchmarks.mutations``: change single places of the program, and ask its tests.

Places are drawn by a seed, as many of every room. Each change is made in a copy of the tree, where
the tests that stand nearest to the place are executed until one fails: those that import the
module, then those of its room, then those that import whatever imports it. Where a file
``.coverage`` says which tests execute the line (``pytest --cov=fvi_cli --cov-context=test``), their
files are tried as well.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import os
import random
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from benchmarks.measuring import table

ROOT = Path(__file__).parents[1]
PACKAGE = "fvi_cli"
COMPARISONS = {
    "Lt": ">=", "LtE": ">", "Gt": "<=", "GtE": "<", "Eq": "!=", "NotEq": "==",
    "In": "not in", "NotIn": "in",
}  # fmt: skip
SUMS = {"Add": "-", "Sub": "+", "Mult": "/", "Div": "*", "Pow": "*", "FloorDiv": "*", "Mod": "*"}
CALLS = {"min": "max", "max": "min", "any": "all", "all": "any"}
MOST_FILES = 14
"""So many files of tests are executed before a change counts as not seen."""
MOST_SECONDS = 900.0
"""Tests that take longer hang: the change is seen."""


@dataclass(frozen=True, kw_only=True)
class Mutation:
    """A change of one place.

    Parameters
    ----------
    path
        The module, below the root.
    line
        Its line, from 1.
    begin, end
        The characters that are replaced.
    old, new
        By what.
    """

    path: str
    line: int
    begin: int
    end: int
    old: str
    new: str


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The test that sees a change, or nothing, and how many files were asked."""

    mutation: Mutation
    seen_by: str
    n_files: int


def mutations_of(path: Path) -> list[Mutation]:
    """Every change of a module that the rules of this file make."""
    text = path.read_text(encoding="utf-8")
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for node in _code(ast.parse(text)):
        new = _replacement(node, text)
        if new is None or not isinstance(node, ast.expr):
            continue
        old = ast.get_source_segment(text, node)
        if old is None or old == new or not text.isascii():
            continue
        begin = starts[node.lineno - 1] + node.col_offset
        found.append(
            Mutation(
                path=path.relative_to(ROOT).as_posix(),
                line=node.lineno,
                begin=begin,
                end=begin + len(old),
                old=old,
                new=new,
            )
        )
    return found


def _code(tree: ast.AST) -> Iterator[ast.AST]:
    """What is executed: no annotations, default values, decorators, messages of errors."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.FunctionDef):
            for statement in child.body:
                yield from _with_children(statement)
        elif isinstance(child, ast.ClassDef):
            yield from _code(child)


def _with_children(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.AnnAssign | ast.Subscript):
        return
    yield node
    for child in ast.iter_child_nodes(node):
        yield from _with_children(child)


def _replacement(node: ast.AST, text: str) -> str | None:
    def source(part: ast.AST) -> str:
        return ast.get_source_segment(text, part) or ""

    match node:
        case ast.Compare(ops=[ast.Is() | ast.IsNot()]):
            # seen at once by whatever runs
            return None
        case ast.Compare(left=left, ops=[operator], comparators=[right]):
            return f"{source(left)} {COMPARISONS[type(operator).__name__]} {source(right)}"
        case ast.BinOp(left=left, op=operator, right=right) if type(operator).__name__ in SUMS:
            if any(
                isinstance(one, ast.Constant) and one.value in (1, 1.0) for one in (left, right)
            ):
                return None
            return f"({source(left)}) {SUMS[type(operator).__name__]} ({source(right)})"
        case ast.BoolOp(op=operator, values=values):
            word = " or " if isinstance(operator, ast.And) else " and "
            return f"({word.join(f'({source(value)})' for value in values)})"
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return f"bool({source(operand)})"
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return source(operand)
        case ast.Call(func=ast.Name(id=name), args=arguments) if name in CALLS and arguments:
            return CALLS[name] + source(node)[len(name) :]
        case ast.IfExp(test=test, body=body, orelse=other):
            return f"({source(other)} if {source(test)} else {source(body)})"
    return None


def rooms() -> list[list[Path]]:
    """Files of every room: a folder of the package, those of the integrator each by itself."""
    top = ROOT / PACKAGE
    folders = [path for path in top.iterdir() if path.is_dir() and (path / "__init__.py").exists()]
    inner = [path for path in (top / "integrator").iterdir() if path.is_dir()]
    found = [sorted(folder.rglob("*.py")) for folder in folders if folder.name != "integrator"]
    found += [sorted(folder.rglob("*.py")) for folder in inner]
    found += [sorted(top.glob("*.py")), sorted((top / "integrator").glob("*.py"))]
    return sorted(one for one in found if any(mutations_of(path) for path in one))


def drawn(count: int, seed: int) -> list[Mutation]:
    """So many changes, each room in turn."""
    chance = random.Random(seed)  # noqa: S311
    places = [[one for path in room for one in mutations_of(path)] for room in rooms()]
    chance.shuffle(places)
    found: list[Mutation] = []
    while len(found) < count:
        # a room with fewer places is left when all of them are taken
        found += [room.pop(chance.randrange(len(room))) for room in places if room]
    return found[:count]


# --- which tests are near -------------------------------------------------------------------------


@cache
def imported(path: Path) -> frozenset[str]:
    """Modules and names of the package that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return frozenset(name for name in found if name.startswith(PACKAGE))


def near(mutation: Mutation) -> list[Path]:
    """Files of tests, the nearest first."""
    module = mutation.path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    tests = sorted((ROOT / "tests").rglob("test_*.py"))
    users = {
        path.relative_to(ROOT).as_posix().removesuffix(".py").replace("/", ".")
        for path in (ROOT / PACKAGE).rglob("*.py")
        if module in imported(path)
    }
    stem = Path(mutation.path).stem
    room = "/".join(Path(mutation.path).parts[1:-1])

    def distance(path: Path) -> int:
        own = imported(path)
        folder = path.parent.relative_to(ROOT / "tests").as_posix()
        if module in own:
            return 0
        if stem.rstrip("s") in path.stem:
            return 1
        if users & own:
            return 2
        if room and (room == folder or room.startswith(f"{folder}/")):
            return 3
        if path.stem in ("test_sessions", "test_every_route"):
            return 3
        if "test_cli" in path.stem or "test_api" in path.stem:
            return 4
        return 9

    near_by = sorted((distance(path), path.stat().st_size, path) for path in tests)
    return [path for away, _, path in near_by if away < 9][:MOST_FILES]


def executing(mutation: Mutation, contexts: Path) -> list[str]:
    """Files of tests that execute a line, those with most such tests first."""
    asked = (
        "select context.context, line_bits.numbits from line_bits, file, context "
        "where file.id = line_bits.file_id and context.id = line_bits.context_id "
        "and file.path like ? order by context.context"
    )
    found: Counter[str] = Counter()
    with contextlib.closing(sqlite3.connect(contexts)) as data:
        for name, bits in data.execute(asked, (f"%/{mutation.path}",)):
            byte, bit = divmod(mutation.line, 8)
            if "::" in name and byte < len(bits) and bits[byte] >> bit & 1:
                found[name.partition("::")[0]] += 1
    return [file for file, _ in found.most_common(MOST_FILES) if (ROOT / file).exists()]


def judge(mutation: Mutation, copy: Path, contexts: Path) -> Verdict:
    """Make the change in a copy of the tree, execute the tests near it, and take it back."""
    path = copy / mutation.path
    text = path.read_text(encoding="utf-8")
    changed = text[: mutation.begin] + mutation.new + text[mutation.end :]
    files = [one.relative_to(ROOT).as_posix() for one in near(mutation)]
    further = executing(mutation, contexts) if contexts.exists() else []
    files += [one for one in further if one not in files]
    path.write_text(changed, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-rfE"]
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        ended = subprocess.run(  # noqa: S603
            [*command, *files],
            cwd=copy,
            env=environment,
            capture_output=True,
            text=True,
            timeout=MOST_SECONDS,
        )
        failed = [
            line.split()[1]
            for line in ended.stdout.splitlines()
            if line.startswith(("FAILED ", "ERROR "))
        ]
        seen_by = "" if ended.returncode == 0 else (failed or ["no test could be collected"])[0]
    except subprocess.TimeoutExpired:
        seen_by = "a test that does not end"
    finally:
        path.write_text(text, encoding="utf-8")
    return Verdict(mutation=mutation, seen_by=seen_by, n_files=len(files))


def main() -> int:
    """Print the table; 1 where a change is not seen."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutations", description=__doc__)
    parser.add_argument("--count", type=int, default=60, metavar="N", help="changes (default 60)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the places")
    parser.add_argument("--contexts", type=Path, default=Path(".coverage"), metavar="FILE")
    parser.add_argument("--list", action="store_true", help="print the places and execute nothing")
    asked = parser.parse_args()
    rows = []
    missed = 0
    with tempfile.TemporaryDirectory(prefix="fvi-mutations-") as name:
        copy = Path(name) / "tree"
        ignored = shutil.ignore_patterns(
            ".git", ".venv", "*.h5", "*.parts", "__pycache__", ".*_cache"
        )
        shutil.copytree(ROOT, copy, ignore=ignored)
        for mutation in drawn(asked.count, asked.seed):
            place = f"{mutation.path}:{mutation.line}"
            change = f"{' '.join(mutation.old.split())} -> {' '.join(mutation.new.split())}"
            if asked.list:
                print(f"{place}: {change}")
                continue
            verdict = judge(mutation, copy, asked.contexts)
            missed += not verdict.seen_by
            seen_by = verdict.seen_by or f"NOT SEEN by {verdict.n_files} files"
            print(f"{place}: {change}: {seen_by}", flush=True)
            rows.append((f"`{place}`", f"`{change}`", seen_by))
    if rows:
        heading = f"{len(rows) - missed} of {len(rows)} changes are seen."
        print(table(heading, ("place", "change", "seen by"), rows))
    return int(missed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
