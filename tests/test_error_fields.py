"""Errors carry what is decided by as fields: nobody reads the text of a message to decide."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import fvi_cli
from fvi_cli.errors import ArgumentError

PACKAGE = Path(fvi_cli.__file__).parent
# errors of another package have no fields
FOREIGN = {"runner/executors/cluster.py"}
TAKING_APART = {
    *("partition", "rpartition", "split", "rsplit", "splitlines", "find", "index", "count"),
    *("startswith", "endswith", "removeprefix", "removesuffix"),
    *("match", "fullmatch", "search", "findall", "sub"),
}


def is_text_of(node: ast.expr, name: str) -> bool:
    """Whether an expression is ``str(name)``, ``f"{name}"`` or part of ``name.args``."""
    text = ast.unparse(node)
    return text in (f"str({name})", f"f'{{{name}}}'", f"{name}.message", f"{name}.args[0]")


def decisions(source: str) -> list[int]:
    """Lines where the text of a caught error is compared or taken apart."""
    found = []
    # most modules catch nothing
    for handler in ast.walk(ast.parse(source if "except" in source else "")):
        if not isinstance(handler, ast.ExceptHandler) or handler.name is None:
            continue
        name = handler.name
        texts = {
            one.targets[0].id
            for one in ast.walk(handler)
            if isinstance(one, ast.Assign)
            and isinstance(one.targets[0], ast.Name)
            and is_text_of(one.value, name)
        }

        def is_text(node: ast.expr, name: str = name, texts: set[str] = texts) -> bool:
            return is_text_of(node, name) or (isinstance(node, ast.Name) and node.id in texts)

        for node in ast.walk(handler):
            if isinstance(node, ast.Compare):
                parts = [node.left, *node.comparators]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                if node.func.attr not in TAKING_APART:
                    continue
                parts = [node.func.value, *node.args]
            else:
                continue
            if any(is_text(one) for one in parts):
                found.append(node.lineno)
    return found


@pytest.mark.parametrize(
    "decision",
    [
        "if 'no run' in str(error): pass",
        "if str(error) == DAMAGED: pass",
        "key = str(error).partition(': ')[2]",
        "found = PATTERN.fullmatch(str(error))",
        "said = str(error)\n    if said.startswith('n'): pass",
        "if error.args[0] == 'gone': pass",
        "if 'x' in error.message: pass",
    ],
)
def test_decisions_by_text_are_seen(decision):
    """The control: what the house had."""
    assert decisions(f"try:\n    run()\nexcept ValueError as error:\n    {decision}\n")


def test_printing_is_no_decision():
    assert not decisions("try:\n    run()\nexcept ValueError as error:\n    print(str(error))\n")
    assert not decisions("try:\n    run()\nexcept E as error:\n    at(error.key.split('.'))\n")


def test_nothing_decides_by_the_text_of_an_error():
    found = {
        str(path.relative_to(PACKAGE)): lines
        for path in PACKAGE.rglob("*.py")
        if (lines := decisions(path.read_text(encoding="utf-8")))
    }
    assert set(found) <= FOREIGN, found


def test_an_error_knows_its_key_and_what_is_wrong():
    error = ArgumentError("order", "3 is not allowed").below("damping.1")
    assert (error.key, error.message) == ("damping.1.order", "3 is not allowed")
    assert str(error) == "damping.1.order: 3 is not allowed"
    assert isinstance(error, ValueError)
