"""The painter of ladders: errors over step sizes, lost runs, the floor, and a fan of slopes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, NullLocator

from fvi_cli.plotting.draw import SMALL, draw_curves, properties_of, scale_log
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.style import GREY, STRIP
from fvi_cli.plotting.words import fraction_in_words

_BOX = 0.92  # height over width of every panel, so that slopes compare
_ROW, _EDGE = 0.06, 0.02  # shares of the panel for a row of lost runs, and around the rows
_CORNER, _RAY, _LONGER = (0.64, 0.05), 0.18, 0.06  # of the fan, as shares of the panel


def ladder(axes: Axes, panel: Panel) -> None:
    """Marked lines over two logarithmic axes: every run is a marker on the line of its method."""
    axes.set(xscale="log", yscale="log")
    axes.set_box_aspect(_BOX)
    axes.margins(0.05)
    axes.grid(visible=True)
    draw_curves(axes, panel.curves)
    for curve in panel.curves:
        axes.update_datalim([(h, np.nan) for h in curve.lost], updatey=False)
    axes.autoscale_view()


def finish_ladders(axes: Sequence[Axes], panels: Sequence[Panel]) -> None:
    """Add what needs the final limits: the strips of lost runs and of the floor, and the fans."""
    losers = list(dict.fromkeys(c.label for p in panels for c in p.curves if len(c.lost)))
    share = _ROW * len(losers) + _EDGE if losers else 0.0
    raised = {}
    for one in axes:
        low, high = np.log10(one.get_ylim())
        raised[one] = (10**low, 10 ** (high + share / (1 - share) * (high - low)))
    for one, panel in zip(axes, panels, strict=True):
        one.set_ylim(raised[one])
        scale_log(one)
        if losers:
            _draw_lost(one, panel.curves, losers, share)
        bottom = raised[one][0]
        if panel.floor > bottom:
            one.axhspan(bottom, panel.floor, color=STRIP, zorder=0, linewidth=0)
            words = one.text(0.985, panel.floor, "floor", transform=one.get_yaxis_transform())
            words.set(color=GREY, fontsize=SMALL, ha="right", va="top")
        _draw_fan(one, panel)


def _draw_lost(axes: Axes, curves: Sequence[Curve], losers: Sequence[str], share: float) -> None:
    """A strip on top with a hollow mark for every run that has no error, a line a method."""
    low, high = np.log10(axes.get_ylim())
    limit = 10 ** (high - share * (high - low))
    strip = axes.fill_between([0, 1], 1 - share, 1, color=STRIP, transform=axes.transAxes)
    strip.set(zorder=0, linewidth=0)
    axes.yaxis.set_major_locator(FixedLocator([y for y in axes.get_yticks() if y < limit]))
    axes.yaxis.set_minor_locator(NullLocator())
    for curve, look in zip(curves, properties_of(curves), strict=True):
        if len(curve.lost):
            height = 1 - share * (losers.index(curve.label) + 0.5) / len(losers)
            look |= {"linestyle": "none", "markerfacecolor": "none", "markeredgewidth": 0.9}
            look["markeredgecolor"] = look["color"]
            at = axes.get_xaxis_transform()
            axes.plot(curve.lost, [height] * len(curve.lost), transform=at, **look)
    words = axes.text(0.985, 1 - share / 2, "diverged", transform=axes.transAxes)
    words.set(color=GREY, fontsize=SMALL, ha="right", va="center")


def _draw_fan(axes: Axes, panel: Panel) -> None:
    """Rays from one corner, where no converging curve is: how steep an order is in this panel."""
    (left, right), (low, high) = np.log10(axes.get_xlim()), np.log10(axes.get_ylim())
    band = max(0.0, math.log10(panel.floor) - low) / (high - low) if panel.floor else 0.0
    corner = np.array(_CORNER) - (0.08 * bool(panel.stated), -band)
    rays = sorted([(order, "") for order in panel.orders] + [(p, "stated") for p in panel.stated])
    for number, (order, source) in enumerate(rays):
        ray = np.array([1 / (right - left), order * _BOX / (high - low)])
        ray /= np.hypot(*ray)
        end = corner + (_RAY + _LONGER * number) * ray / (1, _BOX)
        (line,) = axes.plot(*zip(corner, end, strict=True), transform=axes.transAxes)
        line.set(color=GREY, linewidth=0.8, zorder=1, linestyle="--" if source else "-")
        words = "$h$" if order == 1 else f"$h^{{{fraction_in_words(order)}}}$"
        note = axes.annotate(f"{words} {source}".rstrip(), tuple(end), tuple(2.5 * ray))
        note.set(color=GREY, fontsize=SMALL, va="center", ha="left")
        note.xycoords, note.anncoords = "axes fraction", "offset points"
