"""Writing figures to files, and comparing figures with stored ones."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from fvi_cli.errors import RequestError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def drawn_as(formats: Sequence[str], style: Path | None) -> Iterator[None]:
    """A context in which figures follow a style file; formats are checked at its beginning.

    Raises
    ------
    RequestError
        For an unknown format, or a style file that cannot be used.
    """
    if formats or style:
        # a slow import, which other requests do not need
        from fvi_cli import plotting
    for kind in formats:
        if kind not in plotting.FORMATS:
            raise RequestError(f"--format: {kind!r} is not one of {', '.join(plotting.FORMATS)}")
    with ExitStack() as styled:
        if style is not None:
            try:
                styled.enter_context(plotting.style_file(style))
            except ValueError as error:
                raise RequestError(f"--style: {error}") from None
        yield


def write_figures(
    figures: Mapping[str, Figure],
    output: Path,
    *,
    formats: Sequence[str] = (),
    anew: bool = False,
) -> list[Path]:
    """Update figures under ``figures/`` in `output`; returns the paths.

    `formats` are those of pictures, by default PDF and PNG. Files of a figure that has not changed
    stay unchanged, and only missing pictures are drawn; with `anew` all files are written.
    """
    if not figures:
        return []
    # a slow import, which tables do not need
    from fvi_cli.plotting import USUAL_FORMS, save_figure

    forms = list(dict.fromkeys((*formats, "json") if formats else USUAL_FORMS))
    paths: list[Path] = []
    for name, figure in figures.items():
        files = {form: output / "figures" / f"{name}.{form}" for form in forms}
        agrees = not anew and not _differences(files["json"], figure)
        wanted = [form for form, path in files.items() if not (agrees and path.is_file())]
        save_figure(figure, output / "figures", name, wanted)
        paths += files.values()
    return paths


def compare_figures(
    figures: Mapping[str, Figure], output: Path, *, formats: Sequence[str] = ()
) -> list[str]:
    """One line for everything that the stored figures show differently.

    Pictures in `formats` must exist: by default PNG, which documents show.
    """
    lines = []
    for name, figure in figures.items():
        path = output / "figures" / f"{name}.json"
        pictures = [path.with_suffix(f".{kind}") for kind in formats or ("png",)]
        lines += [f"{one}: missing" for one in pictures if not one.is_file()]
        lines += _differences(path, figure)
    return lines


def _differences(path: Path, figure: Figure) -> list[str]:
    """One line for every difference between a figure and its stored data."""
    from fvi_cli.plotting import compare_drawn, drawn_text

    if not path.is_file():
        return [f"{path}: missing"]
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        return [f"{path}: cannot be read"]
    fresh = json.loads(drawn_text(figure))
    return [f"{path}: {line}" for line in compare_drawn(stored, fresh)]
