"""From the text of an expression to its syntax tree, with complaints that name the column."""

from __future__ import annotations

import ast
import re
import warnings
from typing import Final

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError

LONGEST_TEXT: Final = 10_000  # characters
DEEPEST_NESTING: Final = 100  # of parentheses
EVERY_PERIOD: Final = (
    "; there is no remainder: what happens once every period T is a rising zero of sin(2*pi*t/T)"
)
_ADVICE: Final = {
    "%": EVERY_PERIOD,
    "^²³": "; a power is written **, as in x**2",
    "<>": "; what jumps is given in pieces, an event as a change of sign",
    "=": "; give the difference of both sides",
    "'": "; the velocity of x is vx, its acceleration ax",
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
        if forbidden[0] == "=" and (instead := difference_of_sides(text)):
            advice += f": {instead}"
        raise ExpressionError(f"{forbidden[0]!r} is not allowed{advice}", forbidden.start() + 1)
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
    # The parentheses make leading blanks and line breaks harmless; one column is subtracted later.
    source = "(" + re.sub(r"\s", " ", text) + ")"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(source, mode="eval").body
    except SyntaxError as error:
        column = min(max((error.offset or 2) - 1, 1), len(text) + 1)
        call = re.search(r"\b(sin|cos|tan|exp|log|sqrt)\s+(\w+)", text)
        hint = f"; write {call[1]}({call[2]})" if call else ""
        incomplete = ExpressionError(f"this is not a complete expression{hint}", column)
        raise _without_factor(text) or incomplete from None
    except (ValueError, RecursionError, MemoryError, OverflowError):
        raise ExpressionError("nested too deeply, or a number with too many digits") from None
    if isinstance(tree, ast.Tuple):
        comma = re.search(r"\d,\d", text)
        hint = f"; numbers have a decimal point: {comma[0].replace(',', '.')}" if comma else ""
        raise ExpressionError(f"one expression is expected, not several between commas{hint}")
    # Python takes a number before a parenthesis for the name of a function
    if (missing := _without_factor(text)) and missing.message.endswith("("):
        raise missing
    return tree


def difference_of_sides(text: str) -> str:
    """The expression that is 0 where an equation ``a = b`` holds; empty for any other text."""
    sides = [side.strip() for side in text.split("=")]
    if len(sides) != 2 or not all(sides):
        return ""
    left, right = sides
    if right.replace(".", "").strip("0") == "":
        return left
    return f"{left} - {right}" if re.fullmatch(r"[\w.*/]+", right) else f"{left} - ({right})"


def _without_factor(text: str) -> ExpressionError | None:
    """The complaint about a missing ``*`` after a number or parenthesis; None if there is none."""
    found = _NO_OPERATOR.search(text)
    message = f"'*' is missing: write {found[1]}*{found[2]}" if found else ""
    return ExpressionError(message, found.start(2) + 1) if found else None
