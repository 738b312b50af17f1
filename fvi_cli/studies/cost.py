"""What accuracy costs: error, time and work of every method on every number of steps.

Everything is measured in this process, one run after the other. The caches of the package (rules,
tableaux) are emptied before every timed run, so that its time is that of a first run
without the import of modules, since every run is computed once before.
"""

from __future__ import annotations

import copy
import functools
import math
import statistics
import sys
import timeit
from dataclasses import dataclass, replace

from fvi_cli.integrator.integrate import integrate
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.study import execute

REPEATS = 5
"""Default number of timed runs."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CostRow:
    """One method on one number of steps."""

    finished: FinishedRun
    seconds: float  # set-up and steps, the least of the repeats
    median_seconds: float
    repeats: int

    @property
    def is_usable(self) -> bool:
        """Whether the run reached an accuracy that is worth its time."""
        return self.finished.status in ("ok", "floor") and math.isfinite(self.finished.error)


@dataclass(frozen=True, kw_only=True, eq=False)
class CostTable:
    """The cost of the methods of one experiment."""

    experiment: Experiment
    rows: tuple[CostRow, ...]  # by method, steps increasing

    @property
    def unexpected(self) -> list[str]:
        """One line for every run that failed although the configuration did not say so."""
        failed = [row.finished for row in self.rows if not row.is_usable]
        return [
            f"{one.run.title}: {one.status} ({one.trajectory.message})".removesuffix(" ()")
            for one in failed
            if not self.experiment.expects_failure(one.run.method)
        ]


def measure_cost(run: Run, *, repeats: int = REPEATS) -> CostRow:
    """Error, time and work of one run.

    It is computed once before: imports, and first access to pages of memory, are not measured.
    """
    finished = execute(run)

    def once() -> None:
        # the copy lacks the factors of the mass that an earlier run has left in the scene
        scene = replace(run.scene, inertia=copy.copy(run.scene.inertia))
        integrate(scene, run.method, run.steps)

    seconds = timeit.repeat(once, clear_caches, number=1, repeat=repeats)
    return CostRow(
        finished=finished,
        seconds=min(seconds),
        median_seconds=statistics.median(seconds),
        repeats=repeats,
    )


_FORGETFUL = ("fvi_cli.mathematics.", "fvi_cli.effects.", "fvi_cli.integrator.")


def clear_caches() -> None:
    """Empty every cache of the floors that integrate: the next run begins cold."""
    for name, module in list(sys.modules.items()):
        if name.startswith(_FORGETFUL):
            for kept in vars(module).values():
                if isinstance(kept, functools._lru_cache_wrapper):
                    kept.cache_clear()
