"""``fvi quantities``: tables of what is asked of a motion."""

from __future__ import annotations

from fvi_cli.cli.exits import guarded
from fvi_cli.cli.options import Check, Sources
from fvi_cli.cli.runs import Runs, with_runs


@guarded
@with_runs
def quantities(runs: Runs, sources: Sources, check: Check = False) -> int:
    """Make tables of quantities (peak, its time, RMS) and events of every run."""
    from fvi_cli.render.results import observed_report

    runs.gather(sources)
    if runs.is_dry:
        return runs.show_plans()
    for name, outcomes in runs.succeeded():
        runs.tell(observed_report(outcomes, name), name)
    return runs.code
