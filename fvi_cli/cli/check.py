"""``fvi check``: validate only."""

from __future__ import annotations

from fvi_cli.cli.exits import DONE, guarded
from fvi_cli.cli.options import Configs, Json, Overrides, Quiet, Verbose
from fvi_cli.errors import RequestError


@guarded
def check(
    configs: Configs,
    overrides: Overrides = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Validate configurations and compute nothing."""
    from fvi_cli.runner.request import gather

    try:
        requests = gather(configs, overrides or ())
    except RequestError as error:
        if json:
            from fvi_cli.render.json import checked_as_json

            print(checked_as_json((), error.complaints))
        raise
    if json:
        from fvi_cli.render.json import checked_as_json

        print(checked_as_json(requests))
        return DONE
    for request in requests:
        runs = sum(len(e.searches() or e.runs()) for e in request.loaded.experiments)
        experiments = len(request.loaded.experiments)
        what = f"{_counted(experiments, 'experiment')}, {_counted(runs, 'run')}"
        print(f"{request.loaded.path}: valid, {what}")
    return DONE


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
