"""Runs whose steps are found one after the other, kept and taken up."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.engine.checkpoint import Arrays, Keeper, RunKeeper
from fvi_cli.integrator.results.newton_record import NewtonRecord
from fvi_cli.integrator.run.loop import Course, Marker


class CourseKeeper:
    """The checkpoint of a run whose steps are found one after the other.

    Parameters
    ----------
    keeper
        Where it is kept; None: nowhere.
    marker, course
        The run at its start; they are brought to where it was stopped.
    asked
        Method, number of steps that are asked for, and their size, or the tolerance of theirs.
    determined_by
        What determines the numbers of the run beside these.
    needs
        Names of what else is kept.

    Attributes
    ----------
    found
        What else was kept, by name; nothing for a run that begins at its start.
    earlier_seconds
        Time of the steps before the checkpoint.
    """

    def __init__(
        self,
        keeper: RunKeeper | None,
        marker: Marker,
        course: Course,
        asked: tuple[str, int, float],
        determined_by: tuple[object, ...],
        needs: tuple[str, ...],
    ) -> None:
        self._marker, self._course, self._asked, self._needs = marker, course, asked, needs
        self._further: Callable[[], Arrays] = dict
        self.found: Arrays = {}
        self._keeper = Keeper(keeper, asked, determined_by, self)
        self.earlier_seconds = self._keeper.earlier_seconds

    @property
    def progress(self) -> tuple[int, int]:
        """Finished steps, and those of the grid that is asked for."""
        done, (_, n_steps, step_size) = len(self._course.sizes), self._asked
        return done, int(self._marker.time / step_size) if n_steps else done

    def arrays(self) -> Arrays:
        """The marker."""
        marker = self._marker
        found = {
            "time": np.array(marker.time),
            "step_size": np.array(marker.step_size),
            "position": marker.position.value.copy(),
            "momentum": marker.momentum.value.copy(),
            "position_lost": marker.position.lost.copy(),
            "momentum_lost": marker.momentum.lost.copy(),
            "states": marker.states.copy(),
        }
        return found if marker.unknowns is None else found | {"unknowns": marker.unknowns.copy()}

    def kept(self) -> Arrays:
        """The course, and what else there is."""
        newton = self._course.newton
        counts = [newton.iterations, newton.largest, newton.worst_step]
        return {
            **self._course.kept(),
            "newton": np.array(counts),
            "residuals": np.array(newton.worst_residuals),
            **self._further(),
        }

    def restore(self, arrays: Arrays, kept: Arrays) -> None:
        """Go on from there."""
        marker = self._marker
        if missing := set(self._needs) - kept.keys():
            raise KeyError(min(missing))
        states, position = arrays["states"].copy(), arrays["position"]
        if (states.shape, position.shape) != (marker.states.shape, marker.position.value.shape):
            raise ValueError("state: it has other shapes")
        iterations, largest, worst_step = kept["newton"].tolist()
        record = NewtonRecord(
            iterations=iterations,
            largest=largest,
            worst_step=worst_step,
            worst_residuals=tuple(kept["residuals"].tolist()),
        )
        self._course.restore(record, kept)
        marker.time, marker.step_size = float(arrays["time"]), float(arrays["step_size"])
        marker.position = CompensatedSum(position, arrays["position_lost"])
        marker.momentum = CompensatedSum(arrays["momentum"], arrays["momentum_lost"])
        marker.states = states
        marker.unknowns = arrays["unknowns"].copy() if "unknowns" in arrays else None
        self.found = kept

    def offer(self, further: Callable[[], Arrays], *, has_ended: bool = False) -> None:
        """Behind a step, or the last one: keep a checkpoint, with further state, if it is due."""
        self._further = further
        self._keeper.offer(has_ended=has_ended)
