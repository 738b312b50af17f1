"""Measured responses to harmonic forces, as fits take them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fvi_cli.studies.fits.settings import Amplitude, DataSet, Series


def response_data(
    hertz: Any,
    columns: Mapping[str, Any],
    *,
    row: Sequence[float] = (1.0,),
    rates: Mapping[str, int] | None = None,
    force: str = "x",
    coordinates: tuple[str, ...] = ("x",),
) -> DataSet:
    """Columns of parts of one amplitude, by the names of the parts."""
    series = tuple(
        Series(
            name=part,
            column=part,
            times=hertz,
            values=values,
            amplitude=Amplitude(row=np.array(row), rate=(rates or {}).get(part, 0), part=part),
        )
        for part, values in columns.items()
    )
    return DataSet(name="a", series=series, forces=(force,), coordinates=coordinates)
