"""The style of figures: the packaged sheet, a user's own style, and its colours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from matplotlib import style

from fvi_cli.errors import RequestError

SHEET = Path(__file__).with_name("fvi.mplstyle")
INK, GREY, PALE, STRIP = "#222222", "#777777", "#c9c9c9", "#f1f1f1"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")

_own: ContextVar[str | None] = ContextVar("a style of matplotlib", default=None)


@contextmanager
def journal_style() -> Iterator[None]:
    """A context in which figures are made and saved with the packaged sheet.

    A user's own settings file is left out; inside :func:`styled` that style takes precedence.
    """
    own = _own.get()
    with style.context(["default", str(SHEET), *([own] if own else [])]):
        yield


@contextmanager
def styled(name: str) -> Iterator[None]:
    """A context in which figures follow a style of matplotlib: its name, or a file.

    Raises
    ------
    RequestError
        If matplotlib does not know it, or refuses what it says.
    """
    try:
        with style.context(name):
            pass
    except (OSError, ValueError) as error:
        raise RequestError(f"style: {error}") from None
    token = _own.set(name)
    try:
        yield
    finally:
        _own.reset(token)
