"""From the text of a configuration to experiments."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fvi_cli.config.experiment import ReadExperiment, make_experiment
from fvi_cli.config.keys.experiment import NAME, SEVERAL, SINGLE
from fvi_cli.config.keys.sweep import Sweep
from fvi_cli.config.members import experiment_cursors, first_members
from fvi_cli.config.text.document import LARGEST_DOCUMENT, read_document
from fvi_cli.config.text.overrides import apply_overrides
from fvi_cli.errors import ConfigError
from fvi_cli.keys.complaints import ChecksMember, Complaints, SourcePosition, every_member, excerpt
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.nodes import ListNode, MappingNode, Node, ScalarNode, describe, node_of
from fvi_cli.studies.experiment import Experiment


@dataclass(frozen=True, kw_only=True, eq=False)
class LoadedConfig:
    """A valid configuration."""

    path: Path  # the path of the file, as it was given
    name: str  # names of result files are derived from it
    text: str  # the contents of the file
    # JSON values ``{"name": ..., "experiments": [...]}`` with every default filled in and every
    # override applied; written as YAML it is a configuration of the same experiments
    resolved: Mapping[str, Any]
    experiments: tuple[Experiment, ...]  # the experiments that the file describes
    overrides: tuple[str, ...] = ()  # changes ``key.path=value`` of the command


def load_config(
    path: Path, *, overrides: Sequence[str] = (), checks_member: ChecksMember = every_member
) -> LoadedConfig:
    """Read and check a configuration file (YAML in UTF-8) with changes ``key.path=value``.

    `checks_member(number)` says whether a member of a sweep is checked.

    Raises
    ------
    ConfigError
        Every mistake at once, each as ``file:line:column: key.path: message``.
    """
    source = excerpt(str(path), 1000)
    try:
        with path.open("rb") as file:
            content = file.read(4 * LARGEST_DOCUMENT + 1)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise ConfigError(f"{source}: cannot be read: {reason}") from None
    if len(content) > LARGEST_DOCUMENT:
        raise ConfigError(f"{source}:1:1: more than {LARGEST_DOCUMENT} bytes: too large")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8-sig")
        place = SourcePosition(
            source=source,
            line=before.count("\n") + 1,
            column=len(before) - (before.rfind("\n") + 1) + 1,
        )
        raise ConfigError(
            f"{place}: not UTF-8 (byte 0x{content[error.start]:02x}); save the file as UTF-8"
        ) from None
    return parse_config(
        text, str(path), base=path.parent, overrides=overrides, checks_member=checks_member
    )


def parse_config(
    text: str,
    source_name: str,
    *,
    base: Path | None = None,
    overrides: Sequence[str] = (),
    checks_member: ChecksMember = every_member,
    is_json: bool = False,
) -> LoadedConfig:
    """Check the text of a configuration and build its experiments, as :func:`load_config` does.

    Complaints name the text by `source_name`, whose stem is the default name; relative paths begin
    in the folder `base`, or in that of the process.
    """
    complaints = Complaints(folder=base, checks_member=checks_member)
    start = SourcePosition(source=excerpt(source_name, 1000), line=1, column=1)
    root = read_document(text, start, complaints, is_json=is_json)
    return _loaded(root, text, source_name, start, complaints, overrides)


def load_stored(
    values: Mapping[str, Any],
    source_name: str,
    *,
    overrides: Sequence[str] = (),
    checks_member: ChecksMember = every_member,
) -> LoadedConfig:
    """Build the experiments of a resolved configuration, as :func:`parse_config` does from a text.

    There is no limit on its size, since the program itself has written it.
    """
    complaints = Complaints(checks_member=checks_member)
    start = SourcePosition(source=excerpt(source_name, 1000))
    text = json.dumps(values)
    return _loaded(node_of(values, start), text, source_name, start, complaints, overrides)


def _loaded(
    root: Node | None,
    text: str,
    source_name: str,
    start: SourcePosition,
    complaints: Complaints,
    overrides: Sequence[str],
) -> LoadedConfig:
    if isinstance(root, ScalarNode) and root.value is None:
        complaints.add(start, (), "the configuration is empty; `fvi new` writes one")
    elif isinstance(root, ScalarNode | ListNode):
        complaints.add(
            root.place,
            (),
            f"{describe(root)} is not allowed; it must be a mapping with "
            "name, problem, method and ladder, or with experiments",
        )
    if not isinstance(root, MappingNode):
        raise complaints.error()
    changed, sweeps = first_members(apply_overrides(root, overrides, complaints), complaints)
    name, read = _read(changed, sweeps, Path(source_name).stem, complaints)
    complaints.raise_if_any()
    experiments = tuple(experiment for _, experiment in read if experiment is not None)
    if len(experiments) != len(read) or not isinstance(name, str):
        raise ConfigError(f"{start}: cannot be used")  # pragma: no cover - said above
    return LoadedConfig(
        path=Path(source_name),
        name=name,
        text=text,
        resolved={"name": name, "experiments": [resolved for resolved, _ in read]},
        experiments=experiments,
        overrides=tuple(overrides),
    )


def _read(
    root: Node, sweeps: Sequence[Sweep | None], stem: str, complaints: Complaints
) -> tuple[Any, list[ReadExperiment]]:
    at = Cursor(node=root, complaints=complaints)
    several = at.has("experiments")
    values = (SEVERAL if several else SINGLE).read(at)
    name = values.get("name", stem)
    if "name" not in values and not NAME.allows(stem):
        at.refuse(
            f"missing; the name of the file, {excerpt(stem)!r}, cannot "
            f"stand in for it: it must be {NAME.expected}",
            "name",
        )
    read: list[ReadExperiment] = []
    inner = values["experiments"] if several else [values]
    if not isinstance(inner, list):
        return name, read
    seen: dict[str, int] = {}
    for index, (entry, one, sweep) in enumerate(
        zip(inner, experiment_cursors(root, complaints), sweeps, strict=True)
    ):
        if not isinstance(entry, Mapping):
            continue
        own = entry["name"] if several else name
        read.append(make_experiment(entry, own, one, sweep))
        if isinstance(own, str):
            # file systems that ignore case would confuse names that differ in case only
            if own.lower() in seen:
                taken = f"experiments.{seen[own.lower()]}"
                one.refuse(f"{own!r} is the name of {taken} already", "name")
            seen.setdefault(own.lower(), index)
    return name, read
