"""``fvi export``: results in formats for those without HDF5."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fvi_cli.cli.completion import export_formats
from fvi_cli.cli.exits import DONE, guarded
from fvi_cli.cli.options import RESULTS, Output, Quiet, Verbose


@guarded
def export(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5", help="Results of `fvi run`.")],
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="csv|npz|mat",
            help="Format to write.",
            autocompletion=export_formats,
        ),
    ],
    output: Output = RESULTS,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write the runs of a result file as CSV, npz (NumPy) or mat (MATLAB, Octave, SciPy)."""
    from fvi_cli.storage.export import export_file

    for path in export_file(file, to, output / "export" / file.stem):
        print(path)
    return DONE
