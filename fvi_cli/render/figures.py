"""Figures put into files, and compared with those that are there."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING

from fvi_cli.errors import RequestError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_FORMATS: ContextVar[Sequence[str]] = ContextVar("formats of pictures", default=())


@contextmanager
def pictures_as(formats: Sequence[str], style: Path | None) -> Iterator[None]:
    """Within this context pictures are written in these formats, by this style file.

    Raises
    ------
    RequestError
        For another format, or a style file that cannot be followed.
    """
    if formats or style:
        # a slow import, which other requests need not wait for
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
        token = _FORMATS.set(tuple(formats))
        styled.callback(_FORMATS.reset, token)
        yield


def write_figures(
    figures: Mapping[str, Figure],
    output: Path,
    *,
    formats: Sequence[str] = (),
    anew: bool = False,
) -> list[Path]:
    """Bring figures under ``figures/`` in `output` up to date; returns the paths.

    Where the files show what the figure shows (:func:`compare_figures`) they are left as they are,
    and only pictures that are missing are drawn, unless it is wanted `anew`.
    """
    if not figures:
        return []
    # a slow import, which tables need not wait for
    from fvi_cli.plotting import USUAL_FORMS, save_figure

    wanted_forms = formats or _FORMATS.get()
    forms = list(dict.fromkeys((*wanted_forms, "json") if wanted_forms else USUAL_FORMS))
    paths: list[Path] = []
    for name, figure in figures.items():
        files = {form: output / "figures" / f"{name}.{form}" for form in forms}
        agrees = not anew and not compare_figures({name: figure}, output, formats=())
        wanted = [form for form, path in files.items() if not (agrees and path.is_file())]
        save_figure(figure, output / "figures", name, wanted)
        paths += files.values()
    return paths


def compare_figures(
    figures: Mapping[str, Figure], output: Path, *, formats: Sequence[str] | None = None
) -> list[str]:
    """One line for everything that the stored figures show differently.

    Pictures in `formats` must be there: by default those of :func:`pictures_as`, or else PNG, which
    documents show.
    """
    if not figures:
        return []
    from fvi_cli.plotting import compare_drawn, drawn_text

    if formats is None:
        formats = _FORMATS.get() or ("png",)
    differences = []
    for name, figure in figures.items():
        path = output / "figures" / f"{name}.json"
        files = (path, *(path.with_suffix(f".{kind}") for kind in formats))
        differences += [f"{other}: missing" for other in files if not other.is_file()]
        if not path.is_file():
            continue
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            differences.append(f"{path}: cannot be read")
            continue
        fresh = json.loads(drawn_text(figure))
        differences += [f"{path}: {line}" for line in compare_drawn(stored, fresh)]
    return differences
