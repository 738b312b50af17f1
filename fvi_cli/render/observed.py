"""What is printed of quantities and events."""

from __future__ import annotations

from collections.abc import Iterable

from fvi_cli.storage.fields.observed import ObservedSummary

Observed = tuple[tuple[str, ...], ObservedSummary]
"""The words that name a run, and what was observed of it."""

_RUN = ("experiment", "case", "n_steps")


def observed_rows(runs: Iterable[Observed]) -> list[list[tuple[str, ...]]]:
    """A table of the quantities and one of the events, as far as there are any."""
    quantities: list[tuple[str, ...]] = [
        (*_RUN, "quantity", "peak", "at t", "least", "greatest", "rms")
    ]
    events: list[tuple[str, ...]] = [(*_RUN, "event", "times", "run")]
    for words, observed in runs:
        quantities += [
            (
                *words,
                name,
                *(
                    f"{value:.6g}"
                    for value in (one.peak, one.peak_time, one.least, one.greatest, one.rms)
                ),
            )
            for name, one in observed.extents.items()
        ]
        events += [
            (
                *words,
                name,
                str(count) if count else "never",
                "ended by it" if name == observed.stopped_by else "",
            )
            for name, count in observed.counts.items()
        ]
    return [rows for rows in (quantities, events) if len(rows) > 1]
