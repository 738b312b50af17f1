"""Figures as files: PDF for print, PNG for the screen, JSON for the comparison."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

from matplotlib.figure import Figure

from fvi_cli.plotting.drawn import drawn_data
from fvi_cli.plotting.style import journal_style
from fvi_cli.storage.atomic import replace_file

RESOLUTION = 200
"""Dots per inch of the PNG."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


def save_figure(figure: Figure, directory: Path, name: str) -> list[Path]:
    """Write ``<name>.pdf``, ``<name>.png`` and ``<name>.json`` (what is drawn) into `directory`.

    The files carry no date and no version, so that equal figures give equal bytes. Every file
    appears whole or not at all: all are rendered before the first is put in its place.

    Parameters
    ----------
    figure
        A figure of this package.
    directory
        Folder for the files; it is made when it is missing.
    name
        Letters, digits, ``-`` and ``_``.

    Returns
    -------
    list of Path
        The files that were written, in the order above.

    Raises
    ------
    ValueError
        For a name with other characters.
    """
    if not _NAME.fullmatch(name):
        raise ValueError(f"name: {name!r} is not allowed; use letters, digits, - and _")
    contents = {
        ".pdf": _rendered(figure, "pdf"),
        ".png": _rendered(figure, "png"),
        ".json": drawn_text(figure).encode(),
    }
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    for suffix, content in contents.items():
        path = directory / f"{name}{suffix}"
        replace_file(path, content)
        written.append(path)
    return written


def drawn_text(figure: Figure) -> str:
    """Return :func:`drawn_data` as the text of the JSON file, one line for every curve's axis."""
    text = json.dumps(drawn_data(figure), indent=1, ensure_ascii=False, allow_nan=False)
    return re.sub(r"\[[^][{}\"]*\]", _on_one_line, text) + "\n"


def _on_one_line(numbers: re.Match[str]) -> str:
    return re.sub(r"\s+", " ", numbers[0]).replace("[ ", "[").replace(" ]", "]")


def _rendered(figure: Figure, kind: str) -> bytes:
    metadata: dict[str, str | None] = (
        {"CreationDate": None, "Creator": None, "Producer": None}
        if kind == "pdf"
        else {"Software": None}
    )
    buffer = io.BytesIO()
    with journal_style():
        figure.savefig(buffer, format=kind, dpi=RESOLUTION, metadata=metadata)
    return buffer.getvalue()
