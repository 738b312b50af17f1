"""Figures as files."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.figure import Figure

from fvi_cli.errors import RequestError
from fvi_cli.plotting.style import journal_style
from fvi_cli.storage.files import replace_file

FORMATS = tuple(sorted(FigureCanvasBase.filetypes, key=lambda kind: kind != "png"))
"""Kinds of pictures that matplotlib writes; the first is the usual one."""

_NO_METADATA: Mapping[str, dict[str, str | None]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
}


def save_figure(
    figure: Figure, directory: Path, name: str, formats: Sequence[str] = FORMATS[:1]
) -> list[Path]:
    """Write pictures into `directory`, which is created, each complete or not at all.

    The files contain no date and no version, so that equal figures give equal bytes.

    Raises
    ------
    RequestError
        For an unknown format.
    """
    paths = []
    for kind in formats:
        if kind not in FORMATS:
            raise RequestError(f"format: {kind!r} is not one of {', '.join(FORMATS)}")
        picture = io.BytesIO()
        with journal_style():
            figure.savefig(picture, format=kind, metadata=_NO_METADATA.get(kind))
        paths.append(directory / f"{name}.{kind}")
        replace_file(paths[-1], picture.getvalue())
    return paths
