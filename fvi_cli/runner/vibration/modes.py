"""Modes of the scenes of a request."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator, Mapping
from typing import Any

from fvi_cli.errors import RequestError
from fvi_cli.runner.request import Request, Source, Task, requested
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.members import Member
from fvi_cli.studies.vibration.modes import ModeTable, find_modes

_logger = logging.getLogger(__name__)

USUAL_COUNT = 10


def linear_problems(
    experiment: Experiment,
) -> Iterator[tuple[Member | None, Mapping[str, Any], Problem]]:
    """Each member, or none, with its specification and scene.

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
                "need a linear scene"
            )
        if member is None:
            yield None, experiment.problem_specification, problem
        else:
            yield member, member.specification, problem


def titled(experiment: Experiment, member: Member | None) -> str:
    """Name of an experiment or member in messages."""
    return experiment.name if member is None else f"{experiment.name} ({member.label})"


def linear_tasks(request: Request, action: str) -> list[Task]:
    """Every linear scene of a request, for a computation that has a name."""
    return [
        Task(
            experiment=experiment.name,
            action=action,
            of=f"{problem.scene.dimension} degrees of freedom"
            + (f", {member.label}" if member else ""),
        )
        for experiment in request.loaded.experiments
        for member, _, problem in linear_problems(experiment)
    ]


def modes(
    source: Source, *, count: int | None = None, near: float | None = None
) -> list[ModeTable]:
    """Modes of every experiment of a configuration, as ``fvi modes`` computes them.

    Parameters
    ----------
    source
        As of :func:`load`.
    count
        How many; default 10, or all of fewer.
    near
        Frequency in oscillations per unit of time, to which they are nearest; default: the lowest.

    Raises
    ------
    RequestError
        For scenes that are not linear, and numbers out of range.
    """
    if near is not None and not near > 0:
        raise RequestError(f"--near: {near:g} is not allowed; it must be positive")
    tables = []
    for experiment in requested(source).loaded.experiments:
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
                of_member=member,
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
