"""``store``: the points that files keep, and diagnostics of the motion."""

from __future__ import annotations

from typing import Annotated, Final

from fvi_cli.config.keys.ladder import MOST_STEPS
from fvi_cli.keys.containers import ListOf
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Choice, Integer
from fvi_cli.keys.settings import Setting, key
from fvi_cli.scenes.problem import AnyProblem, Problem

ENERGY: Final = "energy-balance"
_DIAGNOSTICS: Final = ListOf(shape=Choice(words=(ENERGY,)), least=0, example=f"[{ENERGY}]")


class StoreKeys(Setting):
    """The points and diagnostics that files keep."""

    every: Annotated[int, Integer(least=1, most=MOST_STEPS)] = key(
        "Keep every n-th grid point in files.", default=1
    )
    diagnostics: Annotated[tuple[str, ...] | None, _DIAGNOSTICS] = key(
        "What is stored in addition to the motion: energy-balance (dissipated work, work of the "
        "forcing, defect of the balance). Default: nothing.",
        default=None,
    )

    def request(self, problem: AnyProblem, at: Cursor) -> bool:
        """The diagnostics of a problem; `at` is the cursor at the experiment."""
        wanted, place = self.diagnostics or (), ("store", "diagnostics")
        if not wanted:
            return False
        if not isinstance(problem, Problem):
            at.refuse(f"not for kind {problem.kind}, which has no motion", *place)
            return False
        if problem.scene.prescribed is not None:
            at.refuse(f"not for kind {problem.kind}, whose motion is given", *place)
            return False
        if at.has("sweep") or at.has("designs"):
            at.refuse(
                "not together with sweep or designs; give each member its own experiment", *place
            )
        return True
