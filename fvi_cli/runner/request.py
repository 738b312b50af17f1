"""What a command is asked for: configurations, shipped ones by name, or result files."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fvi_cli.config import LoadedConfig, find_config, load_config, load_values
from fvi_cli.errors import FviError, RequestError

STORED_SUFFIX = ".h5"


@dataclass(frozen=True, kw_only=True, eq=False)
class Request:
    """A configuration, and the result file that it was taken from if it was."""

    name: str  # name of the files that are written
    loaded: LoadedConfig  # the configuration
    stored: Path | None = None  # result file that was named in its place; then nothing is computed


Source = str | Path | Mapping[str, Any] | LoadedConfig | Request
"""What a call of the package is given in place of a request."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One thing other than a run that a command would compute, such as a fit."""

    experiment: str
    action: str  # such as "fit zener"
    of: str  # what it is done with: "damping.0.order to decay.csv"


def gather(
    sources: Sequence[str],
    overrides: Sequence[str] = (),
    *,
    results: Callable[[str], Path] | None = None,
) -> list[Request]:
    """Read configurations given as files, as names of shipped ones, or as result files.

    `results` gives the result file for the name of a configuration: a configuration that is stored
    there was checked before, and its members are not checked again.

    Raises
    ------
    StorageError
        For a result file that cannot be read.
    RequestError
        With the mistakes in all of them, names that are neither files nor shipped
        configurations, and names that occur twice.
    """
    requests: list[Request] = []
    mistakes: list[str] = []
    for source in sources:
        try:
            requests.append(_request(source, overrides, results))
        except RequestError as error:
            mistakes.extend(error.complaints)
    if mistakes:
        raise RequestError(*mistakes)
    names = [request.name for request in requests]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RequestError(f"{', '.join(twice)}: given twice; the files would overwrite each other")
    return requests


def _request(
    source: str,
    overrides: Sequence[str],
    results: Callable[[str], Path] | None,
) -> Request:
    path = Path(source) if source.endswith(STORED_SUFFIX) else None
    if path is None:
        found = find_config(source)
        known = None if results is None else _known(found, overrides, results)
        loaded = known or load_config(found, overrides=overrides)
    else:
        # most commands are given no result file, and reading one takes long to import
        from fvi_cli.storage import read_configuration

        # without changes the file's own configuration; with them that of other runs in the file
        values = _as_written(read_configuration(path).resolved)
        loaded = load_values(values, source, overrides=overrides, check_members=bool(overrides))
    return Request(name=loaded.name, loaded=loaded, stored=path)


def _known(
    path: Path, overrides: Sequence[str], results: Callable[[str], Path]
) -> LoadedConfig | None:
    """The configuration if no member has to be checked: it has none, or its result file has it."""
    # mistakes are reported by the caller, which loads it again with all checks
    with contextlib.suppress(FviError):
        loaded = load_config(path, overrides=overrides, check_members=False)
        stored = results(loaded.name)
        if not any(one.members for one in loaded.experiments):
            return loaded
        if stored.exists():
            # most commands need not wait for this import
            from fvi_cli.storage import has_configuration

            is_same = has_configuration(stored, loaded.text, loaded.resolved, loaded.overrides)
            return loaded if is_same else None
    return None


def _as_written(resolved: Mapping[str, Any]) -> dict[str, Any]:
    """A stored configuration in full, a single experiment without a list, as people write it."""
    experiments = resolved["experiments"]
    is_single = len(experiments) == 1 and experiments[0]["name"] == resolved["name"]
    return dict(experiments[0] if is_single else resolved)


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
        values = json.loads(json.dumps(source, default=_plain))
        return load_values(values, str(source.get("name", "mapping")), overrides=overrides)
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


def requested(source: Source, *, overrides: Sequence[str] = ()) -> Request:
    """What a command would be asked for."""
    if isinstance(source, Request):
        return source
    loaded = load(source, overrides=overrides)
    return Request(name=loaded.name, loaded=loaded)
