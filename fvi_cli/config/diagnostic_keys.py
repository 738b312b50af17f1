"""Which diagnostics are stored with a trajectory: the keys, and the request that they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from fvi_cli.config.complaints import Complaints, KeyPath
from fvi_cli.config.document import MappingNode
from fvi_cli.config.method_keys import ListedMethod
from fvi_cli.config.records import Key, ListOf, Record, node_at
from fvi_cli.config.shapes import OPTIONAL, Choice, Number, Text, is_complete
from fvi_cli.effects.scene import Scene
from fvi_cli.effects.symmetry import Symmetry, symmetry_defect
from fvi_cli.integrator.diagnostics import NOTHING, Asked
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.registry import coordinate_names
from fvi_cli.scenes.symmetries import known_symmetries

ENERGY: Final = "energy-balance"
MAPS: Final = "momentum-maps"
LARGEST_DEFECT: Final = 1e-6

_ROW: Final = ListOf(shape=Number(), most=1000, example="[0, -1]")
_SYMMETRY: Final = Record(
    keys=(
        Key(
            name="name",
            shape=Text(what="a name"),
            meaning="What the momentum is called.",
        ),
        Key(
            name="generator",
            shape=ListOf(shape=_ROW, most=1000, example="[[0, -1], [1, 0]]"),
            meaning="Matrix G of the motion dq = G q + g; default: zero.",
            default=OPTIONAL,
        ),
        Key(
            name="shift",
            shape=_ROW,
            meaning="Vector g of the motion; default: zero.",
            default=OPTIONAL,
        ),
    )
)
DIAGNOSTIC_KEYS: Final = (
    Key(
        name="diagnostics",
        shape=ListOf(shape=Choice(words=(ENERGY, MAPS)), least=0, example=f"[{ENERGY}, {MAPS}]"),
        meaning="What is stored beside the motion: energy-balance (dissipated work, work of the "
        "forcing, defect of the balance), momentum-maps (of the symmetries). Default: nothing.",
        default=OPTIONAL,
    ),
    Key(
        name="symmetries",
        shape=ListOf(
            shape=_SYMMETRY, most=100, example="[{name: angular, generator: [[0, -1], [1, 0]]}]"
        ),
        meaning="Symmetries dq = G q + g of the scene without damping and forcing; each has the "
        "momentum p (G q + g). Default: shifts, and turns of a plane, that change nothing.",
        default=OPTIONAL,
    ),
)


def read_diagnostics(
    store: object,
    problem: AnyProblem,
    specification: Mapping[str, Any],
    methods: Sequence[ListedMethod],
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
) -> Asked:
    """The diagnostics that the mapping under ``store`` asks for.

    Parameters
    ----------
    store
        What was read; may hold INVALID.
    problem, specification
        The problem, and the mapping that made it.
    methods
        The methods of the experiment.
    node, path
        Where the experiment stands.
    complaints
        Receives what is wrong.
    """
    if not isinstance(store, Mapping) or not is_complete(dict(store)):
        return NOTHING

    def complain(key: KeyPath, message: str) -> None:
        found, _ = node_at(node, ("store", *key))
        complaints.add(found.place, (*path, "store", *key), message)

    wanted = store.get("diagnostics", [])
    if "symmetries" in store and MAPS not in wanted:
        complain(("symmetries",), f"needs diagnostics: [{MAPS}]")
    if not wanted:
        return NOTHING
    if not isinstance(problem, Problem):
        complain(("diagnostics",), f"not for kind {problem.kind}, in which nothing moves")
        return NOTHING
    if "sweep" in node.entries:
        complain(("diagnostics",), "not together with sweep; give each member its own experiment")
    for found in methods:
        if isinstance(found.method, Method) and found.method.history == "exponentials":
            complain(
                ("diagnostics",),
                f"{found.method.case} with history: exponentials keeps no increments of its "
                "steps; use history: auto, fft or direct",
            )
    symmetries: tuple[Symmetry, ...] = ()
    if MAPS in wanted:
        scene = problem.scene
        names = coordinate_names(problem.kind, scene.dimension)
        if problem.kind == "lagrangian":
            names = tuple(specification["coordinates"])
        if "symmetries" in store:
            symmetries = _given(store["symmetries"], scene, complain)
        else:
            symmetries = known_symmetries(scene, names)
            if not symmetries:
                complain(
                    ("diagnostics", list(wanted).index(MAPS)),
                    "no symmetry of this scene was found (turns of a plane and shifts were "
                    "tried); give store.symmetries, or leave momentum-maps out",
                )
    return Asked(energy_balance=ENERGY in wanted, symmetries=symmetries)


def _given(
    entries: Sequence[Mapping[str, Any]], scene: Scene, complain: Callable[[KeyPath, str], None]
) -> tuple[Symmetry, ...]:
    d = scene.dimension
    symmetries = []
    for index, entry in enumerate(entries):
        place: KeyPath = ("symmetries", index)
        generator = entry.get("generator", np.zeros((d, d)).tolist())
        shift = entry.get("shift", [0.0] * d)
        if len(generator) != d or any(len(row) != d for row in generator):
            complain((*place, "generator"), f"must be {d} rows of {d} numbers")
            continue
        if len(shift) != d:
            complain((*place, "shift"), f"{len(shift)} numbers for {d} coordinates")
            continue
        try:
            symmetry = Symmetry(
                name=entry["name"], generator=np.array(generator), shift=np.array(shift)
            )
        except ValueError as error:
            complain(place, str(error))
            continue
        defect = symmetry_defect(scene, symmetry)
        if not defect < LARGEST_DEFECT:
            complain(
                place,
                f"{symmetry.name} is no symmetry: the energy without damping and forcing changes "
                f"along it (relative defect {defect:.1g})",
            )
            continue
        symmetries.append(symmetry)
    repeated = {one.name for one in symmetries if [s.name for s in symmetries].count(one.name) > 1}
    for name in sorted(repeated):
        complain(("symmetries",), f"two symmetries are called {name}")
    return tuple(symmetries)
