"""Stability of methods: a matrix over the steps, over members, and regions in the plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain, repeat
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.region import StabilityMap
from fvi_cli.plotting.draw import cells, figure
from fvi_cli.plotting.kinds.convergence import step_label
from fvi_cli.plotting.panels import Cells
from fvi_cli.plotting.style import method_words
from fvi_cli.plotting.words import fraction_in_words
from fvi_cli.reports.naming import key_label
from fvi_cli.studies.members import value_in_words
from fvi_cli.studies.study import StabilityRow, StabilityTable

_COLOURS = (
    ("stable", "#c9dff2"),
    ("unstable after the final time", "#fbe6d4"),
    ("unstable: growth factor per step", "#ee9b63"),
    ("not predicted", "#e6e6e6"),
)
_LEVELS = (
    ("not decided", "#E69F00"),
    ("stable", "#5b94c4"),
    ("grows by 0.1 to 1 % a step", "#f7f7f7"),
    ("1 to 10 %", "#e3e3e3"),
    ("10 % to a factor e", "#c8c8c8"),
    ("faster", "#a4a4a4"),
)
_MOST_PANELS = 12
_ROW = 0.17  # inches of a row of a matrix


def stability_figures(name: str, tables: Sequence[StabilityTable]) -> dict[str, Figure]:
    """Every figure of a study, by the name of its files."""
    figures: dict[str, Figure] = {}
    for table in tables:
        stem = table.experiment.name if len(tables) > 1 else name
        for order in sorted({region.order for region in table.regions}):
            word = f"{order:g}".replace(".", "-")
            maps = [region for region in table.regions if region.order == order]
            figures[f"{stem}-stability-region-{word}"] = _region_figure(maps)
        if table.experiment.members or len(table.experiment.steps) > 1:
            figures[f"{stem}-stability"] = _verdicts_figure(table)
    return figures


def _verdicts_figure(table: StabilityTable) -> Figure:
    """Verdict and growth of every method, a row each, over the step sizes.

    Of a sweep a panel for every method, with a row for each step size and a column for each member.
    """
    experiment = table.experiment
    step = step_label(experiment)
    names = {case: own["label"] for case, own in method_words(experiment.methods).items()}
    cases = list(names)
    if not experiment.members:
        up = [(cases.index(row.run.method.case), names[row.run.method.case]) for row in table.rows]
        across = [(row.run.step_size, _in_words(row.run.step_size)) for row in table.rows]
        panel = _verdicts(table.rows, across, up, x=step)
        return figure([panel], cells, height=0.9 + _ROW * len(names))
    keys, panels = ", ".join(map(key_label, experiment.swept, repeat(experiment.units))), []
    for case in cases[:_MOST_PANELS]:
        rows = [row for row in table.rows if row.run.method.case == case]
        sizes = [(-row.run.step_size, _in_words(row.run.step_size)) for row in rows]
        across = [_member(row) for row in rows]
        panels.append(_verdicts(rows, across, sizes, x=keys, y=step, title=names[case]))
    columns = min(3 if len(panels) > 4 else 2, len(panels))
    return figure(panels, cells, columns=columns, sharex=True, sharey=True)


def _in_words(size: float) -> str:
    """``1/32`` for the inverse of a whole number."""
    inverse = round(1 / size)
    return f"1/{inverse}" if inverse > 1 and abs(size * inverse - 1) < 1e-9 else f"{size:.3g}"


def _member(row: StabilityRow) -> tuple[float, str]:
    member = row.run.member
    if member is None:
        return 0.0, ""
    return member.number, member.name or ", ".join(map(value_in_words, member.values.values()))


def _verdicts(
    rows: Sequence[StabilityRow],
    across: Sequence[tuple[float, str]],
    up: Sequence[tuple[float, str]],
    **labels: Any,
) -> Cells:
    """Cells with the verdicts of rows, and the factor by which the worst mode grows in a step.

    `across` and `up` are places and names of the column and row of each.
    """
    x, y = sorted(set(across)), sorted(set(up))
    kinds = np.full((len(y), len(x)), 3)
    texts = [[""] * len(x) for _ in y]
    for row, column, line in zip(rows, across, up, strict=True):
        at = y.index(line), x.index(column)
        verdict, growth = row.prediction.verdict, row.prediction.growth_per_step
        kinds[at] = {"stable": int(growth > 0), "unstable": 2}.get(verdict, 3)
        texts[at[0]][at[1]] = f"{math.exp(min(growth, 700.0)):.3g}" if growth > 0 else ""
    return Cells(
        kinds=kinds,
        colours=_COLOURS,
        rows=[name for _, name in y],
        columns=[name for _, name in x],
        texts=texts,
        **labels,
    )


def _region_figure(maps: Sequence[StabilityMap]) -> Figure:
    """A panel for every method, a row for every family, with the stable share of the plane."""
    families: dict[object, list[Cells | None]] = {}
    for one in maps:
        method = one.method
        family: object = "baseline"
        if isinstance(method, Method):
            family = method.cq if method.is_runge_kutta else (method.sampling, method.degree)
        panel = Cells(
            kinds=one.level + 1,
            colours=_LEVELS,
            plane=(one.stiffness, one.damping),
            title=f"{method.label}: {100 * one.share_stable:.0f} %",
            x="stiffness $h^2k/m$",
            y=r"damping $\mu\,h^{2-\gamma}/m$",
        )
        families.setdefault(family, []).append(panel)
    columns = min(max(map(len, families.values())), 3)
    for own in families.values():
        own += [None] * (-len(own) % columns)
    order = fraction_in_words(maps[0].order)
    drawn, name = list(chain(*families.values())), rf"damping of order $\gamma = {order}$"
    return figure(drawn, cells, columns=columns, height=1.5, sharex=True, sharey=True, heading=name)
