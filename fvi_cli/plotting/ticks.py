"""Tick labels: few, in one format, and not over other text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import (
    FixedLocator,
    Formatter,
    LogLocator,
    MaxNLocator,
    NullFormatter,
    NullLocator,
)

from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.looks import EXACT
from fvi_cli.plotting.style import label_axis, small, text_width
from fvi_cli.plotting.words import in_formula

_LEAST, _MOST = 1e-4, 1e6  # numbers between them are written in full
_DEEPEST = 1e-5  # least share of a median that is shown; smaller values are near a zero
_NEAR = 0.03  # an end of an axis this near to a number (share of the axis) is moved to it

ROUND_OFF = 1e-9
"""Variations below this share of the largest value count as round-off."""


def few_numbers(axes: Axes, most: int) -> None:
    """Limit the ticks on the x axis; numbers from 1e-4 to 1e6 are written in full."""
    axes.ticklabel_format(axis="x", scilimits=(-4, 6))
    axes.xaxis.set_major_locator(MaxNLocator(most))


def ends_of(curves: Sequence[Curve]) -> tuple[float, float]:
    """First and last abscissa of all curves."""
    places = np.concatenate([curve.x for curve in curves])
    low, high = float(places.min()), float(places.max())
    # a little more, so that rounding of an end does not remove its tick
    return low - 1e-3 * abs(low), high + 1e-3 * abs(high)


def reach_numbers(axis: Axis) -> None:
    """Move an end of a linear axis to a number that it nearly reaches."""
    low, high = axis.get_view_interval()
    room = _NEAR * (high - low)
    numbers = axis.get_major_locator().tick_values(low, high)
    near = [at for at in numbers if low - room < at < high + room]
    axis.set_view_interval(min([low, *near]), max([high, *near]), ignore=True)


def three_numbers(axis: Axis) -> None:
    """Three numbers or more on a linear axis, however short it is."""
    axis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))


def clear_factor(axis: Axis, width: float) -> None:
    """Move the common factor of the numbers to the unit in the label, as ``($10^{7}$ N)``.

    The label has lines of at most `width` inches.
    """
    factor = axis.get_offset_text().get_text().replace("\N{MINUS SIGN}", "-")
    power = re.search(r"10\^\{.*?\}", factor)
    words = axis.get_label_text().replace("\n", " ")
    # an axis without label, or with a step size in place of the unit, keeps the factor at its end
    if power and words and "=" not in words:
        name, unit = re.findall(r"^(.*?)(?: \(([^()]*)\))?$", words)[0]
        label_axis(axis, f"{name} ({f'${power[0]}$ {unit}'.rstrip()})", width)
        axis.get_offset_text().set_visible(False)


def logarithmic_ticks(axis: Axis, most: int) -> None:
    """Powers of ten on an axis, at most `most`, if at least two are visible; else plain numbers."""
    low, high = sorted(axis.get_view_interval())
    if low > 0 and math.floor(math.log10(high)) > math.ceil(math.log10(low)):
        axis.set_major_locator(LogLocator(numticks=most))
        axis.set_minor_formatter(NullFormatter())
    else:
        plain_numbers(axis)


def plain_numbers(axis: Axis) -> None:
    """Numbers without powers on a logarithmic axis, at 1, 2 and 5 where there are few decades."""
    low, high = sorted(axis.get_view_interval())
    subs = (1.0, 2.0, 5.0) if low > 0 and high / low < 200 else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(_OneForm(axis))
    axis.set_minor_formatter(NullFormatter())


class _OneForm(Formatter):
    """Numbers with three digits, all in full or all with a power of ten."""

    def __init__(self, scaled: Axis) -> None:
        self.scaled = scaled

    def __call__(self, x: float, pos: int | None = None) -> str:
        return self.format_ticks([x])[0]

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        low, high = sorted(self.scaled.get_view_interval())
        seen = [value for value in values if low <= value <= high]
        if all(_LEAST <= value < _MOST for value in seen):
            return [f"{float(f'{value:.3g}'):.6g}" for value in values]
        parts = [f"{value:.2e}".split("e") for value in values]
        return [
            rf"${float(mantissa):g} \times 10^{{{int(exponent)}}}$" for mantissa, exponent in parts
        ]


def widen(axes: Axes, curves: Sequence[Curve]) -> None:
    """Widen the limits of constant curves, so that their round-off does not fill a panel."""
    for axis in ("x", "y"):
        values = np.concatenate([getattr(one, axis) for one in curves])
        largest = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
        low, high = getattr(axes, f"get_{axis}lim")()
        if high - low < ROUND_OFF * largest:
            getattr(axes, f"set_{axis}lim")(low - 0.5 * largest, low + 0.5 * largest)


def limit_over_time(axes: Axes, panel: Panel) -> None:
    """Set limits so that neither curves that run away nor zeros of an error hide the others."""
    if any(curve.peaks for curve in panel.curves):
        # space for the marks
        axes.margins(y=0.15)
    exact = [curve for curve in panel.curves if curve.look is EXACT]
    ranges = [curve.y[np.isfinite(curve.y)] for curve in exact or panel.curves]
    ranges = [values for values in ranges if values.size]
    if panel.is_log:
        axes.set_yscale("log", nonpositive="mask")
        positive = [values[values > 0] for values in ranges if np.any(values > 0)]
        if not positive:
            # all values are exactly 0
            axes.set_ylim(panel.rounding / 10 or 1e-17, 100 * panel.rounding or 1e-15)
            return
        middles = [float(np.median(values)) for values in positive]
        high = min(max(values.max() for values in positive), 1e3 * max(middles))
        least = min(float(values.min()) for values in positive)
        low = max(least, _DEEPEST * min(middles))
        if panel.rounding:
            low, high = min(low, panel.rounding / 3), max(high, 30 * panel.rounding)
        if least < low:
            words = [panel.remark, f"deepest point: ${in_formula(least, 2)}$"]
            axes.set_title("; ".join(filter(None, words)), loc="right", fontsize=small(), pad=2.5)
        axes.set_ylim(low / 2, high * 2)
        logarithmic_ticks(axes.yaxis, 6)
        return
    if not panel.may_run_away or not ranges:
        return
    values = np.concatenate(ranges)
    if len(ranges) > 1:
        sizes = [float(np.abs(values).max()) for values in ranges]
        # leave out curves at rest, such as the force of a damper that a design lacks
        calmest = min(size for size in sizes if size >= ROUND_OFF * max(sizes))
        values = values[np.abs(values) <= 10 * calmest]
    low, high = float(values.min()), float(values.max())
    span = (high - low) or abs(high) or 1.0
    bottom, top = axes.get_ylim()
    axes.set_ylim(max(bottom, low - 0.6 * span), min(top, high + 0.6 * span))


def limit_ladder(axes: Axes, curves: Sequence[Curve]) -> None:
    """Fit limits and ticks of a log-log panel to all steps and to the existing errors."""
    steps = [h for curve in curves for h in curve.x.tolist()]
    errors = np.concatenate([curve.y for curve in curves])
    errors = errors[np.isfinite(errors) & (errors > 0)]
    low, high = (errors.min(), errors.max()) if errors.size else (1e-2, 1.0)
    if high / low < 10:
        low, high = low / 3, high * 3
    margin = (high / low) ** 0.06
    side_margin = (max(steps) / min(steps)) ** 0.06 if len(set(steps)) > 1 else 2.0
    axes.set_xlim(min(steps) / side_margin, max(steps) * side_margin)
    axes.set_ylim(low / margin, high * margin)
    _ladder_ticks(axes, steps)
    if not errors.size:
        # without errors: tick labels would suggest a measured range
        axes.set_yticks([])
        axes.set_yticks([], minor=True)


def _ladder_ticks(axes: Axes, step_sizes: Sequence[float]) -> None:
    """Set ticks of a log-log panel that stay apart, for any number of decades."""
    low, high = axes.get_xlim()
    decades = [k for k in range(-30, 31) if low <= 10.0**k <= high]
    if len(decades) < 2:
        wide = axes.get_window_extent().width / axes.figure.dpi / math.log(high / low)
        form = _OneForm(axes.xaxis)
        axes.xaxis.set_major_formatter(form)
        shown: list[float] = []
        for size in sorted(set(step_sizes)):
            room = 0.15 + text_width(form(size))
            if not shown or wide * math.log(size / shown[-1]) > room:
                shown.append(size)
        axes.xaxis.set_major_locator(FixedLocator(shown))
        axes.xaxis.set_minor_locator(NullLocator())
    else:
        logarithmic_ticks(axes.xaxis, 5)
    bottom, top = axes.get_ylim()
    tall = axes.get_window_extent().height / axes.figure.dpi
    logarithmic_ticks(axes.yaxis, max(4, min(8, math.floor(5.5 * tall))))
    if top / bottom > 1e8:
        axes.yaxis.set_minor_locator(NullLocator())
