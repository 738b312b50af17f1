"""Stability of methods: a matrix over the steps, over parameters, and regions in the plane."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.region import StabilityMap
from fvi_cli.plotting.draw import cells, figure
from fvi_cli.plotting.kinds.convergence import in_rows, step_label
from fvi_cli.plotting.panels import Cells
from fvi_cli.plotting.style import method_names
from fvi_cli.plotting.words import fraction_in_words
from fvi_cli.reports.naming import key_label
from fvi_cli.studies.stability_study import StabilityRow, StabilityTable

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

Coordinate = tuple[str, Callable[[StabilityRow], float], Callable[[float], str]]


def stability_figures(name: str, tables: Sequence[StabilityTable]) -> dict[str, Figure]:
    """Every figure of a study, by the name of its files."""
    figures: dict[str, Figure] = {}
    for table in tables:
        stem = table.experiment.name if len(tables) > 1 else name
        for order in sorted({region.order for region in table.regions}):
            word = f"{order:g}".replace(".", "-")
            maps = [region for region in table.regions if region.order == order]
            figures[f"{stem}-stability-region-{word}"] = _region_figure(maps)
        if table.experiment.members:
            figures[f"{stem}-stability"] = _parameter_figure(table)
        elif len(table.experiment.steps) > 1:
            figures[f"{stem}-stability"] = _step_figure(table)
    return figures


def _step_figure(table: StabilityTable) -> Figure:
    """Verdict and growth of every method, a row each, over the step sizes."""
    names = method_names(table.experiment.methods)
    cases = list(names)
    method = ("", lambda row: cases.index(row.run.method.case), lambda k: names[cases[int(k)]])
    panel = _verdicts(table.rows, _step(table), method, "")
    return figure([[panel]], cells, height=0.9 + _ROW * len(names))


def _step(table: StabilityTable) -> Coordinate:
    """The step size, in words ``1/32`` for the inverse of a whole number."""

    def in_words(size: float) -> str:
        inverse = round(1 / size)
        return f"1/{inverse}" if inverse > 1 and abs(size * inverse - 1) < 1e-9 else f"{size:.3g}"

    return step_label(table.experiment), lambda row: row.run.step_size, in_words


def _parameter_figure(table: StabilityTable) -> Figure:
    """Verdicts over one parameter and the step, or over two parameters, a panel per method."""
    experiment = table.experiment
    parameters = [_parameter(table, key) for key in experiment.swept if _is_number(table, key)][:2]
    parameters = parameters or [("member", _member_number, "{:.0f}".format)]
    up = parameters[1] if len(parameters) > 1 else _step(table)
    panels = []
    for case, name in method_names(experiment.methods).items():
        own = [row for row in table.rows if row.run.method.case == case]
        if len(parameters) < 2:
            panels.append(_verdicts(own, parameters[0], up, name))
            continue
        for n in experiment.steps:
            rows = [row for row in own if row.run.n_steps == n]
            panels.append(_verdicts(rows, parameters[0], up, f"{name}, $N={n}$"))
    shown = panels[:_MOST_PANELS]
    columns = min(3 if len(shown) > 4 else 2, len(shown))
    return figure(in_rows(shown, columns), cells, is_wide=columns > 1, sharex=True, sharey=True)


def _is_number(table: StabilityTable, key: str) -> bool:
    return all(isinstance(one.values[key], int | float) for one in table.experiment.members)


def _parameter(table: StabilityTable, key: str) -> Coordinate:
    def value(row: StabilityRow) -> float:
        return math.nan if row.run.member is None else float(row.run.member.values[key])

    return key_label(key, table.experiment.units), value, "{:.3g}".format


def _member_number(row: StabilityRow) -> float:
    return 0.0 if row.run.member is None else row.run.member.number + 1.0


def _verdicts(
    rows: Sequence[StabilityRow], across: Coordinate, up: Coordinate, title: str
) -> Cells:
    """Cells with the verdicts of rows, and the factor by which the worst mode grows in a step."""
    x = sorted({across[1](row) for row in rows})
    y = sorted({up[1](row) for row in rows}, reverse=bool(up[0]))
    kinds = np.full((len(y), len(x)), 3)
    texts = [[""] * len(x) for _ in y]
    for row in rows:
        at = y.index(up[1](row)), x.index(across[1](row))
        verdict, growth = row.prediction.verdict, row.prediction.growth_per_step
        kinds[at] = {"stable": int(growth > 0), "unstable": 2}.get(verdict, 3)
        texts[at[0]][at[1]] = f"{math.exp(min(growth, 700.0)):.3g}" if growth > 0 else ""
    return Cells(
        kinds=kinds,
        colours=_COLOURS,
        rows=[up[2](value) for value in y],
        columns=[across[2](value) for value in x],
        texts=texts,
        x=across[0],
        y=up[0],
        title=title,
    )


def _region_figure(maps: Sequence[StabilityMap]) -> Figure:
    """A panel for every method, a row for every family, with the stable share of the plane."""
    families: dict[object, list[Cells]] = {}
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
    rows = [
        row
        for own in families.values()
        for row in in_rows([*own, *[None] * (columns - len(own))], columns)
    ]
    return figure(
        rows,
        cells,
        height=1.5,
        is_wide=columns > 1,
        sharex=True,
        sharey=True,
        heading=rf"damping of order $\gamma = {fraction_in_words(maps[0].order)}$",
    )
