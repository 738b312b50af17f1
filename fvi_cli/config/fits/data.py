"""Measurements of a fit, read from their files, and the models that are fitted to them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from fvi_cli.config.fits.keys import Data, FitKeys, ModelKeys, NoiseKeys, ParameterKeys
from fvi_cli.config.members import Choice, place_changes
from fvi_cli.config.names import FORCE, names_along
from fvi_cli.config.text.mistakes import Report
from fvi_cli.errors import excerpt, listed, suggestion
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.keys.values import plain
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.records.csv_samples import CsvSamples, read_csv_samples
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
from fvi_cli.studies.members import leads_somewhere, value_at, with_values
from fvi_cli.studies.vibration.response import GROUND, forms_of, harmonic_force

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
    models = []
    model_keys: Mapping[str, ModelKeys | None] = fit.models or {"": None}
    for name, model in model_keys.items():
        under = report.under("models", name) if model else report
        specification: Mapping[str, Any] | None = template
        chosen, where = fit.parameters, report.under("parameters")
        if model is not None:
            specification = _changed(name, model.set, template, report)
            chosen = {key: one for key, one in chosen.items() if not _is_set(key, model.set)}
            if model.parameters is not None:
                chosen, where = model.parameters, under.under("parameters")
        if specification is None:
            continue
        parameters = tuple(_parameters(chosen, specification, where))
        models.append(FitModel(name=name, specification=specification, parameters=parameters))
    if len(report) > before:
        return None
    size, most = sum(one.size for one in data), max(len(one.parameters) for one in models)
    if size <= most:
        words = f"{size} measured values are too few for {most} parameters"
        report.add(f"{words}; at least {most + 1} are needed", "data")
    if not all(one.parameters for one in models):
        report.add("give at least one parameter to be fitted", "parameters")
    if isinstance(fit.noise, NoiseKeys):
        _refuse_zeros(data, report)
    return FitSettings(
        data=tuple(data),
        models=tuple(models),
        deviation=fit.noise if isinstance(fit.noise, float | int) else None,
        relative=fit.noise.relative if isinstance(fit.noise, NoiseKeys) else None,
    )


def _refuse_zeros(data: Iterable[DataSet], report: Report) -> None:
    """Refuse relative noise of values that are 0."""
    for series in (series for one in data for series in one.series):
        zeros = series.times[series.values == 0]
        if zeros.size:
            where = "t" if series.amplitude is None else "frequency"
            more = f" and in {zeros.size - 1} more rows" * (zeros.size > 1)
            report.add(
                f"column {series.column} is 0 at {where} = {zeros[0]:g}{more}, where relative "
                "noise would be 0; leave such rows out, or write a number",
                "noise",
            )


def _is_set(key: str, changes: Iterable[str]) -> bool:
    """Whether a model sets a parameter, or what holds it."""
    return any(f"{key}.".startswith(f"{one}.") for one in changes)


def _changed(
    name: str, changes: Mapping[str, Any], template: Mapping[str, Any], report: Report
) -> Mapping[str, Any] | None:
    """The resolved problem with the values of a model, read like the file; None: it is wrong."""
    under = report.under("models", name, "set")
    if not changes or not _can_change(template, changes, under):
        return None if changes else template
    values = {"problem": with_values(template, changes)}
    try:
        return plain(OnlyProblem.model_validate(values).problem)
    except ValidationError as error:
        whole = Report(report.document, report.prefix[:-1], report.found)
        places = {path: ("fit", "models", name, "set", path) for path in changes}
        place_changes(Choice(changes=changes, places=places), whole)
        whole.validation(error)
    return None


def _parameters(
    given: Mapping[str, ParameterKeys], template: Mapping[str, Any], report: Report
) -> Iterator[FitParameter]:
    for key, value in given.items():
        number = value_at(template, key) if _may_change(template, key) else None
        if isinstance(number, bool) or not isinstance(number, int | float):
            _refuse_path(template, key, report)
            continue
        low, high = -math.inf, math.inf
        if key.endswith(".order"):
            owner = value_at(template, key.rpartition(".")[0])
            is_of_law = owner.get("law", "springpot") != "springpot"
            low, high = LEAST_ORDER, LARGEST_LAW_ORDER if is_of_law else LARGEST_ORDER
        low = low if value.from_ is None else value.from_
        high = high if value.to is None else value.to
        start = float(number) if value.start is None else value.start
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
        _can_change(template, one.set, under.under("set"))
        reader = _Reader(given=one, problem=problem, folder=folder, report=under)
        if one.frequency is None:
            forces: tuple[str, ...] = ()
            series = list(reader.motion(quantities))
        else:
            forces = tuple(reader.forces(template))
            series = list(reader.response())
        name = one.name if one.name is not None else Path(one.file).stem
        if name in names:
            under.add(f"{excerpt(name)!r} is the name of another motion; give each a name")
        names.append(name)
        if series:
            yield DataSet(
                name=name,
                series=tuple(series),
                changes=dict(one.set),
                forces=forces,
                coordinates=problem.coordinates,
            )


class _Reader:
    """Reads the columns of a file of measurements."""

    def __init__(self, *, given: Data, problem: Problem, folder: Path, report: Report) -> None:
        self.given, self.problem = given, problem
        self.folder, self.report = folder, report

    def motion(self, quantities: Mapping[str, Expression]) -> Iterator[Series]:
        """The columns of a motion."""
        problem, coordinates = self.problem, self.problem.coordinates
        known = names_along(problem, problem.ready)
        qualities = {f"v{name}": "velocity" for name in coordinates}
        qualities |= dict.fromkeys(coordinates, "length")
        for name, column in self.given.columns.items():
            formula = quantities.get(name)
            try:
                formula = formula or Expression.parse(name, variables=known).expand(problem.ready)
            except ExpressionError as error:
                measured = list(dict.fromkeys((*quantities, *known)))
                reason = "" if error.unknown == name else f": {error}"
                words = f"not known{suggestion(name, measured)}{reason} (measured can be: "
                words += f"{listed(measured[:12])}, and expressions in them)"
                self.report.add(words, "columns", name, of_key=True)
                continue
            quality = "" if name in quantities else qualities.get(name, "")
            yield from self._series(name=name, column=str(column), formula=formula, quality=quality)

    def forces(self, template: Mapping[str, Any]) -> Iterator[str]:
        """Where the harmonic force of a response acts."""
        scene, coordinates, report = self.problem.scene, self.problem.coordinates, self.report
        if not scene.is_linear:
            words = f"{self.problem.kind} is not linear and has no harmonic response"
            report.add(words, "frequency")
        given = self.given.force or []
        if scene.prescribed is not None:
            # the response is the complex stiffness, the force for a unit displacement
            if given:
                words = "not for a damper on the bench, whose displacement is given"
                report.add(words, "force")
            yield "displacement"
            return
        if not given and template.get("ground_acceleration", "0") != "0":
            given = [GROUND]
        if not given:
            words = f"say where the force acts, force: {coordinates[0]} or force: {GROUND}"
            report.add(words)
        for text in given:
            try:
                harmonic_force(text, scene, coordinates)
            except ValueError as error:
                report.add(str(error), "force")
            yield text

    def response(self) -> Iterator[Series]:
        """The columns of a response; v and a before a coordinate are its rates 1 and 2."""
        is_prescribed = self.problem.scene.prescribed is not None
        coordinates = (FORCE,) if is_prescribed else self.problem.coordinates
        under = self.report.under("columns")
        for name, columns in self.given.columns.items():
            rate = 0 if name in coordinates or name[1:] not in coordinates else "xva".find(name[0])
            try:
                (row,) = forms_of([name[1:] if rate > 0 else name], coordinates)
            except ValueError as error:
                under.add(f"not known: {error}", name, of_key=True)
                continue
            parts = {"magnitude": columns} if isinstance(columns, str) else plain(columns)
            for part, column in parts.items():
                own = Amplitude(row=row, rate=max(rate, 0), part=part)
                yield from self._series(name=f"{name} ({part})", column=column, amplitude=own)

    def _series(self, *, column: str, **fields: Any) -> Iterator[Series]:
        """A column of the file with its times or frequencies."""
        given, path = self.given, self.folder / self.given.file
        name, first = excerpt(given.file, 200), given.frequency or given.time or "t"
        try:
            samples = read_csv_samples(path, name, first, column, decimal=given.decimal)
            if given.frequency is None:
                self._check_times(samples, name, first)
            elif not samples.time[0] > 0:
                words = f"{first} = {samples.time[0]:g} is not a frequency; it must be positive"
                raise DataFileError(f"{name}:{samples.lines[0]}: {words}")
        except DataFileError as error:
            for message in error.messages:
                self.report.add(message, error.key)
            return
        yield Series(column=column, times=samples.time, values=samples.values, **fields)

    def _check_times(self, samples: CsvSamples, name: str, column: str) -> None:
        end = self.problem.final_time
        for time, line in zip(samples.time.tolist(), samples.lines, strict=True):
            if not 0 <= time <= end * (1 + 1e-12):
                raise DataFileError(
                    f"{name}:{line}: {column} = {time:g} is outside of the run, which goes from 0 "
                    f"to final_time = {end:g}"
                )


def _can_change(template: Mapping[str, Any], changes: Iterable[str], report: Report) -> bool:
    """Whether every key path names a value that may be changed; otherwise with a mistake."""
    wrong = next((key for key in changes if not _may_change(template, key)), None)
    if wrong is not None:
        _refuse_path(template, wrong, report)
    return wrong is None


def _may_change(template: Mapping[str, Any], key: str) -> bool:
    """Whether the value at a key path exists and may be changed."""
    is_fixed = not key.startswith("problem.") or key in ("problem.kind", "problem.final_time")
    return not is_fixed and leads_somewhere(template, key)


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


def _refuse_path(template: Mapping[str, Any], key: str, report: Report) -> None:
    """Report a key path that leads to no number, with those that do."""
    known = [one for one in _numbers(template, "problem") if one != "problem.final_time"]
    more = ", ..." if len(known) > 12 else ""
    words = f"not a number of the problem{suggestion(key, known)} "
    report.add(f"{words}(numbers: {listed(known[:12])}{more})", key, of_key=True)
