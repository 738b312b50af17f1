"""Stability of methods: a matrix over the steps, over parameters, and regions in the plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.region import StabilityMap
from fvi_cli.plotting.draw import cells, figure
from fvi_cli.plotting.looks import method_names
from fvi_cli.plotting.panels import Cells
from fvi_cli.plotting.words import fraction_in_words, typeset
from fvi_cli.reports.naming import key_label, with_unit
from fvi_cli.studies.stability_study import StabilityRow, StabilityTable

_COLOURS = (
    ("stable", "#c9dff2"),
    ("unstable after the final time", "#fbe6d4"),
    ("unstable: growth per step (ln)", "#ee9b63"),
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
MOST_PANELS = 12
_ROW = 0.17  # inches of a row of a matrix


def stability_figures(name: str, tables: Sequence[StabilityTable]) -> dict[str, Figure]:
    """Every figure of a study, by the name of its files."""
    figures: dict[str, Figure] = {}
    for table in tables:
        stem = table.experiment.name if len(tables) > 1 else name
        for order in sorted({region.order for region in table.regions}):
            word = f"{order:g}".replace(".", "-")
            maps = [region for region in table.regions if region.order == order]
            figures[f"{stem}-stability-region-{word}"] = region_figure(maps)
        if table.experiment.members:
            figures[f"{stem}-stability"] = parameter_figure(table)
        elif len(table.experiment.steps) > 1:
            figures[f"{stem}-stability"] = step_figure(table)
    return figures


def step_figure(table: StabilityTable) -> Figure:
    """Verdict and growth of every method, a row each, over the step sizes."""
    names = method_names(table.experiment.methods)
    sizes = sorted({row.run.step_size for row in table.rows})
    kinds = np.full((len(names), len(sizes)), 3)
    texts = [[""] * len(sizes) for _ in names]
    for row in table.rows:
        at = list(names).index(row.run.method.case), sizes.index(row.run.step_size)
        growth = row.prediction.growth_per_step
        kinds[at] = _kind(row)
        texts[at[0]][at[1]] = f"{growth:.2g}" if growth > 0 else ""
    panel = Cells(
        kinds=kinds,
        colours=_COLOURS,
        rows=list(names.values()),
        columns=[_in_words(size) for size in sizes],
        texts=texts,
        x=with_unit("step size $h$", table.experiment.units, "time"),
    )
    return figure([[panel]], cells, height=0.9 + _ROW * len(names))


def _in_words(size: float) -> str:
    """``1/32`` for the inverse of a whole number."""
    inverse = round(1 / size)
    return f"1/{inverse}" if inverse > 1 and abs(size * inverse - 1) < 1e-9 else f"{size:.3g}"


def parameter_figure(table: StabilityTable) -> Figure:
    """Verdicts over one parameter and the step, or over two parameters, a panel per method."""
    experiment, keys = table.experiment, _numeric_keys(table)
    panels: list[Cells | None] = []
    for case, name in method_names(experiment.methods).items():
        own = [row for row in table.rows if row.run.method.case == case]
        for n in experiment.steps if len(keys) > 1 else (0,):
            rows = [row for row in own if n in (0, row.run.n_steps)]
            panels.append(_verdicts(table, keys, rows, f"{name}, $N={n}$" if n else name))
    shown = panels[:MOST_PANELS]
    columns = min(3 if len(shown) > 4 else 2, len(shown))
    shown += [None] * (-len(shown) % columns)
    rows_of_panels = [shown[k : k + columns] for k in range(0, len(shown), columns)]
    return figure(
        rows_of_panels,
        cells,
        height=max(1.5, 7.5 / len(rows_of_panels)) if len(rows_of_panels) > 3 else 2.0,
        is_wide=columns > 1,
        sharex=True,
        sharey=True,
        legend="below",
    )


def _verdicts(
    table: StabilityTable, keys: Sequence[str], rows: Sequence[StabilityRow], title: str
) -> Cells:
    """Cells of verdicts of one method."""
    across = [_coordinate(row, keys[0]) for row in rows]
    up = [_coordinate(row, keys[1]) if len(keys) > 1 else row.run.step_size for row in rows]
    x, y = sorted(set(across)), sorted(set(up), reverse=True)
    kinds = np.full((len(y), len(x)), 3)
    for row, a, b in zip(rows, across, up, strict=True):
        kinds[y.index(b), x.index(a)] = _kind(row)
    units = table.experiment.units
    step = with_unit("step size $h$", units, "time")
    return Cells(
        kinds=kinds,
        colours=_COLOURS,
        rows=[f"{value:.3g}" if len(keys) > 1 else _in_words(value) for value in y],
        columns=[f"{value:.3g}" for value in x],
        x=key_label(keys[0], units),
        y=step if len(keys) == 1 else key_label(keys[1], units),
        title=title,
    )


def _numeric_keys(table: StabilityTable) -> list[str]:
    """The swept keys with numbers, at most two; without such keys the number of the member."""
    members = table.experiment.members
    keys = [
        key
        for key in table.experiment.swept
        if all(isinstance(member.values[key], int | float) for member in members)
    ]
    return keys[:2] or ["member"]


def _coordinate(row: StabilityRow, key: str) -> float:
    member = row.run.member
    if member is None:
        return 0.0
    return float(member.number if key == "member" else member.values[key])


def _kind(row: StabilityRow) -> int:
    """The index of the colour of a cell."""
    verdict = row.prediction.verdict
    if verdict == "stable":
        return int(row.prediction.growth_per_step > 0)
    return 2 if verdict == "unstable" else 3


def region_figure(maps: Sequence[StabilityMap]) -> Figure:
    """A panel for every method, a row for every family, with the stable share of the plane."""
    panels = [
        Cells(
            kinds=one.level + 1,
            colours=_LEVELS,
            plane=(one.stiffness, one.damping),
            note=f"{100 * one.share_stable:.0f} %",
            title=typeset(one.method.label),
            x="stiffness $h^2 k / m$",
            y=r"damping $\mu\, h^{2-\gamma} / m$",
        )
        for one in maps
    ]
    families: dict[object, list[Cells | None]] = {}
    for one, panel in zip(maps, panels, strict=True):
        families.setdefault(_family(one), []).append(panel)
    columns = min(max(map(len, families.values())), 3)
    rows = [
        [*own[k : k + columns], *[None] * (columns - len(own[k : k + columns]))]
        for own in families.values()
        for k in range(0, len(own), columns)
    ]
    order = fraction_in_words(maps[0].order)
    return figure(
        rows,
        cells,
        height=1.5,
        is_wide=columns > 1,
        sharex=True,
        sharey=True,
        legend="below",
        heading=rf"damping of order $\gamma = {order}$",
    )


def _family(one: StabilityMap) -> object:
    method = one.method
    if not isinstance(method, Method):
        return "baseline"
    return "runge-kutta" if method.is_runge_kutta else (method.sampling, method.degree)
