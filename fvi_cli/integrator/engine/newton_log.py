"""Log of Newton's iteration for every member."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fvi_cli.integrator.results.diagnostics import NewtonRecord
from fvi_cli.mathematics.arrays import Array, Integers, Places


class Attempt(NamedTuple):
    """The iteration for one block of steps."""

    first: int  # number of its first step among those that are solved together
    members: Places  # members that take these steps
    iterations: Integers  # of each member
    changes: Sequence[Array]  # largest changes in each iteration, (members, components)

    def among(self, places: Places) -> "Attempt":
        """The attempt with other numbers of the members: member k becomes ``places[k]``."""
        return self._replace(members=places[self.members])

    @property
    def sizes(self) -> Array:
        """Largest change of each member in each iteration, ``(iterations, members)``."""
        return np.array([one.max(axis=1) for one in self.changes])

    def of_member(self, place: int) -> tuple[float, ...]:
        """Largest change of one member in each iteration."""
        count = int(self.iterations[place])
        return tuple(float(one[place].max()) for one in self.changes[:count])


class NewtonLog:
    """Numbers of iterations so far, and the changes of the longest iteration of every member."""

    def __init__(self, members: int) -> None:
        self._total = np.zeros(members, dtype=np.int64)
        self._largest = np.zeros(members, dtype=np.int64)
        self._step = np.full(members, -1, dtype=np.int64)
        self._longest: dict[int, Array] = {}
        self._waiting: list[tuple[int, Attempt]] = []

    def add(self, first: int, attempts: Sequence[Attempt]) -> None:
        """Add iterations of steps that come after the first `first` steps of the run."""
        self._waiting += [(first + one.first, one) for one in attempts]

    def count(self) -> None:
        """Count the attempts that were added; of equally long iterations the first is kept."""
        waiting, self._waiting = self._waiting, []
        whole = [one for one in waiting if len(one[1].members) == self._total.size]
        if whole:
            # all members take the same steps: they are counted at once
            counts = np.array([one.iterations for _, one in whole])
            self._total += counts.sum(axis=0)
            longest = counts.argmax(axis=0)
            for index in set(longest.tolist()):
                step, one = whole[index]
                self._take(step, one, np.flatnonzero(longest == index))
        for step, one in waiting:
            if len(one.members) < self._total.size:
                self._total[one.members] += one.iterations
                self._take(step, one, np.arange(len(one.members)))

    def _take(self, step: int, attempt: Attempt, places: Places) -> None:
        """Keep the changes of members for which this is the longest iteration."""
        members, count = attempt.members[places], attempt.iterations[places]
        largest = self._largest[members]
        chosen = (count > largest) | ((count == largest) & (step < self._step[members]))
        if chosen.any():
            places, members, count = places[chosen], members[chosen], count[chosen]
            self._largest[members], self._step[members] = count, step
            every = zip(members.tolist(), attempt.sizes[:, places].T, count.tolist(), strict=True)
            self._longest |= {member: own[:most] for member, own, most in every}

    def of(self, member: int) -> NewtonRecord:
        """The record of a member."""
        return NewtonRecord(
            iterations=int(self._total[member]),
            largest=int(self._largest[member]),
            worst_step=int(self._step[member]),
            worst_residuals=tuple(self._longest.get(member, np.zeros(0)).tolist()),
        )
