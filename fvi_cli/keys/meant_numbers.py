"""Advice for a text that means a number: with a unit, a fraction, a decimal comma."""

from __future__ import annotations

import math
import re
from typing import Final

from fvi_cli.keys.complaints import excerpt
from fvi_cli.keys.nodes import Node, ScalarNode, read_scalar
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.expressions import Expression

_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_WITH_MORE: Final = re.compile(rf"({_NUMBER})\s*(?:/\s*(\d+\.?\d*)|(%|°|[a-zA-Zµμ][\w\s/^*·²³-]*))")
_FORTRAN: Final = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+))[dD]([-+]?\d+)")
_UNIT: Final = re.compile(r"([*/·]?)\s*([a-zA-Zµμ]+)(?:\^|\*\*)?(-?\d|[²³])?\s*")
_PREFIXES: Final = {
    "n": 1e-9,
    "µ": 1e-6,
    "μ": 1e-6,
    "u": 1e-6,
    "m": 1e-3,
    "c": 1e-2,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
}
_BASES: Final = ("s", "m", "N", "Pa", "J", "W", "Hz")
_UNITS: Final = {
    **dict.fromkeys((*_BASES, "kg", "rad", "sec"), 1.0),
    "t": 1e3,
    "ms": 1e-3,
    "min": 60.0,
    "h": 3600.0,
    **{f"{prefix}{base}": f for base in _BASES for prefix, f in _PREFIXES.items()},
}
"""Factors to kg, m, s and N by unit."""


def meant_number(node: Node) -> str:
    """How to write a text that looks like a number; empty for any other node."""
    if not isinstance(node, ScalarNode) or not isinstance(node.value, str):
        return ""
    bare = node.text.replace("_", "").strip()
    comma = ""
    if re.match(r"[-+]?\d+,\d", bare) and "." not in bare:
        bare, comma = bare.replace(",", "."), " with a decimal point"
    value = read_scalar(bare)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return _number_before(bare)
    return f"; as a number it is written {excerpt(bare)}{comma}"


def _number_before(text: str) -> str:
    """Advice for a fraction, a percentage, or a number with a unit."""
    if fortran := _FORTRAN.fullmatch(text):
        return f"; write {fortran[1]}e{fortran[2]}"
    found = _WITH_MORE.fullmatch(text)
    if found is None:
        return _constant_in(text)
    number, over, unit = found.groups()
    if over is not None:
        return f"; write {float(number) / float(over):.15g}" if float(over) else ""
    if unit == "%":
        return f"; write {float(number) / 100:.15g}"
    if unit in ("°", "deg"):
        return f"; angles are in radians: write {math.radians(float(number)):.15g}"
    if unit == "pi":
        return f"; write {float(number) * math.pi:.15g}"
    factor = _factor_of(unit)
    if factor in (None, 1.0):
        return f"; numbers have no unit: write {number}"
    return f"; numbers have no unit: with kg, m, s and N write {float(number) * factor:.15g}"


def _factor_of(unit: str) -> float | None:
    """The factor of a unit such as ``kN s/m`` in kg, m, s and N; None: it is not known."""
    factor, place, is_below = 1.0, 0, False
    while place < len(unit):
        found = _UNIT.match(unit, place)
        if found is None or found[2] not in _UNITS:
            return None
        is_below = is_below or found[1] == "/"
        power = {"²": 2, "³": 3}.get(found[3] or "", 0) or int(found[3] or 1)
        factor *= _UNITS[found[2]] ** (-power if is_below else power)
        place = found.end()
    return factor


def _constant_in(text: str) -> str:
    """Advice for an expression of numbers, such as ``10*pi``."""
    try:
        value = Expression.parse(text, variables=()).evaluate({})
        number = float(value)
    except (ExpressionError, TypeError, ValueError, OverflowError):
        return ""
    return f"; write {number:.15g}" if math.isfinite(number) else ""
