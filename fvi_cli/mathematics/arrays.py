"""Types of arrays for annotations, and read-only arrays as fields of frozen values."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Integers = NDArray[np.int64]
LongArray = NDArray[np.longdouble]
Places = NDArray[np.intp]
Mask = NDArray[np.bool_]


def set_arrays(owner: object, **values: ArrayLike) -> None:
    """Let fields of a frozen value be read-only copies of arrays."""
    for name, value in values.items():
        array = np.array(value, dtype=float)
        array.setflags(write=False)
        object.__setattr__(owner, name, array)
