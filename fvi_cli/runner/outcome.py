"""What became of an experiment: its finished runs, and what of them went wrong."""

from __future__ import annotations

from dataclasses import dataclass

from fvi_cli.studies.experiment import Experiment, FinishedRun


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What became of one experiment.

    Parameters
    ----------
    experiment
        What was asked for.
    finished
        Finished runs in the order of the experiment's own list.
    """

    experiment: Experiment
    finished: tuple[FinishedRun, ...]

    @property
    def unexpected(self) -> tuple[FinishedRun, ...]:
        """Runs that came to nothing although the configuration did not say so."""
        return tuple(f for f in self.finished if is_unexpected_failure(f))

    @property
    def missing(self) -> int:
        """Number of runs that were not computed."""
        asked = 1 if self.experiment.needs_search else len(self.experiment.runs())
        return asked - len(self.finished)


def is_unexpected_failure(finished: FinishedRun) -> bool:
    """Whether the run failed and its configuration did not expect that."""
    if finished.status in ("ok", "floor"):
        return False
    return not finished.run.experiment.expects_failure(finished.run.method)
