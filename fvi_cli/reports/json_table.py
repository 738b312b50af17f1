"""Order tables as JSON: everything that the other forms show, readable back without loss."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import TypeVar, cast, get_args

from fvi_cli.integrator.method import (
    AnyMethod,
    Baseline,
    ForcingQuadrature,
    History,
    Method,
    RuleName,
    RuleSpecification,
    Sampling,
    Start,
)
from fvi_cli.studies.experiment import Norm, Observed, Predicted
from fvi_cli.studies.order import OrderCase, OrderRow, OrderTable

FORMAT = 1
"""Number of this layout; files with another one are not read."""

Number = float | str | None
Entry = Mapping[str, object]
T = TypeVar("T")


def to_json(name: str, tables: Sequence[OrderTable]) -> str:
    """All tables of the configuration `name`; nan is null, infinity the text ``inf``."""
    content = {"format": FORMAT, "name": name, "experiments": [_table(table) for table in tables]}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _table(table: OrderTable) -> dict[str, object]:
    return {
        "experiment": table.experiment,
        "equation": table.equation,
        "gamma": table.gamma,
        "reference": table.reference,
        "norm": table.norm,
        "final_time": _number(table.final_time),
        **({"swept": dict(table.swept)} if table.swept else {}),
        "cases": [_case(case) for case in table.cases],
    }


def _case(case: OrderCase) -> dict[str, object]:
    return {
        "case": case.method.case,
        "method": _method(case.method),
        "slope": _number(case.slope),
        "fit_residual": _number(case.fit_residual),
        "last_order": _number(case.last_order),
        "stated": _number(case.claim),
        "expected_failure": case.expected_failure,
        "rows": [_row(row) for row in case.rows],
    }


def _method(method: AnyMethod) -> dict[str, object]:
    if isinstance(method, Baseline):
        if method.tolerance is None:
            return {"baseline": method.name}
        return {"baseline": method.name, "tolerance": method.tolerance}
    return {
        "cq": method.cq,
        "degree": method.degree,
        "quadrature": {"rule": method.rule.rule, "points": method.rule.points},
        "sampling": method.sampling,
        "start": method.start,
        "start_exponents": list(method.start_exponents),
        "forcing_quadrature": method.forcing_quadrature,
        "history": method.history,
    }


def _row(row: OrderRow) -> dict[str, object]:
    return {
        "n_steps": row.n_steps,
        "step_size": _number(row.step_size),
        "error": _number(row.error),
        "floor": _number(row.floor),
        "pairwise_order": _number(row.pairwise_order),
        "used_in_fit": row.used_in_fit,
        "expected_order": _number(row.expected_order),
        "predicted": row.predicted,
        "status": row.status,
        "message": row.message,
        "remarks": list(row.remarks),
    }


def _number(value: float) -> Number:
    if math.isnan(value):
        return None
    return repr(float(value)) if math.isinf(value) else float(value)


def from_json(text: str) -> list[OrderTable]:
    """The tables that :func:`to_json` wrote.

    Raises
    ------
    ValueError
        If the text is not JSON, of another format, or something is missing or of a wrong kind.
    """
    content = _mapping(json.loads(text), "file")
    if content.get("format") != FORMAT:
        raise ValueError(f"format: {content.get('format')!r} is not {FORMAT}")
    return [_read_table(_mapping(one, "experiment")) for one in _list(content, "experiments")]


def _read_table(entry: Entry) -> OrderTable:
    return OrderTable(
        experiment=_get(entry, "experiment", str),
        equation=_get(entry, "equation", str),
        gamma=_get(entry, "gamma", str),
        reference=_get(entry, "reference", str),
        norm=cast(Norm, _one_of(entry, "norm", get_args(Norm))),
        final_time=_float(entry, "final_time"),
        cases=tuple(_read_case(_mapping(one, "case")) for one in _list(entry, "cases")),
        swept=_mapping(entry.get("swept", {}), "swept"),
    )


def _read_case(entry: Entry) -> OrderCase:
    return OrderCase(
        method=_read_method(_mapping(entry.get("method"), "method")),
        rows=tuple(_read_row(_mapping(one, "row")) for one in _list(entry, "rows")),
        slope=_float(entry, "slope"),
        fit_residual=_float(entry, "fit_residual"),
        claim=_float(entry, "stated"),
        expected_failure=_get(entry, "expected_failure", bool),
    )


def _read_method(entry: Entry) -> AnyMethod:
    if "baseline" in entry:
        tolerance = _real(entry["tolerance"], "tolerance") if "tolerance" in entry else None
        return Baseline(name=_get(entry, "baseline", str), tolerance=tolerance)
    rule = _mapping(entry.get("quadrature"), "quadrature")
    # the value checks its own names at construction
    return Method(
        cq=_get(entry, "cq", str),
        degree=_get(entry, "degree", int),
        quadrature=RuleSpecification(
            rule=cast(RuleName, _get(rule, "rule", str)), points=_get(rule, "points", int)
        ),
        sampling=cast(Sampling, _get(entry, "sampling", str)),
        start=cast(Start, _get(entry, "start", str)),
        start_exponents=tuple(
            _real(one, "start_exponents") for one in _list(entry, "start_exponents")
        ),
        forcing_quadrature=cast(ForcingQuadrature, _get(entry, "forcing_quadrature", str)),
        history=cast(History, _get(entry, "history", str)),
    )


def _read_row(entry: Entry) -> OrderRow:
    return OrderRow(
        n_steps=_get(entry, "n_steps", int),
        step_size=_float(entry, "step_size"),
        error=_float(entry, "error"),
        floor=_float(entry, "floor"),
        pairwise_order=_float(entry, "pairwise_order"),
        used_in_fit=_get(entry, "used_in_fit", bool),
        expected_order=_float(entry, "expected_order"),
        predicted=cast(Predicted, _one_of(entry, "predicted", get_args(Predicted))),
        status=cast(Observed, _one_of(entry, "status", get_args(Observed))),
        message=_get(entry, "message", str),
        remarks=tuple(str(one) for one in _list(entry, "remarks")),
    )


def _mapping(value: object, what: str) -> Entry:
    if not isinstance(value, dict):
        raise ValueError(f"{what}: {value!r} is not an object")
    return value


def _list(entry: Entry, key: str) -> list[object]:
    return _get(entry, key, list)


def _get(entry: Entry, key: str, kind: type[T]) -> T:
    value = entry.get(key)
    # bool is an int in Python, but not in a table
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise ValueError(f"{key}: {value!r} is not of kind {kind.__name__}")
    return value


def _one_of(entry: Entry, key: str, permitted: Sequence[str]) -> str:
    value = _get(entry, key, str)
    if value not in permitted:
        raise ValueError(f"{key}: {value!r} is not one of {', '.join(permitted)}")
    return value


def _float(entry: Entry, key: str) -> float:
    if key not in entry:
        raise ValueError(f"{key}: missing")
    return _real(entry[key], key)


def _real(value: object, key: str) -> float:
    if value is None:
        return math.nan
    if value in ("inf", "-inf") or (isinstance(value, int | float) and not isinstance(value, bool)):
        return float(cast(float, value))
    raise ValueError(f"{key}: {value!r} is not a number")
