"""What is drawn, without how: a curve is points with a name, a panel is curves that share axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fvi_cli.mathematics.arrays import Array, Integers
from fvi_cli.plotting.style import Look


class NothingToDraw(Exception):  # noqa: N818 - no error: the reason why a figure is left out
    """There is nothing to draw, for the given reason."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Points with a name."""

    x: Array  # shape ``(n,)``; nan where there is nothing to draw
    y: Array
    label: str = ""  # in the legend; curves of one label share an entry
    look: Look | None = None  # None: by its place in the panel
    by: float = math.nan  # a number that a colour bar shows in place of the label
    bands: Sequence[tuple[str, Array, Array]] = ()  # (name, lower, upper edge) of regions
    marks: Sequence[tuple[float, float, str]] = ()  # points that stand out, with a word or number
    lost: Sequence[float] = ()  # abscissas of runs without a value


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Curves that share their axes."""

    curves: Sequence[Curve]
    x: str = ""  # labels of the axes, with units
    y: str = ""
    title: str = ""
    log: str = ""  # axes that are logarithmic: ``x``, ``y`` or ``xy``
    orders: Sequence[float] = ()  # slopes shown in the corner of a ladder
    stated: Sequence[float] = ()  # the same, as the source states them: dashed
    floor: float = 0.0  # values below are round-off or error of the reference
    levels: Sequence[float] = ()  # thin horizontal lines
    xlim: tuple[float, float] | None = None
    ylim: tuple[float | None, float | None] | None = None
    is_equal: bool = False  # whether both axes have the same scale
    unit: str = ""  # of the curves of a waterfall


@dataclass(frozen=True, kw_only=True, eq=False)
class Cells:
    """A matrix of kinds with names of its rows and columns, or over a plane of numbers."""

    kinds: Integers  # index of the kind of every cell, (rows, columns)
    colours: Sequence[tuple[str, str]]  # (name, colour) of every kind
    rows: Sequence[str] = ()
    columns: Sequence[str] = ()
    texts: Sequence[Sequence[str]] = ()  # numbers in the cells
    plane: tuple[Array, Array] | None = None  # abscissas and ordinates, on logarithmic axes
    x: str = ""
    y: str = ""
    title: str = ""
