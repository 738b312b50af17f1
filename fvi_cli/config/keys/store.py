"""``store``: the points that files keep, and diagnostics of the motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Final

import numpy as np

from fvi_cli.config.keys.ladder import MOST_STEPS
from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.effects.symmetry import Symmetry, symmetry_defect
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.containers import ListOf
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Choice, Integer, Number, Text
from fvi_cli.keys.settings import Setting, key, record_of
from fvi_cli.scenes.problem import AnyProblem, Problem

ENERGY: Final = "energy-balance"
MAPS: Final = "momentum-maps"
LARGEST_DEFECT: Final = 1e-6

_ROW: Final = ListOf(shape=Number(), most=1000, example="[0, -1]")
_MATRIX: Final = ListOf(shape=_ROW, most=1000, example="[[0, -1], [1, 0]]")
_WORDS: Final = Choice(words=(ENERGY, MAPS))


class GivenSymmetry(Setting):
    """An infinitesimal symmetry dq = G q + g of the Lagrangian."""

    name: Annotated[str, Text(what="a name")] = key("What the momentum is called.")
    generator: Annotated[tuple[tuple[float, ...], ...] | None, _MATRIX] = key(
        "Matrix G of the infinitesimal symmetry dq = G q + g; default: zero.", default=None
    )
    shift: Annotated[tuple[float, ...] | None, _ROW] = key(
        "Vector g of the infinitesimal symmetry; default: zero.", default=None
    )

    def symmetry(self, scene: Scene) -> Symmetry:
        """The symmetry of a scene."""
        d = scene.dimension
        generator = np.zeros((d, d)).tolist() if self.generator is None else self.generator
        shift = (0.0,) * d if self.shift is None else self.shift
        if len(generator) != d or any(len(row) != d for row in generator):
            raise ArgumentError("generator", f"must be {d} rows of {d} numbers")
        if len(shift) != d:
            raise ArgumentError("shift", f"{len(shift)} numbers for {d} coordinates")
        try:
            one = Symmetry(name=self.name, generator=np.array(generator), shift=np.array(shift))
        except ValueError as error:
            raise ArgumentError("", str(error)) from None
        defect = symmetry_defect(scene, one)
        if not defect < LARGEST_DEFECT:
            raise ArgumentError(
                "",
                f"{one.name} is not a symmetry: the energy without damping and forcing changes "
                f"along it (relative defect {defect:.1g})",
            )
        return one


_SYMMETRIES: Final = ListOf(
    shape=record_of(GivenSymmetry),
    most=100,
    example="[{name: angular, generator: [[0, -1], [1, 0]]}]",
)
_DIAGNOSTICS: Final = ListOf(shape=_WORDS, least=0, example=f"[{ENERGY}, {MAPS}]")


class StoreKeys(Setting):
    """The points and diagnostics that files keep."""

    every: Annotated[int, Integer(least=1, most=MOST_STEPS)] = key(
        "Keep every n-th grid point in files.", default=1
    )
    diagnostics: Annotated[tuple[str, ...] | None, _DIAGNOSTICS] = key(
        "What is stored in addition to the motion: energy-balance (dissipated work, work of the "
        "forcing, defect of the balance), momentum-maps (of the symmetries). Default: nothing.",
        default=None,
    )
    symmetries: Annotated[tuple[GivenSymmetry, ...] | None, _SYMMETRIES] = key(
        "Symmetries dq = G q + g of the scene without damping and forcing; each has the "
        "momentum p (G q + g). Default: those shifts and turns of the plane that leave the "
        "Lagrangian unchanged.",
        default=None,
    )

    def request(self, problem: AnyProblem, at: Cursor) -> DiagnosticsRequest:
        """The diagnostics of a problem; `at` is the cursor at the experiment."""
        wanted, place = self.diagnostics or (), ("store", "diagnostics")
        if self.symmetries is not None and MAPS not in wanted:
            at.refuse(f"needs diagnostics: [{MAPS}]", "store", "symmetries")
        if not wanted:
            return NO_DIAGNOSTICS
        if not isinstance(problem, Problem):
            at.refuse(f"not for kind {problem.kind}, which has no motion", *place)
            return NO_DIAGNOSTICS
        if problem.scene.prescribed is not None:
            at.refuse(f"not for kind {problem.kind}, whose motion is given", *place)
            return NO_DIAGNOSTICS
        if at.has("sweep") or at.has("designs"):
            at.refuse(
                "not together with sweep or designs; give each member its own experiment", *place
            )
        symmetries: tuple[Symmetry, ...] = ()
        if MAPS in wanted and self.symmetries is not None:
            symmetries = _given(self.symmetries, problem.scene, at.under("store", "symmetries"))
        elif MAPS in wanted:
            symmetries = known_symmetries(problem.scene, problem.coordinates)
            if not symmetries:
                at.refuse(
                    "no symmetry of this scene was found (turns of a plane and shifts were "
                    "tried); give store.symmetries, or leave momentum-maps out",
                    *place,
                    wanted.index(MAPS),
                )
        return DiagnosticsRequest(energy_balance=ENERGY in wanted, symmetries=symmetries)


def _given(entries: Sequence[GivenSymmetry], scene: Scene, at: Cursor) -> tuple[Symmetry, ...]:
    found = []
    for index, entry in enumerate(entries):
        try:
            found.append(entry.symmetry(scene))
        except ArgumentError as error:
            at.under(index).report_argument(error)
    names = [one.name for one in found]
    for name in sorted({name for name in names if names.count(name) > 1}):
        at.refuse(f"two symmetries are called {name}")
    return tuple(found)


FOUND_DEFECT = 1e-9
MOST_COORDINATES = 32


def known_symmetries(scene: Scene, coordinates: tuple[str, ...]) -> tuple[Symmetry, ...]:
    """The symmetries of the Lagrangian without forcing among some usual shifts and rotations.

    Candidates are a rotation of the plane (``angular``, two coordinates), a shift of all
    coordinates together (``linear``), and a shift of a single coordinate (``p_<coordinate>``; up to
    32 coordinates).
    """
    return tuple(
        one
        for one in _candidates(scene.dimension, coordinates)
        if symmetry_defect(scene, one) < FOUND_DEFECT
    )


def _candidates(d: int, coordinates: tuple[str, ...]) -> Iterator[Symmetry]:
    still = np.zeros((d, d))
    if d == 2:
        turn = np.array([[0.0, -1.0], [1.0, 0.0]])
        yield Symmetry(name="angular", generator=turn, shift=np.zeros(2))
    if d > 1:
        yield Symmetry(name="linear", generator=still, shift=np.ones(d))
    if d <= MOST_COORDINATES:
        for name, unit in zip(coordinates, np.eye(d), strict=True):
            yield Symmetry(name=f"p_{name}", generator=still, shift=unit)
