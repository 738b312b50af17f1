"""Measurements of a fit, read from their files, and the models that are fitted to them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from fvi_cli.config.fits.keys import Data, FitKeys, ModelKeys, NoiseKeys, ParameterKeys
from fvi_cli.config.members import Choice
from fvi_cli.config.names import FORCE, names_along
from fvi_cli.config.text.mistakes import Report
from fvi_cli.errors import excerpt, listed, suggestion
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.keys.mistakes import KeyPath, mistakes_of
from fvi_cli.scenes.keys.values import plain
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.records.csv_samples import read_csv_samples
from fvi_cli.scenes.records.inputs import DataFileError
from fvi_cli.scenes.registry import OnlyProblem
from fvi_cli.studies.fits.settings import (
    Amplitude,
    DataSet,
    FitModel,
    FitParameter,
    FitSettings,
    Series,
)
from fvi_cli.studies.members import value_at, with_values
from fvi_cli.studies.vibration.response import GROUND, harmonic_load, linear_form_of

LEAST_ORDER: Final = 1e-3
LARGEST_ORDER: Final = 1.999
LARGEST_LAW_ORDER: Final = 0.999
"""Default bounds of orders: 1e-3 inside of those allowed, 0 to 2 and, of a law, 0 to 1."""


def fit_settings(
    fit: FitKeys,
    template: Mapping[str, Any],
    problem: Problem,
    quantities: Mapping[str, Expression],
    folder: Path,
    report: Report,
) -> FitSettings | None:
    """The settings of a fit; None, with mistakes, where something is wrong.

    `template` is the resolved ``problem`` mapping that made `problem`, `report` is that of ``fit``;
    paths of files begin in `folder`.
    """
    before = len(report)
    data = list(_data(fit, template, problem, quantities, folder, report))
    keys: Mapping[str, ModelKeys | None] = fit.models or {"": None}
    models = [_model(name, own, fit, template, report) for name, own in keys.items()]
    if len(report) > before:
        return None
    size, most = sum(one.size for one in data), max(len(one.parameters) for one in models)
    if size <= most:
        words = f"{size} measured values are too few for {most} parameters"
        report.add(f"{words}; at least {most + 1} are needed", "data")
    if not all(one.parameters for one in models):
        report.add("give at least one parameter to be fitted", "parameters")
    return FitSettings(
        data=tuple(data),
        models=tuple(models),
        deviation=fit.noise if isinstance(fit.noise, float | int) else None,
        relative=fit.noise.relative if isinstance(fit.noise, NoiseKeys) else None,
    )


def _model(
    name: str, keys: ModelKeys | None, fit: FitKeys, template: Mapping[str, Any], report: Report
) -> FitModel:
    """A model with its parameters."""
    given, where, specification = fit.parameters, report.under("parameters"), template
    if keys is not None:
        specification = _changed(name, keys.set, template, report)
        set_ones = tuple(f"{one}." for one in keys.set)
        given = {key: one for key, one in given.items() if not f"{key}.".startswith(set_ones)}
        if keys.parameters is not None:
            given, where = keys.parameters, report.under("models", name, "parameters")
    parameters = tuple(_parameters(given, specification, where))
    return FitModel(name=name, specification=specification, parameters=parameters)


def _changed(
    name: str, changes: Mapping[str, Any], template: Mapping[str, Any], report: Report
) -> Mapping[str, Any]:
    """The resolved problem with the values of a model, read like the file."""
    try:
        values = {"problem": with_values(template, changes)}
        return plain(OnlyProblem.model_validate(values).problem)
    except LookupError as error:
        report.add(str(error), "models", name, "set")
    except ValidationError as error:
        places: dict[str, KeyPath] = {path: ("models", name, "set", path) for path in changes}
        choice = Choice(changes=changes, places=places)
        report.extend(map(choice.placed, mistakes_of(error)))
    return template


def _parameters(
    given: Mapping[str, ParameterKeys], template: Mapping[str, Any], report: Report
) -> Iterator[FitParameter]:
    for key in _numbers(given, template, report):
        value, low, high = given[key], -math.inf, math.inf
        if key.endswith(".order"):
            owner = value_at(template, key.rpartition(".")[0])
            is_of_law = owner.get("law", "springpot") != "springpot"
            low, high = LEAST_ORDER, LARGEST_LAW_ORDER if is_of_law else LARGEST_ORDER
        low = low if value.from_ is None else value.from_
        high = high if value.to is None else value.to
        start = float(value_at(template, key)) if value.start is None else value.start
        if not low < high:
            report.add(f"from = {low:g} is not below to = {high:g}", key)
        elif not low <= start <= high:
            words = f"{start:g} lies outside of the bounds, {low:g} to {high:g}"
            report.add(words, key, *(() if value.start is None else ("start",)))
        yield FitParameter(key=key, start=start, low=low, high=high)


def _data(
    fit: FitKeys,
    template: Mapping[str, Any],
    problem: Problem,
    quantities: Mapping[str, Expression],
    folder: Path,
    report: Report,
) -> Iterator[DataSet]:
    """The measured motions and responses, as far as they can be read."""
    names: list[str] = []
    is_list = isinstance(report.value("data"), list)
    for number, one in enumerate(fit.data):
        under = report.under(*("data", number)[: 1 + is_list])
        changes = {key: one.set[key] for key in _numbers(one.set, template, under.under("set"))}
        forces: tuple[str, ...] = ()
        if one.frequency is None:
            measured = _motion(one, problem, quantities, under)
        else:
            forces = tuple(_forces(one, problem, template, under))
            measured = _response(one, problem, under)
        series = [
            read for column in measured for read in _read(one, column, problem, folder, under)
        ]
        name = one.name if one.name is not None else Path(one.file).stem
        if name in names:
            under.add(f"{excerpt(name)!r} is the name of another motion; give each a name")
        names.append(name)
        if isinstance(fit.noise, NoiseKeys):
            for zero in (own.column for own in series if not own.values.all()):
                words = f"column {zero} holds 0, where relative noise would be 0"
                report.add(f"{words}; leave such rows out, or write a number", "noise")
        if series:
            yield DataSet(
                name=name,
                series=tuple(series),
                changes=changes,
                forces=forces,
                coordinates=problem.coordinates,
            )


def _motion(
    given: Data, problem: Problem, quantities: Mapping[str, Expression], report: Report
) -> Iterator[dict[str, Any]]:
    """The fields of every column of a motion."""
    known = names_along(problem, problem.ready)
    qualities = {f"v{name}": "velocity" for name in problem.coordinates}
    qualities |= dict.fromkeys(problem.coordinates, "length")
    for name, column in given.columns.items():
        formula = quantities.get(name)
        try:
            formula = formula or Expression.parse(name, variables=known).expand(problem.ready)
        except ExpressionError as error:
            measured = list(dict.fromkeys((*quantities, *known)))
            reason = "" if error.unknown == name else f": {error}"
            words = f"not known{suggestion(name, measured)}{reason} (measured can be: "
            words += f"{listed(measured[:12])}, and expressions in them)"
            report.add(words, "columns", name, of_key=True)
            continue
        quality = "" if name in quantities else qualities.get(name, "")
        yield {"name": name, "column": str(column), "formula": formula, "quality": quality}


def _forces(
    given: Data, problem: Problem, template: Mapping[str, Any], report: Report
) -> Iterator[str]:
    """Where the harmonic force of a response acts."""
    scene, coordinates = problem.scene, problem.coordinates
    if not scene.is_linear:
        report.add(f"{problem.kind} is not linear and has no harmonic response", "frequency")
    if scene.prescribed is not None:
        # the response is the complex stiffness, the force for a unit displacement
        if given.force:
            report.add("not for a damper on the bench, whose displacement is given", "force")
        yield "displacement"
        return
    is_shaken = template.get("ground_acceleration", "0") != "0"
    forces = given.force or ([GROUND] if is_shaken else [])
    if not forces:
        report.add(f"say where the force acts, force: {coordinates[0]} or force: {GROUND}")
    for text in forces:
        try:
            harmonic_load([text], scene, coordinates)
        except ValueError as error:
            report.add(str(error), "force")
        yield text


def _response(given: Data, problem: Problem, report: Report) -> Iterator[dict[str, Any]]:
    """The fields of every column of a response; v, a before a coordinate: its rates 1 and 2."""
    coordinates = problem.coordinates if problem.scene.prescribed is None else (FORCE,)
    for name, columns in given.columns.items():
        rate = 0 if name in coordinates or name[1:] not in coordinates else "xva".find(name[0])
        try:
            row = linear_form_of(name[1:] if rate > 0 else name, coordinates)
        except ValueError as error:
            report.add(f"not known: {error}", "columns", name, of_key=True)
            continue
        parts = {"magnitude": columns} if isinstance(columns, str) else plain(columns)
        for part, column in parts.items():
            own = Amplitude(row=row, rate=max(rate, 0), part=part)
            yield {"name": f"{name} ({part})", "column": column, "amplitude": own}


def _read(
    given: Data, fields: dict[str, Any], problem: Problem, folder: Path, report: Report
) -> Iterator[Series]:
    """A column of the file with its times or frequencies, as far as it is right."""
    name, first = excerpt(given.file, 200), given.frequency or given.time or "t"
    end = problem.final_time
    low, high, allowed = 0.0, end * (1 + 1e-12), f"in the run, from 0 to final_time = {end:g}"
    if given.frequency is not None:
        low, high, allowed = math.ulp(0.0), math.inf, "a frequency, above 0"
    try:
        table, lines = read_csv_samples(
            folder / given.file, name, first, fields["column"], decimal=given.decimal
        )
        for time, line in zip(table[:, 0].tolist(), lines, strict=True):
            if not low <= time <= high:
                raise DataFileError(f"{name}:{line}: {first} = {time:g} is not {allowed}")
    except DataFileError as error:
        report.add(error.message, error.key)
        return
    yield Series(times=table[:, 0], values=table[:, 1], **fields)


def _numbers(keys: Iterable[str], template: Mapping[str, Any], report: Report) -> Iterator[str]:
    """The key paths that lead to numbers of a problem; others are told, with those that do."""
    known = list(_paths(template, "problem"))
    for key in keys:
        if key in known:
            yield key
            continue
        words = f"not a number of the problem{suggestion(key, known)} "
        more = ", ..." * (len(known) > 12)
        report.add(f"{words}(numbers: {listed(known[:12])}{more})", key, of_key=True)


def _paths(node: Any, path: str) -> Iterator[str]:
    """Key paths of all numbers in a problem."""
    if isinstance(node, Mapping | list):
        for key, value in node.items() if isinstance(node, Mapping) else enumerate(node):
            yield from _paths(value, f"{path}.{key}")
    elif type(node) in (int, float):
        yield path
