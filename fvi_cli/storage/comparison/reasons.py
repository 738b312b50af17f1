"""Why a run is not taken from what is stored."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from fvi_cli.storage.code import Code, own_code
from fvi_cli.storage.comparison.differences import changed_keys
from fvi_cli.storage.provenance import SOLVER_VERSION, canonical_json
from fvi_cli.storage.records import Place, group_path, place_of
from fvi_cli.storage.store import Store
from fvi_cli.studies.experiment import Run

NEW, INCOMPLETE, OLDER_SOLVER, OTHER_SOLVER = "new", "incomplete", "older solver", "newer solver"

MOST_KEYS = 4
"""Keys that are named at most."""


@dataclass(kw_only=True, eq=False)
class Reasons:
    """Compares runs that are to be computed with what is stored in their place.

    Parameters
    ----------
    stored
        A result file with its parts.
    asked
        Places of all runs of the configuration; a stored run elsewhere is one that it no longer
        asks for.
    """

    stored: Store
    asked: Collection[Place]
    _read: dict[Place, Mapping[str, Any]] = field(default_factory=dict)

    def of(self, run: Run) -> str:
        """Why the run is computed.

        Returns
        -------
        str
            ``new``: there is none in its place; ``incomplete``: it is only half there;
            ``older solver``: a version of the program that gave other numbers made it;
            ``numpy 2.4.1 in place of 2.4.0``, ``other source files of fvi 0.2.0``: other code did;
            ``changed: problem.stiffness, ...``: these keys of the configuration are not what they
            were. Where there is none in its place, but a run of the same experiment and number of
            steps is stored that is not asked for any more and differs in keys of the method
            alone, these count as changed: ``changed: method.degree``.

        Raises
        ------
        StorageError
            If what is stored is damaged.
        """
        place = place_of(run)
        specification = json.loads(canonical_json(run.specification()))
        if place in self.stored.places():
            return self._difference(place, specification)
        if group_path(place) in self.stored.incomplete():
            return INCOMPLETE
        return self._replaced(place, specification)

    def _difference(self, place: Place, specification: Mapping[str, Any]) -> str:
        attributes = self._attributes(place)
        changed = changed_keys(json.loads(attributes["specification"]), specification)
        reasons = [_named(changed)] if changed else []
        version = int(attributes["solver_version"])
        if version != SOLVER_VERSION:
            reasons.append(OLDER_SOLVER if version < SOLVER_VERSION else OTHER_SOLVER)
        elif not changed and "code" in attributes:
            reasons.append(Code(**json.loads(attributes["code"])).differences(own_code()))
        return "; ".join(reasons) or "older format"

    def _replaced(self, place: Place, specification: Mapping[str, Any]) -> str:
        """As `changed` if a run is left over that this one may stand for, else `new`."""
        candidates = (
            changed_keys(json.loads(self._attributes(other)["specification"]), specification)
            for other in self._left_over.get((place[0], place[2:]), ())
        )
        of_method = [
            changed for changed in candidates if all(key.startswith("method.") for key in changed)
        ]
        return _named(min(of_method, key=len)) if of_method else NEW

    def _attributes(self, place: Place) -> Mapping[str, Any]:
        if place not in self._read:
            self._read[place] = self.stored.attributes(place)
        return self._read[place]

    @cached_property
    def _left_over(self) -> Mapping[tuple[object, ...], list[Place]]:
        """Stored runs that are not asked for any more, by all but their case."""
        found: dict[tuple[object, ...], list[Place]] = {}
        for place in self.stored.places():
            if place not in self.asked:
                found.setdefault((place[0], place[2:]), []).append(place)
        return found


def _named(keys: tuple[str, ...]) -> str:
    more = len(keys) - MOST_KEYS
    shown = ", ".join(keys[:MOST_KEYS])
    return f"changed: {shown}" + (f" and {more} more" if more > 0 else "")
