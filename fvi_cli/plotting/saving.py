"""Figures as files: PDF and SVG for print, PNG for the screen, JSON for the comparison."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from fvi_cli.plotting.drawn import drawn_data
from fvi_cli.plotting.style import journal_style, own_style
from fvi_cli.storage.atomic import replace_file

FORMATS = ("pdf", "png", "svg")
"""Kinds of pictures."""

USUAL_FORMS = ("pdf", "png", "json")
"""What is written of a figure unless something else is asked for."""

_NO_METADATA: Mapping[str, Mapping[str, str | None]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
}
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


def save_figure(
    figure: Figure, directory: Path, name: str, forms: Sequence[str] = USUAL_FORMS
) -> list[Path]:
    """Write pictures and ``<name>.json`` (what is drawn) into `directory`.

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
    forms
        Kinds of pictures, of :data:`FORMATS`, and ``json``.

    Returns
    -------
    list of Path
        The files that were written, in the order of `forms`.

    Raises
    ------
    ValueError
        For a name with other characters, or a form that is not known.
    """
    if not _NAME.fullmatch(name):
        raise ValueError(f"name: {name!r} is not allowed; use letters, digits, - and _")
    for form in forms:
        if form not in (*FORMATS, "json"):
            raise ValueError(f"format: {form!r} is not one of {', '.join(FORMATS)}")
    contents = {directory / f"{name}.{form}": _rendered(figure, form) for form in forms}
    directory.mkdir(parents=True, exist_ok=True)
    for path, content in contents.items():
        replace_file(path, content)
    return list(contents)


def drawn_text(figure: Figure) -> str:
    """Return :func:`drawn_data` as the text of the JSON file, one line for every curve's axis."""
    content = dict(drawn_data(figure))
    if style := own_style():
        content["style"] = style
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    return re.sub(r"\[[^][{}\"]*\]", _on_one_line, text) + "\n"


def _on_one_line(numbers: re.Match[str]) -> str:
    return re.sub(r"\s+", " ", numbers[0]).replace("[ ", "[").replace(" ]", "]")


def _rendered(figure: Figure, kind: str) -> bytes:
    if kind == "json":
        return drawn_text(figure).encode()
    buffer = io.BytesIO()
    with journal_style():
        figure.savefig(buffer, format=kind, metadata=dict(_NO_METADATA[kind]))
    return buffer.getvalue()
