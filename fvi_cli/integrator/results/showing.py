"""Points of a run as people look at them: a small table, columns of a data frame, a picture."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fvi_cli.mathematics.arrays import Array

DIGITS = 15
"""Significant digits of times: further digits are round-off of k h."""
WIDTH, HEIGHT, POINTS = 480, 120, 600  # of a picture, in pixels; points of a curve, about
MOST_ROWS = 8  # of a table
MOST_CURVES = 6  # coordinates in a picture
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def clean_times(time: Array) -> Array:
    """Times without round-off: 0.3 in place of 0.30000000000000004."""
    return np.array([float(f"{t:.{DIGITS}g}") for t in time.tolist()])


def dataframe_of(time: Array, columns: Mapping[str, Array]) -> Any:
    """A pandas DataFrame with the times as index."""
    import pandas

    return pandas.DataFrame(columns, index=pandas.Index(clean_times(time), name="time"))


def dataset_of(
    time: Array,
    coordinates: Sequence[str],
    vectors: Mapping[str, Array],
    scalars: Mapping[str, Array],
    attributes: Mapping[str, object],
) -> Any:
    """An xarray Dataset of vectors ``(n, d)`` and scalars ``(n,)`` along time and coordinate."""
    import xarray

    found = {name: (("time", "coordinate"), values) for name, values in vectors.items()}
    return xarray.Dataset(
        {**found, **{name: ("time", values) for name, values in scalars.items()}},
        coords={"time": clean_times(time), "coordinate": list(coordinates)},
        attrs=attributes,
    )


def html_of(
    line: str,
    time: Array,
    coordinates: Sequence[str],
    position: Array,
    columns: Mapping[str, Array],
) -> str:
    """A line, a picture of the positions and a small table."""
    every = {"time": clean_times(time), **columns}
    shown = np.unique(np.linspace(0, max(time.size - 1, 0), MOST_ROWS).astype(int))[: time.size]
    head = "".join(f"<th>{html.escape(name)}</th>" for name in every)
    rows = "".join(
        "<tr>" + "".join(f"<td>{values[k]:.6g}</td>" for values in every.values()) + "</tr>"
        for k in shown.tolist()
    )
    picture = _picture(time, coordinates, position)
    return f"<p>{html.escape(line)}</p>{picture}<table><tr>{head}</tr>{rows}</table>"


def _picture(time: Array, coordinates: Sequence[str], position: Array) -> str:
    """Positions over time as a drawing in HTML; empty where they are not finite."""
    if time.size < 2 or not np.isfinite(position).all():
        return ""
    every = max(1, time.size // POINTS)
    low, high = float(position.min()), float(position.max())
    span = (high - low) or 1.0
    across = WIDTH * time[::every] / time[-1]
    curves = []
    for k in range(min(position.shape[1], MOST_CURVES)):
        down = HEIGHT * (high - position[::every, k]) / span
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(across, down, strict=True))
        curves.append(
            f'<polyline fill="none" stroke="{COLOURS[k]}" stroke-width="1.2" points="{points}"/>'
        )
    return (
        f'<svg width="{WIDTH}" height="{HEIGHT}" viewBox="0 -2 {WIDTH} {HEIGHT + 4}">'
        f"<title>{html.escape(', '.join(coordinates[:MOST_CURVES]))} from {low:.4g} to "
        f"{high:.4g}</title>{''.join(curves)}</svg>"
    )
