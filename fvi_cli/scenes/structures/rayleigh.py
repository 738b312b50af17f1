"""Rayleigh damping, by its factors or by the damping ratios of two modes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.matrices import Form, as_csc, dense
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.keys.values import Fraction, Keys, NotNegative, Order, Pair, Wrong, key

LARGEST_DENSE: Final = 400
"""Degrees of freedom up to which all modes are computed at once."""


class Rayleigh(Keys):
    """Damping (a M + b K) D^gamma x, by its factors or by the ratios of two modes."""

    ratios: Pair[Fraction] | None = key("Damping ratios of two modes, which give a and b.", None)
    modes: Pair[Annotated[int, Field(ge=1, le=100_000)]] | None = key(
        "Their numbers, counted from 1 by frequency; default: [1, 2].", None
    )
    mass: NotNegative | None = key(
        "a, in place of ratios; default: 0.", None, unit="time^(gamma-2)"
    )
    stiffness: NotNegative | None = key(
        "b, in place of ratios; default: 0.", None, unit="time^gamma"
    )
    order: Order | None = key("Order gamma beside mass and stiffness; default: 1.", None)

    def mistakes(self) -> Iterator[Wrong]:
        """Both forms together, or none."""
        given = {name for name, value in self if value is not None}
        if not given & {"ratios", "mass", "stiffness"}:
            yield Wrong((), "ratios: [0.02, 0.05] are missing, or mass and stiffness")
        if given & {"ratios", "modes"}:
            for name in sorted(given & {"mass", "stiffness", "order"}):
                yield Wrong((name,), "not together with ratios", of_key=True)


def rayleigh_damping(mass: Form, stiffness: Form, given: Rayleigh) -> FractionalDamping:
    r"""The term :math:`(a M + b K) D^\gamma x`.

    Of ratios :math:`\zeta_i = a/(2 \omega_i) + b \omega_i/2`, and the order is 1.

    Raises
    ------
    ArgumentError
        For modes that do not exist or have the same frequency, and for ratios that need a negative
        factor a or b, which would make other modes grow.
    """
    if given.ratios is None:
        a, b = given.mass or 0.0, given.stiffness or 0.0
    else:
        a, b = _factors(mass, stiffness, given.ratios, given.modes or (1, 2))
    order = 1.0 if given.order is None else given.order
    return FractionalDamping(order=order, coefficient=a * mass + b * stiffness)


def _factors(
    mass: Form, stiffness: Form, ratios: Sequence[float], modes: Sequence[int]
) -> tuple[float, float]:
    """The factors a and b that give two modes their damping ratios."""
    size = mass.shape[0]
    if max(modes) > size:
        raise ArgumentError(
            "rayleigh.modes", f"mode {max(modes)} does not exist; write 1 to {size}"
        )
    found = natural_frequencies(mass, stiffness, max(modes))
    first, second = (float(found[number - 1]) for number in modes)
    hint = "; write modes: [1, 2]" if modes[0] == modes[1] and size > 1 else ""
    if not (first > 0 and second > 0) or math.isclose(first, second, rel_tol=1e-9):
        raise ArgumentError(
            "rayleigh.modes",
            f"their angular frequencies are {first:.6g} and {second:.6g}; two different ones "
            f"above 0 are needed{hint}",
        )
    system = 0.5 * np.array([[1 / first, first], [1 / second, second]])
    a, b = np.linalg.solve(system, np.asarray(ratios, dtype=float))
    tiny = 1e-12 * max(ratios)
    if a < -tiny * first or b < -tiny / first:
        low, high = sorted((first / second, second / first))
        raise ArgumentError(
            "rayleigh.ratios",
            f"these need a = {a:.6g}, b = {b:.6g}, and a negative factor drives other modes; the "
            f"second ratio must be from {ratios[0] * low:.6g} to {ratios[0] * high:.6g}",
        )
    return max(float(a), 0.0), max(float(b), 0.0)


def natural_frequencies(mass: Form, stiffness: Form, count: int) -> Array:
    """The lowest angular frequencies of M and K, shape ``(count,)`` or more."""
    size = mass.shape[0]
    k, m = as_csc(stiffness), as_csc(mass)
    scale = float(k.diagonal().sum() / m.diagonal().sum())
    if size <= LARGEST_DENSE or count > size - 2:
        root = np.linalg.cholesky(dense(mass))
        reduced = np.linalg.solve(root, np.linalg.solve(root, dense(stiffness)).T)
        squares = np.linalg.eigvalsh(0.5 * (reduced + reduced.T))
    else:
        from scipy.sparse.linalg import eigsh

        # below 0, since the stiffness of a free structure is singular; one start for every run
        start = np.random.default_rng(1).standard_normal(size)
        squares = np.sort(
            eigsh(k, k=count, M=m, sigma=-1e-9 * scale, v0=start, return_eigenvectors=False)
        )
    # what is round-off of 0 is 0
    return np.asarray(np.sqrt(np.where(squares > 1e-13 * scale, squares, 0.0)))
