"""What a command is asked for: configurations, shipped ones by name, or result files."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fvi_cli.config import LoadedConfig, find_config, load_config, parse_config
from fvi_cli.errors import RequestError
from fvi_cli.keys.complaints import ChecksMember, every_member, no_member

if TYPE_CHECKING:
    from fvi_cli.storage import StoredConfiguration

STORED_SUFFIX = ".h5"


@dataclass(frozen=True, kw_only=True, eq=False)
class Request:
    """A configuration, and the result file that it was taken from if it was.

    Parameters
    ----------
    name
        Name of the files that are written.
    loaded
        The configuration.
    stored
        Result file that was named in its place; then nothing is computed.
    """

    name: str
    loaded: LoadedConfig
    stored: Path | None = None


def gather(
    sources: Sequence[str],
    overrides: Sequence[str] = (),
    *,
    allow_unstable: bool = False,
    checks_member: ChecksMember = every_member,
) -> list[Request]:
    """Read configurations given as files, as names of shipped ones, or as result files.

    Members of a sweep are checked if `checks_member` says so, by their number; those of a result
    file were checked before it was made.

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
            requests.append(
                _request(source, overrides, checks_member, allow_unstable=allow_unstable)
            )
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
    source: str, overrides: Sequence[str], checks_member: ChecksMember, *, allow_unstable: bool
) -> Request:
    path = Path(source) if source.endswith(STORED_SUFFIX) else None
    if path is None:
        loaded = load_config(find_config(source), overrides=overrides, checks_member=checks_member)
    else:
        # most commands are given no result file, and reading one takes long to import
        from fvi_cli.storage import read_configuration

        # the file's own configuration, or with changes that of other runs in it
        loaded = parse_config(
            _as_written(read_configuration(path)),
            source,
            overrides=overrides,
            checks_member=every_member if overrides else no_member,
        )
    if allow_unstable:
        loaded = allowing_unstable(loaded)
    return Request(name=loaded.name, loaded=loaded, stored=path)


def _as_written(configuration: StoredConfiguration) -> str:
    """A stored configuration in full, a single experiment without a list, as people write it."""
    resolved = json.loads(configuration.resolved)
    experiments = resolved["experiments"]
    is_single = len(experiments) == 1 and experiments[0]["name"] == resolved["name"]
    return json.dumps(experiments[0]) if is_single else configuration.resolved


def allowing_unstable(loaded: LoadedConfig) -> LoadedConfig:
    """The configuration as if ``allow_unstable`` stood in every experiment; files say so."""
    is_single = len(loaded.experiments) == 1 and loaded.experiments[0].name == loaded.name
    prefixes = [""] if is_single else [f"experiments.{k}." for k in range(len(loaded.experiments))]
    resolved = [{**one, "allow_unstable": True} for one in loaded.resolved["experiments"]]
    return dataclasses.replace(
        loaded,
        experiments=tuple(dataclasses.replace(e, allow_unstable=True) for e in loaded.experiments),
        resolved={**loaded.resolved, "experiments": resolved},
        overrides=(*loaded.overrides, *(f"{prefix}allow_unstable=true" for prefix in prefixes)),
    )
