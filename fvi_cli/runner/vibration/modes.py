"""Modes of the scenes of a request."""

from __future__ import annotations

import dataclasses
import logging

from fvi_cli.errors import RequestError
from fvi_cli.runner.request import Request
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.vibration.modes import ModeTable, find_modes

_logger = logging.getLogger(__name__)

USUAL_COUNT = 10


def linear_problem(experiment: Experiment) -> Problem:
    """The scene of an experiment.

    Raises
    ------
    RequestError
        Where it has none, or one that is not linear.
    """
    problem = experiment.problem
    if not isinstance(problem, Problem):
        raise RequestError(f"{experiment.name}: nothing moves in it")
    if not problem.scene.is_linear:
        raise RequestError(
            f"{experiment.name}: {problem.kind} is not linear; modes and harmonic responses are "
            "those of linear scenes"
        )
    return problem


def request_modes(request: Request, count: int | None, near: float | None) -> list[ModeTable]:
    """Modes of every experiment; of a sweep those of its first member.

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
    tables = []
    for experiment in request.loaded.experiments:
        problem = linear_problem(experiment)
        d = problem.scene.dimension
        wanted = min(USUAL_COUNT, d) if count is None else count
        if not 1 <= wanted <= d:
            raise RequestError(
                f"--count: {wanted} is not allowed; {experiment.name} has 1 to {d} modes"
            )
        if near is not None and not near > 0:
            raise RequestError(f"--near: {near:g} is not allowed; it must be positive")
        try:
            table = find_modes(problem.scene, wanted, near=near)
        except ValueError as error:
            raise RequestError(f"{experiment.name}: {error}") from None
        table = dataclasses.replace(
            table, name=experiment.name, coordinates=problem.coordinates or table.coordinates
        )
        if not table.is_complete:
            _logger.warning("%s: %s", experiment.name, _told(table))
        tables.append(table)
    return tables


def _told(table: ModeTable) -> str:
    """Why it is not known that no mode is missing."""
    if table.counted is None:
        return "whether any mode is missing cannot be told: one lies on the edge of the region"
    return f"{table.inside} modes are found where the argument principle counts {table.counted}"
