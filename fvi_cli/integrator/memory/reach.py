"""The reach of dampers: the few directions of a large structure that the memory stores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from fvi_cli.effects.damping import MatrixForce
from fvi_cli.effects.matrices import Form, as_csr, dense, form, sparse_unit, touched
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class DamperForms:
    r"""Linear forms :math:`y = B q`, on which every damping matrix acts as :math:`B^T C B`."""

    rows: Form  # B, shape (r, d): those of dampers, or single components
    are_components: bool

    @property
    def count(self) -> int:
        """Number r of forms."""
        return int(self.rows.shape[0])

    def along(self, values: Array) -> Array:
        """Values ``(..., d)`` along the forms, ``(..., r)``."""
        return _mapped(self.rows, values)

    def spread(self, forces: Array) -> Array:
        """Forces along the forms ``(..., r)`` on all components ``(..., d)``."""
        return _mapped(cast(Form, as_csr(self.rows).T), forces)

    def inner(self, term: MatrixForce) -> Form:
        """The matrix C of a term, shape ``(r, r)``."""
        if self.are_components or term.factored is None:
            rows = as_csr(self.rows)
            inner = cast(Form, rows @ as_csr(term.form) @ rows.T)
            return form(dense(inner) if isinstance(term.form, np.ndarray) else inner)
        place_of = {row.tobytes(): place for place, row in enumerate(dense(self.rows))}
        places = [place_of[(row + 0.0).tobytes()] for row in term.factored.rows]  # -0.0 to 0.0
        whole = np.zeros((self.count, self.count))
        np.add.at(whole, np.ix_(places, places), term.factored.inner)
        return form(whole)


def _mapped(matrix: Form, values: Array) -> Array:
    """Rows of values ``(..., b)`` times the transpose of a matrix ``(a, b)``."""
    flat = values.reshape(-1, values.shape[-1])
    return np.asarray((matrix @ flat.T).T.reshape(*values.shape[:-1], -1))


def find_damper_forms(terms: Sequence[MatrixForce]) -> DamperForms | None:
    """The fewest forms on which all damping terms act; None if these are all coordinates."""
    reached = np.any([touched(term.form) for term in terms], axis=0)
    components = np.flatnonzero(reached)
    factors = [term.factored for term in terms if term.factored is not None]
    if len(factors) == len(terms):
        rows = np.unique(np.concatenate([one.rows for one in factors]), axis=0)
        if rows.shape[0] < components.size:
            return DamperForms(rows=cast(Form, as_csr(rows)), are_components=False)
    if components.size == reached.size:
        return None
    units = cast(Form, as_csr(sparse_unit(reached.size))[components])
    return DamperForms(rows=units, are_components=True)
