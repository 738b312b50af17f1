"""Samples of a force as a text that travels with the problem, and back."""

from __future__ import annotations

import base64
import functools
import zlib
from collections.abc import Mapping
from typing import Any, Final, cast

import numpy as np

from fvi_cli.effects.sampled import Interpolation, SampledForce
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import excerpt
from fvi_cli.mathematics.arrays import Array

MOST_SAMPLES: Final = 100_000
LARGEST_TEXT: Final = 500_000
"""Characters of samples as text: they stand in every result file, and in every run's identity."""
_LARGEST_LINE: Final = 52


def samples_as_text(time: Array, values: Array) -> str:
    """Times and values without loss as one word.

    Lines ``t,value`` with the shortest digits that give the numbers back, compressed (zlib) and in
    letters (base64).
    """
    lines = "".join(f"{t!r},{v!r}\n" for t, v in zip(time.tolist(), values.tolist(), strict=True))
    return base64.b64encode(zlib.compress(lines.encode(), 9)).decode()


@functools.lru_cache(maxsize=8)
def samples_from_text(text: str) -> tuple[Array, Array]:
    """Times and values of a text from `samples_as_text`, which are only to be read.

    Members of a sweep have the same text.

    Raises
    ------
    ValueError
        If the text is not of that kind, or holds too many samples.
    """
    limit = MOST_SAMPLES * _LARGEST_LINE
    try:
        unpacking = zlib.decompressobj()
        content = unpacking.decompress(base64.b64decode(text, validate=True), limit)
        if unpacking.unconsumed_tail or content.count(b"\n") > MOST_SAMPLES:
            raise ValueError(f"more than {MOST_SAMPLES} samples")
        if not unpacking.eof or unpacking.unused_data:
            # only at its end is the checksum of what was compressed
            raise ValueError("the text is cut off, or has something behind its end")
        rows = [line.split(",") for line in content.decode("ascii").removesuffix("\n").split("\n")]
        table = np.array([[float(cell) for cell in row] for row in rows])
    except (zlib.error, ValueError) as error:
        raise ValueError(f"not samples as text: {excerpt(str(error))}") from None
    if table.ndim != 2 or table.shape[1] != 2:
        raise ValueError("not samples as text: two columns are needed")
    table.setflags(write=False)
    return table[:, 0], table[:, 1]


def sampled_component(specification: Mapping[str, Any], final_time: float) -> SampledForce:
    """The component that ``{file, column, interpolation, scale, content}`` describes.

    Raises
    ------
    ValueError
        ``<key>: what is wrong``, or what is wrong without a key.
    """
    name, column = str(specification["file"]), str(specification.get("column", "acceleration"))
    if "content" not in specification:
        raise ArgumentError("content", f"missing; what {name} holds is needed as well")
    time, values = samples_from_text(str(specification["content"]))
    slack = 1e-9 * final_time
    ends_early = time[-1] < final_time - slack
    if time[0] > slack or (ends_early and specification.get("beyond") != "zero"):
        hint = "" if time[0] > slack else "; with beyond: zero there is no force behind them"
        raise ArgumentError(
            name,
            f"its samples reach from t = {time[0]:g} to {time[-1]:g}; they must reach from "
            f"0 to final_time = {final_time:g}{hint}",
        )
    return SampledForce.through(
        time,
        float(specification.get("scale", 1.0)) * values,
        cast(Interpolation, specification.get("interpolation", "linear")),
        source=f"{column} of {name}",
    )


def end_of_samples(specification: Mapping[str, Any], final_time: float) -> float | None:
    """Where samples end before T with nothing behind them; None where they do not."""
    if specification.get("beyond") != "zero" or "content" not in specification:
        return None
    end = float(samples_from_text(str(specification["content"]))[0][-1])
    return end if end < final_time * (1.0 - 1e-9) else None
