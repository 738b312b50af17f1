"""The members of a sweep, each of them checked."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from fvi_cli.config.complaints import Complaints, KeyPath, excerpt
from fvi_cli.config.document import MappingNode
from fvi_cli.config.memory import in_gigabytes, machine_bytes
from fvi_cli.config.problem_checks import make_problem
from fvi_cli.config.problem_keys import PROBLEM as PROBLEM_SHAPE
from fvi_cli.config.shapes import is_complete
from fvi_cli.config.sweep import (
    BYTES_PER_RUN,
    PROBLEM,
    SWEEP,
    Sweep,
    read_sweep,
    tree_of,
    with_node,
)
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem, Problem
from fvi_cli.scenes.registry import build_problem, build_scene
from fvi_cli.studies.members import Member, value_at, with_values

MOST_TOLD: Final = 10
"""Members whose mistakes are told; the others are likely to have the same."""

CheckMember = Callable[[Mapping[str, Any], AnyProblem, MappingNode, Complaints], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadMembers:
    """Members, and the sweep with every value as it was understood."""

    members: tuple[Member, ...]
    resolved: Any


def make_members(
    template: Mapping[str, Any],
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
    check: CheckMember,
) -> ReadMembers | None:
    """The members of the experiment at `node`; None, with complaints, where something is wrong.

    Every value of every key is read like the file; then every member's problem is checked.

    Parameters
    ----------
    template
        The complete ``problem`` mapping of the first member.
    node, path
        Where the experiment stands.
    complaints
        Receives what is wrong, with the values of the member that it is wrong with.
    check
        What else must hold for a member's mapping and problem, in a tree that has its values.
    """
    # the same mistake may have been noted before
    own = Complaints(folder=complaints.folder)
    made = _made(template, node, path, own, check)
    complaints.adopt(own)
    return None if len(own) else made


def _made(
    template: Mapping[str, Any],
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
    check: CheckMember,
) -> ReadMembers | None:
    sweep = read_sweep(node.entries[SWEEP].node, (*path, SWEEP), complaints)
    if sweep is None:
        return None
    values = {key: _values(key, sweep, template, node, path, complaints) for key in sweep.values}
    # a key that is not known was complained of when the first member was read
    is_whole = all(len(values[key]) == len(nodes) for key, nodes in sweep.values.items())
    if len(complaints) or not is_whole:
        return None
    text = json.dumps(template)
    dimension = _dimension(_without_closed_form(template))
    members = tuple(
        Member(
            number=number,
            values={
                key: found[index]
                for (key, found), index in zip(values.items(), combination, strict=True)
            },
            template=text,
            dimension=dimension,
        )
        for number, combination in enumerate(sweep.combinations)
    )
    _check_members(members, template, sweep, node, path, complaints, check)
    is_listed = not isinstance(node.entries[SWEEP].node, MappingNode)
    resolved = [dict(member.values) for member in members] if is_listed else values
    return ReadMembers(members=members, resolved=resolved)


def _values(
    key: str,
    sweep: Sweep,
    template: Mapping[str, Any],
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
) -> list[Any]:
    """The values of one key, read at their place in the problem of the first member."""
    found: list[Any] = []
    place = sweep.key_places[key]
    if not _is_there(template, key):
        return found
    shared = with_values(template, {key: None})
    for value in sweep.values[key]:
        tree = with_node(node, key, value, place).entries[PROBLEM].node
        read = PROBLEM_SHAPE.read(tree, (*path, PROBLEM), complaints)
        if not is_complete(read) or not _is_there(read, key):
            continue
        if with_values(read, {key: None}) != shared:
            outer = key.rpartition(".")[0]
            complaints.add(
                place,
                (*path, SWEEP, key),
                f"cannot be swept alone, for it changes what stands beside it; sweep "
                f"{excerpt(outer)} as a whole",
            )
            break
        found.append(value_at(read, key))
    return found


def _is_there(specification: Mapping[str, Any], key: str) -> bool:
    """Whether a key path leads to something; it does not where the key is not known."""
    try:
        value_at(specification, key)
    except (LookupError, TypeError, ValueError):
        return False
    return True


def _check_members(
    members: Sequence[Member],
    template: Mapping[str, Any],
    sweep: Sweep,
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
    check: CheckMember,
) -> None:
    first = _without_closed_form(template)
    told = 0
    for member, combination in zip(members, sweep.combinations, strict=True):
        specification = member.specification
        own = Complaints(folder=complaints.folder)
        # the places are those of the first member; they matter only where something is wrong
        _check_member(specification, first, node, path, own, check)
        if not len(own):
            continue
        own = Complaints(folder=complaints.folder)
        tree = tree_of(sweep, node, combination)
        _check_member(specification, first, tree, path, own, check)
        complaints.adopt(own, f" (member {member.number}: {excerpt(member.label, 200)})")
        told += 1
        if told == MOST_TOLD:
            complaints.add(
                sweep.place,
                (*path, SWEEP),
                f"members after the {MOST_TOLD} told here are checked when these are mended",
            )
            return


def _check_member(
    specification: Mapping[str, Any],
    first: AnyProblem,
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
    check: CheckMember,
) -> None:
    tree = node.entries[PROBLEM].node
    problem = make_problem(
        specification, tree, (*path, PROBLEM), complaints, build=_without_closed_form
    )
    if problem is None:
        return
    if _dimension(problem) != _dimension(first):
        complaints.add(
            tree.place,
            (*path, PROBLEM),
            f"has {_dimension(problem)} degrees of freedom, the first member "
            f"{_dimension(first)}; members must have the same number",
        )
        return
    check(specification, problem, node, complaints)


def _dimension(problem: AnyProblem) -> int:
    return 1 if isinstance(problem, DerivativeProblem) else problem.scene.dimension


def _without_closed_form(specification: Mapping[str, Any]) -> AnyProblem:
    """The problem, but for the search for a closed form, which takes long and finds no mistake."""
    kind = specification["kind"]
    if kind == "fractional-derivative" or specification.get("exact", "auto") != "auto":
        return build_problem(specification)
    return Problem(kind=kind, scene=build_scene(specification))


def check_total_memory(
    count: int,
    dimension: int,
    points: Sequence[int],
    n_methods: int,
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
) -> None:
    """All finished runs of a sweep must have room in memory, for tables and figures.

    Parameters
    ----------
    count, dimension
        Numbers of members and of degrees of freedom.
    points
        Number of points that are kept in memory for every number of steps.
    n_methods
        Number of methods.
    node, path
        The experiment.
    """
    each = sum(8 * (1 + 3 * dimension) * size + BYTES_PER_RUN for size in points)
    needed, available = count * n_methods * each, machine_bytes()
    if available is not None and needed > available:
        complaints.add(
            node.entries[SWEEP].node.place,
            (*path, SWEEP),
            f"{count} members need about {in_gigabytes(needed)} of memory in all, this machine has "
            f"{in_gigabytes(available)}; store: {{every: n}}, fewer numbers of steps, or several "
            "files need less",
        )
