"""No ufunc of the package writes into a part of an array: NumPy 2.4.6 may write it wrong.

``np.negative(a[:, :, :1], out=b[:, :, 1:])`` with rows of 64 bytes in and 16 out is wrong.
"""

import ast
from pathlib import Path

import numpy as np
import pytest

import fvi_cli

FILES = sorted(Path(fvi_cli.__file__).parent.rglob("*.py"))


def written_parts(source: str) -> list[str]:
    """Calls whose ``out=`` is a view: any slice, or more than one plain index from the front."""
    return [
        ast.unparse(node)
        for node in ast.walk(ast.parse(source if "out=" in source else ""))
        if isinstance(node, ast.Call)
        for keyword in node.keywords
        if keyword.arg == "out" and any(map(is_strided, ast.walk(keyword.value)))
    ]


def is_strided(node: ast.AST) -> bool:
    """Whether an expression takes a part that may have gaps, or an array turned around."""
    if isinstance(node, ast.Attribute):
        return node.attr in ("T", "real", "imag")
    if isinstance(node, ast.Call):
        name = ast.unparse(node.func)
        return name.endswith((".transpose", ".swapaxes", ".diagonal", "moveaxis", "diagonal"))
    if not isinstance(node, ast.Subscript):
        return False
    places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    # rows of a contiguous array are contiguous
    return any(isinstance(place, ast.Slice) or len(places) > 1 for place in places)


def test_no_ufunc_writes_into_a_part():
    found = {path: written_parts(path.read_text(encoding="utf-8")) for path in FILES}
    assert not {path: parts for path, parts in found.items() if parts}


@pytest.mark.parametrize(
    "call",
    [
        "np.add(a, b, out=c[:, 0])",
        "np.negative(a, out=c[:, :, 1:])",
        "np.multiply(a, b, out=self.c[1:])",
        "np.add(a, b, out=(c[0, 1],))",
        "np.exp(a, out=c.T)",
        "np.exp(a, where=m, out=np.moveaxis(c, 0, 1))",
    ],
)
def test_a_part_is_seen(call):
    assert written_parts(call) == [call]


@pytest.mark.parametrize(
    "call", ["np.add(a, b, out=c)", "np.exp(a, out=columns[0])", "np.maximum(a, b, out=self.most)"]
)
def test_whole_arrays_and_rows_may_be_written(call):
    assert written_parts(call) == []


@pytest.mark.parametrize("width", range(1, 18))
def test_the_ways_of_blocks_do_not_depend_on_how_they_are_written(width):
    """An assignment to a part goes another way than ``out=``, whatever its width."""
    rng = np.random.default_rng(width)
    base, values = rng.standard_normal((3, 1, width)), rng.standard_normal((3, 4, width))
    ways = np.full((3, 5, 4, width), np.nan)
    for index in range(5):
        ways[:, index] = base + index * values
    for place in np.ndindex(3, 5, 4, width):
        q, index, row, column = place
        assert ways[place] == base[q, 0, column] + index * values[q, row, column]
