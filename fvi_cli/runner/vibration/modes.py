"""Modes of the scenes of a request."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator, Mapping
from typing import Any

from fvi_cli.errors import RequestError
from fvi_cli.runner.request import Request, Task
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.vibration.modes import ModeTable, find_modes

_logger = logging.getLogger(__name__)

USUAL_COUNT = 10


def linear_problems(experiment: Experiment) -> Iterator[tuple[str, Mapping[str, Any], Problem]]:
    """Swept values in words, specification and scene of each member, or of the one problem.

    Raises
    ------
    RequestError
        Where an experiment has no scene, or one that is not linear.
    """
    for member in experiment.members or (None,):
        owner = member or experiment
        problem = owner.problem
        if not isinstance(problem, Problem):
            raise RequestError(f"{experiment.name}: has no motion, and so no modes")
        if not problem.scene.is_linear:
            raise RequestError(
                f"{experiment.name}: {problem.kind} is not linear; modes and harmonic responses "
                "are those of linear scenes"
            )
        if member is None:
            yield "", experiment.problem_specification, problem
        else:
            yield member.label, member.specification, problem


def titled(experiment: Experiment, member: str) -> str:
    """Name of an experiment or member in messages."""
    return f"{experiment.name} ({member})" if member else experiment.name


def linear_tasks(request: Request, action: str) -> list[Task]:
    """Every linear scene of a request, for a computation that has a name."""
    return [
        Task(
            experiment=experiment.name,
            action=action,
            of=f"{problem.scene.dimension} degrees of freedom{f', {member}' if member else ''}",
        )
        for experiment in request.loaded.experiments
        for member, _, problem in linear_problems(experiment)
    ]


def request_modes(request: Request, count: int | None, near: float | None) -> list[ModeTable]:
    """Modes of every experiment, of a sweep those of each member.

    Parameters
    ----------
    request
        What is asked for.
    count
        How many; None: ten, or all where there are fewer.
    near
        Frequency in oscillations per unit of time.

    Raises
    ------
    RequestError
        For scenes that are not linear or have no modes, and numbers out of range.
    """
    if near is not None and not near > 0:
        raise RequestError(f"--near: {near:g} is not allowed; it must be positive")
    tables = []
    for experiment in request.loaded.experiments:
        for member, _, problem in linear_problems(experiment):
            d = problem.scene.dimension
            if count is not None and not 1 <= count <= d:
                raise RequestError(
                    f"--count: {count} is not allowed; {experiment.name} has 1 to {d} modes"
                )
            try:
                table = find_modes(problem.scene, count or USUAL_COUNT, near=near)
            except ValueError as error:
                raise RequestError(f"{titled(experiment, member)}: {error}") from None
            table = dataclasses.replace(
                table,
                name=experiment.name,
                member=member,
                units=experiment.units,
                coordinates=problem.coordinates or table.coordinates,
            )
            if not table.is_complete:
                _logger.warning("%s: %s", titled(experiment, member), _why_incomplete(table))
            tables.append(table)
    return tables


def _why_incomplete(table: ModeTable) -> str:
    """Why it is not known that no mode is missing."""
    if table.counted is None:
        return "modes may be missing: they cannot be counted, one lies at the edge of the region"
    return f"{table.inside} modes are found where the argument principle counts {table.counted}"
