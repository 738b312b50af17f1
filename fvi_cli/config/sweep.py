"""``sweep``: the members that a list of values, or several lists, make of one problem."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from fvi_cli.config.complaints import Complaints, KeyPath, Place, excerpt, show_path
from fvi_cli.config.document import Entry, ListNode, MappingNode, Node, ScalarNode
from fvi_cli.config.memory import in_gigabytes
from fvi_cli.config.ranges import Range
from fvi_cli.config.shapes import INVALID, Schema, needed

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

    place: Place
    key_places: Mapping[str, Place]
    values: Mapping[str, Sequence[Node]]
    combinations: Sequence[tuple[int, ...]]

    def nodes_of(self, combination: tuple[int, ...]) -> dict[str, Node]:
        """The value of every key of one member."""
        return {
            key: self.values[key][index]
            for key, index in zip(self.values, combination, strict=True)
        }


@dataclass(frozen=True, kw_only=True)
class SweepShape:
    """What may stand under ``sweep``."""

    expected: str = _EXPECTED

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """Plain values, ranges written out; what the values mean is read with the problem."""
        own = Complaints(folder=complaints.folder)
        sweep = read_sweep(node, path, own)
        complaints.adopt(own)
        if sweep is None or len(own):
            return INVALID
        if isinstance(node, MappingNode):
            return {key: [plain(value) for value in sweep.values[key]] for key in sweep.values}
        return [
            {key: plain(value) for key, value in sweep.nodes_of(combination).items()}
            for combination in sweep.combinations
        ]

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        key = {"propertyNames": {"pattern": r"^problem\."}, "minProperties": 1}
        several = {"anyOf": [{"type": "array", "minItems": 1}, Range().schema()]}
        return {
            "oneOf": [
                {"type": "object", "additionalProperties": several, **key},
                {"type": "array", "minItems": 1, "items": {"type": "object", **key}},
            ]
        }


def plain(node: Node) -> Any:
    """What a node says, as JSON values."""
    if isinstance(node, ListNode):
        return [plain(item) for item in node.items]
    if isinstance(node, MappingNode):
        return {key: plain(entry.node) for key, entry in node.entries.items()}
    return node.value


def read_sweep(node: Node, path: KeyPath, complaints: Complaints) -> Sweep | None:
    """The members' values, as far as they can be told where there are complaints; None: not."""
    sweep = None
    if isinstance(node, MappingNode) and node.entries:
        sweep = _every_combination(node, path, complaints)
    elif isinstance(node, ListNode) and node.items:
        sweep = _listed_members(node, path, complaints)
    else:
        complaints.add(node.place, path, needed(node, _EXPECTED))
    return sweep if sweep is not None and sweep.values and sweep.combinations else None


def _every_combination(node: MappingNode, path: KeyPath, complaints: Complaints) -> Sweep | None:
    values: dict[str, Sequence[Node]] = {}
    for key in _swept_keys(node, path, complaints):
        entry, here = node.entries[key], (*path, key)
        found: Sequence[Node] = ()
        if isinstance(entry.node, ListNode):
            found = entry.node.items
            if not found:
                complaints.add(entry.node.place, here, "no entries; there must be at least one")
        elif isinstance(entry.node, MappingNode):
            numbers = Range().read(entry.node, here, complaints)
            if numbers is INVALID:
                continue
            place = entry.node.place
            found = [ScalarNode(place=place, value=x, text=repr(x)) for x in numbers]
        else:
            complaints.add(
                entry.node.place,
                here,
                needed(entry.node, f"a list of values, or a range such as {Range().expected}"),
            )
        if found:
            _complain_of_repeated(found, here, complaints)
            values[key] = found
    count = 1
    for found in values.values():
        count *= len(found)
    if count > MOST_MEMBERS:
        complaints.add(node.place, path, too_many(count))
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
        f"take more than {in_gigabytes(count * BYTES_PER_RUN)} of memory)"
    )


def _complain_of_repeated(found: Sequence[Node], path: KeyPath, complaints: Complaints) -> None:
    seen: set[str] = set()
    for index, value in enumerate(found):
        text = _told(value)
        if text in seen:
            complaints.add(
                value.place, (*path, index), f"{excerpt(text)} stands in the list already"
            )
        seen.add(text)


def _told(node: Node) -> str:
    """Equal for values that mean the same."""
    value = plain(node)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return json.dumps(_float(value) if is_number else value, sort_keys=True)


def _float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return float("inf")


def _listed_members(node: ListNode, path: KeyPath, complaints: Complaints) -> Sweep | None:
    if len(node.items) > MOST_MEMBERS:
        complaints.add(node.place, path, too_many(len(node.items)))
        return None
    first = node.items[0]
    entries = first.entries if isinstance(first, MappingNode) else {}
    keys = _swept_keys(first, (*path, 0), complaints) if isinstance(first, MappingNode) else []
    values: dict[str, list[Node]] = {key: [] for key in keys}
    indices: dict[str, dict[str, int]] = {key: {} for key in keys}
    combinations: dict[tuple[int, ...], None] = {}
    for number, item in enumerate(node.items):
        here = (*path, number)
        if not isinstance(item, MappingNode) or not item.entries:
            complaints.add(
                item.place, here, needed(item, "a mapping such as {problem.stiffness: 2}")
            )
            continue
        if set(item.entries) != set(entries):
            shown = ", ".join(excerpt(key) for key in entries)
            complaints.add(item.place, here, f"every member must have the same keys: {shown}")
            continue
        chosen = []
        for key in keys:
            value = item.entries[key].node
            index = indices[key].setdefault(_told(value), len(values[key]))
            if index == len(values[key]):
                values[key].append(value)
            chosen.append(index)
        if tuple(chosen) in combinations:
            complaints.add(item.place, here, "the same values stand in the list already")
        combinations[tuple(chosen)] = None
    return Sweep(
        place=node.place,
        key_places={key: entries[key].key_place for key in keys},
        values=values,
        combinations=list(combinations),
    )


def _swept_keys(node: MappingNode, path: KeyPath, complaints: Complaints) -> list[str]:
    """The keys, all of which must lead to something under ``problem``, and none into another."""
    if len(node.entries) > MOST_KEYS:
        complaints.add(
            node.place, path, f"{len(node.entries)} keys are too many; at most {MOST_KEYS}"
        )
        return []
    keys = []
    for key, entry in node.entries.items():
        first, *rest = key.split(".")
        if first != PROBLEM or not rest or not all(rest):
            hint = "; methods and numbers of steps are listed there" if first != PROBLEM else ""
            complaints.add(
                entry.key_place,
                (*path, key),
                f"only keys of the problem can be swept, such as problem.stiffness{hint}",
            )
        elif key in _NOT_SWEPT:
            complaints.add(entry.key_place, (*path, key), _NOT_SWEPT[key])
        parts = key.split(".")
        for outer in (".".join(parts[:count]) for count in range(1, len(parts))):
            if outer in node.entries:
                complaints.add(entry.key_place, (*path, key), f"lies inside of {excerpt(outer)}")
                break
        else:
            if first == PROBLEM and rest and all(rest) and key not in _NOT_SWEPT:
                keys.append(key)
    return keys


def nodes_with_sweeps(root: MappingNode, complaints: Complaints) -> MappingNode:
    """The tree of a file in which every problem is that of the first member of its sweep."""
    several = root.entries.get("experiments")
    if several is None:
        return _first_member(root, (), complaints)
    if not isinstance(several.node, ListNode):
        return root
    items = tuple(
        _first_member(item, ("experiments", index), complaints)
        if isinstance(item, MappingNode)
        else item
        for index, item in enumerate(several.node.items)
    )
    changed = replace(several, node=replace(several.node, items=items))
    return replace(root, entries={**root.entries, "experiments": changed})


def _first_member(node: MappingNode, path: KeyPath, complaints: Complaints) -> MappingNode:
    entry = node.entries.get(SWEEP)
    sweep = None if entry is None else read_sweep(entry.node, (*path, SWEEP), complaints)
    if sweep is None:
        return node
    for key, value in sweep.nodes_of(sweep.combinations[0]).items():
        try:
            changed = with_node(node, key, value, sweep.key_places[key])
        except LookupError as error:
            complaints.add(sweep.key_places[key], (*path, SWEEP, key), str(error.args[0]))
        else:
            node = changed
    return node


def with_node(node: MappingNode, key: str, value: Node, place: Place) -> MappingNode:
    """The tree with another node at a key path; mappings that it needs are made.

    Raises
    ------
    LookupError
        If the path leads into a list that is too short, or into a plain value.
    """
    changed = _with_node(node, key.split("."), (), value, place)
    if not isinstance(changed, MappingNode):  # pragma: no cover - a mapping stays one
        raise LookupError(f"{key} leads nowhere")
    return changed


def _with_node(node: Node, parts: list[str], done: KeyPath, value: Node, place: Place) -> Node:
    if not parts:
        return value
    part, rest = parts[0], parts[1:]
    here = (*done, part)
    if isinstance(node, ListNode):
        if not part.isdecimal() or len(part) > 6 or int(part) >= len(node.items):
            raise LookupError(
                f"there is no {show_path(here)}; the list has {len(node.items)} entries from 0 on"
            )
        items = list(node.items)
        items[int(part)] = _with_node(items[int(part)], rest, here, value, place)
        return replace(node, items=tuple(items))
    if not isinstance(node, MappingNode):
        raise LookupError(f"there is no {show_path(here)}; {show_path(done)} has no keys")
    old = node.entries.get(part)
    inner: Node = MappingNode(place=place, entries={}) if old is None else old.node
    key_place = place if old is None or not rest else old.key_place
    entry = Entry(key_place=key_place, node=_with_node(inner, rest, here, value, place))
    return replace(node, entries={**node.entries, part: entry})


def tree_of(sweep: Sweep, node: MappingNode, combination: tuple[int, ...]) -> MappingNode:
    """The tree of the experiment with the values of one member.

    Raises
    ------
    LookupError
        As :func:`with_node`.
    """
    for key, value in sweep.nodes_of(combination).items():
        node = with_node(node, key, value, sweep.key_places[key])
    return node
