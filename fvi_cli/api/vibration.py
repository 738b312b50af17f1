"""Modes and harmonic responses of linear scenes."""

from __future__ import annotations

from collections.abc import Sequence

from fvi_cli.api.calls import Source, load
from fvi_cli.runner.request import Request
from fvi_cli.runner.vibration.modes import request_modes
from fvi_cli.runner.vibration.response import frequencies, request_responses
from fvi_cli.studies.vibration.modes import ModeTable
from fvi_cli.studies.vibration.response import ResponseTable


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
    loaded = load(source)
    return request_modes(Request(name=loaded.name, loaded=loaded), count, near)


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
        What is told of; default: the coordinate that moves most.

    Raises
    ------
    RequestError
        For scenes that are not linear, and places that do not exist.
    """
    loaded = load(source)
    request = Request(name=loaded.name, loaded=loaded)
    return request_responses(request, frequencies(over), force, at)
