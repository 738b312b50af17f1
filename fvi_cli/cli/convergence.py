"""``fvi convergence``: tables of orders."""

from __future__ import annotations

from fvi_cli.cli.exits import guarded, verdict
from fvi_cli.cli.options import Check, UsualSources
from fvi_cli.cli.runs import Runs, with_runs

DEFAULT_TABLES = ("table-1", "table-2", "full-order")


@guarded
@with_runs
def convergence(runs: Runs, sources: UsualSources = None, check: Check = False) -> int:
    """Make tables of orders; without argument those of the paper and of full order."""
    from fvi_cli.render.results import order_tables
    from fvi_cli.reports import missing

    runs.gather(sources or DEFAULT_TABLES)
    if runs.is_dry:
        return runs.show_plans()
    folder = runs.settings.output / "tables"
    absent = [line for one in runs.requests for line in missing(folder, one.name)]
    if check and absent:
        return verdict(absent)
    for name, outcomes in runs.succeeded():
        runs.tell(order_tables(outcomes), name)
    return runs.code
