"""The hard cases, read from ``hard-cases.yaml``."""

from __future__ import annotations

import functools
import itertools
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fvi_cli.config.text.document import read_document
from fvi_cli.keys.complaints import Complaints, SourcePosition
from fvi_cli.keys.nodes import plain
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.studies.hard_cases.case import CaseSetting, Claim, HardCase, Sense
from fvi_cli.studies.hard_cases.judges import JUDGES, JUDGES_OF_PREDICTIONS, judge_of
from fvi_cli.studies.members import with_values

FILE = Path(__file__).with_name("hard-cases.yaml")
OPTIONS = ("parts", "time", "units", "hanging")
"""Keys of a claim that are keywords of its judge."""


@functools.cache
def hard_cases() -> Mapping[str, HardCase]:
    """All cases by their names, in the order of the report."""
    complaints = Complaints()
    start = SourcePosition(source=FILE.name, line=1, column=1)
    root = read_document(FILE.read_text(encoding="utf-8"), start, complaints)
    complaints.raise_if_any()
    assert root is not None
    return {
        case["name"]: HardCase(
            name=case["name"],
            title=case["title"],
            description=case["description"],
            reference=case["reference"],
            claims=tuple(_claims(case["claims"], case, {})),
        )
        for case in plain(root)
    }


def _claims(
    entries: list[dict[str, Any]], case: Mapping[str, Any], values: Mapping[str, Any]
) -> Iterator[Claim]:
    for entry in entries:
        for chosen in entry.get("each", [{}]):
            known = {**values, **chosen}
            if "claims" in entry:
                yield from _claims(entry["claims"], case, known)
            else:
                yield _claim(entry, case, known)


def _claim(entry: Mapping[str, Any], case: Mapping[str, Any], values: Mapping[str, Any]) -> Claim:
    runs = entry.get("runs", {})
    problem = with_values(
        entry.get("problem", case["problem"]),
        {f"problem.{path}": value for path, value in entry.get("changes", {}).items()},
    )
    settings = [
        CaseSetting(
            json.dumps(_filled(problem, known)),
            case["steps"],
            json.dumps(_filled(entry.get("truth"), known)),
        )
        for chosen in itertools.product(*runs.values())
        for known in [{**values, **dict(zip(runs, chosen, strict=True))}]
    ]
    sense: Sense = "at least" if "at least" in entry else "at most"
    options = {name: entry[name] for name in OPTIONS if name in entry}
    return Claim(
        entry["quantity"].format(**values),
        float(_filled(entry[sense], values)),
        tuple(settings),
        judge_of(entry["judge"], settings, options),
        sense=sense,
        judges_predictions=JUDGES[entry["judge"]] in JUDGES_OF_PREDICTIONS,
        is_comparable=_filled(entry.get("comparable", True), values),
    )


def _filled(node: Any, values: Mapping[str, Any]) -> Any:
    """The node with the values of formulas in place of these (texts that begin with =)."""
    if isinstance(node, Mapping):
        return {key: _filled(value, values) for key, value in node.items()}
    if isinstance(node, list):
        return [_filled(one, values) for one in node]
    if not (isinstance(node, str) and node.startswith("=")):
        return node
    if node[1:] in values:
        return values[node[1:]]
    formula = Expression.parse(node[1:], variables=tuple(values))
    return float(formula.evaluate(values))
