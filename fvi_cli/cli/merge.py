"""``fvi merge``: join the result files of the parts of a configuration."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from fvi_cli.cli.exits import DONE, RUN_FAILED, guarded
from fvi_cli.cli.options import RESULTS, Output, Quiet, Verbose, Wait

_logger = logging.getLogger("fvi_cli")


@guarded
def merge(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE.h5...", help="Results of `fvi run --shard I/N`.")
    ],
    output: Output = RESULTS,
    wait: Wait = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Join result files of one configuration, such as those of its parts, into one."""
    from fvi_cli.runner.parts.merge import merge_files

    merged = merge_files(files, output, waits=wait)
    print(f"{merged.path}: {merged.runs - merged.missing} of {merged.runs} runs")
    if merged.missing:
        _logger.error(
            "%d runs are in none of the files; run their part, then merge again", merged.missing
        )
    return RUN_FAILED if merged.missing else DONE
