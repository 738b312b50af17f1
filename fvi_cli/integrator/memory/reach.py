"""The reach of dampers: the few directions of a large structure that the memory stores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.damping import MatrixForce
from fvi_cli.effects.matrices import Form, as_csr, form, sparse_unit, touched
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class DamperForms:
    r"""Linear forms :math:`y = B q`, on which every damping matrix acts as :math:`B^T C B`."""

    rows: Form  # B, shape (r, d)
    # component of each row, if rows are single components; None: they are combinations
    components: NDArray[np.intp] | None

    @cached_property
    def _compact(self) -> tuple[NDArray[np.intp], Array]:
        """Columns of B that are not zero, and B in these columns only: few of thousands."""
        sparse = as_csr(self.rows).tocsc()
        columns = np.flatnonzero(np.diff(sparse.indptr))
        return columns, np.asarray(sparse[:, columns].toarray())

    @property
    def count(self) -> int:
        """Number r of forms."""
        return int(self.rows.shape[0])

    def along(self, values: Array) -> Array:
        """Values ``(..., d)`` along the forms, ``(..., r)``."""
        if self.components is not None:
            return values[..., self.components]
        columns, factors = self._compact
        return np.asarray(values[..., columns] @ factors.T)

    def spread(self, forces: Array) -> Array:
        """Forces along the forms ``(..., r)`` on all components ``(..., d)``."""
        if self.components is not None:
            total = np.zeros((*forces.shape[:-1], self.rows.shape[1]))
            total[..., self.components] = forces
            return total
        columns, factors = self._compact
        total = np.zeros((*forces.shape[:-1], self.rows.shape[1]))
        total[..., columns] = forces @ factors
        return total

    def inner(self, term: MatrixForce) -> Form:
        """The matrix C of a term, shape ``(r, r)``."""
        if self.components is not None:
            if isinstance(term.form, np.ndarray):
                return form(term.form[np.ix_(self.components, self.components)])
            return cast(Form, as_csr(term.form)[self.components][:, self.components])
        if term.factored is None:
            raise ValueError("damping: a term on every component has no rows of its own")
        columns, kept = self._compact
        own = term.factored.rows[:, columns]
        places = [int(np.flatnonzero((kept == row).all(axis=1))[0]) for row in own]
        whole = np.zeros((self.count, self.count))
        np.add.at(whole, np.ix_(places, places), term.factored.inner)
        return form(whole)


def find_damper_forms(terms: Sequence[MatrixForce]) -> DamperForms | None:
    """The fewest forms on which all damping terms act; None if these are all coordinates."""
    reached = np.any([touched(term.form) for term in terms], axis=0)
    components = np.flatnonzero(reached)
    factors = [term.factored for term in terms]
    if all(one is not None for one in factors):
        stacked = np.concatenate([one.rows for one in factors if one is not None])
        rows = np.unique(stacked, axis=0)
        if rows.shape[0] < components.size:
            return DamperForms(rows=cast(Form, as_csr(rows)), components=None)
    if components.size == reached.size:
        return None
    units = as_csr(sparse_unit(reached.size))[components]
    return DamperForms(rows=cast(Form, units), components=components)
