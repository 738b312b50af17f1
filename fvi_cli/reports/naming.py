"""Members and keys in words, and the units of quantities."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from fvi_cli.studies.members import Member, leads_somewhere, swept_in_words, value_at

_KEYS: Mapping[str, str] = {
    "rayleigh.stiffness": "stiffness-proportional damping",
    "rayleigh.mass": "mass-proportional damping",
}


_SINGULAR = {"masses": "mass", "modulus": "modulus", "stiffnesses": "stiffness"}
_PARTS = {
    "relaxed": "relaxed modulus",
    "unrelaxed": "unrelaxed modulus",
    "moduli": "modulus",
    "times": "relaxation time",
    "time": "relaxation time",
}


def key_in_words(key: str) -> str:
    """``order of the damping`` for ``problem.damping.0.order``, for axes and legends."""
    key = _without_room(key)
    if key in _KEYS:
        return _KEYS[key]
    words = ""
    parts = key.replace("initial.", "initial ").split(".")
    for place, part in enumerate(parts, start=1):
        if part.isdigit():
            head, of, rest = words.partition(" of ")
            # the first entry of a list needs no number: it is mostly the only one
            is_first = part == "0" and place < len(parts)
            one = _SINGULAR.get(head) or head.removesuffix("s")
            words = one + ("" if is_first else f" {int(part) + 1}") + of + rest
            continue
        name = _PARTS.get(part, part.replace("_", " "))
        the = "" if words[-1:].isdigit() else "the "
        words = f"{name} of {the}{words}" if words else name
    return words


def _without_room(key: str) -> str:
    return key.removeprefix("problem.").removeprefix("parameters.")


def all_units(units: Mapping[str, str]) -> Mapping[str, str]:
    """The given units, and those that follow from time, length and force."""
    time, length, force = (units.get(name, "") for name in ("time", "length", "force"))
    found: dict[str, str] = {}
    if time:
        found |= {"rate": f"1/{time}", "frequency": "Hz" if time == "s" else f"1/{time}"}
        found["rayleigh.stiffness"] = rf"{time}$^\gamma$"
        found["rayleigh.mass"] = rf"{time}$^{{\gamma-2}}$"
    if length and time:
        found |= {"velocity": f"{length}/{time}", "acceleration": f"{length}/{time}²"}
    if length and force:
        found |= {"stiffness": f"{force}/{length}", "energy": f"{force} {length}"}
    if length and force and time:
        found["momentum"] = f"{force} {time}"
        found["coefficient"] = rf"{force} {time}$^\gamma$/{length}"
    return found | {**units}


def unit_of(units: Mapping[str, str], *names: str) -> str:
    """The unit of the first of `names` that has one; else empty."""
    known = all_units(units)
    return next((known[name] for name in names if name in known), "")


def with_unit(label: str, units: Mapping[str, str], *names: str) -> str:
    """A label with the unit of the first of `names` that has one."""
    unit = unit_of(units, *names)
    return f"{label} ({unit})" if unit else label


def with_ratio(label: str, units: Mapping[str, str], above: str, below: str) -> str:
    """A label with the unit of a response, such as metres per newton; none of a pure number."""
    known = all_units(units)
    has_unit = {above, below} <= known.keys() and above != below
    return f"{label} ({known[above]} per {known[below]})" if has_unit else label


_LIKE = dict.fromkeys(("relaxed", "unrelaxed", "modulus", "moduli", "stiffnesses"), "stiffness") | {
    "times": "time",
    "final_time": "time",
    "position": "length",
    "lengths": "length",
}


def key_label(
    key: str,
    units: Mapping[str, str],
    problem: Mapping[str, Any] | None = None,
    varied: Sequence[str] = (),
) -> str:
    """The label of an axis for a key of the configuration, with its unit.

    The unit of a coefficient contains the order next to it in `problem`: as a number unless that
    order is `varied`.
    """
    last = [part for part in key.split(".") if not part.isdigit()][-1]
    whole = _without_room(key)
    names = (whole,) if whole in _KEYS else (last, _LIKE.get(last, last))
    # the units of coefficients contain the letter of the order
    words = re.sub(r"^order\b", r"order $\\gamma$", key_in_words(key))
    label = with_unit(words, units, *names)
    order = f"{key.rpartition('.')[0]}.order"
    if order not in (key, *varied) and leads_somewhere(problem or {}, order):
        label = label.replace(r"\gamma", f"{{{value_at(problem or {}, order):g}}}")
    return label


def members_in_words(members: Sequence[Member]) -> str:
    """``3 designs: bare, soft, stiff``, or the number of members and the swept keys."""
    names = list(dict.fromkeys(member.name for member in members if member.name))
    keys = list(members[0].unnamed) if members else []
    swept = [swept_in_words(key, [one.values[key] for one in members]) for key in keys]
    if names:
        return "; ".join([f"{len(names)} designs: {', '.join(names)}", *swept])
    return f"{len(members)} members, {'; '.join(swept)}"
