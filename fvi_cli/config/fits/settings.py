"""Checks across the keys under ``fit``, and the settings that they make."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from fvi_cli.config.fits.data import (
    can_change,
    is_possible,
    may_change,
    read_data,
    refuse_path,
)
from fvi_cli.config.keys.fit import Fit, Model, Parameter
from fvi_cli.keys.cursor import Cursor, is_complete
from fvi_cli.keys.nodes import NowhereError, with_node
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.registry import KINDS
from fvi_cli.studies.fits.settings import (
    FitModel,
    FitParameter,
    FitSettings,
)
from fvi_cli.studies.members import value_at, with_values

LEAST_ORDER: Final = 1e-3
LARGEST_ORDER: Final = 1.999
LARGEST_LAW_ORDER: Final = 0.999
"""Default bounds of orders."""


def fit_settings(
    fit: Fit,
    described: Mapping[str, Any],
    problem: AnyProblem,
    quantities: Mapping[str, Expression],
    at: Cursor,
    tree: Cursor,
) -> FitSettings | None:
    """The settings of a fit; None, with complaints, where something is wrong.

    `described` is the resolved ``problem`` mapping that made `problem`; `fit` may hold INVALID;
    `at` is the cursor at ``fit``, `tree` the cursor at the problem.
    """
    before = len(at.complaints)
    if not isinstance(problem, Problem):
        at.refuse("a fit needs a motion; the problem is a fractional derivative")
        return None
    data = read_data(fit.data, described, problem, quantities, at.under("data"))
    if not is_complete(fit):
        return None
    models = []
    common = fit.parameters
    for name, model in (fit.models or {"": Model.of({})}).items():
        under = at.under("models", name) if name else at
        specification: Mapping[str, Any] | None = described
        if model.set:
            specification = _changed(described, model.set, under.under("set"), tree)
        own = model.parameters
        chosen = own if own is not None else _without(common, model.set)
        where = under.under("parameters") if own is not None or not name else at.under("parameters")
        if specification is None:
            continue
        found = _parameters(chosen, specification, where)
        if len(at.complaints) > before:
            continue
        full = with_values(specification, {one.key: one.start for one in found})
        if not is_possible(full, where):
            continue
        models.append(FitModel(name=name, specification=specification, parameters=found))
    if len(at.complaints) > before:
        return None
    for made in models:
        free = len(made.parameters)
        size = sum(one.size for one in data)
        if size <= free:
            at.refuse(
                f"{size} measured values are too few for {free} parameters; at least "
                f"{free + 1} are needed",
                "data",
            )
        if free == 0:
            at.refuse("give at least one parameter to be fitted", "parameters")
    if len(at.complaints) > before:
        return None
    deviation = None if fit.noise == "auto" else float(fit.noise)
    return FitSettings(data=tuple(data), models=tuple(models), deviation=deviation)


def _changed(
    described: Mapping[str, Any], changes: Mapping[str, Any], at: Cursor, tree: Cursor
) -> Mapping[str, Any] | None:
    """The problem with the values of a model, read like the file; None: they are wrong."""
    node, before = tree.node, len(at.complaints)
    if not can_change(described, changes, at):
        return None
    for key in changes:
        try:
            place = at.under(key).node
            node = with_node(node, tuple(key.split(".")[1:]), place, place.place)
        except NowhereError as error:
            at.refuse_key(key, error.reason)
            return None
    names = tuple(described.get("parameters", ()))
    whole = replace(tree, node=node, names=names)
    keys = KINDS[described["kind"]].keys
    read = {
        outer: keys[outer].shape.read(whole.under(outer))
        for outer in dict.fromkeys(key.split(".")[1] for key in changes)
    }
    if len(at.complaints) > before or not is_complete(read):
        return None
    full = {**described, **read}
    return full if is_possible(full, at) else None


def _without(
    parameters: Mapping[str, Parameter], changes: Mapping[str, Any]
) -> dict[str, Parameter]:
    """The parameters that a model does not set."""
    return {
        key: value
        for key, value in parameters.items()
        if not any(key == one or key.startswith(f"{one}.") for one in changes)
    }


def _parameters(
    given: Mapping[str, Parameter], described: Mapping[str, Any], at: Cursor
) -> tuple[FitParameter, ...]:
    found = []
    for key, value in given.items():
        number = value_at(described, key) if may_change(described, key) else None
        if isinstance(number, bool) or not isinstance(number, int | float):
            refuse_path(described, key, at)
            continue
        under = at.under(key)
        is_order = key.endswith(".order")
        low = (LEAST_ORDER if is_order else -math.inf) if value.from_ is None else value.from_
        owner = value_at(described, key.rpartition(".")[0])
        is_of_law = isinstance(owner, Mapping) and "law" in owner
        largest = LARGEST_LAW_ORDER if is_of_law else LARGEST_ORDER
        high = (largest if is_order else math.inf) if value.to is None else value.to
        start = float(number) if value.start is None else value.start
        if not low < high:
            under.refuse(f"from = {low:g} is not below to = {high:g}")
        elif not low <= start <= high:
            under.refuse(
                f"{start:g} lies outside of the bounds, {low:g} to {high:g}",
                *(() if value.start is None else ("start",)),
            )
        found.append(
            FitParameter(
                key=key,
                start=start,
                low=low,
                high=high,
                place=f"{under.node.place}: ",
            )
        )
    return tuple(found)
