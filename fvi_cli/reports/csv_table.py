"""Order tables as CSV: one row for every run, numbers in full precision."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Sequence

from fvi_cli.studies.order import OrderTable

COLUMNS = (
    "experiment",
    "case",
    "cq",
    "sampling",
    "degree",
    "quadrature",
    "start",
    "gamma",
    "norm",
    "n_steps",
    "step_size",
    "error",
    "pairwise_order",
    "used_in_fit",
    "slope",
    "fit_residual",
    "expected_order",
    "predicted",
    "status",
)


def to_csv(tables: Sequence[OrderTable]) -> str:
    """The rows of all tables under :func:`columns_of` them.

    A float is written as its ``repr``, which reads back as the same number; ``nan`` says that there
    is no error or no order. ``used_in_fit`` is ``yes`` or ``no``. Lines end with a newline only.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, columns_of(tables), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(csv_rows(tables))
    return text.getvalue()


def columns_of(tables: Sequence[OrderTable]) -> tuple[str, ...]:
    """:data:`COLUMNS`, and behind them the keys that are swept over in any of the tables."""
    return (*COLUMNS, *dict.fromkeys(key for table in tables for key in table.swept))


def csv_rows(tables: Sequence[OrderTable]) -> Iterator[dict[str, str]]:
    """Every row as the words that stand in the file."""
    for table in tables:
        swept = {key: _swept(value) for key, value in table.swept.items()}
        for case in table.cases:
            for row in case.rows:
                yield {
                    "experiment": table.experiment,
                    "case": case.method.case,
                    **case.columns(),
                    "gamma": table.gamma,
                    "norm": table.norm,
                    "n_steps": str(row.n_steps),
                    "step_size": field(row.step_size),
                    "error": field(row.error),
                    "pairwise_order": field(row.pairwise_order),
                    "used_in_fit": "yes" if row.used_in_fit else "no",
                    "slope": field(case.slope),
                    "fit_residual": field(case.fit_residual),
                    "expected_order": field(row.expected_order),
                    "predicted": row.predicted,
                    "status": row.status,
                    **swept,
                }


def _swept(value: object) -> str:
    if isinstance(value, float):
        return field(value)
    return value if isinstance(value, str) else json.dumps(value)


def field(value: float) -> str:
    """``repr`` of a float, also of one that NumPy made."""
    return repr(float(value))
