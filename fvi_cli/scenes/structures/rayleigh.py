"""Rayleigh damping by the damping ratios of two modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.matrices import Form, as_csc, dense
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.containers import ListOf
from fvi_cli.keys.scalars import Integer, Number
from fvi_cli.keys.settings import Setting, key
from fvi_cli.mathematics.arrays import Array

LARGEST_DENSE: Final = 400
"""Degrees of freedom up to which all modes are computed at once."""


class Rayleigh(
    Setting,
    expected="a mapping such as {ratios: [0.02, 0.05], modes: [1, 3]}",
    refused=dict.fromkeys(
        ("alpha", "beta", "mass", "stiffness"),
        "not a key: write ratios and modes; a structure also has proportional: {mass: a, "
        "stiffness: b}",
    ),
):
    """Damping (a M + b K) x' by two damping ratios."""

    ratios: Annotated[
        tuple[float, float],
        ListOf(shape=Number(above=0.0, below=1.0), least=2, most=2, example="[0.02, 0.05]"),
    ] = key("Damping ratios of the two modes (no unit).")
    modes: Annotated[
        tuple[int, int],
        ListOf(shape=Integer(least=1, most=100_000), least=2, most=2, example="[1, 3]"),
    ] = key("Their numbers, counted from 1 by frequency.", default=[1, 2])


def rayleigh_damping(
    mass: Form, stiffness: Form, ratios: Sequence[float], modes: Sequence[int]
) -> FractionalDamping:
    r"""The term :math:`(a M + b K) x'` with :math:`\zeta_i = a/(2 \omega_i) + b \omega_i/2`.

    Raises
    ------
    ArgumentError
        For modes that do not exist or have the same frequency, and for ratios that need a negative
        factor a or b, which would make other modes grow.
    """
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
    together = max(float(a), 0.0) * mass + max(float(b), 0.0) * stiffness
    return FractionalDamping(order=1.0, coefficient=together)


def natural_frequencies(mass: Form, stiffness: Form, count: int) -> Array:
    """The lowest angular frequencies of M and K, shape ``(count,)`` or more."""
    size = mass.shape[0]
    if size <= LARGEST_DENSE or count > size - 2:
        return np.sqrt(np.maximum(natural_modes(mass, stiffness)[0], 0.0))
    from scipy.sparse.linalg import eigsh

    squares = eigsh(
        as_csc(stiffness), k=count, M=as_csc(mass), sigma=0.0, return_eigenvectors=False
    )
    return np.sqrt(np.maximum(np.sort(squares), 0.0))


def natural_modes(mass: Form, stiffness: Form) -> tuple[Array, Array]:
    r"""Squares of the angular frequencies, increasing, and :math:`M \phi` in columns."""
    root = np.linalg.cholesky(dense(mass))
    reduced = np.linalg.solve(root, np.linalg.solve(root, dense(stiffness)).T)
    values, vectors = np.linalg.eigh(0.5 * (reduced + reduced.T))
    return values, np.asarray(root @ vectors)
