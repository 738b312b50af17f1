"""What the steps to come depend on, and what steps that are solved give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from fvi_cli.integrator.engine.law import Linearisation
from fvi_cli.integrator.engine.newton_log import Attempt
from fvi_cli.mathematics.arrays import Array, Integers, Mask, Places


@dataclass(eq=False, kw_only=True)
class State:
    """Everything that the steps to come depend on; a checkpoint writes it."""

    t: float
    x: Array  # positions and momenta, (q, e), and what Kahan's sums have lost of them
    p: Array
    x_lost: Array
    p_lost: Array
    z: Array  # states of the memory, (q, J, e)
    column: Array  # those of a start velocity of 1, (1, J, 1)
    live: Mask  # members that have not failed
    longest: Integers  # steps of the longest block that may contract
    wait: Integers  # blocks until a longer one is tried
    excess: Integers  # iterations beyond the usual number
    stale: Mask  # whose second derivatives are to be made anew
    unknowns: Array | None = None  # of the last step, for a guess: U (q, s, e),
    h: float = 0.0  # its length,
    rest: Array | None = None  # and its last remainder (q, w)
    block: Linearisation | None = None  # second derivatives in use, of blocks

    def of(self, places: Places) -> State:
        """That of some members."""
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
        """One that may go on while this one stays; arrays are replaced, never written."""
        return replace(self)

    def arrays(self) -> dict[str, Array]:
        """All of it as arrays by name."""
        found: dict[str, Array] = {}
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, Linearisation):
                parts = zip(Linearisation._fields, value, strict=True)
                found |= {f"{one.name}.{name}": part for name, part in parts if part is not None}
            elif value is not None:
                found[one.name] = np.asarray(value)
        return found

    @classmethod
    def from_arrays(cls, arrays: dict[str, Array]) -> State:
        """The state that :meth:`arrays` wrote."""
        plain = {name: value.copy() for name, value in arrays.items() if "." not in name}
        found: dict[str, object] = dict(plain)
        for name in ("t", "h"):
            found[name] = float(plain[name])
        if "block.mass" in arrays:
            parts = (arrays.get(f"block.{one}") for one in Linearisation._fields)
            found["block"] = Linearisation(*parts).copy()  # type: ignore[arg-type]
        return cls(**found)  # type: ignore[arg-type]


@dataclass(eq=False, kw_only=True)
class Steps:
    """What solving B steps of length h gave."""

    h: float  # length and number B
    count: int
    dx: Array  # changes from the beginning of the block, (q, B, e)
    dp: Array
    unknowns: Array  # U, (q, B, s, e), and what drives the memory, (q, B i, e)
    inputs: Array
    z: Array  # states of the memory behind them, (q, J, e)
    iterations: Integers  # of Newton, and where it found no solution, (q,)
    failed: Mask
    rest: Array | None = None  # remainders at the points, (q, B r, w); None for linear scenes
    attempts: tuple[Attempt, ...] = ()  # how the iterations went that solved them

    @property
    def has_failed(self) -> bool:
        """Whether any member has no solution."""
        return bool(np.count_nonzero(self.failed))

    def _members(self) -> dict[str, Array]:
        every = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: one for name, one in every.items() if isinstance(one, np.ndarray)}

    def put(self, places: Places, other: Steps) -> None:
        """Take those of `other` for some members."""
        mine, new = self._members(), other._members()
        for name in mine.keys() & new.keys():
            mine[name][places] = new[name]
        self.attempts += tuple(one.among(places) for one in other.attempts)

    def among(self, places: Places, members: int) -> Steps:
        """The same among so many members, zero for others."""
        found: dict[str, object] = {}
        for name, one in self._members().items():
            whole = found[name] = np.zeros((members, *one.shape[1:]), one.dtype)
            whole[places] = one
        found["attempts"] = tuple(one.among(places) for one in self.attempts)
        return replace(self, **found)  # type: ignore[arg-type]

    @classmethod
    def join(cls, parts: Sequence[Steps]) -> Steps:
        """Steps one after the other."""
        x, p = np.zeros(()), np.zeros(())
        dx, dp = [], []
        attempts: list[Attempt] = []
        done = 0
        for one in parts:
            attempts += [own._replace(first=own.first + done) for own in one.attempts]
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
            failed=np.any([one.failed for one in parts], axis=0),
            rest=np.concatenate(rests, axis=1) if rests else None,
            attempts=tuple(attempts),
        )


def compensated(value: Array, lost: Array, change: Array) -> tuple[Array, Array]:
    """Add by Kahan's compensated sum (1965): the value, and what round-off took too much."""
    corrected = change - lost
    total = value + corrected
    return total, (total - value) - corrected
