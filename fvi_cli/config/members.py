"""The members of a sweep, and their checks."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from fvi_cli.config.keys.designs import DESIGNS, read_members
from fvi_cli.config.keys.sweep import (
    PROBLEM,
    SWEEP,
    Sweep,
    is_absent,
)
from fvi_cli.config.problem import make_problem, problem_keys
from fvi_cli.keys.complaints import Complaints, excerpt, no_member, not_known
from fvi_cli.keys.cursor import Cursor, is_complete
from fvi_cli.keys.nodes import ListNode, Node, NowhereError, with_node, without_node
from fvi_cli.scenes.kinds.kind import Kind
from fvi_cli.scenes.problem import AnyProblem
from fvi_cli.scenes.registry import KINDS
from fvi_cli.studies.members import Member, leads_somewhere, value_at, with_values


def first_members(root: Node, complaints: Complaints) -> tuple[Node, list[Sweep | None]]:
    """The tree of a file with the first member in place of every problem, and the sweeps."""
    sweeps = []
    for at in experiment_cursors(root, complaints):
        before = len(complaints)
        sweep = read_members(at)
        if sweep is not None:
            root = with_node(root, at.path, _tree_of_first(sweep, at), at.node.place)
            sweep = replace(sweep, is_valid=len(complaints) == before)
        sweeps.append(sweep)
    return root, sweeps


def experiment_cursors(root: Node, complaints: Complaints) -> list[Cursor]:
    """A cursor for every experiment of a file."""
    at = Cursor(node=root, complaints=complaints)
    return at.under("experiments").items() if at.has("experiments") else [at]


def _tree_of_first(sweep: Sweep, at: Cursor) -> Node:
    """The tree of an experiment with the values of its first member, as far as they fit."""
    node = at.node
    for key, value in sweep.nodes_of(sweep.combinations[0]).items():
        try:
            node = with_value(node, key, value, sweep)
        except NowhereError as error:
            at.under(SWEEP).refuse_key(key, str(error))
    return node


def tree_of(sweep: Sweep, node: Node, combination: tuple[int, ...]) -> Node:
    """The tree of the experiment with the values of one member."""
    for key, value in sweep.nodes_of(combination).items():
        node = with_value(node, key, value, sweep)
    return node


def with_value(node: Node, key: str, value: Node, sweep: Sweep) -> Node:
    """The tree with another value at a swept key, or without the key where it is null."""
    path = tuple(key.split("."))
    if is_absent(value):
        return without_node(node, path)
    return with_node(node, path, value, sweep.key_places[key])


MOST_REPORTED: Final = 10
"""Most members whose mistakes are reported; other members are likely to have the same mistakes."""

MANY: Final = 5000
"""From so many members on the check takes long and is announced."""

_logger = logging.getLogger(__name__)

CheckMember = Callable[[AnyProblem, Cursor], None]


ReadMembers = tuple[tuple[Member, ...], dict[str, Any]]
"""Members, and the resolved mappings under ``designs`` and ``sweep`` that make them."""


def make_members(
    sweep: Sweep, template: Mapping[str, Any], first: AnyProblem, at: Cursor, check: CheckMember
) -> ReadMembers | None:
    """The members of an experiment; None, with complaints, where something is wrong.

    Every value of every key is read like the file; then the problem of every member is checked.
    `template` is the resolved mapping of the problem `first`.
    """
    before = len(at.complaints)
    values = {key: _values(key, sweep, template, at) for key in sweep.values}
    # the reading of the first member has complained of unknown keys
    is_whole = all(len(values[key]) == len(nodes) for key, nodes in sweep.values.items())
    if len(at.complaints) > before or not (is_whole and sweep.is_valid):
        return None
    text = json.dumps(template)
    members = tuple(
        Member(
            number=number,
            values={
                key: found[index]
                for (key, found), index in zip(values.items(), combination, strict=True)
            },
            template=text,
            dimension=first.dimension,
            name=sweep.names[number] if sweep.names else "",
            named=sweep.named,
        )
        for number, combination in enumerate(sweep.combinations)
    )
    _check_members(members, template, first, sweep, at, check)
    if len(at.complaints) > before:
        return None
    return members, _resolved(members, values, at)


def _resolved(
    members: Sequence[Member], values: Mapping[str, list[Any]], at: Cursor
) -> dict[str, Any]:
    """The mappings under ``designs`` and ``sweep`` with the values as they were read."""
    found: dict[str, Any] = {}
    if at.has(DESIGNS):
        found[DESIGNS] = {one.name: {key: one.values[key] for key in one.named} for one in members}
    if isinstance(at.under(SWEEP).node, ListNode):
        rows = [one.unnamed for one in members]
        designs = len(found.get(DESIGNS, ())) or 1
        found[SWEEP] = rows[: len(rows) // designs]
    elif at.has(SWEEP):
        named = members[0].named
        found[SWEEP] = {key: one for key, one in values.items() if key not in named}
    return found


def _values(key: str, sweep: Sweep, template: Mapping[str, Any], at: Cursor) -> list[Any]:
    """The values of one swept key, each read in the problem of the first member."""
    found: list[Any] = []
    if not leads_somewhere(template, key) and not any(map(is_absent, sweep.values[key])):
        return found
    # only the outermost key is read again: the others do not depend on the value
    outermost = key.split(".")[1]
    known = KINDS[template["kind"]].keys
    if outermost not in known:
        at.under(DESIGNS).refuse(f"{excerpt(key)}: {not_known(outermost, known)}")
        return found
    shared = with_values({outermost: template.get(outermost)}, {key: None})
    for value in sweep.values[key]:
        if is_absent(value):
            found.append(None)
            continue
        tree = replace(
            at,
            node=with_value(at.node, key, value, sweep),
            names=tuple(template.get("parameters", ())),
        )
        read = {outermost: known[outermost].shape.read(tree.under(PROBLEM, outermost))}
        if not is_complete(read) or not leads_somewhere(read, key):
            continue
        if with_values(read, {key: None}) != shared:
            outer = excerpt(key.rpartition(".")[0])
            at.under(SWEEP if at.has(SWEEP) else DESIGNS).refuse_key(
                key,
                f"also changes the entries next to it; sweep {outer} as a whole",
            )
            break
        found.append(value_at(read, key))
    return found


def _check_members(
    members: Sequence[Member],
    template: Mapping[str, Any],
    first: AnyProblem,
    sweep: Sweep,
    at: Cursor,
    check: CheckMember,
) -> None:
    n_reported = 0
    if at.complaints.checks_member is no_member:
        return
    if len(members) >= MANY:
        _logger.info("checking %d members of a sweep", len(members))
    trial = replace(at, complaints=at.complaints.separate())
    keys, swept = problem_keys(template), {key.split(".")[1] for key in sweep.values}
    for member, combination in zip(members, sweep.combinations, strict=True):
        if not at.complaints.checks_member(member.number):
            continue
        own_keys = keys.with_values(with_values(template, member.values), swept)
        # the first check uses the tree, and so the places, of the first member
        _check_member(own_keys, first, trial, check)
        if not len(trial.complaints):
            continue
        trial = replace(at, complaints=at.complaints.separate())
        own = at.complaints.separate()
        tree = tree_of(sweep, at.node, combination)
        _check_member(own_keys, first, replace(at, node=tree, complaints=own), check)
        at.complaints.adopt(own, f" (member {member.number}: {excerpt(member.label, 200)})")
        n_reported += 1
        if n_reported == MOST_REPORTED:
            at.refuse(
                f"only the first {MOST_REPORTED} are reported; fix these and run again",
                SWEEP,
            )
            return


def _check_member(keys: Kind, first: AnyProblem, at: Cursor, check: CheckMember) -> None:
    problem = make_problem(keys, at.under(PROBLEM), search=False)
    if problem is None:
        return
    if problem.dimension == first.dimension:
        check(problem, at)
        return
    at.refuse(
        f"has {problem.dimension} degrees of freedom, the first member "
        f"{first.dimension}; members must have the same number",
        PROBLEM,
    )
