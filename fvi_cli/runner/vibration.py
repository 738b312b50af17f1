"""Modes and harmonic responses of the linear scenes of a configuration."""

from __future__ import annotations

import contextlib
import functools
import logging
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from fvi_cli.config import LoadedConfig
from fvi_cli.config.names import names_along
from fvi_cli.errors import RequestError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.runner.progress import Task, carry_out
from fvi_cli.runner.request import Source, load
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Subject
from fvi_cli.studies.members import OfMember, label_of
from fvi_cli.studies.vibration.modes import ModeTable, find_modes
from fvi_cli.studies.vibration.outputs import harmonic_outputs
from fvi_cli.studies.vibration.response import (
    GROUND,
    ResponseTable,
    harmonic_load,
    harmonic_response,
)

_logger = logging.getLogger(__name__)

Table = TypeVar("Table", bound=OfMember)

USUAL_COUNT = 10
MOST_FREQUENCIES = 100_000


def modes(
    source: Source,
    *,
    count: int | None = None,
    near: float | None = None,
    progress: bool = False,
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
    progress
        As for :func:`run`.

    Raises
    ------
    RequestError
        For scenes that are not linear, and numbers out of range.
    """
    config = load(source)
    return carry_out(modes_tasks(config, count=count, near=near), config.name, progress=progress)


def modes_tasks(
    config: LoadedConfig, *, count: int | None = None, near: float | None = None
) -> list[Task]:
    """A task for every scene; raises :class:`RequestError` as :func:`modes` does."""
    if near is not None and not near > 0:
        raise RequestError(f"--near: {near:g} is not allowed; it must be positive")
    return _tasks("modes", config, functools.partial(_modes, count=count, near=near))


def _modes(one: Subject, problem: Problem, *, count: int | None, near: float | None) -> ModeTable:
    d = problem.scene.dimension
    if count is not None and not 1 <= count <= d:
        raise ValueError(f"--count: {count} is not allowed; there are 1 to {d} modes")
    table = find_modes(problem.scene, count or USUAL_COUNT, near=near)
    if not table.is_complete:
        words = "they cannot be counted, one lies at the edge of the region"
        if table.counted is not None:
            words = f"{table.inside} are found where the argument principle counts {table.counted}"
        _logger.warning("%s: modes may be missing: %s", one.name, words)
    return replace(table, coordinates=problem.coordinates or table.coordinates)


def response(
    source: Source,
    *,
    frequency: str,
    force: Sequence[str] = (),
    at: Sequence[str] = (),
    progress: bool = False,
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
    progress
        As for :func:`run`.

    Raises
    ------
    RequestError
        For scenes that are not linear, and coordinates that do not exist.
    """
    config = load(source)
    tasks = response_tasks(config, frequency=frequency, force=force, at=at)
    return carry_out(tasks, config.name, progress=progress)


def response_tasks(
    config: LoadedConfig, *, frequency: str, force: Sequence[str] = (), at: Sequence[str] = ()
) -> list[Task]:
    """A task for every scene; raises :class:`RequestError` as :func:`response` does."""
    hertz = frequencies(frequency)
    return _tasks("response", config, functools.partial(_response, hertz=hertz, force=force, at=at))


def frequencies(text: str) -> Array:
    """Frequencies of a text such as ``0.1:20:400:log``, in oscillations per unit of time.

    Raises
    ------
    RequestError
        For another form and numbers out of range.
    """
    space = np.geomspace if text.endswith(":log") else np.linspace
    try:
        low, high, number = text.removesuffix(":log").split(":")
        ends, count = (float(low), float(high)), int(number)
    except ValueError:
        ends, count = (0.0, 0.0), 0
    if not (0 < ends[0] < ends[1] < math.inf and 3 <= count <= MOST_FREQUENCIES):
        raise RequestError(
            f"--frequency: {text!r} is not allowed; it must be FROM:TO:N[:log], such as "
            f"0.2:8:400, with 0 < FROM < TO and 3 to {MOST_FREQUENCIES} frequencies"
        )
    return space(*ends, count)


def _response(
    one: Subject, problem: Problem, *, hertz: Array, force: Sequence[str], at: Sequence[str]
) -> ResponseTable:
    scene, coordinates = problem.scene, problem.coordinates
    specification = one.problem_specification
    if not force and specification.get("ground_acceleration", "0") != "0":
        force = [GROUND]
    if not force:
        raise ValueError(f"say where forces act, for example --force x1, or --force {GROUND}")
    direction = specification.get("ground_direction", 1.0)
    with _naming("--force"):
        load, ground = harmonic_load(force, scene, coordinates, direction)
    quantities = one.experiment.observations.quantities or {}
    with _naming("--at"):
        names = names_along(problem, problem.ready)
        outputs = harmonic_outputs(at, names, problem, quantities) if at else None
    table = harmonic_response(
        scene,
        load,
        hertz,
        outputs=at or coordinates,
        rows=None if outputs is None else outputs.rows,
        offsets=0.0 if outputs is None else outputs.ground * ground,
        load_words=", ".join(force),
    )
    qualities = ("displacement",) if outputs is None else outputs.qualities
    return replace(table, qualities=qualities)


@contextlib.contextmanager
def _naming(option: str) -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{option}: {error}") from None


def _tasks(action: str, config: LoadedConfig, compute: Callable[..., Table]) -> list[Task]:
    """A task for the scene of every experiment or member."""
    return [
        Task(
            experiment=experiment.name,
            action=action,
            of=label_of(member),
            work=functools.partial(_table, Subject(experiment=experiment, member=member), compute),
        )
        for experiment in config.experiments
        for member in experiment.members or (None,)
    ]


def _table(one: Subject, compute: Callable[..., Table]) -> Table:
    """The table of a linear scene; RequestError where there is none."""
    experiment, problem = one.experiment, one.problem
    if not isinstance(problem, Problem) or not problem.scene.is_linear:
        words = "modes and harmonic responses need a linear scene"
        raise RequestError(f"{one.name}: {words}, and {problem.kind} is none")
    if problem.scene.prescribed is not None:
        words = "has no mass, and so no modes and responses"
        raise RequestError(f"{one.name}: {problem.kind} {words}; give its law to a structure")
    try:
        table = compute(one, problem)
    except ValueError as error:
        raise RequestError(f"{one.name}: {error}") from None
    return replace(table, name=experiment.name, of_member=one.member, units=experiment.units)
