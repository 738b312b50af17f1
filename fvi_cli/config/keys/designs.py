"""``designs``: named sets of overrides, each of which makes a member of the experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Final

from fvi_cli.config.keys.sweep import (
    MOST_MEMBERS,
    PROBLEM,
    SWEEP,
    Sweep,
    indexed,
    is_absent,
    objection_to_name,
    read_sweep,
    swept_keys,
    too_many,
)
from fvi_cli.keys.complaints import SourcePosition, excerpt, listed, suggestion
from fvi_cli.keys.cursor import Cursor, Missing
from fvi_cli.keys.nodes import (
    MappingNode,
    Node,
    NowhereError,
    node_at,
    node_of,
    plain,
    with_node,
    without_node,
)
from fvi_cli.keys.scalars import AsWritten, Schema
from fvi_cli.keys.settings import Key
from fvi_cli.scenes.registry import KINDS

DESIGNS: Final = "designs"
_EXPECTED: Final = (
    "a mapping from names to what they change of the problem, such as {bare: {problem.damping: "
    "[]}, damped: {problem.damping: [{order: 0.5, coefficient: 2.0}]}}"
)


def _described(defs: Schema) -> Schema:
    changes = {"type": ["object", "null"], "propertyNames": {"pattern": r"^problem\."}}
    return {"type": "object", "additionalProperties": changes, "minProperties": 1}


Designs = Annotated[Any, AsWritten(expected=_EXPECTED, described=_described)]


def read_members(at: Cursor) -> Sweep | None:
    """The members of the experiment at `at`: its designs, its sweep, or all pairs of both.

    None: it has neither, or there are complaints.
    """
    sweep = read_sweep(at) if at.has(SWEEP) else None
    if not at.has(DESIGNS):
        return sweep
    designs = _read_designs(at)
    if not at.has(SWEEP) or designs is None or sweep is None:
        return designs if not at.has(SWEEP) else None
    return _every_pair(designs, sweep, at)


def _every_pair(designs: Sweep, sweep: Sweep, at: Cursor) -> Sweep | None:
    clash = next(((a, b) for a in sweep.values for b in designs.values if _meet(a, b)), None)
    if clash is not None:
        inner, outer = clash
        at.under(SWEEP).refuse_key(inner, f"designs change {excerpt(outer)}; sweep other keys")
        return None
    count = len(designs.combinations) * len(sweep.combinations)
    if count > MOST_MEMBERS:
        at.under(SWEEP).refuse(too_many(count))
        return None
    pairs = [(d, s) for d in range(len(designs.combinations)) for s in sweep.combinations]
    return replace(
        designs,
        key_places={**designs.key_places, **sweep.key_places},
        values={**designs.values, **sweep.values},
        combinations=[(*designs.combinations[d], *s) for d, s in pairs],
        names=[designs.names[d] for d, _ in pairs],
    )


def _meet(one: str, other: str) -> bool:
    """Whether two keys are equal, or one lies inside the other."""
    return one == other or one.startswith(other + ".") or other.startswith(one + ".")


def _read_designs(at: Cursor) -> Sweep | None:
    """The members that designs make; each has values of all keys that any design changes."""
    under = at.under(DESIGNS)
    if not isinstance(under.node, MappingNode) or not under.node.entries:
        under.needs(_EXPECTED)
        return None
    before = len(at.complaints)
    trees: dict[str, Node] = {}
    names: dict[str, str] = {}
    places: dict[str, SourcePosition] = {}
    for name, here in under.entries():
        if reason := objection_to_name(name, names):
            under.refuse_key(name, reason)
        trees[name] = _changed(at.node, here, places)
    # keys inside other changed keys are covered by the outer ones
    keys = [key for key in places if not any(key.startswith(f"{one}.") for one in places)]
    if len(at.complaints) > before:
        return None
    if not keys:
        under.refuse(f"a change is missing; it must be {_EXPECTED}")
        return None
    rows: list[dict[str, Node]] = []
    for name, tree in trees.items():
        rows.append({})
        for key in keys:
            node = _node_of_key(tree, key)
            if node is None:
                under.refuse(
                    f"does not give {excerpt(key)}, and the problem has no such key; write it "
                    "in every design",
                    name,
                )
                return None
            rows[-1][key] = node
    values, combinations, repeated = indexed(keys, rows)
    for later, earlier in repeated:
        name, other = (list(trees)[number] for number in (later, earlier))
        under.refuse_key(name, f"is the same as the design {excerpt(other)!r}")
    if len(at.complaints) > before:
        return None
    return Sweep(
        place=under.node.place,
        key_places={key: places[key] for key in keys},
        values=values,
        combinations=combinations,
        names=list(trees),
        named=tuple(keys),
    )


def _changed(tree: Node, here: Cursor, places: dict[str, SourcePosition]) -> Node:
    """The tree of the experiment with the overrides of one design."""
    if is_absent(here.node):
        return tree
    if not isinstance(here.node, MappingNode):
        here.needs("a mapping of overrides, such as {problem.damping: []}")
        return tree
    for key in swept_keys(here.node, here):
        entry = here.node.entries[key]
        known = _known_keys(tree)
        if known and (name := key.split(".")[1]) not in known:
            hint = suggestion(name, known) or f" (known here: {listed(known)})"
            here.refuse_key(key, f"{excerpt(name)}: not known{hint}")
            continue
        places.setdefault(key, entry.key_place)
        path = tuple(key.split("."))
        outer = _node_of_key(tree, ".".join(path[:2]))
        if outer is not None and not is_absent(outer) and len(path) > 2:
            # write out the default, so that a key in it can be changed, e.g. initial.position
            tree = with_node(tree, path[:2], outer, entry.key_place)
        try:
            tree = (
                without_node(tree, path)
                if is_absent(entry.node)
                else with_node(tree, path, entry.node, entry.key_place)
            )
        except NowhereError as error:
            here.refuse_key(key, str(error))
    return tree


def _node_of_key(tree: Node, key: str) -> Node | None:
    """The node at a key of the problem, or its default; None: it has neither."""
    path = tuple(key.split("."))
    node, found = node_at(tree, path)
    if found == path:
        return node
    if len(found) > 1:
        return None
    named = _known_keys(tree).get(path[1])
    if named is None:
        return None
    default = named.default
    if isinstance(default, Missing):
        return node_of(None) if len(path) == 2 else None
    node, found = node_at(node_of(default), path[2:])
    return node if found == path[2:] else None


def _known_keys(tree: Node) -> Mapping[str, Key]:
    """The keys of the kind of problem; empty if the kind is not known."""
    kind = plain(node_at(tree, (PROBLEM, "kind"))[0])
    return KINDS[kind].keys if isinstance(kind, str) and kind in KINDS else {}
