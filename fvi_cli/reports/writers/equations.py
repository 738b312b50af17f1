r"""Equations in plain text as mathematics: ``sum mu D^gamma x`` is ``\sum \mu\,D^{\gamma}\,x``."""

from __future__ import annotations

import re
from collections.abc import Iterator

_GREEK = {
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda"),
    *("mu", "nu", "xi", "pi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega"),
}
_FUNCTIONS = {
    *("sin", "cos", "tan", "exp", "log", "sinh", "cosh", "tanh", "arcsin", "arccos", "arctan"),
    "sum",
}
_SMALL_WORDS = {"of", "and", "in", "from", "to", "the", "for", "with", "on", "at"}

_WORD = re.compile(r"\(?[A-Za-z]{2,}\)?[,;:.]?")
_OPERATOR = re.compile(r"[-+=*/^'|<>]")
_TOKEN = re.compile(
    r"(?P<number>\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z]+\d*(?:_[A-Za-z0-9]+)*)"
    r"|(?P<power>\*\*|\^)|(?P<index>_)|(?P<space>\s+)|(?P<dots>\.\.\.)|(?P<other>.)"
)
_LETTERS = {"*": r"\,", "{": r"\{", "}": r"\}", "%": r"\%", "#": r"\#", "&": r"\&", "$": r"\$"}
_LETTERS |= {"~": r"\sim ", "\\": r"\backslash ", "_": r"\_", "^": "{}^", '"': "''"}


def to_mathematics(text: str) -> list[tuple[str, bool]]:
    """Pairs (piece, whether it is mathematics for LaTeX) of an equation in plain text.

    Words between formulas stay words: they have two letters or more, are not the name of a Greek
    letter or a function, and are not next to an operator.
    """
    words = " ".join(text.split()).split(" ")
    found: list[tuple[list[str], bool]] = []
    for k, word in enumerate(words):
        neighbours = words[max(k - 1, 0) : k] + words[k + 1 : k + 2]
        is_mathematics = not _is_prose(word, neighbours) and word.isascii() and word.isprintable()
        if not found or found[-1][1] != is_mathematics:
            found.append(([], is_mathematics))
        found[-1][0].append(word)
    pieces: list[tuple[str, bool]] = []
    for group, is_mathematics in found:
        if pieces:
            pieces.append((" ", False))
        part = " ".join(group)
        if is_mathematics:
            # punctuation belongs to the sentence
            formula = part.rstrip(",;:")
            pieces.append((_tight("".join(_typeset(formula))), True))
            if formula != part:
                pieces.append((part[len(formula) :], False))
        else:
            pieces.append((part, False))
    return [(part, is_mathematics) for part, is_mathematics in pieces if part]


def _tight(formula: str) -> str:
    """The formula without blanks, except those that end a command."""
    return re.sub(r"(\\[a-z]+) +(?![A-Za-z ])", r"\1", re.sub(r" +", " ", formula))


def _is_prose(word: str, neighbours: list[str]) -> bool:
    if not _WORD.fullmatch(word):
        return False
    bare = word.strip("(),;:.")
    if bare in _SMALL_WORDS or (word[0] == "(" and ")" in word):
        return True
    if bare in _GREEK | _FUNCTIONS:
        return False
    return not any(_OPERATOR.search(other) for other in neighbours)


def _typeset(formula: str) -> Iterator[str]:
    tokens = [(match.lastgroup or "", match[0]) for match in _TOKEN.finditer(formula)]
    k = 0
    was_operand = was_raised = was_lowered = False
    while k < len(tokens):
        kind, word = tokens[k]
        k += 1
        is_root = word == "sqrt" and k < len(tokens) and tokens[k][1] == "("
        if kind in ("power", "index") or is_root:
            inside, k = _argument(tokens, k)
            # LaTeX needs {} between two successive powers, or two indices
            between = "{}" if (was_raised if kind == "power" else was_lowered) else ""
            start = r"\sqrt" if is_root else f"{between}{'^' if kind == 'power' else '_'}"
            yield f"{start}{{{''.join(_typeset(inside))}}}"
        elif kind == "space":
            follows = k < len(tokens) and tokens[k][0] in ("name", "number")
            yield r"\," if was_operand and follows else " "
        elif kind == "name":
            yield _name(word)
        elif kind == "number":
            mantissa, _, exponent = word.lower().partition("e")
            yield rf"{mantissa}\cdot10^{{{int(exponent)}}}" if exponent else mantissa
        elif kind == "dots":
            yield r"\ldots "
        else:
            yield ("{}" if word == "'" and was_raised and tokens[k - 2][1] != "'" else "") + (
                _LETTERS.get(word, word)
            )
        was_operand = (
            kind in ("name", "number", "power", "index") or word in ("'", ")", "|")
        ) and word not in _FUNCTIONS
        was_raised = kind == "power" or word == "'" or (kind == "number" and "e" in word.lower())
        was_lowered = kind == "index" or (kind == "name" and "_" in _name(word))


def _argument(tokens: list[tuple[str, str]], k: int) -> tuple[str, int]:
    """The argument of an exponent, an index or a root, and the place after it."""
    if k >= len(tokens):
        return "", k
    if tokens[k][1] == "-" and k + 1 < len(tokens):
        inside, end = _argument(tokens, k + 1)
        return f"-{inside}", end
    if tokens[k][1] != "(":
        return tokens[k][1], k + 1
    depth = 0
    for end in range(k, len(tokens)):
        depth += {"(": 1, ")": -1}.get(tokens[end][1], 0)
        if depth == 0:
            return "".join(token for _, token in tokens[k + 1 : end]), end + 1
    return "".join(token for _, token in tokens[k:]), len(tokens)


def _name(name: str) -> str:
    base, *indices = name.split("_")
    if indices and len(indices[-1]) > 2:
        word = name.replace("_", r"\_")
        return rf"\mathrm{{{word}}}"
    letters, digits = re.fullmatch(r"([A-Za-z]+)(\d*)", base).groups()  # type: ignore[union-attr]
    if letters in _GREEK | _FUNCTIONS:
        letters = f"\\{letters} "
    elif len(letters) > 2:
        letters = rf"\mathrm{{{letters}}}"
    below = ",".join(filter(None, (digits, *indices)))
    return f"{letters}_{{{below}}}" if below else letters
