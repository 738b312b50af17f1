"""Modes and harmonic responses of the linear scenes of a request."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fvi_cli.config.names import names_along
from fvi_cli.errors import RequestError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.runner.request import Request, Source, Task, requested
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Subject
from fvi_cli.studies.vibration.modes import ModeTable, find_modes
from fvi_cli.studies.vibration.outputs import harmonic_outputs
from fvi_cli.studies.vibration.response import (
    GROUND,
    ResponseTable,
    ground_amplitude,
    harmonic_force,
    harmonic_response,
)

_logger = logging.getLogger(__name__)

USUAL_COUNT = 10
MOST_FREQUENCIES = 100_000
_FORM = "it must be FROM:TO:N[:log], such as 0.2:8:400"


def linear_scenes(request: Request) -> Iterator[tuple[Subject, Problem]]:
    """Every experiment or member of a request, with its linear scene.

    Raises
    ------
    RequestError
        If an experiment has no scene, or one that is not linear.
    """
    for experiment in request.loaded.experiments:
        for member in experiment.members or (None,):
            one = Subject(experiment=experiment, member=member)
            problem = one.problem
            if not isinstance(problem, Problem):
                raise RequestError(f"{experiment.name}: has no motion, and so no modes")
            if not problem.scene.is_linear:
                raise RequestError(
                    f"{experiment.name}: {problem.kind} is not linear; modes and harmonic "
                    "responses need a linear scene"
                )
            yield one, problem


def linear_tasks(request: Request, action: str) -> list[Task]:
    """One task with the name `action` for every linear scene of a request."""
    return [
        Task(
            experiment=one.experiment.name,
            action=action,
            of=f"{problem.scene.dimension} degrees of freedom"
            + (f", {one.member.label}" if one.member else ""),
        )
        for one, problem in linear_scenes(request)
    ]


def modes(
    source: Source, *, count: int | None = None, near: float | None = None
) -> list[ModeTable]:
    """Modes of every experiment of a configuration, as ``fvi modes`` computes them.

    Parameters
    ----------
    source
        As for :func:`load`.
    count
        Number of modes; default 10, or all if there are fewer.
    near
        Frequency (oscillations per unit of time) near which modes are computed; default: the
        lowest modes.

    Raises
    ------
    RequestError
        For scenes that are not linear, and numbers out of range.
    """
    if near is not None and not near > 0:
        raise RequestError(f"--near: {near:g} is not allowed; it must be positive")
    tables = []
    for one, problem in linear_scenes(requested(source)):
        d = problem.scene.dimension
        if count is not None and not 1 <= count <= d:
            raise RequestError(
                f"--count: {count} is not allowed; {one.experiment.name} has 1 to {d} modes"
            )
        try:
            table = find_modes(problem.scene, count or USUAL_COUNT, near=near)
        except ValueError as error:
            raise RequestError(f"{one.name}: {error}") from None
        if table.counted is None:
            _logger.warning(
                "%s: modes may be missing: they cannot be counted, one lies at the edge of the "
                "region",
                one.name,
            )
        elif not table.is_complete:
            _logger.warning(
                "%s: %d modes are found where the argument principle counts %d",
                one.name,
                table.inside,
                table.counted,
            )
        tables.append(
            replace(
                table,
                name=one.experiment.name,
                of_member=one.member,
                units=one.experiment.units,
                coordinates=problem.coordinates or table.coordinates,
            )
        )
    return tables


def frequencies(text: str) -> Array:
    """Frequencies of a text such as ``0.1:20:400:log``, in oscillations per unit of time.

    Raises
    ------
    RequestError
        For another form and numbers out of range.
    """
    parts = text.split(":")
    is_log = len(parts) == 4 and parts[3] == "log"
    if not (len(parts) == 3 or is_log):
        raise RequestError(f"--frequency: {text!r} is not allowed; {_FORM}")
    try:
        low, high, number = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise RequestError(f"--frequency: {text!r} is not allowed; {_FORM}") from None
    if not (0 < low < high < math.inf and 3 <= number <= MOST_FREQUENCIES):
        raise RequestError(
            f"--frequency: {text!r} is not allowed; 0 < FROM < TO, and 3 to {MOST_FREQUENCIES} "
            "frequencies"
        )
    return np.geomspace(low, high, number) if is_log else np.linspace(low, high, number)


def response(
    source: Source, *, frequency: str, force: Sequence[str] = (), at: Sequence[str] = ()
) -> list[ResponseTable]:
    """Steady responses of every experiment of a configuration, as ``fvi response`` computes them.

    Parameters
    ----------
    source
        As for :func:`load`.
    frequency
        Frequencies, ``FROM:TO:N``, or with ``:log`` at the end.
    force
        Where harmonic forces of amplitude 1 act: coordinates, combinations of them such as
        ``x2 - x1``, or ``ground``; ``x1=2.5`` for another amplitude.
    at
        Outputs to report, linear expressions in the names that quantities may use (``ax5``,
        ``drift_1``, ``force_1``) or names of quantities; default: the coordinate that moves most.

    Raises
    ------
    RequestError
        For scenes that are not linear, and coordinates that do not exist.
    """
    hertz = frequencies(frequency)
    tables = []
    for one, problem in linear_scenes(requested(source)):
        name, scene, coordinates = one.experiment.name, problem.scene, problem.coordinates
        wanted, specification = list(force), one.problem_specification
        if not wanted and specification.get("ground_acceleration", "0") != "0":
            wanted = [GROUND]
        if not wanted:
            raise RequestError(
                f"{name}: say where forces act, for example --force x1, or --force {GROUND}"
            )
        direction = specification.get("ground_direction", 1.0)
        option = "--force"
        try:
            loads = [harmonic_force(text, scene, coordinates, direction) for text in wanted]
            option = "--at"
            names = names_along(problem, problem.ready)
            quantities = one.experiment.observations.quantities or {}
            outputs = harmonic_outputs(at, names, problem, quantities) if at else None
        except ValueError as error:
            raise RequestError(f"{option}: {error}") from None
        try:
            table = harmonic_response(
                scene,
                sum(loads, np.zeros(1)),
                hertz,
                outputs=at or coordinates,
                rows=None if outputs is None else outputs.forms,
                offsets=0.0 if outputs is None else outputs.ground * ground_amplitude(wanted),
                load_words=", ".join(wanted),
            )
        except ValueError as error:
            raise RequestError(f"{one.name}: {error}") from None
        tables.append(
            replace(
                table,
                name=name,
                of_member=one.member,
                units=one.experiment.units,
                qualities=("displacement",) if outputs is None else outputs.qualities,
            )
        )
    return tables
