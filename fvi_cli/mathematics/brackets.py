"""Roots of functions of one variable between places where their signs differ."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fvi_cli.mathematics.arrays import Array, Places

SWEEPS = 80
"""Most iterations for a root in a bracket: bisection alone would need some 60."""

Function = Callable[[Places, Array], Array]
"""From numbers of functions and places, both ``(n,)``, to the values there, ``(n,)``."""


def bracketed_roots(
    function: Function,
    which: Places,
    left: Array,
    right: Array,
    at_left: Array,
    at_right: Array,
) -> Array:
    """Roots between places with values of different sign, all at once, shape ``(n,)``.

    Bisection with inverse quadratic interpolation (Chandrupatla, *Advances in Engineering
    Software* 28, 1997), to round-off in the place.
    """
    a, b, fa, fb = right.copy(), left.copy(), at_right.copy(), at_left.copy()
    c, fc = a.copy(), fa.copy()
    share, roots = np.full(a.size, 0.5), np.zeros(a.size)
    index = np.arange(a.size)
    for _ in range(SWEEPS):
        place = a + share * (b - a)
        value = function(which[index], place)
        same = np.sign(value) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = place, value
        nearer = np.abs(fa) < np.abs(fb)
        nearest = np.where(nearer, a, b)
        roots[index] = nearest
        width = np.abs(b - a)
        least = 4e-16 * np.maximum(np.abs(nearest), 1e-3)  # round-off; 1e-3: of places in [0, 1]
        going = ~((width <= 2.0 * least) | (np.where(nearer, fa, fb) == 0.0))
        if not going.any():
            break
        with np.errstate(all="ignore"):
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            quadratic = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            share = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (
                fc - fb
            )
            limit = least / width
        usable = quadratic & np.isfinite(share)
        share = np.where(usable, share, 0.5)
        share = np.clip(share, np.minimum(limit, 0.5), np.maximum(1.0 - limit, 0.5))
        # a root that is found is iterated no further, so that it does not depend on the others
        a, b, c, share, index = a[going], b[going], c[going], share[going], index[going]
        fa, fb, fc = fa[going], fb[going], fc[going]
    return roots
