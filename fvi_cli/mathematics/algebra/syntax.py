"""From the text of an expression to its syntax tree, with complaints that name the column."""

from __future__ import annotations

import ast
import re
import warnings
from typing import Final

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError

LONGEST_TEXT: Final = 10_000  # characters
DEEPEST_NESTING: Final = 100  # of parentheses
_ADVICE: Final = {
    "^²³": "; a power is written **, as in x**2",
    "<>": "; what jumps is given in pieces, an event as a change of sign",
    "=": "; give the difference of both sides",
    "'": "; the velocity of x is vx, its acceleration ax",
    "%": "; there is no remainder: a rising zero of sin(2*pi*t/T) comes once every period T",
}
"""Advice by the characters that people write."""
_NO_OPERATOR: Final = re.compile(r"(?<![\w.])([\d.]+(?:[eE][-+]?\d+)?|\))\s*([A-Za-z_]\w*|\()")


def syntax_tree(text: str) -> ast.expr:
    """The tree of one expression by Python's grammar.

    Raises
    ------
    ExpressionError
        If the text is no expression, is too long or nested too deeply.
    """
    if len(text) > LONGEST_TEXT:
        raise ExpressionError(f"too long: {len(text)} characters, at most {LONGEST_TEXT}")
    if not text.strip():
        raise ExpressionError("empty; give a number or an expression")
    if forbidden := re.search(r"[^0-9A-Za-z_.+\-*/(),\s]", text, re.ASCII):
        advice = next((says for signs, says in _ADVICE.items() if forbidden[0] in signs), "")
        raise ExpressionError(f"{forbidden[0]!r} is not allowed{advice}", forbidden.start() + 1)
    _check_nesting(text)
    # The parentheses make leading blanks and line breaks harmless; one column is subtracted later.
    source = "(" + re.sub(r"\s", " ", text) + ")"
    missing = _NO_OPERATOR.search(text)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(source, mode="eval").body
    except SyntaxError as error:
        if missing:
            raise _without_factor(missing) from None
        column = min(max((error.offset or 2) - 1, 1), len(text) + 1)
        raise ExpressionError("this is not a complete expression", column) from None
    except (ValueError, RecursionError, MemoryError, OverflowError):
        raise ExpressionError("nested too deeply, or a number with too many digits") from None
    if isinstance(tree, ast.Tuple):
        raise ExpressionError(
            "one expression is expected, not several between commas; numbers have a decimal point"
        )
    # Python takes a number before a parenthesis for the name of a function
    if missing and missing[2] == "(":
        raise _without_factor(missing)
    return tree


def _check_nesting(text: str) -> None:
    nesting = 0
    for position, character in enumerate(text):
        nesting += (character == "(") - (character == ")")
        if nesting < 0:
            raise ExpressionError("this ')' has no '('", position + 1)
        if nesting > DEEPEST_NESTING:
            deep = f"parentheses are nested more than {DEEPEST_NESTING} deep"
            raise ExpressionError(deep, position + 1)
    if nesting:
        raise ExpressionError(f"{nesting} ')' missing at the end", len(text) + 1)


def _without_factor(found: re.Match[str]) -> ExpressionError:
    """The complaint about a missing ``*`` after a number or parenthesis."""
    message = f"'*' is missing: write {found[1]}*{found[2]}"
    return ExpressionError(message, found.start(2) + 1)
