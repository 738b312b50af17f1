"""Numbers beside axes: few, plain, and not over the words."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import (
    FixedLocator,
    FuncFormatter,
    LogLocator,
    MaxNLocator,
    NullFormatter,
    NullLocator,
)

from fvi_cli.plotting.style import text_width


def few_decades(axis: Axis, number: int) -> None:
    """At most so many ticks with numbers on a logarithmic axis, none between decades."""
    axis.set_major_locator(LogLocator(numticks=number))
    axis.set_minor_formatter(NullFormatter())


def few_numbers(axes: Axes, most: int) -> None:
    """At most so many ticks on the first axis, numbers from 1e-4 to 1e6 in full."""
    axes.ticklabel_format(axis="x", scilimits=(-4, 6))
    axes.xaxis.set_major_locator(MaxNLocator(most))


def clear_factor(axis: Axis) -> None:
    """Move the factor of the numbers into the label where it would stand on that."""
    factor, label = axis.get_offset_text(), axis.label
    power = re.search(r"10\^\{.*?\}", factor.get_text())
    if power and factor.get_window_extent().overlaps(label.get_window_extent()):
        words, _, unit = label.get_text().partition(" (")
        axis.set_label_text(f"{words} (${power[0]}$" + (f" {unit}" if unit else ")"))
        factor.set_visible(False)


def short_numbers(axis: Axis) -> None:
    """Plain numbers on a logarithmic axis, at 1, 2 and 5 where there are few decades."""
    low, high = sorted(axis.get_view_interval())
    subs = (1.0, 2.0, 5.0) if low > 0 and high / low < 200 else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _short(value)))
    axis.set_minor_formatter(NullFormatter())


def _short(value: float) -> str:
    mantissa, _, exponent = f"{value:.3g}".partition("e")
    return rf"${mantissa} \times 10^{{{int(exponent)}}}$" if exponent else mantissa


def logarithmic_ticks(axes: Axes, step_sizes: Sequence[float]) -> None:
    """Set ticks of a log-log panel that stay apart, for any number of decades."""
    low, high = axes.get_xlim()
    decades = [k for k in range(-30, 31) if low <= 10.0**k <= high]
    if len(decades) < 2:
        wide = axes.get_window_extent().width / axes.figure.dpi / math.log(high / low)
        shown: list[float] = []
        for size in sorted(set(step_sizes)):
            room = 0.15 + text_width(f"{size:.3g}")
            if not shown or wide * math.log(size / shown[-1]) > room:
                shown.append(size)
        axes.xaxis.set_major_locator(FixedLocator(shown))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
        axes.xaxis.set_minor_locator(NullLocator())
    else:
        few_decades(axes.xaxis, 5)
    bottom, top = axes.get_ylim()
    if top / bottom > 1e2:
        tall = axes.get_window_extent().height / axes.figure.dpi
        few_decades(axes.yaxis, max(4, min(8, math.floor(5 * tall))))
        if top / bottom > 1e8:
            axes.yaxis.set_minor_locator(NullLocator())
