"""A part of a configuration, which one of several commands computes on any machine."""

from __future__ import annotations

import heapq
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from fvi_cli.errors import RequestError
from fvi_cli.keys.complaints import excerpt
from fvi_cli.runner.executors.batches import LARGEST_PACK, Pack, batches_of, pack_of
from fvi_cli.runner.request import STORED_SUFFIX
from fvi_cli.studies.experiment import Experiment, Run

MOST_SHARDS: Final = 100_000
_SHARD: Final = re.compile(r"[0-9]{1,12}/[0-9]{1,12}")


@dataclass(frozen=True, kw_only=True)
class Shard:
    """The part `number` of `count` parts, counted from 1.

    The runs of a part depend only on the configuration. Members of a sweep that are computed
    together stay together, so that numbers equal those of an undivided computation; the longest
    packs are distributed first.

    Raises
    ------
    RequestError
        If there is no such part.
    """

    number: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        if self.count > MOST_SHARDS:
            raise RequestError(
                f"--shard {self.number}/{self.count}: is not allowed; there may be {MOST_SHARDS} "
                "parts"
            )
        if not 1 <= self.number <= self.count:
            raise RequestError(
                f"--shard {self.number}/{self.count}: is not allowed; in I/N the part I lies "
                "between 1 and N"
            )

    def file_name(self, name: str) -> str:
        """``<name>.h5``, for a part ``<name>.shard-2-of-4.h5``."""
        part = "" if self.count == 1 else f".shard-{self.number}-of-{self.count}"
        return f"{name}{part}{STORED_SUFFIX}"

    def checks_member(self, number: int) -> bool:
        """Whether this part checks a member of a sweep; each member is checked by one part."""
        return number // LARGEST_PACK % self.count == self.number - 1

    def runs_of(self, experiments: Sequence[Experiment]) -> dict[Experiment, list[Run]]:
        """The runs and searches of this part, in the order of the experiments."""
        listed = {one: one.runs() for one in experiments}
        if self.count == 1:
            return listed
        dealt = itertools.cycle(range(1, self.count + 1))
        searches = [run for runs in listed.values() for run in runs if run.is_search]
        mine: set[Pack] = {pack_of(run) for run in searches if next(dealt) == self.number}
        together: dict[Pack, int] = {}
        for batch in batches_of(
            [run for runs in listed.values() for run in runs if not run.is_search]
        ):
            pack = pack_of(batch[0])
            steps = sum(run.n_steps for run in batch)
            together[pack] = together.get(pack, 0) + steps
        loads = [(0, number) for number in range(1, self.count + 1)]
        # sorting is stable: packs of equal length are distributed in their order
        for pack in sorted(together, key=lambda pack: -together[pack]):
            load, number = heapq.heappop(loads)
            heapq.heappush(loads, (load + together[pack], number))
            if number == self.number:
                mine.add(pack)
        return {e: [run for run in runs if pack_of(run) in mine] for e, runs in listed.items()}


WHOLE = Shard()


def shard_named(text: str) -> Shard:
    """The part that a text ``I/N`` names.

    Raises
    ------
    RequestError
        If the text names no part.
    """
    if _SHARD.fullmatch(text) is None:
        raise RequestError(
            f"--shard {excerpt(text)}: is not I/N, such as 2/4 for the second of four parts; N may "
            f"be {MOST_SHARDS}"
        )
    number, _, count = text.partition("/")
    return Shard(number=int(number), count=int(count))
