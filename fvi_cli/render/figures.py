"""Writing figures to files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from fvi_cli.errors import RequestError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def drawn_as(formats: Sequence[str], style: str | None) -> Iterator[None]:
    """A context in which figures follow a style; formats are checked at its beginning.

    Raises
    ------
    RequestError
        For an unknown format, or a style that matplotlib does not know.
    """
    if not formats and style is None:
        yield
        return
    # a slow import, which other requests do not need
    from fvi_cli import plotting

    for kind in formats:
        if kind not in plotting.FORMATS:
            raise RequestError(f"--format: {kind!r} is not one of {', '.join(plotting.FORMATS)}")
    with ExitStack() as stack:
        if style is not None:
            try:
                stack.enter_context(plotting.styled(style))
            except (OSError, ValueError) as error:
                raise RequestError(f"--style: {error}") from None
        yield


def write_figures(
    figures: Mapping[str, Figure], output: Path, *, formats: Sequence[str] = ()
) -> list[Path]:
    """Write figures under ``figures/`` in `output`, as PNG or in `formats`; returns the paths."""
    if not figures:
        return []
    # a slow import, which tables do not need
    from fvi_cli.plotting import FORMATS, save_figure

    forms = list(dict.fromkeys(formats or FORMATS[:1]))
    folder = output / "figures"
    return [p for name, one in figures.items() for p in save_figure(one, folder, name, forms)]
