"""From the text of an expression to its syntax tree, with complaints that name the column."""

from __future__ import annotations

import ast
import re
import warnings
from typing import Final

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError

LONGEST_TEXT: Final = 10_000  # characters


def syntax_tree(text: str) -> ast.expr:
    """The tree of one expression by Python's grammar; columns count from 0 in the stripped text.

    Raises
    ------
    ExpressionError
        If the text is no expression, is too long or nested too deeply.
    """
    if len(text) > LONGEST_TEXT:
        raise ExpressionError(f"too long: {len(text)} characters, at most {LONGEST_TEXT}")
    # line breaks are blanks
    source = re.sub(r"\s", " ", text).strip()
    if not source:
        raise ExpressionError("empty; give a number or an expression")
    if forbidden := re.search(r"[^0-9A-Za-z_.+\-*/(), ]", source, re.ASCII):
        advice = "; a power is written **" if forbidden[0] == "^" else ""
        raise ExpressionError(f"{forbidden[0]!r} is not allowed{advice}", forbidden.start() + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(source, mode="eval").body
    except SyntaxError as error:
        column = min(error.offset or len(source) + 1, len(source) + 1)
        raise ExpressionError("this is not a complete expression", column) from None
    except (ValueError, RecursionError, MemoryError, OverflowError):
        raise ExpressionError("nested too deeply, or a number with too many digits") from None
    if isinstance(tree, ast.Tuple):
        raise ExpressionError(
            "one expression is expected, not several between commas; numbers have a decimal point"
        )
    return tree
