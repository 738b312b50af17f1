"""``fvi run``: compute and store."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.cli.exits import DONE, guarded
from fvi_cli.cli.options import CheckpointEvery, Json, Sources
from fvi_cli.cli.runs import Runs, with_runs

if TYPE_CHECKING:
    from pathlib import Path


@guarded
@with_runs
def run(
    runs: Runs,
    sources: Sources,
    checkpoint_every: CheckpointEvery = 60.0,
    shard: Annotated[
        str,
        typer.Option(
            metavar="I/N",
            help="Compute the I-th of N parts alone, into a file of its own; see `fvi merge`.",
        ),
    ] = "1/1",
    json: Json = False,
) -> int:
    """Compute every method of a configuration on every step size; store what comes out."""
    from fvi_cli.render.json import outcomes_as_json, plans_as_json
    from fvi_cli.render.runs import runs_as_text
    from fvi_cli.runner.parts.shard import shard_named

    runs.settings = dataclasses.replace(
        runs.settings,
        checkpoint_seconds=checkpoint_every,
        keeps_motions=False,
        shard=shard_named(shard),
    )
    runs.gather(sources)
    if runs.is_dry and json:
        print(plans_as_json(runs.plans()))
        return DONE
    if runs.is_dry:
        return runs.show_plans()
    paths: list[Path] = []
    for request, outcomes in runs.finished():
        paths.append(runs.settings.path_of(request))
        if not json:
            print(runs_as_text(outcomes, every_member=runs.is_verbose), paths[-1], sep="\n")
    if json:
        print(outcomes_as_json(runs.outcomes, paths))
    return runs.code
