"""Texts that show numbers, compared as numbers: what round-off changes is no difference."""

import re

NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")

ORDER_TOLERANCE = 0.011
"""Orders have two decimals, and may be rounded to either side."""


def differences_of_texts(shown: str, made: str) -> list[str]:
    """What differs between two texts but for their numbers' last digit and the width of columns.

    Whole numbers (steps, counts) must be the same.
    """
    words, own_words = (
        " ".join(re.sub(r"-{3,}", "-", NUMBER.sub("#", t)).split()) for t in (shown, made)
    )
    if words != own_words:
        return [f"{words!r} is not {own_words!r}"]
    return [
        f"{one} is shown, {other} is made"
        for one, other in zip(NUMBER.findall(shown), NUMBER.findall(made), strict=True)
        if one != other and ("." not in one or abs(float(one) - float(other)) > ORDER_TOLERANCE)
    ]
