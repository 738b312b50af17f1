"""The trees of a file in which an experiment is that of one of its members."""

from __future__ import annotations

from fvi_cli.config.keys.designs import DESIGNS, designs_in_full, read_members
from fvi_cli.config.keys.sweep import SWEEP, Sweep, is_absent
from fvi_cli.keys.complaints import Complaints
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.nodes import Node, NowhereError, with_node, without_node


def nodes_with_sweeps(root: Node, complaints: Complaints) -> Node:
    """The tree of a file in which every problem is that of the first of its members."""
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
    """An experiment with the values of its first member, as far as they fit."""
    sweep = read_members(at)
    if sweep is None:
        return at.node
    node = at.node
    if at.has(DESIGNS):
        # what they say is meant of the problem as it was written
        node = with_node(node, (DESIGNS,), designs_in_full(sweep, at.under(DESIGNS)), sweep.place)
    for key, value in sweep.nodes_of(sweep.combinations[0]).items():
        try:
            node = with_value(node, key, value, sweep)
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
        node = with_value(node, key, value, sweep)
    return node


def with_value(node: Node, key: str, value: Node, sweep: Sweep) -> Node:
    """The tree with another value at a swept key, or without the key where it is null."""
    path = tuple(key.split("."))
    if is_absent(value):
        return without_node(node, path)
    return with_node(node, path, value, sweep.key_places[key])
