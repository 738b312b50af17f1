"""``sweep``: the members that a list of values, or several lists, make of one problem."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from fvi_cli.keys.complaints import Complaints, SourcePosition, excerpt, listed
from fvi_cli.keys.cursor import INVALID, Cursor
from fvi_cli.keys.nodes import (
    ListNode,
    MappingNode,
    Node,
    NowhereError,
    ScalarNode,
    plain,
    with_node,
)
from fvi_cli.keys.ranges import RANGE
from fvi_cli.keys.scalars import Schema, Shape

DEEPEST: Final = 50
MOST_MEMBERS: Final = 100_000
MOST_KEYS: Final = 20
BYTES_PER_RUN: Final = 4000
"""What is kept in memory of a finished run beside its trajectory."""

SWEEP: Final = "sweep"
PROBLEM: Final = "problem"

_EXPECTED: Final = (
    "a mapping such as {problem.stiffness: [1, 2, 4], problem.damping.0.order: {from: 0.1, "
    "to: 0.9, number: 9}}, or a list of mappings with one value for every key"
)
_NOT_SWEPT: Final = {
    "problem.kind": "members are of one kind; write several experiments",
    "problem.final_time": "members share their times; write several experiments",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """What stands under ``sweep``, as nodes.

    Parameters
    ----------
    place
        Where it stands.
    key_places
        Every swept key with its place.
    values
        The values of every key that occur.
    combinations
        For every member the index of its value, key by key.
    """

    place: SourcePosition
    key_places: Mapping[str, SourcePosition]
    values: Mapping[str, Sequence[Node]]
    combinations: Sequence[tuple[int, ...]]

    def nodes_of(self, combination: tuple[int, ...]) -> dict[str, Node]:
        """The value of every key of one member."""
        return {
            key: self.values[key][index]
            for key, index in zip(self.values, combination, strict=True)
        }


@dataclass(frozen=True, kw_only=True)
class SweepShape(Shape):
    """What may stand under ``sweep``."""

    expected: str = _EXPECTED

    def read(self, at: Cursor) -> Any:
        """Plain values, ranges written out; what the values mean is read with the problem."""
        own = at.complaints.separate()
        sweep = read_sweep(replace(at, complaints=own))
        at.complaints.adopt(own)
        if sweep is None or len(own):
            return INVALID
        if isinstance(at.node, MappingNode):
            return {key: [plain(value) for value in sweep.values[key]] for key in sweep.values}
        return [
            {key: plain(value) for key, value in sweep.nodes_of(combination).items()}
            for combination in sweep.combinations
        ]

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        key = {"propertyNames": {"pattern": r"^problem\."}, "minProperties": 1}
        several = {"anyOf": [{"type": "array", "minItems": 1}, RANGE.schema(defs)]}
        return {
            "title": "mapping of lists or ranges, or list of mappings",
            "oneOf": [
                {"type": "object", "additionalProperties": several, **key},
                {"type": "array", "minItems": 1, "items": {"type": "object", **key}},
            ],
        }


def read_sweep(at: Cursor) -> Sweep | None:
    """The members' values, as far as they can be told where there are complaints; None: not."""
    sweep = None
    if isinstance(at.node, MappingNode) and at.node.entries:
        sweep = _every_combination(at.node, at)
    elif at.items():
        sweep = _listed_members(at)
    else:
        at.needs(_EXPECTED)
    return sweep if sweep is not None and sweep.values and sweep.combinations else None


def _every_combination(node: MappingNode, at: Cursor) -> Sweep | None:
    values: dict[str, Sequence[Node]] = {}
    for key in _swept_keys(node, at):
        under = at.under(key)
        found: Sequence[Node] = [item.node for item in under.items()]
        if isinstance(under.node, ListNode):
            if not found:
                under.refuse("no entries; there must be at least one")
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
    """The complaint of so many members."""
    # a finished run takes a few kilobytes, whatever its number of steps
    return (
        f"{count} members are too many; at most {MOST_MEMBERS} are allowed (one run of each would "
        f"take more than {count * BYTES_PER_RUN / 1e9:.3g} GB of memory)"
    )


def _refuse_repeated(found: Sequence[Node], at: Cursor) -> None:
    seen: set[str] = set()
    for index, value in enumerate(found):
        text = _value_text(value)
        if text in seen:
            at.refuse(f"{excerpt(text)} stands in the list already", index)
        seen.add(text)


def _value_text(node: Node) -> str:
    """Equal for values that mean the same."""
    value = plain(node)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return json.dumps(_float(value) if is_number else value, sort_keys=True)


def _float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return float("inf")


def _listed_members(at: Cursor) -> Sweep | None:
    items = at.items()
    if len(items) > MOST_MEMBERS:
        at.refuse(too_many(len(items)))
        return None
    first = items[0]
    entries = first.node.entries if isinstance(first.node, MappingNode) else {}
    keys = _swept_keys(first.node, first) if isinstance(first.node, MappingNode) else []
    values: dict[str, list[Node]] = {key: [] for key in keys}
    indices: dict[str, dict[str, int]] = {key: {} for key in keys}
    combinations: dict[tuple[int, ...], None] = {}
    for item in items:
        if not isinstance(item.node, MappingNode) or not item.node.entries:
            item.needs("a mapping such as {problem.stiffness: 2}")
            continue
        if set(item.node.entries) != set(entries):
            shown = listed(excerpt(key) for key in entries)
            item.refuse(f"every member must have the same keys: {shown}")
            continue
        chosen = []
        for key in keys:
            value = item.node.entries[key].node
            index = indices[key].setdefault(_value_text(value), len(values[key]))
            if index == len(values[key]):
                values[key].append(value)
            chosen.append(index)
        if tuple(chosen) in combinations:
            item.refuse("the same values stand in the list already")
        combinations[tuple(chosen)] = None
    return Sweep(
        place=at.node.place,
        key_places={key: entries[key].key_place for key in keys},
        values=values,
        combinations=list(combinations),
    )


def _swept_keys(node: MappingNode, at: Cursor) -> list[str]:
    """The keys, all of which must lead to something under ``problem``, and none into another."""
    if len(node.entries) > MOST_KEYS:
        at.refuse(f"{len(node.entries)} keys are too many; at most {MOST_KEYS}")
        return []
    keys = []
    for key in node.entries:
        parts = key.split(".")
        outer = [".".join(parts[:count]) for count in range(1, min(len(parts), DEEPEST))]
        inside = next((one for one in outer if one in node.entries), None)
        if parts[0] != PROBLEM or len(parts) == 1 or not all(parts):
            is_other = parts[0] != PROBLEM
            hint = "; methods and numbers of steps are listed there" if is_other else ""
            at.refuse_key(
                key, f"only keys of the problem can be swept, such as problem.stiffness{hint}"
            )
        elif len(parts) > DEEPEST:
            at.refuse_key(key, f"leads more than {DEEPEST} deep")
        elif key in _NOT_SWEPT:
            at.refuse_key(key, _NOT_SWEPT[key])
        elif inside is not None:
            at.refuse_key(key, f"lies inside of {excerpt(inside)}")
        else:
            keys.append(key)
    return keys


def nodes_with_sweeps(root: Node, complaints: Complaints) -> Node:
    """The tree of a file in which every problem is that of the first member of its sweep."""
    for at in experiment_cursors(root, complaints):
        first = tree_of_first(at)
        if first is not at.node:
            root = with_node(root, at.path, first, first.place)
    return root


def experiment_cursors(root: Node, complaints: Complaints) -> list[Cursor]:
    """The experiments in a file."""
    at = Cursor(node=root, complaints=complaints)
    return at.under("experiments").items() if at.has("experiments") else [at]


def tree_of_first(at: Cursor) -> Node:
    """An experiment with the values of the first member of its sweep, as far as they fit."""
    sweep = read_sweep(at.under(SWEEP)) if at.has(SWEEP) else None
    node = at.node
    for key, value in ({} if sweep is None else sweep.nodes_of(sweep.combinations[0])).items():
        place = sweep.key_places[key] if sweep else node.place
        try:
            node = with_node(node, tuple(key.split(".")), value, place)
        except NowhereError as error:
            at.under(SWEEP).refuse_key(key, str(error))
    return node


def tree_of(sweep: Sweep, node: Node, combination: tuple[int, ...]) -> Node:
    """The tree of the experiment with the values of one member.

    Raises
    ------
    NowhereError
        If a key leads nowhere.
    """
    for key, value in sweep.nodes_of(combination).items():
        node = with_node(node, tuple(key.split(".")), value, sweep.key_places[key])
    return node
