"""How Newton's iteration went, for every member."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fvi_cli.integrator.results.diagnostics import NewtonRecord
from fvi_cli.mathematics.arrays import Array, Integers, Places


class Attempt(NamedTuple):
    """The iteration for one block of steps."""

    first: int  # number of its first step among those that are solved together
    members: Places  # whose steps they are, and the iterations of each
    iterations: Integers
    changes: Sequence[Array]  # largest ones by the iterations, (members, components)

    def among(self, places: Places) -> "Attempt":
        """The same where the members have other numbers, `places` of theirs."""
        return self._replace(members=places[self.members])

    @property
    def sizes(self) -> Array:
        """Largest changes of each of them, ``(iterations, members)``."""
        return np.array([one.max(axis=1) for one in self.changes])

    def of_member(self, place: int) -> tuple[float, ...]:
        """Largest changes of one of them."""
        count = int(self.iterations[place])
        return tuple(float(one[place].max()) for one in self.changes[:count])


class NewtonLog:
    """Numbers of iterations so far, and the changes of the longest iteration of every member."""

    def __init__(self, members: int) -> None:
        self._total = np.zeros(members, dtype=np.int64)
        self._largest = np.zeros(members, dtype=np.int64)
        self._step = np.full(members, -1, dtype=np.int64)
        self._changes: dict[int, tuple[float, ...]] = {}
        self._longest: dict[int, Array] = {}

    def add(self, first: int, attempts: Sequence[Attempt]) -> None:
        """Count iterations for steps behind the first `first` ones of the run."""
        for one in attempts:
            members: Places | slice = one.members
            if len(one.members) == self._total.size:
                members = slice(None)
            self._total[members] += one.iterations
            longer = one.iterations > self._largest[members]
            if not longer.any():
                continue
            places = np.flatnonzero(longer)
            members = one.members[places]
            self._largest[members] = one.iterations[places]
            self._step[members] = first + one.first
            self._longest |= zip(members.tolist(), one.sizes.T[places], strict=True)

    def of(self, member: int) -> NewtonRecord:
        """The record of a member."""
        return NewtonRecord(
            iterations=int(self._total[member]),
            largest=int(self._largest[member]),
            worst_step=int(self._step[member]),
            worst_residuals=self._changes_of(member),
        )

    def _changes_of(self, member: int) -> tuple[float, ...]:
        if member not in self._longest:
            return self._changes.get(member, ())
        return tuple(self._longest[member][: self._largest[member]].tolist())

    def arrays(self) -> dict[str, Array]:
        """All of it by name, for a checkpoint."""
        changes = np.full((self._total.size, int(self._largest.max(initial=0))), np.nan)
        for member in range(self._total.size):
            own = self._changes_of(member)
            changes[member, : len(own)] = own
        counts = np.stack([self._total, self._largest, self._step]).astype(float)
        return {"counts": counts, "changes": changes}

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Go on from what :meth:`arrays` gave."""
        counts = arrays["counts"].astype(np.int64)
        self._total, self._largest, self._step = counts[0], counts[1], counts[2]
        self._longest.clear()
        for member, own in enumerate(arrays["changes"]):
            if self._largest[member]:
                self._changes[member] = tuple(own[: self._largest[member]].tolist())
