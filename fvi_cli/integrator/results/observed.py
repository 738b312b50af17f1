"""Outputs along a run: quantities, their extremes, and events."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How large a quantity becomes in a run, found on the dense motion."""

    peak: float  # largest absolute value, and when it is reached first
    peak_time: float
    least: float
    greatest: float
    rms: float  # root of the mean square over the run
    error: float = math.nan  # estimated error of the peak; nan without a second run


@dataclass(frozen=True, kw_only=True, eq=False)
class Occurrences:
    """The times of an event."""

    time: Array  # (n,), and positions and velocities then, (n, d)
    position: Array
    velocity: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Observed:
    """Outputs that were requested of a motion, by name."""

    mesh: Array  # points of the steps, (n + 1,)
    quantities: Mapping[str, Array] = field(default_factory=dict)  # at the reported times, (k,)
    extents: Mapping[str, Extent] = field(default_factory=dict)  # between all times
    events: Mapping[str, Occurrences] = field(default_factory=dict)
    stopped_by: str = ""  # event that ended the run, or empty

    def __repr__(self) -> str:
        """Names, with the number of occurrences of every event."""
        events = ", ".join(f"{name} ({one.time.size})" for name, one in self.events.items())
        return f"<Observed: quantities {', '.join(self.quantities) or '-'}; events {events or '-'}>"
