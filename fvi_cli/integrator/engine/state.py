"""The state on which later steps depend, and the results of solved steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from fvi_cli.integrator.engine.law import Linearisation
from fvi_cli.mathematics.arrays import Array, Integers, Mask, Places


@dataclass(eq=False, kw_only=True)
class State:
    """Everything that later steps depend on."""

    t: float
    x: Array  # positions and momenta, (q, e), and their rounding errors by Kahan's sums
    p: Array
    x_lost: Array
    p_lost: Array
    z: Array  # states of the memory, (q, J, e)
    column: Array  # states of a start velocity of 1, (1, J, 1)
    live: Mask  # members that have not failed
    longest: Integers  # steps of the longest block that may contract
    wait: Integers  # number of blocks until a longer one is tried
    excess: Integers  # iterations beyond the usual number
    stale: Mask  # members whose second derivatives must be computed again
    unknowns: Array | None = None  # U of the last step, for a guess, (q, s, e)
    h: float = 0.0  # length of the last step
    rest: Array | None = None  # last remainder of the last step, (q, w)
    block: Linearisation | None = None  # second derivatives that blocks use

    def of(self, places: Places) -> State:
        """The state of some members."""
        found = {}
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, Linearisation):
                value = value.of(places)
            elif isinstance(value, np.ndarray) and one.name != "column":
                value = value[places]
            found[one.name] = value
        return State(**found)

    def copy(self) -> State:
        """A copy that can move on independently; arrays are replaced, never written."""
        return replace(self)


@dataclass(eq=False, kw_only=True)
class Steps:
    """Results of solving B steps of length h."""

    h: float  # length and number B
    count: int
    dx: Array  # changes from the beginning of the block, (q, B, e)
    dp: Array
    unknowns: Array  # U, (q, B, s, e), and inputs of the memory, (q, B i, e)
    inputs: Array
    z: Array  # states of the memory after the steps, (q, J, e)
    # of every member, (q,): all iterations of Newton, most of them for one block, whether it has no
    # solution, the first step without one, and the last change there
    iterations: Integers
    most: Integers
    failed: Mask
    failed_at: Integers
    change: Array
    rest: Array | None = None  # remainders at the points, (q, B r, w); None for linear scenes

    @property
    def has_failed(self) -> bool:
        """Whether any member has no solution."""
        return bool(np.count_nonzero(self.failed))

    def _members(self) -> dict[str, Array]:
        every = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: one for name, one in every.items() if isinstance(one, np.ndarray)}

    def put(self, places: Places, other: Steps) -> None:
        """Copy the results of some members from `other`."""
        mine, new = self._members(), other._members()
        for name in mine.keys() & new.keys():
            mine[name][places] = new[name]

    def among(self, places: Places, members: int) -> Steps:
        """The results as those of `places` among so many members, zero for others."""
        found: dict[str, object] = {}
        for name, one in self._members().items():
            whole = found[name] = np.zeros((members, *one.shape[1:]), one.dtype)
            whole[places] = one
        return replace(self, **found)  # type: ignore[arg-type]

    @classmethod
    def join(cls, parts: Sequence[Steps]) -> Steps:
        """Join the results of successive steps."""
        x, p = np.zeros(()), np.zeros(())
        dx, dp = [], []
        failed = np.zeros_like(parts[0].failed)
        failed_at, change = parts[0].failed_at.copy(), parts[0].change.copy()
        done = 0
        for one in parts:
            new = one.failed & ~failed
            failed_at[new], change[new] = done + one.failed_at[new], one.change[new]
            failed = failed | new
            done += one.count
            dx.append(x + one.dx)
            dp.append(p + one.dp)
            x, p = x + one.dx[:, -1:], p + one.dp[:, -1:]
        rests = [one.rest for one in parts if one.rest is not None]
        return cls(
            h=parts[-1].h,
            count=sum(one.count for one in parts),
            dx=np.concatenate(dx, axis=1),
            dp=np.concatenate(dp, axis=1),
            unknowns=np.concatenate([one.unknowns for one in parts], axis=1),
            inputs=np.concatenate([one.inputs for one in parts], axis=1),
            z=parts[-1].z,
            iterations=np.sum([one.iterations for one in parts], axis=0),
            most=np.max([one.most for one in parts], axis=0),
            failed=failed,
            failed_at=failed_at,
            change=change,
            rest=np.concatenate(rests, axis=1) if rests else None,
        )


def compensated(value: Array, lost: Array, change: Array) -> tuple[Array, Array]:
    """Add by Kahan's compensated sum (1965): the value, and its rounding error."""
    corrected = change - lost
    total = value + corrected
    return total, (total - value) - corrected
