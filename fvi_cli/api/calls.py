"""What each command does, as one call; what it needs is imported when it is called."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fvi_cli.config import LoadedConfig, find_config, load_config, parse_config
from fvi_cli.errors import RequestError
from fvi_cli.runner.request import Request, allowing_unstable, gather, ranges

if TYPE_CHECKING:
    from fvi_cli.effects.scene import Scene
    from fvi_cli.runner.outcome import Outcome
    from fvi_cli.runner.plan import PlannedRun
    from fvi_cli.storage import StoredConfiguration, StoredFile
    from fvi_cli.studies.cost import CostTable
    from fvi_cli.studies.fits.result import FitResult
    from fvi_cli.studies.hard_cases.case import HardCaseReport
    from fvi_cli.studies.stability_study import StabilityTable
    from fvi_cli.studies.vibration.modes import ModeTable
    from fvi_cli.studies.vibration.response import ResponseTable

Source = str | Path | Mapping[str, Any] | LoadedConfig | Request


def load(
    source: str | Path | Mapping[str, Any] | LoadedConfig, *, overrides: Sequence[str] = ()
) -> LoadedConfig:
    """Read and check a configuration.

    Parameters
    ----------
    source
        A file, the name of a shipped configuration, or what would stand in the file as a mapping
        (with its ``name``); NumPy arrays and numbers in it stand for lists and numbers.
    overrides
        Changes ``key.path=value`` as of ``--set``, validated like the rest.

    Raises
    ------
    ConfigError
        Every mistake at once.
    RequestError
        For a name that is neither a file nor a shipped configuration.
    """
    if isinstance(source, LoadedConfig):
        if overrides:
            raise RequestError("overrides: give them when the configuration is first loaded")
        return source
    if isinstance(source, Mapping):
        # JSON is YAML: the same checks, the same words
        text = json.dumps(source, indent=1, default=_plain)
        return parse_config(text, str(source.get("name", "mapping")), overrides=overrides)
    return load_config(find_config(str(source)), overrides=overrides)


def _plain(value: object) -> object:
    """The value of a mapping as a list, a number or a text.

    Raises
    ------
    RequestError
        For what a configuration cannot hold.
    """
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if hasattr(value, "toarray"):
        # a sparse matrix of SciPy
        return np.asarray(value.toarray()).tolist()
    if isinstance(value, Path):
        return str(value)
    raise RequestError(
        f"a {type(value).__name__} cannot stand in a configuration; it holds mappings, lists, "
        "numbers and texts (a formula, or a file of samples, for a force); a Scene takes more"
    )


def run(
    source: Source,
    *,
    output: Path | str | None = None,
    workers: int = 1,
    dask: str | None = None,
    fresh: bool = False,
    fail_fast: bool = False,
    allow_unstable: bool = False,
    keep: bool = True,
    wait: bool = False,
    shard: str = "1/1",
    checkpoint_every: float = 60.0,
    progress: bool = False,
    keeps_motions: bool = True,
) -> list[Outcome]:
    """Compute every run of a configuration, as ``fvi run`` does; one that fails says so, no more.

    Parameters
    ----------
    source
        As for :func:`load`.
    output
        Folder of ``<name>.h5``, whose runs are not computed again; None: nothing is written.
    workers
        Number of processes; more than one needs the ``if __name__ == "__main__"`` guard.
    dask
        Address of a Dask scheduler, whose workers compute in their place.
    fresh, fail_fast, allow_unstable, wait, shard, checkpoint_every
        As the options of the command line.
    keep
        Store what is computed in `output`.
    progress
        Show a progress bar where there is a terminal.
    keeps_motions
        Give the points of members of a sweep; a summary does without them.

    One outcome for every experiment; a run that failed is among its finished ones with its status.
    """
    from fvi_cli.runner.compute import run_request
    from fvi_cli.runner.parts.shard import shard_named
    from fvi_cli.runner.settings import Settings

    settings = Settings(
        output=Path(output or "."),
        workers=workers,
        dask=dask,
        fresh=fresh or output is None,
        fail_fast=fail_fast,
        show_progress=progress,
        keep=keep and output is not None,
        checkpoint_seconds=checkpoint_every,
        waits=wait,
        keeps_motions=keeps_motions,
        shard=shard_named(shard),
    )
    return run_request(_request(source, allow_unstable=allow_unstable), settings)


def plan(
    source: Source,
    *,
    output: Path | str = "results",
    workers: int = 1,
    fresh: bool = False,
    allow_unstable: bool = False,
    shard: str = "1/1",
) -> list[PlannedRun]:
    """What :func:`run` would do with every run, why, and what is predicted; nothing is written."""
    from fvi_cli.runner.parts.shard import shard_named
    from fvi_cli.runner.plan import plan_request
    from fvi_cli.runner.settings import Settings

    settings = Settings(output=Path(output), workers=workers, fresh=fresh, shard=shard_named(shard))
    return plan_request(_request(source, allow_unstable=allow_unstable), settings)


def recall(path: Path | str, *, overrides: Sequence[str] = ()) -> list[Outcome]:
    """Read the runs of a result file that its configuration asks for; nothing is computed.

    Parameters
    ----------
    path
        Result file.
    overrides
        Changes ``key.path=value`` of that configuration, for runs of other values in the file.

    Raises
    ------
    StorageError
        If it cannot be read.
    """
    (request,) = gather([str(path)], overrides)
    return run(request, output=Path(path).parent)


def forget(
    path: Path | str,
    *,
    overrides: Sequence[str] = (),
    case: str | None = None,
    others: bool = False,
    everything: bool = False,
) -> int:
    """Remove runs from a result file, as ``fvi forget`` does; returns how many.

    Those that its configuration asks for with `overrides`, of a method, not asked for, or all.

    Raises
    ------
    RequestError
        If nothing is said, or there is no such run.
    """
    from fvi_cli.runner.forget import forget_runs

    found = forget_runs(
        Path(path), overrides=overrides, case=case, others=others, everything=everything
    )
    return len(found)


def contents(path: Path | str) -> StoredFile:
    """What a result file holds and where it comes from, without the numbers of the runs."""
    from fvi_cli.storage import list_runs

    return list_runs(Path(path))


def configuration(path: Path | str) -> StoredConfiguration:
    """The configuration that made a result file, word for word, with its overrides."""
    from fvi_cli.storage import read_configuration

    return read_configuration(Path(path))


def stability(
    source: Source, *, over: Sequence[str] = (), observe: bool | None = None, progress: bool = False
) -> list[StabilityTable]:
    """What is stable, predicted and observed, as ``fvi stability`` studies it.

    Parameters
    ----------
    source
        As for :func:`load`.
    over
        Entries to vary, such as ``problem.stiffness=1:1e6:40:log``; at most two, and not for a
        configuration that is loaded already.
    observe
        Compare with runs from random data; default as configured.
    progress
        Show a progress bar where there is a terminal.

    A :class:`RequestError` reports an experiment in which nothing is integrated.
    """
    from fvi_cli.runner.stability import study_stability

    request = _request(source, overrides=ranges(over))
    return study_stability(request, is_observed=observe, show_progress=progress)


def fit(
    source: Source, *, overrides: Sequence[str] = (), progress: bool = False
) -> list[FitResult]:
    """Numbers of a problem from measurements, as ``fvi fit`` finds them.

    Parameters
    ----------
    source
        As for :func:`load`.
    overrides
        Changes ``key.path=value``, for a configuration that is not loaded yet.
    progress
        As for :func:`stability`.

    Returns
    -------
    list of FitResult
        One for every experiment with ``fit``; a fit that does not converge says so.

    Raises
    ------
    RequestError
        Where there is nothing to fit, and for parameters without influence on the data.
    """
    from fvi_cli.runner.fits.fit import fit_request

    return fit_request(_request(source, overrides=overrides), show_progress=progress)


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
    from fvi_cli.runner.vibration.modes import request_modes

    return request_modes(_request(source), count, near)


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
    from fvi_cli.runner.vibration.response import frequencies, request_responses

    return request_responses(_request(source), frequencies(over), force, at)


def cost(source: Source, *, peers: bool = False, progress: bool = False) -> list[CostTable]:
    """Error, time, memory and work of every method, as ``fvi cost`` measures them.

    Parameters
    ----------
    source
        As for :func:`load`.
    peers
        Measure pycaputo beside the methods, if it is installed.
    progress
        As for :func:`stability`.

    Raises
    ------
    RequestError
        For a sweep, and where nothing is integrated.
    """
    from fvi_cli.runner.cost import measurable, measure_request

    (request,) = measurable([_request(source)], peers=peers)
    return measure_request(request, show_progress=progress)


def hard_cases(
    *, cases: Sequence[str] = (), methods: Sequence[str] = (), progress: bool = False
) -> HardCaseReport:
    """What holds in the hard cases with every method, as ``fvi hard-cases`` measures it.

    Parameters
    ----------
    cases, methods
        Names, as they stand in the report; none: all of them.
    progress
        As for :func:`stability`.

    Raises
    ------
    RequestError
        For names that do not exist.
    """
    from fvi_cli.runner.hard_cases import examine_named

    return examine_named(cases, methods, show_progress=progress)


def export(path: Path | str, form: str, directory: Path | str) -> list[Path]:
    """Write the runs of a result file as ``csv``, ``npz`` or ``mat``, as ``fvi export`` does."""
    from fvi_cli.storage.export import export_file

    return export_file(Path(path), form, Path(directory))


def sandwich_beam(**keys: Any) -> Scene:
    """Scene of a clamped beam with a viscoelastic core, by the keys of ``kind: sandwich-beam``."""
    from fvi_cli.scenes.registry import build_scene

    return build_scene({"kind": "sandwich-beam", **keys})


def _request(
    source: Source, *, overrides: Sequence[str] = (), allow_unstable: bool = False
) -> Request:
    """What a command would be asked for."""
    if isinstance(source, Request):
        return source
    loaded = load(source, overrides=overrides)
    if allow_unstable:
        loaded = allowing_unstable(loaded)
    return Request(name=loaded.name, loaded=loaded)
