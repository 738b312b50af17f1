"""Numbers of steps and of points."""

from __future__ import annotations

import numpy as np


def check_counts(n_steps: object, every: object) -> None:
    """Refuse numbers of steps and of points that are no positive integers.

    Raises
    ------
    ValueError
        With the number and what is allowed.
    """
    for name, value in (("n_steps", n_steps), ("every", every)):
        if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 1:
            others = ", a Mesh or AdaptiveSteps" if name == "n_steps" else ""
            raise ValueError(
                f"{name}: {value!r} is not allowed; it must be an integer >= 1{others}"
            )
