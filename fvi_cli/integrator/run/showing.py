"""A trajectory as people look at it: a few lines, a small table, columns of a data frame."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

import numpy as np

from fvi_cli.mathematics.arrays import Array

if TYPE_CHECKING:
    from fvi_cli.integrator.trajectory import Trajectory

DIGITS = 15
"""Significant digits of times: what is beyond is round-off of k h."""
WIDTH, HEIGHT, POINTS = 480, 120, 600
MOST_ROWS = 8
MOST_CURVES = 6
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def names_in(trajectory: Trajectory) -> tuple[str, ...]:
    """Names of the coordinates: their own, or ``x``, or ``x1``, ``x2``, ..."""
    d = trajectory.position.shape[1]
    if len(trajectory.coordinates) == d:
        return trajectory.coordinates
    return ("x",) if d == 1 else tuple(f"x{k}" for k in range(1, d + 1))


def clean_times(time: Array) -> Array:
    """Times without the dust of round-off: 0.3 in place of 0.30000000000000004."""
    return np.array([float(f"{t:.{DIGITS}g}") for t in time.tolist()])


def columns_of(trajectory: Trajectory) -> dict[str, Array]:
    """What there is at every reported time, by name: ``x1``, ``p_x1``, ``energy``, quantities."""
    names = names_in(trajectory)
    found = {name: trajectory.position[:, k] for k, name in enumerate(names)}
    if trajectory.momentum is not None:
        found |= {f"p_{name}": trajectory.momentum[:, k] for k, name in enumerate(names)}
    if trajectory.energy is not None:
        found["energy"] = trajectory.energy
    if trajectory.observed is not None:
        found |= trajectory.observed.quantities
    return found


def dataframe_of(trajectory: Trajectory) -> Any:
    """A pandas DataFrame with the times as index."""
    import pandas

    index = pandas.Index(clean_times(trajectory.time), name="time")
    return pandas.DataFrame(columns_of(trajectory), index=index)


def dataset_of(trajectory: Trajectory) -> Any:
    """An xarray Dataset along ``time``, and ``coordinate`` with its names."""
    import xarray

    along = ("time", "coordinate")
    found: dict[str, Any] = {"position": (along, trajectory.position)}
    if trajectory.momentum is not None:
        found["momentum"] = (along, trajectory.momentum)
    if trajectory.energy is not None:
        found["energy"] = ("time", trajectory.energy)
    if trajectory.observed is not None:
        found |= {name: ("time", one) for name, one in trajectory.observed.quantities.items()}
    return xarray.Dataset(
        found,
        coords={
            "time": clean_times(trajectory.time),
            "coordinate": list(names_in(trajectory)),
        },
        attrs={"status": trajectory.status, "n_steps": trajectory.n_steps},
    )


def line_of(trajectory: Trajectory) -> str:
    """The trajectory in one line."""
    points, d = trajectory.position.shape
    end = f"{trajectory.time[-1]:.6g}" if points else "-"
    told = f": {trajectory.message}" if trajectory.message else ""
    return (
        f"<Trajectory {trajectory.status}{told}, {points} points to t = {end}, {d} "
        f"coordinate{'s' if d > 1 else ''}, {trajectory.n_steps} steps>"
    )


def html_of(trajectory: Trajectory) -> str:
    """A line, a picture of the positions and a small table."""
    columns = {"time": clean_times(trajectory.time), **columns_of(trajectory)}
    count = trajectory.time.size
    shown = np.unique(np.linspace(0, max(count - 1, 0), MOST_ROWS).astype(int))[:count]
    head = "".join(f"<th>{html.escape(name)}</th>" for name in columns)
    rows = "".join(
        "<tr>" + "".join(f"<td>{values[k]:.6g}</td>" for values in columns.values()) + "</tr>"
        for k in shown.tolist()
    )
    line = html.escape(line_of(trajectory).strip("<>"))
    return f"<p>{line}</p>{_picture(trajectory)}<table><tr>{head}</tr>{rows}</table>"


def _picture(trajectory: Trajectory) -> str:
    """Positions over time as a drawing in HTML; nothing where there is none."""
    time, position = trajectory.time, trajectory.position
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
        f"<title>{html.escape(', '.join(names_in(trajectory)[:MOST_CURVES]))} from {low:.4g} to "
        f"{high:.4g}</title>{''.join(curves)}</svg>"
    )
