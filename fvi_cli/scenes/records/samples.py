"""Samples and columns of files as keys of a configuration."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from numpy.typing import NDArray

from fvi_cli.effects.sampled import Interpolation, SampledForce
from fvi_cli.scenes.keys.values import BY_FORM, key
from fvi_cli.scenes.records.csv_samples import (
    DECIMAL,
    SUFFIX,
    Decimal,
    read_at2_samples,
    read_csv_samples,
)
from fvi_cli.scenes.records.inputs import DataFileError, FromFile, kept_numbers

STANDARD_GRAVITY: Final = 9.80665
"""Acceleration of free fall, in m/s^2 (CGPM 1901)."""


class Samples(FromFile):
    """Samples of a force or motion from a file."""

    file: str = key(
        "CSV file with names of columns in its first line, or a record of ground motion in AT2 "
        "(PEER), in units of g; a relative path begins at the configuration."
    )
    column: str | None = key(
        "Column of the values, in their unit divided by scale; AT2 has none.", None
    )
    time: str = key(
        "Column of the times, which increase from 0 or before to final_time or later.", "t"
    )
    decimal: Decimal = DECIMAL
    interpolation: Interpolation = key(
        "Between the samples: straight lines (order 2 at most), a cubic spline (4), or previous: "
        "the value of a sample until the next.",
        "linear",
    )
    scale: Annotated[float | Literal["g"], BY_FORM] = key(
        "Factor of the values; g: 9.80665, for a record in g and motion in metres and seconds.",
        1.0,
    )
    beyond: Literal["refuse", "zero"] = key(
        "zero: the force is zero after the last sample, where that comes before final_time.",
        "refuse",
    )

    def read(self, path: Path, name: str) -> NDArray[Any]:
        """Times and values, shape ``(n, 2)``."""
        if path.suffix.lower() == SUFFIX:
            return read_at2_samples(path, name)
        if self.column is None:
            message = "missing: the name of a column (records whose names end in .at2 need none)"
            raise DataFileError(message, key="column")
        return read_csv_samples(path, name, self.time, self.column, decimal=self.decimal)[0]

    @property
    def component(self) -> SampledForce:
        """The component of a force."""
        factor = STANDARD_GRAVITY if self.scale == "g" else float(self.scale)
        source = f"{self.column or 'acceleration'} of {self.file}"
        return _through(str(self.digest), factor, self.interpolation, source)

    def end(self, final_time: float) -> float:
        """Time before T at which samples with ``beyond: zero`` end; infinite otherwise."""
        last = float(self.value[-1, 0])
        return last if self.beyond == "zero" and last < final_time * (1.0 - 1e-9) else math.inf


@functools.lru_cache(maxsize=64)
def _through(digest: str, factor: float, interpolation: Interpolation, source: str) -> SampledForce:
    # cached, since thousands of members of a sweep have the same force
    time, values = kept_numbers(digest).T
    return SampledForce.through(time, factor * values, interpolation, source=source)
