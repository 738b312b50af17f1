"""Energies, works and momenta over time, with the defects of their balances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.integrator.results.diagnostics import Diagnostics
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.motions.labels import styled, time_axis, with_unit
from fvi_cli.plotting.motions.time_series import draw_series, select_runs
from fvi_cli.plotting.style import (
    COLOURS,
    COLUMN_WIDTH,
    INK,
    LINE_STYLES,
    few_decades,
    journal_style,
    legend_columns,
    new_figure,
)
from fvi_cli.studies.experiment import Experiment, FinishedRun

Curve = tuple[str, Array]

_EPSILON = float(np.finfo(float).eps)
_PANEL_DIGITS = 1e-6


def balance_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw energy, works and their sum of the most accurate run, and the defect of every method."""
    shown = select_runs(finished, has_balance)
    best = most_accurate(shown)
    energy, found = best.trajectory.energy, _diagnostics(best)
    if energy is None or found.dissipated_work is None or found.forcing_work is None:
        raise ValueError("balance: the run has no energy")  # pragma: no cover - chosen above
    curves = [("energy $E$", energy), ("dissipated work $W_d$", found.dissipated_work)]
    together = "$E + W_d$"
    if np.any(found.forcing_work):
        curves.append(("work of forcing $W_f$", found.forcing_work))
        together = "$E + W_d - W_f$"
    curves.append((together, energy + found.dissipated_work - found.forcing_work))
    if found.stored_energy is not None and np.any(found.stored_energy):
        curves.insert(1, ("stored in the damping $E_s$", found.stored_energy))
    defect = f"defect\n$|{together.strip('$')} - E_0|$"
    defects = [np.abs(_column(_diagnostics(item).energy_defect, 0)) for item in shown]
    return _two_panels(experiment, shown, best, curves, defects, ("energy and work", defect))


def momenta_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the momentum maps of the most accurate run, and their largest defect by method."""
    shown = select_runs(finished, has_momenta)
    best = most_accurate(shown)
    found = _diagnostics(best)
    curves = [
        (f"{name} momentum", _column(found.momentum_map, index))
        for index, name in enumerate(found.map_names)
    ]
    defects = []
    for item in shown:
        values = _diagnostics(item).momentum_map_defect
        defects.append(np.zeros(0) if values is None else np.abs(values).max(axis=1))
    return _two_panels(
        experiment,
        shown,
        best,
        curves,
        defects,
        ("momentum map", "defect\n$|J - J_0 - \\mathrm{impulse}|$"),
    )


def has_balance(item: FinishedRun) -> bool:
    """Whether a run was stored with its energy balance."""
    found = item.trajectory.diagnostics
    return found is not None and found.energy_defect is not None


def has_momenta(item: FinishedRun) -> bool:
    """Whether a run was stored with momentum maps."""
    found = item.trajectory.diagnostics
    return found is not None and bool(found.map_names)


def most_accurate(shown: Sequence[FinishedRun]) -> FinishedRun:
    """The run with the smallest error; the last one where none has an error."""
    measured = [item for item in shown if np.isfinite(item.error)]
    return min(measured, key=lambda item: item.error) if measured else shown[-1]


def _diagnostics(item: FinishedRun) -> Diagnostics:
    found = item.trajectory.diagnostics
    return Diagnostics() if found is None else found


def _column(values: Array | None, index: int) -> Array:
    if values is None:
        return np.zeros(0)
    return values if values.ndim == 1 else values[:, index]


def _two_panels(
    experiment: Experiment,
    shown: Sequence[FinishedRun],
    best: FinishedRun,
    curves: Sequence[Curve],
    defects: Sequence[Array],
    names: tuple[str, str],
) -> Figure:
    """Quantities of one run above, defects of all methods below on a logarithmic axis."""
    scale = float(max(np.abs(values).max() for _, values in curves))
    with journal_style():
        figure = new_figure(3.7)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        time = best.trajectory.time
        others = [*LINE_STYLES[:3], *LINE_STYLES[4:]]
        for index, (label, values) in enumerate(curves):
            last = index == len(curves) - 1 and len(curves) > 1
            above.plot(
                time,
                values,
                label=label,
                color=INK if last else COLOURS[index % len(COLOURS)],
                linestyle=LINE_STYLES[3] if last else others[index],
                linewidth=1.6 if last else 1.1,
                # a sum that may be zero throughout has no digits of its own
                gid=f"floor {_PANEL_DIGITS * scale:.1e}",
            )
        unit = "energy" if names[0].startswith("energy") else "momentum"
        above.set_ylabel(with_unit(names[0], experiment, unit))
        above.legend(
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            ncols=legend_columns([label for label, _ in curves]),
        )
        _draw_defects(below, shown, defects, scale)
        below.set_ylabel(names[1])
        time_axis(below, experiment, [best])
        if len(shown) > 1:
            labels = [style.label for _, style, _ in styled(shown)]
            below.legend(ncols=legend_columns(labels, COLUMN_WIDTH - 0.8), loc="lower right")
    return figure


def _draw_defects(
    axes: Axes, shown: Sequence[FinishedRun], defects: Sequence[Array], scale: float
) -> None:
    """Absolute defects; below a unit of rounding they stand at it, for zero has no logarithm."""
    least = _EPSILON * max(scale, 1e-300)
    axes.set_yscale("log")
    ends = [least]
    for (item, style, position), values in zip(styled(shown), defects, strict=True):
        values = np.maximum(values, least)
        # the start is exact: nothing to show on this axis
        values[0] = np.nan
        draw_series(
            axes,
            item.trajectory.time,
            values,
            style,
            position,
            floor=10 * least * np.sqrt(item.run.n_steps),
        )
        ends.append(float(np.nanmax(values, initial=least)))
    axes.set_ylim(min(least / 2, min(ends) / 2), 5 * max(ends))
    few_decades(axes.yaxis, 6)
