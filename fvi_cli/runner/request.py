"""What a command is asked for: configurations, shipped ones by name, or result files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fvi_cli.config import LoadedConfig, find_config, load_config, load_values
from fvi_cli.errors import RequestError

STORED_SUFFIX = ".h5"

Source = str | Path | Mapping[str, Any] | LoadedConfig
"""What a call of the package is given in place of a configuration."""


def gather(sources: Sequence[str], overrides: Sequence[str] = ()) -> list[LoadedConfig]:
    """Read configurations given as files, as names of shipped ones, or as result files.

    Raises
    ------
    StorageError
        For a result file that cannot be read.
    RequestError
        With the mistakes in all of them, names that are neither files nor shipped
        configurations, and names that occur twice.
    """
    configs: list[LoadedConfig] = []
    mistakes: list[str] = []
    for source in sources:
        try:
            configs.append(load(source, overrides=overrides))
        except RequestError as error:
            mistakes.extend(error.complaints)
    if mistakes:
        raise RequestError(*mistakes)
    names = [config.name for config in configs]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise RequestError(f"{', '.join(twice)}: given twice; the files would overwrite each other")
    return configs


def load(source: Source, *, overrides: Sequence[str] = ()) -> LoadedConfig:
    """Read and check a configuration.

    Parameters
    ----------
    source
        A file, the name of a shipped configuration, a result file for the configuration that made
        it, or what would stand in the file as a mapping (with its ``name``); NumPy arrays and
        numbers in it stand for lists and numbers.
    overrides
        Changes ``key.path=value`` as of ``--set``, one or a list, validated like the rest.

    Raises
    ------
    ConfigError
        Every mistake at once.
    RequestError
        For a name that is neither a file nor a shipped configuration.
    StorageError
        For a result file that cannot be read.
    """
    if isinstance(overrides, str):
        overrides = [overrides]
    if isinstance(source, LoadedConfig):
        if overrides:
            raise RequestError("overrides: give them when the configuration is first loaded")
        return source
    if isinstance(source, Mapping):
        values = json.loads(json.dumps(source, default=_plain))
        return load_values(values, str(source.get("name", "mapping")), overrides=overrides)
    if str(source).endswith(STORED_SUFFIX):
        return _stored(Path(source), overrides)
    return load_config(find_config(str(source)), overrides=overrides)


def _stored(path: Path, overrides: Sequence[str]) -> LoadedConfig:
    """The configuration of a result file, or with changes that of other runs in it."""
    # most commands are given no result file, and reading one takes long to import
    from fvi_cli.storage import read_configuration

    values = read_configuration(path).resolved
    (first, *others) = values["experiments"]
    # a single experiment stands without a list, as people write it
    is_single = not others and first["name"] == values["name"]
    return load_values(first if is_single else values, str(path), overrides=overrides)


def is_stored(config: LoadedConfig) -> bool:
    """Whether a configuration was read from a result file: then nothing is computed."""
    return config.path.suffix == STORED_SUFFIX


def file_of(config: LoadedConfig, output: Path | str | None) -> Path | None:
    """Where the runs of a configuration are, or would be, stored; None: nowhere."""
    if is_stored(config):
        return config.path
    return None if output is None else Path(output) / f"{config.name}{STORED_SUFFIX}"


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
