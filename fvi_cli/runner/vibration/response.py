"""Harmonic responses of the scenes of a request."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fvi_cli.errors import RequestError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.runner.request import Source, requested
from fvi_cli.runner.vibration.modes import linear_problems, titled
from fvi_cli.studies.vibration.response import (
    GROUND,
    ResponseTable,
    forms_of,
    harmonic_force,
    harmonic_response,
)

MOST_FREQUENCIES = 100_000
_FORM = "it must be frequency=FROM:TO:NUMBER or frequency=FROM:TO:NUMBER:log"


def frequencies(over: str) -> Array:
    """Frequencies of a text such as ``frequency=0.1:20:400:log``, in oscillations per unit of time.

    Raises
    ------
    RequestError
        For another form and numbers out of range.
    """
    key, _, numbers = over.partition("=")
    parts = numbers.split(":")
    is_log = len(parts) == 4 and parts[3] == "log"
    if key.strip() != "frequency" or not (len(parts) == 3 or is_log):
        raise RequestError(f"--over: {over!r} is not allowed; {_FORM}")
    try:
        low, high, number = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise RequestError(f"--over: {over!r} is not allowed; {_FORM}") from None
    if not (0 < low < high < math.inf and 3 <= number <= MOST_FREQUENCIES):
        raise RequestError(
            f"--over: {over!r} is not allowed; 0 < FROM < TO, and 3 to {MOST_FREQUENCIES} "
            "frequencies"
        )
    return np.geomspace(low, high, number) if is_log else np.linspace(low, high, number)


def response(
    source: Source, *, over: str, force: Sequence[str] = (), at: Sequence[str] = ()
) -> list[ResponseTable]:
    """Steady responses of every experiment of a configuration, as ``fvi response`` computes them.

    Parameters
    ----------
    source
        As of :func:`load`.
    over
        Frequencies, ``frequency=FROM:TO:NUMBER`` or with ``:log`` behind.
    force
        Where harmonic forces of amplitude 1 act: coordinates, combinations of them such as
        ``x2 - x1``, or ``ground``; ``x1=2.5`` for another amplitude.
    at
        Outputs to report; default: the coordinate that moves most.

    Raises
    ------
    RequestError
        For scenes that are not linear, and places that do not exist.
    """
    hertz = frequencies(over)
    tables = []
    for experiment in requested(source).loaded.experiments:
        for member, specification, problem in linear_problems(experiment):
            wanted = list(force) or _usual_force(experiment.name, specification)
            direction = specification.get("ground_direction", 1.0)
            option = "--force"
            try:
                load = sum(
                    (
                        harmonic_force(t, problem.scene, problem.coordinates, direction)
                        for t in wanted
                    ),
                    np.zeros(1),
                )
                option = "--at"
                rows = forms_of(at, problem.coordinates) if at else None
            except ValueError as error:
                raise RequestError(f"{option}: {error}") from None
            try:
                table = harmonic_response(
                    problem.scene,
                    load,
                    hertz,
                    outputs=at or problem.coordinates,
                    rows=rows,
                    load_words=", ".join(wanted),
                )
            except ValueError as error:
                raise RequestError(f"{titled(experiment, member)}: {error}") from None
            tables.append(
                dataclasses.replace(
                    table, name=experiment.name, of_member=member, units=experiment.units
                )
            )
    return tables


def _usual_force(name: str, specification: Mapping[str, Any]) -> list[str]:
    if specification.get("ground_acceleration", "0") != "0":
        return [GROUND]
    raise RequestError(f"{name}: say where forces act, for example --force x1, or --force {GROUND}")
