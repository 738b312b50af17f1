"""``sweep``: the members of one problem that one or several lists of values make."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final

from fvi_cli.keys.complaints import SourcePosition, excerpt, listed
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.nodes import (
    ListNode,
    MappingNode,
    Node,
    ScalarNode,
    plain,
)
from fvi_cli.keys.ranges import RANGE
from fvi_cli.keys.scalars import AsWritten, Schema

DEEPEST: Final = 50
MOST_MEMBERS: Final = 100_000
MOST_KEYS: Final = 20
BYTES_PER_RUN: Final = 4000
"""Memory of a finished run in addition to its trajectory."""

SWEEP: Final = "sweep"
LONGEST_NAME: Final = 60
PROBLEM: Final = "problem"

_EXPECTED: Final = (
    "a mapping such as {problem.stiffness: [1, 2, 4], problem.damping.0.order: {from: 0.1, "
    "to: 0.9, number: 9}}, or a list of mappings with one value for every key: "
    "[{problem.stiffness: 1}, {problem.stiffness: 4}]"
)
_NOT_SWEPT: Final = {
    "problem.kind": "members are of one kind; write several experiments",
    "problem.final_time": "members share their times; write several experiments",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """The contents of ``sweep`` as nodes."""

    place: SourcePosition
    key_places: Mapping[str, SourcePosition]  # every swept key with its place
    values: Mapping[str, Sequence[Node]]  # the distinct values of every key
    combinations: Sequence[tuple[int, ...]]  # for every member an index into `values` for each key
    # for every member the name of its design, which stands for the values of the keys `named`
    names: Sequence[str] = ()
    named: tuple[str, ...] = ()
    is_valid: bool = True  # whether there are no complaints

    def nodes_of(self, combination: tuple[int, ...]) -> dict[str, Node]:
        """The value of every key of one member."""
        return {
            key: self.values[key][index]
            for key, index in zip(self.values, combination, strict=True)
        }


def _described(defs: Schema) -> Schema:
    key = {"propertyNames": {"pattern": r"^problem\."}, "minProperties": 1}
    several = {"anyOf": [{"type": "array", "minItems": 1}, RANGE.schema(defs)]}
    return {
        "title": "mapping of lists or ranges, or list of mappings",
        "oneOf": [
            {"type": "object", "additionalProperties": several, **key},
            {"type": "array", "minItems": 1, "items": {"type": "object", **key}},
        ],
    }


Members = Annotated[Any, AsWritten(expected=_EXPECTED, described=_described)]


def read_sweep(experiment: Cursor) -> Sweep | None:
    """The values of the members, as far as they are valid; None: there are none."""
    sweep, at = None, experiment.under(SWEEP)
    if isinstance(at.node, MappingNode) and at.node.entries:
        sweep = _every_combination(at.node, at)
    elif at.items():
        sweep = _listed_members(at)
    else:
        at.needs(_EXPECTED)
    return sweep if sweep is not None and sweep.values and sweep.combinations else None


def _every_combination(node: MappingNode, at: Cursor) -> Sweep | None:
    values: dict[str, Sequence[Node]] = {}
    for key in swept_keys(node, at):
        under = at.under(key)
        found: Sequence[Node] = [item.node for item in under.items()]
        if isinstance(under.node, ListNode):
            if not found:
                under.refuse("empty; give at least one entry")
        elif isinstance(under.node, MappingNode):
            numbers, place = RANGE.read(under), under.node.place
            if not isinstance(numbers, list):
                continue
            found = [ScalarNode(place=place, value=x, text=repr(x)) for x in numbers]
        else:
            under.needs(f"a list of values, or a range such as {RANGE.expected}")
        if found:
            _refuse_repeated(found, under)
            values[key] = found
    count = math.prod(len(found) for found in values.values())
    if count > MOST_MEMBERS:
        at.refuse(too_many(count))
        return None
    return Sweep(
        place=node.place,
        key_places={key: node.entries[key].key_place for key in values},
        values=values,
        combinations=list(itertools.product(*(range(len(found)) for found in values.values()))),
    )


def too_many(count: int) -> str:
    """The complaint about too many members."""
    # a finished run takes a few kilobytes, whatever its number of steps
    return (
        f"{count} members are too many; at most {MOST_MEMBERS} are allowed (one run of each would "
        f"take more than {count * BYTES_PER_RUN / 1e9:.3g} GB of memory)"
    )


def _refuse_repeated(found: Sequence[Node], at: Cursor) -> None:
    seen: set[str] = set()
    for index, value in enumerate(found):
        text = value_text(value)
        if text in seen:
            at.refuse(f"{excerpt(text)} is given twice", index)
        seen.add(text)


def value_text(node: Node) -> str:
    """A text that is equal for values that mean the same."""
    value = plain(node)
    if isinstance(value, int | float) and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):
            value = float(value)
    return json.dumps(value, sort_keys=True)


def _listed_members(at: Cursor) -> Sweep | None:
    items = at.items()
    if len(items) > MOST_MEMBERS:
        at.refuse(too_many(len(items)))
        return None
    first = items[0]
    entries = first.node.entries if isinstance(first.node, MappingNode) else {}
    keys = swept_keys(first.node, first) if isinstance(first.node, MappingNode) else []
    rows: list[Mapping[str, Node]] = []
    taken: list[Cursor] = []
    for item in items:
        if not isinstance(item.node, MappingNode) or not item.node.entries:
            item.needs("a mapping such as {problem.stiffness: 2}")
            continue
        if set(item.node.entries) != set(entries):
            shown = listed(excerpt(key) for key in entries)
            item.refuse(f"every member must have the same keys: {shown}")
            continue
        rows.append({key: item.node.entries[key].node for key in keys})
        taken.append(item)
    values, combinations, repeated = indexed(keys, rows)
    for later, _ in repeated if keys else ():
        taken[later].refuse("these values are given twice")
    return Sweep(
        place=at.node.place,
        key_places={key: entries[key].key_place for key in keys},
        values=values,
        combinations=combinations,
    )


def is_absent(node: Node) -> bool:
    """Whether a node is null, which means that the key is left out."""
    return isinstance(node, ScalarNode) and node.value is None


def indexed(
    keys: Sequence[str], rows: Sequence[Mapping[str, Node]]
) -> tuple[dict[str, list[Node]], list[tuple[int, ...]], list[tuple[int, int]]]:
    """Distinct values by key; for each row their indices; pairs (later, earlier) of equal rows."""
    values: dict[str, list[Node]] = {key: [] for key in keys}
    known: dict[str, dict[str, int]] = {key: {} for key in keys}
    first: dict[tuple[int, ...], int] = {}
    combinations, repeated = [], []
    for number, row in enumerate(rows):
        chosen = []
        for key in keys:
            index = known[key].setdefault(value_text(row[key]), len(values[key]))
            if index == len(values[key]):
                values[key].append(row[key])
            chosen.append(index)
        combinations.append(tuple(chosen))
        if (earlier := first.setdefault(tuple(chosen), number)) != number:
            repeated.append((number, earlier))
    return values, combinations, repeated


def objection_to_name(given: object, names: dict[str, str]) -> str:
    """Why a name is not allowed or already taken; empty: it is valid and was added to `names`."""
    name = str(given)
    if not isinstance(given, str | int | float) or not name.strip() or not name.isprintable():
        return "not a name; write a word, such as bare"
    if len(name) > LONGEST_NAME:
        return f"{len(name)} characters; at most {LONGEST_NAME} are allowed"
    other = names.get(name.casefold())
    if other == name:
        return f"{excerpt(name)!r} is the name of another one already"
    if other is not None:
        return f"{excerpt(name)!r} differs from another name in capital letters only"
    names[name.casefold()] = name
    return ""


def swept_keys(node: MappingNode, at: Cursor) -> list[str]:
    """The valid keys; each must lie under ``problem``, and no key inside another one."""
    if len(node.entries) > MOST_KEYS:
        at.refuse(f"{len(node.entries)} keys are too many; at most {MOST_KEYS}")
        return []
    keys = []
    for key in node.entries:
        parts = key.split(".")
        outer = [".".join(parts[:count]) for count in range(1, min(len(parts), DEEPEST))]
        inside = next((one for one in outer if one in node.entries), None)
        if parts[0] != PROBLEM or len(parts) == 1 or not all(parts):
            can = "differ between designs" if "designs" in at.path else "be swept"
            at.refuse_key(key, f"only keys of the problem can {can}, such as problem.stiffness")
        elif len(parts) > DEEPEST:
            at.refuse_key(key, f"is nested more than {DEEPEST} deep")
        elif key in _NOT_SWEPT:
            at.refuse_key(key, _NOT_SWEPT[key])
        elif inside is not None:
            at.refuse_key(key, f"lies inside of {excerpt(inside)}")
        else:
            keys.append(key)
    return keys
