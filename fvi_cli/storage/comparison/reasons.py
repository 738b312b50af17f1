"""The reasons why a run is computed although a result file has runs."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from fvi_cli.storage.code import Code, own_code
from fvi_cli.storage.comparison.differences import changed_keys
from fvi_cli.storage.digests import SOLVER_VERSION, canonical_json, extract_inputs, specification_of
from fvi_cli.storage.records.record import Entry
from fvi_cli.storage.store import Store
from fvi_cli.studies.experiment import Run
from fvi_cli.studies.members import with_values

NEW, OLDER_SOLVER, OTHER_SOLVER = "new", "older solver", "newer solver"

Place = tuple[str, str, int, str]
"""(Experiment, case, number of steps, swept values as JSON): how users identify a run."""

MOST_KEYS = 4
"""Most keys that a reason names."""


@dataclass(kw_only=True, eq=False)
class Reasons:
    """Compares runs that are to be computed with stored runs of the same place."""

    stored: Store  # a result file with its journal
    # returns all runs of the configuration; a stored run in another place is not requested any
    # more
    requested: Callable[[], Iterable[Run]]

    def of(self, run: Run) -> str:
        """Why the run is computed.

        Returns
        -------
        str
            ``new``: no run is stored in its place; ``older solver``: the stored run was computed by
            a version of the program that gave other numbers; ``numpy 2.4.1 in place of 2.4.0``,
            ``other source files of fvi 0.2.0``: it was computed by other code;
            ``changed: problem.stiffness, ...``: these keys of the configuration have other values.
            If no run is stored in its place, it is compared with the stored runs of the same
            experiment and number of steps that are not requested any more; if one differs only in
            keys of the method, these keys are named: ``changed: method.degree``.
        """
        place = _place_of(run)
        if place in self._places:
            allowed = run.experiment.allow_unstable
            return self._difference(self._places[place], _specification(run), is_allowed=allowed)
        left = self._unrequested.get((place[0], place[2:]), ())
        return _replaced([_stored_specification(one) for one in left], run) if left else NEW

    def _difference(
        self, entry: Entry, specification: Mapping[str, Any], *, is_allowed: bool
    ) -> str:
        attributes = entry.attributes()
        changed = changed_keys(_stored_specification(entry), specification)
        if entry.is_unstable and not changed and entry.kind.is_refusal == is_allowed:
            changed = ("allow_unstable",)
        reasons = [_named(changed)] if changed else []
        version = int(attributes["solver_version"])
        if version != SOLVER_VERSION:
            reasons.append(OLDER_SOLVER if version < SOLVER_VERSION else OTHER_SOLVER)
        elif not changed:
            reasons.append(Code(**json.loads(attributes["code"])).differences(own_code()))
        return "; ".join(reasons) or "older format"

    @cached_property
    def _places(self) -> Mapping[Place, Entry]:
        """The stored runs by place; a run of the configuration hides others of its place."""
        listed = sorted(self.stored.entries(), key=lambda one: one.is_of_configuration)
        return {_place_of_stored(one): one for one in listed}

    @cached_property
    def _unrequested(self) -> Mapping[tuple[object, ...], list[Entry]]:
        """Stored runs that are not requested any more, by their place without the case."""
        requested = set(map(_place_of, self.requested()))
        found: dict[tuple[object, ...], list[Entry]] = {}
        for place, entry in self._places.items():
            if place not in requested:
                found.setdefault((place[0], place[2:]), []).append(entry)
        return found


def _place_of(run: Run) -> Place:
    values = {} if run.member is None else extract_inputs(dict(run.member.values))
    return run.experiment.name, run.method.case, run.n_steps, canonical_json(values)


def _place_of_stored(entry: Entry) -> Place:
    kind = entry.kind
    a = entry.attributes() if kind.swept else {}
    values = canonical_json({key: a[key] for key in kind.swept})
    return kind.experiment, kind.case, kind.n_steps, values


def _specification(run: Run) -> dict[str, Any]:
    values = {} if run.member is None else dict(run.member.values)
    return _with_swept(specification_of(run)[0], extract_inputs(values))


def _stored_specification(entry: Entry) -> dict[str, Any]:
    a = entry.attributes()
    return _with_swept(a["specification"], {key: a[key] for key in entry.kind.swept})


def _with_swept(text: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """A specification with the swept values of a member inserted."""
    found: dict[str, Any] = json.loads(text)
    return {**found, "problem": with_values(found["problem"], values)}


def _replaced(candidates: Collection[Mapping[str, Any]], run: Run) -> str:
    """``changed: ...`` if a candidate differs from the run in keys of the method only, else new."""
    specification = _specification(run)
    changes = [changed_keys(one, specification) for one in candidates]
    of_method = [one for one in changes if all(key.startswith("method.") for key in one)]
    return _named(min(of_method, key=len)) if of_method else NEW


def _named(keys: tuple[str, ...]) -> str:
    more = len(keys) - MOST_KEYS
    shown = ", ".join(keys[:MOST_KEYS])
    return f"changed: {shown}" + (f" and {more} more" if more > 0 else "")
