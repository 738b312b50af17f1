"""Points of a run as columns of a data frame, and as a dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fvi_cli.mathematics.arrays import Array

DIGITS = 15
"""Significant digits of times: further digits are round-off of k h."""


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
