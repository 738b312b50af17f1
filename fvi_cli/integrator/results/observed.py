"""What was observed along a run: quantities, their extremes, and events."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How large a quantity becomes in a run, found on the dense motion.

    Parameters
    ----------
    peak, peak_time
        Largest absolute value, and when it is reached first.
    least, greatest
        Smallest and largest value.
    rms
        Root of the mean square over the run.
    """

    peak: float
    peak_time: float
    least: float
    greatest: float
    rms: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Occurrences:
    """The times of an event.

    Parameters
    ----------
    time, position, velocity
        Shapes ``(n,)``, ``(n, d)``, ``(n, d)``.
    """

    time: Array
    position: Array
    velocity: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Observed:
    """Outputs that were requested of a motion.

    Parameters
    ----------
    mesh
        Points of the steps, shape ``(n + 1,)``.
    quantities
        By name the values at the reported times, shape ``(k,)``.
    extents
        By name how large they become between all times.
    events
        By name their occurrences.
    stopped_by
        Event that ended the run, or empty.
    """

    mesh: Array
    quantities: Mapping[str, Array] = field(default_factory=dict)
    extents: Mapping[str, Extent] = field(default_factory=dict)
    events: Mapping[str, Occurrences] = field(default_factory=dict)
    stopped_by: str = ""

    def __repr__(self) -> str:
        """Names, with the number of occurrences of every event."""
        events = ", ".join(f"{name} ({one.time.size})" for name, one in self.events.items())
        return f"<Observed: quantities {', '.join(self.quantities) or '-'}; events {events or '-'}>"
