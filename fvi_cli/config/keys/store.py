"""``store``: what is kept in files, and the diagnostics beside the motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from fvi_cli.config.keys.ladder import MOST_STEPS
from fvi_cli.effects.diagnostics_request import NOTHING, Asked
from fvi_cli.effects.scene import Scene
from fvi_cli.effects.symmetry import Symmetry, symmetry_defect
from fvi_cli.keys.containers import ListOf
from fvi_cli.keys.cursor import Cursor, is_complete
from fvi_cli.keys.records import Key, Record, optional
from fvi_cli.keys.scalars import Choice, Integer, Number, Text
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.symmetries import known_symmetries

ENERGY: Final = "energy-balance"
MAPS: Final = "momentum-maps"
LARGEST_DEFECT: Final = 1e-6

_ROW: Final = ListOf(shape=Number(), most=1000, example="[0, -1]")
_SYMMETRY: Final = Record(
    keys=(
        Key("name", Text(what="a name"), "What the momentum is called."),
        optional(
            "generator",
            ListOf(shape=_ROW, most=1000, example="[[0, -1], [1, 0]]"),
            "Matrix G of the motion dq = G q + g; default: zero.",
        ),
        optional("shift", _ROW, "Vector g of the motion; default: zero."),
    )
)
STORE: Final = Record(
    keys=(
        Key(
            "every",
            Integer(least=1, most=MOST_STEPS),
            "Keep every n-th grid point in files.",
            default=1,
        ),
        optional(
            "diagnostics",
            ListOf(shape=Choice(words=(ENERGY, MAPS)), least=0, example=f"[{ENERGY}, {MAPS}]"),
            "What is stored beside the motion: energy-balance (dissipated work, work of the "
            "forcing, defect of the balance), momentum-maps (of the symmetries). Default: nothing.",
        ),
        optional(
            "symmetries",
            ListOf(
                shape=_SYMMETRY, most=100, example="[{name: angular, generator: [[0, -1], [1, 0]]}]"
            ),
            "Symmetries dq = G q + g of the scene without damping and forcing; each has the "
            "momentum p (G q + g). Default: shifts, and turns of a plane, that change nothing.",
        ),
    )
)


def read_diagnostics(store: object, problem: AnyProblem, at: Cursor) -> Asked:
    """The diagnostics that the mapping under ``store`` of an experiment asks for.

    Parameters
    ----------
    store
        What was read; may hold INVALID.
    problem
        What they are computed of.
    at
        The experiment.
    """
    if not isinstance(store, Mapping) or not is_complete(store):
        return NOTHING
    wanted = store.get("diagnostics", [])
    if "symmetries" in store and MAPS not in wanted:
        at.refuse(f"needs diagnostics: [{MAPS}]", "store", "symmetries")
    if not wanted:
        return NOTHING
    place = ("store", "diagnostics")
    if not isinstance(problem, Problem):
        at.refuse(f"not for kind {problem.kind}, in which nothing moves", *place)
        return NOTHING
    if at.has("sweep"):
        at.refuse("not together with sweep; give each member its own experiment", *place)
    symmetries: tuple[Symmetry, ...] = ()
    if MAPS in wanted and "symmetries" in store:
        symmetries = _given(store["symmetries"], problem.scene, at.under("store", "symmetries"))
    elif MAPS in wanted:
        symmetries = known_symmetries(problem.scene, problem.coordinates)
        if not symmetries:
            at.refuse(
                "no symmetry of this scene was found (turns of a plane and shifts were "
                "tried); give store.symmetries, or leave momentum-maps out",
                *place,
                list(wanted).index(MAPS),
            )
    return Asked(energy_balance=ENERGY in wanted, symmetries=symmetries)


def _given(entries: Sequence[Mapping[str, Any]], scene: Scene, at: Cursor) -> tuple[Symmetry, ...]:
    found = [one for index, entry in enumerate(entries) if (one := _one(entry, index, scene, at))]
    names = [one.name for one in found]
    for name in sorted({name for name in names if names.count(name) > 1}):
        at.refuse(f"two symmetries are called {name}")
    return tuple(found)


def _one(entry: Mapping[str, Any], index: int, scene: Scene, at: Cursor) -> Symmetry | None:
    d = scene.dimension
    generator = entry.get("generator", np.zeros((d, d)).tolist())
    shift = entry.get("shift", [0.0] * d)
    if len(generator) != d or any(len(row) != d for row in generator):
        at.refuse(f"must be {d} rows of {d} numbers", index, "generator")
        return None
    if len(shift) != d:
        at.refuse(f"{len(shift)} numbers for {d} coordinates", index, "shift")
        return None
    try:
        one = Symmetry(name=entry["name"], generator=np.array(generator), shift=np.array(shift))
    except ValueError as error:
        at.refuse(str(error), index)
        return None
    defect = symmetry_defect(scene, one)
    if not defect < LARGEST_DEFECT:
        at.refuse(
            f"{one.name} is no symmetry: the energy without damping and forcing changes "
            f"along it (relative defect {defect:.1g})",
            index,
        )
        return None
    return one
