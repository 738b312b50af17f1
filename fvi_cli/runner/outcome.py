"""The outcome of an experiment: its finished runs, and which of them failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from fvi_cli.errors import RequestError
from fvi_cli.reports.columns import member_columns
from fvi_cli.scenes.problem import Problem
from fvi_cli.storage.fields import COUNTS, FIELDS, extents_in, values_of
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.settings import EXTENTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """The finished runs of one experiment."""

    experiment: Experiment  # the requested experiment
    finished: tuple[FinishedRun, ...]  # in the order of Experiment.runs

    def __repr__(self) -> str:
        """The experiment, and how many of its runs have which status."""
        counts = Counter(one.status for one in self.finished)
        statuses = ", ".join(f"{count} {status}" for status, count in counts.items())
        return f"<Outcome {self.experiment.name}: {statuses or 'no runs'}>"

    def plot(self, figure: str | Mapping[str, Any] | None = None) -> Figure:
        """Draw one figure, by default the first one of the experiment.

        Write `figure` as an entry of ``figures``: a word such as ``trajectory``, or a mapping such
        as ``{"plot": "peak_drift", "against": "problem.stiffness"}``.

        Raises
        ------
        RequestError
            If there is nothing to draw, with the reason.
        ValueError
            For a figure that does not exist.
        """
        from fvi_cli.config.figures import one_figure
        from fvi_cli.plotting import draw_figures

        experiment = self.experiment
        if figure is not None:
            experiment = replace(experiment, figures=(one_figure(figure, experiment),))
        drawn, reasons = draw_figures([(experiment, self.finished)], name=experiment.name)
        for one in drawn.values():
            return one
        raise RequestError(*(reasons or [f"{experiment.name}: no figure to draw"]))

    def to_dataframe(self, what: Literal["runs", "motions", "events"] = "runs") -> Any:
        """A pandas DataFrame.

        ``runs``: a row for every run, with columns for the design and every swept key, error and
        status, extents of quantities (``peak_drift``, ``rms_drift``, ...) and numbers of events.
        ``motions``: the points of all runs; the index has these columns and the time as levels.
        ``events``: a row for every occurrence of an event or impact, with these columns, its name
        and time, and positions (``x``) and velocities (``vx``) at that time.

        Raises
        ------
        ImportError
            If pandas is not installed.
        ValueError
            For another word.
        """
        if what not in ("runs", "motions", "events"):
            raise ValueError(f"what: {what!r} is not known; write 'runs', 'motions' or 'events'")
        import pandas

        runs = [self._row(one) for one in self.finished]
        if what == "runs":
            return pandas.DataFrame([{**key, **found} for key, found in runs])
        if what == "events":
            frames = [
                pandas.DataFrame({**key, **columns})
                for one, (key, _) in zip(self.finished, runs, strict=True)
                for columns in self._occurrences(one)
                if columns["time"].size
            ]
            return pandas.concat(frames, ignore_index=True) if frames else pandas.DataFrame()
        frames = [one.trajectory.to_dataframe() for one in self.finished]
        keys = [key for key, _ in runs]
        names = list(keys[0]) if keys else []
        return pandas.concat(
            frames, keys=[tuple(key.values()) for key in keys], names=[*names, "time"]
        )

    def _occurrences(self, one: FinishedRun) -> Iterator[dict[str, Any]]:
        """The columns of every event of a run."""
        problem, observed = one.run.problem, one.trajectory.observed
        names = problem.coordinates if isinstance(problem, Problem) else ()
        for name, seen in observed.events.items() if observed is not None else ():
            motion = {n: seen.position[:, k] for k, n in enumerate(names)}
            motion |= {f"v{n}": seen.velocity[:, k] for k, n in enumerate(names)}
            yield {"event": name, "time": seen.time, **motion}

    def _row(self, one: FinishedRun) -> tuple[dict[str, Any], dict[str, Any]]:
        """Columns that identify a run, and columns of its results."""
        columns = member_columns(self.experiment.members, "run.member")
        key = {column.name: column.of(one) for column in columns}
        values = values_of(one)
        key |= {name: values.pop(name) for name in ("method", "case", "n_steps")}
        for name, extent in extents_in(values).items():
            values |= {f"{which}_{name}": getattr(extent, which) for which in EXTENTS}
        values |= {f"count_{name}": count for name, count in values.get(COUNTS, {}).items()}
        return key, {
            name: one
            for name, one in values.items()
            if name not in FIELDS or not FIELDS[name].is_json
        }

    @property
    def unexpected(self) -> tuple[FinishedRun, ...]:
        """Runs that failed although the configuration does not expect it."""
        return tuple(f for f in self.finished if is_unexpected_failure(f))


def is_unexpected_failure(finished: FinishedRun) -> bool:
    """Whether the run failed and its configuration did not expect that."""
    if finished.status in ("ok", "floor"):
        return False
    return not finished.run.experiment.expects_failure(finished.run.method)
