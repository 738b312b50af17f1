"""Measured motions and responses, read from their files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from fvi_cli.config.keys.fit import Data
from fvi_cli.config.observations import FORCE, names_along
from fvi_cli.keys.complaints import excerpt, listed, suggestion
from fvi_cli.keys.cursor import Cursor, is_complete
from fvi_cli.keys.settings import as_plain
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.records.csv_samples import CsvSamples, read_csv_samples
from fvi_cli.scenes.records.data_files import DataFileError, file_under
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.fits.settings import PARTS, Amplitude, DataSet, Series
from fvi_cli.studies.members import leads_somewhere, with_values
from fvi_cli.studies.vibration.response import GROUND, forms_of, harmonic_force


def read_data(
    given: Any,
    described: Mapping[str, Any],
    problem: Problem,
    quantities: Mapping[str, Expression],
    at: Cursor,
) -> list[DataSet]:
    """The measured motions and responses, as far as they can be read."""
    items = at.items() or [at]
    found: list[DataSet] = []
    for one, under in zip(given if isinstance(given, tuple) else (), items, strict=False):
        if not isinstance(one, Data) or not is_complete(one):
            continue
        if can_change(described, one.set, under.under("set")):
            is_possible(with_values(described, one.set), under.under("set"))
        if not one.columns:
            under.refuse("no columns; name what was measured", "columns")
        if one.frequency is not None:
            forces, series = _response(one, described, problem, under)
        else:
            forces, series = (), _motion(one, problem, quantities, under)
        name = one.name if one.name is not None else Path(one.file).stem
        if any(other.name == name for other in found):
            under.refuse(f"{excerpt(name)!r} is the name of another motion; give each a name")
        if series:
            found.append(
                DataSet(
                    name=name,
                    series=tuple(series),
                    changes=dict(one.set),
                    forces=forces,
                    coordinates=problem.coordinates,
                )
            )
    return found


def _motion(
    given: Data, problem: Problem, quantities: Mapping[str, Expression], at: Cursor
) -> list[Series]:
    """The columns of a motion."""
    if given.force is not None:
        at.refuse("only for responses; write frequency: and its column in place of time", "force")
    time = given.time or "t"
    coordinates, found = problem.coordinates, []
    known = names_along(problem, problem.ready)
    for name, column in given.columns.items():
        if not isinstance(column, str):
            at.under("columns").refuse("parts are those of a response; name one column", name)
            continue
        is_velocity = name not in coordinates and name[1:] in coordinates and name[0] == "v"
        formula = quantities.get(name)
        if formula is None and not (name in coordinates or is_velocity):
            try:
                formula = Expression.parse(name, variables=known).expand(problem.ready)
            except ExpressionError as error:
                measured = list(dict.fromkeys((*quantities, *known)))
                reason = "" if error.unknown == name else f": {error}"
                at.under("columns").refuse_key(
                    name,
                    f"not known{suggestion(name, measured)}{reason} (measured can be: "
                    f"{listed(measured[:12])}{', ...' if len(measured) > 12 else ''}, and "
                    "expressions in them)",
                )
                continue
            if not formula.names - {"t", *problem.numbers, *problem.inputs}:
                at.under("columns").refuse_key(name, "it contains no coordinate")
                continue
        found += _series(
            given,
            time,
            problem,
            at,
            name=name,
            column=column,
            component=0 if formula else coordinates.index(name[is_velocity:]),
            is_velocity=is_velocity and formula is None,
            formula=formula,
        )
    return found


def _response(
    given: Data, described: Mapping[str, Any], problem: Problem, at: Cursor
) -> tuple[tuple[str, ...], list[Series]]:
    """The forces of a response, and its columns."""
    coordinates, found = problem.coordinates, []
    if given.time is not None:
        at.refuse("not together with frequency: the data are a motion or a response", "time")
    if not problem.scene.is_linear:
        at.refuse(f"{problem.kind} is not linear and has no harmonic response", "frequency")
    forces, is_prescribed = given.force or (), problem.scene.prescribed is not None
    if is_prescribed:
        # the response is the complex stiffness, the force for a unit displacement
        forces = ("displacement",)
        if given.force is not None:
            at.refuse("not for a damper on the bench, whose displacement is given", "force")
    elif not forces and described.get("ground_acceleration", "0") != "0":
        forces = (GROUND,)
    if not forces:
        at.refuse(f"say where the force acts, force: {coordinates[0]} or force: {GROUND}")
    for text in () if is_prescribed else forces:
        try:
            harmonic_force(text, problem.scene, coordinates)
        except ValueError as error:
            at.refuse(str(error), "force")
    for name, columns in given.columns.items():
        rate = 0 if name in coordinates or name[1:] not in coordinates else "xva".find(name[0])
        under = at.under("columns")
        if is_prescribed and name != FORCE:
            under.refuse_key(name, f"not known here: the complex stiffness is that of {FORCE}")
            continue
        try:
            known = (FORCE,) if is_prescribed else coordinates
            (row,) = forms_of([name[1:] if rate > 0 else name], known)
        except ValueError as error:
            under.refuse_key(name, f"not known: {error}")
            continue
        parts = {"magnitude": columns} if isinstance(columns, str) else as_plain(columns)
        if not parts:
            under.refuse(f"no column; name that of {listed(PARTS)}", name)
        for part, column in parts.items():
            own = Amplitude(row=row, rate=max(rate, 0), part=part)
            shown = f"{name} ({part})"
            first = given.frequency or ""
            found += _series(given, first, problem, at, name=shown, column=column, amplitude=own)
    return forces, found


def _series(
    given: Data, first: str, problem: Problem, at: Cursor, *, column: str, **own: Any
) -> list[Series]:
    """A column of the file with its times or frequencies; empty, with complaints, if wrong."""
    path, shown = file_under(given.file, at)
    is_motion = given.frequency is None
    try:
        samples = read_csv_samples(path, shown, first, column)
        if is_motion:
            _check_times(samples, shown, problem.final_time, first)
        elif not samples.time[0] > 0:
            raise DataFileError(
                f"{shown}:{samples.lines[0]}: {first} = {samples.time[0]:g} is not a "
                "frequency; it must be positive"
            )
    except DataFileError as error:
        error.report_argument(at)
        return []
    return [Series(column=column, times=samples.time, values=samples.values, **own)]


def _check_times(samples: CsvSamples, name: str, final_time: float, column: str) -> None:
    """Complain of times outside the run."""
    for time, line in zip(samples.time.tolist(), samples.lines, strict=True):
        if not 0 <= time <= final_time * (1 + 1e-12):
            raise DataFileError(
                f"{name}:{line}: {column} = {time:g} is outside of the run, which goes from 0 to "
                f"final_time = {final_time:g}"
            )


def can_change(described: Mapping[str, Any], changes: Iterable[str], at: Cursor) -> bool:
    """Whether every key path names a value that may be changed; otherwise with a complaint."""
    wrong = next((key for key in changes if not may_change(described, key)), None)
    if wrong is not None:
        refuse_path(described, wrong, at)
    return wrong is None


def is_possible(specification: Mapping[str, Any], at: Cursor) -> bool:
    """Whether a ``problem`` mapping makes a problem; otherwise with a complaint."""
    try:
        build_scene(specification)
    except (ValueError, KeyError, TypeError) as error:
        reason = f"{error.args[0]} is missing" if isinstance(error, KeyError) else error
        at.refuse(f"with these values the problem is not valid: {reason}")
        return False
    return True


def may_change(described: Mapping[str, Any], key: str) -> bool:
    """Whether the value at a key path exists and may be changed."""
    is_fixed = not key.startswith("problem.") or key in ("problem.kind", "problem.final_time")
    return not is_fixed and leads_somewhere(described, key)


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


def refuse_path(described: Mapping[str, Any], key: str, at: Cursor) -> None:
    """Complain about a key path, and list the key paths of numbers."""
    known = [one for one in _numbers(described, "problem") if one != "problem.final_time"]
    at.refuse_key(
        key,
        f"not a number of the problem{suggestion(key, known)} "
        f"(numbers: {listed(known[:12])}{', ...' if len(known) > 12 else ''})",
    )
