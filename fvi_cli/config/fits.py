"""What must hold between the keys under ``fit``, and the settings that they make."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from fvi_cli.keys.complaints import excerpt, listed, suggestion
from fvi_cli.keys.cursor import Cursor, is_complete
from fvi_cli.scenes.csv_samples import CsvMistakesError, CsvSamples, read_csv_samples
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.fits.settings import DataSet, FitModel, FitParameter, FitSettings, Series
from fvi_cli.studies.members import value_at, with_values

LEAST_ORDER: Final = 1e-3
LARGEST_ORDER: Final = 1.999
LARGEST_LAW_ORDER: Final = 0.999
"""Bounds of an order that has none of its own."""


def fit_settings(
    values: Mapping[str, Any], described: Mapping[str, Any], problem: AnyProblem, at: Cursor
) -> FitSettings | None:
    """The settings that a mapping read by FIT describes; None with complaints.

    Parameters
    ----------
    values
        What was read; may hold INVALID.
    described
        The resolved ``problem`` mapping.
    problem
        What it makes.
    at
        Where ``fit`` stands.
    """
    before = len(at.complaints)
    if not isinstance(problem, Problem):
        at.refuse("there is no motion to be fitted: the problem is a derivative")
        return None
    data = _data(values.get("data"), described, problem, at.under("data"))
    if not is_complete(values):
        return None
    models = []
    common = values["parameters"]
    for name, model in values.get("models", {"": {"set": {}}}).items():
        under = at.under("models", name) if name else at
        specification: Mapping[str, Any] | None = described
        if model["set"]:
            specification = _changed(described, model["set"], under.under("set"))
        own = model.get("parameters")
        chosen = own if own is not None else _without(common, model["set"])
        where = under.under("parameters") if own is not None or not name else at.under("parameters")
        if specification is None:
            continue
        found = _parameters(chosen, specification, where)
        fixed = {k: v["fixed"] for k, v in chosen.items() if "fixed" in v}
        if len(at.complaints) > before:
            continue
        full = with_values(specification, {**fixed, **{one.key: one.start for one in found}})
        if not _is_possible(full, where):
            continue
        models.append(
            FitModel(name=name, specification=with_values(specification, fixed), parameters=found)
        )
    deviations = _deviations(values["noise"], data, at.under("noise"))
    if len(at.complaints) > before:
        return None
    for model in models:
        free = sum(len(data) if one.is_own else 1 for one in model.parameters if not one.tied_to)
        size = sum(one.size for one in data)
        if size <= free:
            at.refuse(
                f"{size} measured values are too few for {free} parameters; at least "
                f"{free + 1} are needed",
                "data",
            )
        if free == 0:
            at.refuse("nothing is fitted: every parameter is fixed or tied", "parameters")
    if len(at.complaints) > before:
        return None
    return FitSettings(data=tuple(data), models=tuple(models), deviations=deviations)


def _data(given: Any, described: Mapping[str, Any], problem: Problem, at: Cursor) -> list[DataSet]:
    """The measured motions, as far as they can be read."""
    items = at.items() or [at]
    found: list[DataSet] = []
    for one, under in zip(given if isinstance(given, list) else [], items, strict=False):
        if not isinstance(one, Mapping) or not is_complete(one):
            continue
        _changed(described, one["set"], under.under("set"))
        series = [
            made
            for name, column in one["columns"].items()
            if (made := _series(name, column, one, problem, under)) is not None
        ]
        if not one["columns"]:
            under.refuse("no columns; name what was measured", "columns")
        name = str(one.get("name", Path(one["file"]).stem))
        if any(other.name == name for other in found):
            under.refuse(f"{excerpt(name)!r} is the name of another motion; give each a name")
        if series:
            found.append(DataSet(name=name, series=tuple(series), changes=dict(one["set"])))
    return found


def _series(
    name: str, column: str, given: Mapping[str, Any], problem: Problem, at: Cursor
) -> Series | None:
    coordinates = problem.coordinates
    known = [*coordinates, *(f"v{one}" for one in coordinates)]
    if name not in known:
        at.under("columns").refuse_key(
            name,
            f"not known{suggestion(name, known)} (measured can be: {listed(known[:12])}"
            f"{', ...' if len(known) > 12 else ''})",
        )
        return None
    shown, folder = excerpt(given["file"], 200), at.complaints.folder
    path = Path(given["file"]) if folder is None else folder / given["file"]
    try:
        samples = read_csv_samples(path, shown, given["time"], column)
        _check_times(samples, shown, problem.final_time, given["time"])
    except CsvMistakesError as error:
        for message in error.messages:
            at.refuse(message, "file")
        return None
    is_velocity = name not in coordinates
    return Series(
        name=name,
        column=column,
        component=coordinates.index(name.removeprefix("v") if is_velocity else name),
        is_velocity=is_velocity,
        times=samples.time,
        values=samples.values,
    )


def _check_times(samples: CsvSamples, name: str, final_time: float, column: str) -> None:
    """Refuse times outside of the run.

    Raises
    ------
    CsvMistakesError
        With the line of the first one.
    """
    for time, line in zip(samples.time.tolist(), samples.lines, strict=True):
        if not 0 <= time <= final_time * (1 + 1e-12):
            raise CsvMistakesError(
                f"{name}:{line}: {column} = {time:g} is outside of the run, which goes from 0 to "
                f"final_time = {final_time:g}"
            )


def _changed(
    described: Mapping[str, Any], changes: Mapping[str, Any], at: Cursor
) -> Mapping[str, Any] | None:
    """The problem with other values, which must make one; None with complaints."""
    for key in changes:
        if not _leads_somewhere(described, key):
            _refuse_path(described, key, at)
            return None
    full = with_values(described, changes)
    return full if _is_possible(full, at) else None


def _is_possible(specification: Mapping[str, Any], at: Cursor) -> bool:
    try:
        build_scene(specification)
    except (ValueError, KeyError, TypeError) as error:
        at.refuse(f"there is no such problem: {error}")
        return False
    return True


def _leads_somewhere(described: Mapping[str, Any], key: str) -> bool:
    if not key.startswith("problem.") or key in ("problem.kind", "problem.final_time"):
        return False
    try:
        value_at(described, key)
    except (KeyError, IndexError, TypeError):
        return False
    return True


def _numbers(node: Any, path: str) -> Iterator[str]:
    """Key paths of all numbers in a problem."""
    if isinstance(node, Mapping):
        for key, value in node.items():
            yield from _numbers(value, f"{path}.{key}")
    elif isinstance(node, list | tuple):
        for index, value in enumerate(node):
            yield from _numbers(value, f"{path}.{index}")
    elif isinstance(node, int | float) and not isinstance(node, bool):
        yield path


def _refuse_path(described: Mapping[str, Any], key: str, at: Cursor) -> None:
    known = [one for one in _numbers(described, "problem") if one != "problem.final_time"]
    at.refuse_key(
        key,
        f"no number of the problem stands there{suggestion(key, known)} "
        f"(numbers: {listed(known[:12])}{', ...' if len(known) > 12 else ''})",
    )


def _without(parameters: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters that are not set, nor tied to one that is, by a model."""
    left = {
        key: value
        for key, value in parameters.items()
        if not any(key == one or key.startswith(f"{one}.") for one in changes)
    }
    gone = set(parameters) - set(left)
    return {key: value for key, value in left.items() if value.get("tied") not in gone}


def _is_of_law(described: Mapping[str, Any], key: str) -> bool:
    """Whether a number belongs to a relaxation law."""
    owner = value_at(described, key.rpartition(".")[0])
    return isinstance(owner, Mapping) and "law" in owner


def _parameters(
    given: Mapping[str, Any], described: Mapping[str, Any], at: Cursor
) -> tuple[FitParameter, ...]:
    found = []
    for key, value in given.items():
        number = value_at(described, key) if _leads_somewhere(described, key) else None
        if isinstance(number, bool) or not isinstance(number, int | float):
            _refuse_path(described, key, at)
            continue
        if "fixed" in value:
            continue
        under = at.under(key)
        tied = value.get("tied", "")
        if tied and (tied not in given or {"tied", "fixed"} & set(given[tied])):
            under.refuse(f"{excerpt(tied)!r} is no parameter that is fitted", "tied")
            continue
        is_order = key.endswith(".order")
        low = value.get("from", LEAST_ORDER if is_order else -math.inf)
        largest = LARGEST_LAW_ORDER if _is_of_law(described, key) else LARGEST_ORDER
        high = value.get("to", largest if is_order else math.inf)
        start = value.get("start", float(number))
        if not low < high:
            under.refuse(f"from = {low:g} is not below to = {high:g}")
        elif not tied and not low <= start <= high:
            under.refuse(
                f"{start:g} lies outside of the bounds, {low:g} to {high:g}",
                *(("start",) if "start" in value else ()),
            )
        found.append(
            FitParameter(
                key=key,
                start=start,
                low=low,
                high=high,
                is_own=value["own"],
                tied_to=tied,
                factor=value["factor"],
                place=f"{under.node.place}: ",
            )
        )
    return tuple(found)


def _deviations(noise: Any, data: list[DataSet], at: Cursor) -> dict[str, float]:
    names = [series.column for one in data for series in one.series]
    by_name = {series.name: series.column for one in data for series in one.series}
    if noise == "auto":
        return {}
    if not isinstance(noise, Mapping):
        return {series.name: noise for one in data for series in one.series}
    found = {}
    for column in noise:
        if column not in names:
            at.refuse_key(column, f"no column of the data{suggestion(column, names)}")
    for name, column in by_name.items():
        if column in noise:
            found[name] = noise[column]
        else:
            at.refuse(f"a standard deviation for column {excerpt(column)!r} is missing")
    return found
