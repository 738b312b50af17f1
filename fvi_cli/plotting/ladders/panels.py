"""Log-log panels of errors against step size: curves, failures, floor, slopes, legend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedLocator, NullLocator
from matplotlib.transforms import blended_transform_factory

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.ladders.guides import Box, Curve, draw_slopes
from fvi_cli.plotting.methods import SeriesStyle
from fvi_cli.plotting.style import (
    DECORATION,
    GUIDE_COLOUR,
    SMALL_TEXT,
    legend_of,
    logarithmic_ticks,
    note,
)
from fvi_cli.studies.experiment import FinishedRun

_ROW_HEIGHT = 7.0  # points of one row in the strip of runs without an error


def is_plotted(one: FinishedRun) -> bool:
    """Whether the error of a run can stand on a logarithmic axis."""
    return one.status in ("ok", "floor") and bool(np.isfinite(one.error))


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """The ladder of one method, step sizes increasing."""

    style: SeriesStyle
    rows: tuple[FinishedRun, ...]
    stated_order: float = math.nan

    def values(self) -> tuple[Array, Array]:
        """Step sizes and errors; nan where there is no error to draw.

        An error of exactly zero stands at the floor's unit of round-off.
        """
        errors = [
            max(row.error, row.floor / 100) if is_plotted(row) else np.nan for row in self.rows
        ]
        return np.array([row.run.step_size for row in self.rows]), np.array(errors)

    def curve(self) -> Curve:
        """What is drawn, without gaps, as logarithms."""
        h, e = self.values()
        drawn = np.flatnonzero(e > 0)
        return Curve(
            stated_order=self.stated_order,
            is_broken=bool(np.any(np.diff(drawn[:3]) > 1)),
            log_step=np.log10(h[e > 0]),
            log_error=np.log10(e[e > 0]),
            log_floor=math.log10(self.floor) if self.floor > 0 else -math.inf,
            expected_orders=np.array([row.expected_order for row in self.rows])[e > 0],
        )

    @property
    def floor(self) -> float:
        """Largest floor of the ladder."""
        return max((row.floor for row in self.rows if np.isfinite(row.floor)), default=0.0)


def collect_series(finished: Sequence[FinishedRun], styles: dict[str, SeriesStyle]) -> list[Series]:
    """Ladders by method, in the order of the runs."""
    ladders: dict[str, list[FinishedRun]] = {}
    for item in finished:
        ladders.setdefault(item.run.method.case, []).append(item)
    return [
        Series(
            style=styles[case],
            stated_order=ladder[0].run.experiment.claim(ladder[0].run.method) or math.nan,
            rows=tuple(sorted(ladder, key=lambda item: item.run.step_size)),
        )
        for case, ladder in ladders.items()
    ]


def draw_errors(axes: Axes, series: Sequence[Series]) -> None:
    """Draw the ladders in a log-log panel; limits and what depends on them come later."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    for one in series:
        h, e = one.values()
        axes.plot(
            h,
            e,
            label=one.style.label,
            gid=f"floor {one.floor:.1e}",
            **one.style.line_properties(),
            zorder=3,
        )


def set_limits(axes: Axes, series: Sequence[Series]) -> None:
    """Fit limits and ticks of a log-log panel to `series`."""
    steps = [row.run.step_size for one in series for row in one.rows]
    errors = np.concatenate([one.values()[1] for one in series])
    errors = errors[np.isfinite(errors) & (errors > 0)]
    low, high = (errors.min(), errors.max()) if errors.size else (1e-2, 1.0)
    if high / low < 10:
        low, high = low / 3, high * 3
    margin = (high / low) ** 0.06
    low, high = low / margin, high * margin
    beside = (max(steps) / min(steps)) ** 0.06 if len(set(steps)) > 1 else 2.0
    axes.set_xlim(min(steps) / beside, max(steps) * beside)
    axes.set_ylim(low, high)
    logarithmic_ticks(axes, steps)
    if not errors.size:
        # numbers beside an empty panel would claim a range that nobody measured
        axes.yaxis.set_major_locator(NullLocator())
        axes.yaxis.set_minor_locator(NullLocator())


Panel = tuple[Axes, Sequence[Series], Sequence[float]]
"""A log-log panel with what is drawn in it, and the slopes to explain it by."""


def finish_panels(figure: Figure, panels: Sequence[Panel]) -> None:
    """Add to settled panels what depends on their size: failures, floor and slope triangles."""
    figure.draw_without_rendering()
    for axes, series, orders in panels:
        blocked = [*_draw_failures(axes, series), *_draw_floor(axes, series)]
        curves = [curve for one in series if (curve := one.curve()).log_step.size > 0]
        draw_slopes(axes, curves, orders, blocked=blocked)


def _draw_failures(axes: Axes, series: Sequence[Series]) -> list[Box]:
    """Hollow marks in a strip at the top, one row for every status and method."""
    groups: dict[str, list[tuple[Series, list[float]]]] = {}
    for one in series:
        failed = [row for row in one.rows if not is_plotted(row)]
        for observed in dict.fromkeys(row.status for row in failed):
            steps = [row.run.step_size for row in failed if row.status == observed]
            groups.setdefault(observed, []).append((one, steps))
    if not groups:
        return []
    extent = axes.get_window_extent()
    points = extent.height * 72.0 / axes.figure.dpi
    width = extent.width * 72.0 / axes.figure.dpi
    x0, x1 = np.log10(axes.get_xlim())
    # hollow marks, unless that already tells two methods apart
    is_hollow = all(one.style.is_filled for one in series)
    across = blended_transform_factory(axes.transData, axes.transAxes)
    top = 1.0
    for status, members in groups.items():
        places = [(np.log10(h) - x0) / (x1 - x0) for _, steps in members for h in steps]
        word = 0.5 * SMALL_TEXT * len(_status_word(status)) / width + 0.06
        n_rows = len(members)
        if 1 - max(places) > word:
            at, side = 0.97, "right"
        elif min(places) > word:
            at, side = 0.03, "left"
        else:
            at, side, n_rows = 0.5, "center", n_rows + 1
        # at least as high as the word
        height = (max(n_rows * _ROW_HEIGHT, SMALL_TEXT) + 4) / points
        bottom = top - height
        row = (height - 4 / points) / n_rows
        for position, (one, steps) in enumerate(members):
            # rows are filled from the bottom: the word may stand above them
            level = bottom + 2 / points + (len(members) - position - 0.5) * row
            axes.plot(
                steps,
                [level] * len(steps),
                transform=across,
                color=one.style.colour,
                marker=one.style.marker,
                linestyle="none",
                markerfacecolor=(
                    one.style.colour if one.style.is_filled and not is_hollow else "none"
                ),
                markeredgewidth=0.8,
                label=f"_{one.style.label}: {status}",
                gid="failure",
                scalex=False,
                scaley=False,
                zorder=4,
            )
        if side == "center":
            middle = top - 2 / points - row / 2
            note(axes, at, middle, _status_word(status), va="center_baseline")
        else:
            note(axes, at, 0.5 * (top + bottom), _status_word(status), ha=side)
        axes.plot(
            [0.0, 1.0],
            [bottom, bottom],
            transform=axes.transAxes,
            color=GUIDE_COLOUR,
            linewidth=0.5,
            label="_edge",
            **DECORATION,
        )
        top = bottom
    _make_room(axes, 1 - top)
    strip = Rectangle(
        (0.0, top),
        1.0,
        1.0 - top,
        transform=axes.transAxes,
        facecolor="#f0f0f0",
        edgecolor="none",
        zorder=0,
    )
    axes.add_patch(strip)
    return [(0.0, top, 1.0, 1.0)]


def _status_word(status: str) -> str:
    return "no reference" if status in ("ok", "floor") else status


def _make_room(axes: Axes, share: float) -> None:
    """Raise the upper limit so that `share` of the panel at the top holds no curve, nor a tick."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, low * (high / low) ** (1 / (1 - share)))
    for is_minor in (False, True):
        ticks = axes.yaxis.get_ticklocs(minor=is_minor)
        kept = FixedLocator([tick for tick in ticks if low <= tick <= high])
        if is_minor:
            axes.yaxis.set_minor_locator(kept)
        else:
            axes.yaxis.set_major_locator(kept)


def _draw_floor(axes: Axes, series: Sequence[Series]) -> list[Box]:
    """Hatched region below the floor, where a curve reaches it."""
    reached = [
        row.floor
        for one in series
        for row in one.rows
        if is_plotted(row) and (row.status == "floor" or row.error < row.floor)
    ]
    if not reached:
        return []
    level = max(reached)
    low, high = axes.get_ylim()
    axes.axhspan(
        low, level, facecolor="none", edgecolor="#b0b0b0", hatch="/////", linewidth=0, zorder=0.5
    )
    note(axes, 0.97, 0.03, "round-off", ha="right", va="bottom", paper={"pad": 1.0})
    top = float(np.log(level / low) / np.log(high / low))
    return [(0.0, 0.0, 1.0, top), (0.65, 0.0, 1.0, 0.12)]


def figure_legend(
    figure: Figure, styles: Sequence[SeriesStyle], *, title: str = "", above: bool = True
) -> None:
    """One legend for all panels, outside of them."""
    by_label = {style.label: style for style in styles}
    handles = [
        Line2D([], [], label=label, **style.line_properties()) for label, style in by_label.items()
    ]
    legend_of(figure, handles, title=title, above=above)
