"""The distinct directions of the coefficient matrices of the damping."""

from __future__ import annotations

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.matrices import Form, as_csr, entries, is_sparse, scaled
from fvi_cli.effects.matrix_force import MatrixForce


def terms_by_direction(
    damping: tuple[FractionalDamping, ...],
) -> tuple[tuple[Form, tuple[tuple[float, float], ...]], ...]:
    """The distinct directions of the coefficients, each with scale and order of its terms.

    Every direction has one sequence of weights, however many terms there are.
    """
    found: list[tuple[Form, list[tuple[float, float]]]] = []
    for term in damping:
        scale, direction = scale_and_direction(term)
        for other, terms in found:
            if same_direction(other, direction):
                terms.append((scale, term.order))
                break
        else:
            found.append((direction, [(scale, term.order)]))
    return tuple((direction, tuple(terms)) for direction, terms in found)


def scale_and_direction(term: MatrixForce) -> tuple[float, Form]:
    """The coefficient matrix as a number times a matrix whose largest entry is 1."""
    kept = entries(term.form)
    scale = float(kept[np.abs(kept).argmax()])
    if isinstance(term.form, np.ndarray):
        return scale, term.form / scale
    return scale, scaled(term.form, 1.0 / scale)


def same_direction(a: Form, b: Form) -> bool:
    """Whether two matrices from `scale_and_direction` are one."""
    if a.shape != b.shape or is_sparse(a) != is_sparse(b):
        return False
    if not isinstance(a, np.ndarray):
        one, other = as_csr(a), as_csr(b)
        if not (
            np.array_equal(one.indptr, other.indptr) and np.array_equal(one.indices, other.indices)
        ):
            return False
    return bool(np.allclose(entries(a), entries(b), rtol=1e-14, atol=0))
