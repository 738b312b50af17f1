"""From the text of a configuration to experiments."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from fvi_cli.config.build import Built, build_experiment
from fvi_cli.config.members import Choice, choices
from fvi_cli.config.models import LONGEST_NAME, NAME, ExperimentKeys, MemberKeys, SeveralExperiments
from fvi_cli.config.text.mistakes import Report
from fvi_cli.config.text.overrides import apply_overrides
from fvi_cli.config.text.tree import LARGEST_TEXT, Document, MistakesError, Place, read_document
from fvi_cli.errors import ConfigError, excerpt
from fvi_cli.scenes.keys.mistakes import describe, mistakes_of
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.members import with_values


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


def load_config(path: Path, *, overrides: Sequence[str] = ()) -> LoadedConfig:
    """Read and check a configuration file (YAML in UTF-8) with changes ``key.path=value``.

    Raises
    ------
    ConfigError
        Every mistake at once, each as ``file:line:column: key.path: message``.
    """
    source = excerpt(str(path), 1000)
    try:
        with path.open("rb") as file:
            content = file.read(4 * LARGEST_TEXT + 1)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise ConfigError(f"{source}: cannot be read: {reason}") from None
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8-sig")
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        words = f"not UTF-8 (byte 0x{content[error.start]:02x}); save the file as UTF-8"
        raise ConfigError(f"{Place(source, line, column)}: {words}") from None
    return parse_config(text, str(path), base=path.parent, overrides=overrides)


def parse_config(
    text: str,
    source_name: str,
    *,
    base: Path | None = None,
    overrides: Sequence[str] = (),
) -> LoadedConfig:
    """Check the text of a configuration and build its experiments, as :func:`load_config` does.

    Mistakes name the text by `source_name`, whose stem is the default name; relative paths begin
    in the folder `base`, or in that of the process.
    """
    try:
        document = read_document(text, excerpt(source_name, 1000))
    except MistakesError as error:
        raise ConfigError(*map(str, sorted(error.mistakes))) from None
    return _loaded(document, text, source_name, base, overrides)


def load_values(
    values: Mapping[str, Any],
    source_name: str,
    *,
    base: Path | None = None,
    overrides: Sequence[str] = (),
) -> LoadedConfig:
    """Build the experiments of JSON values, as :func:`parse_config` does from a text.

    There is no limit on their size.
    """
    text = json.dumps(values, indent=1)
    document = Document(excerpt(source_name, 1000), json.loads(text))
    return _loaded(document, text, source_name, base, overrides)


def _loaded(
    document: Document,
    text: str,
    source_name: str,
    base: Path | None,
    overrides: Sequence[str],
) -> LoadedConfig:
    report = Report(document)
    report.found += apply_overrides(document, overrides)
    if not isinstance(document.value, dict):
        words = "it must be a mapping with name, problem, method and ladder, or with experiments"
        report.add(f"{describe(document.value)} is not allowed; {words}")
        raise report.error()
    context = {"folder": base or Path(), "files": {}}
    several = "experiments" in document.value
    name = _name(document.value, Path(source_name).stem, report)
    if several:
        try:
            SeveralExperiments.model_validate(document.value)
        except ValidationError as error:
            report.extend(mistakes_of(error))
    built: list[Built | None] = []
    names: dict[str, int] = {}
    given = document.value.get("experiments", [document.value])
    for number, values in enumerate(given if isinstance(given, list) else ()):
        if not isinstance(values, dict):
            continue
        under = report.under("experiments", number) if several else report
        own = values.get("name", "" if several else name)
        if several and "name" not in values:
            under.add("missing: the name of the experiment; file names come from it", "name")
        # file systems that ignore case would confuse names that differ in case only
        first = names.setdefault(str(own).lower(), number)
        if first != number and own:
            under.add(f"{own!r} is the name of experiments.{first} already", "name")
        built.append(_read(values, str(own), under, context))
    if len(report) or None in built:
        raise report.error()
    found = [one for one in built if one is not None]
    return LoadedConfig(
        path=Path(source_name),
        name=name,
        text=text,
        resolved={"name": name, "experiments": [one.resolved for one in found]},
        experiments=tuple(one.experiment for one in found),
        overrides=tuple(overrides),
    )


def _name(values: Mapping[str, Any], stem: str, report: Report) -> str:
    """The name of a file; without one its stem."""
    if "name" not in values and not is_name(stem):
        words = f"missing; the name of the file, {excerpt(stem)!r}, cannot stand in for it: it "
        report.add(words + "must be letters, digits, - and _", "name")
    return str(values.get("name", stem))


def is_name(text: str) -> bool:
    """Whether a text can be the name of an experiment, and so part of a file name."""
    return len(text) <= LONGEST_NAME and re.fullmatch(NAME, text) is not None


def _read(
    values: dict[str, Any], name: str, report: Report, context: Mapping[str, Any]
) -> Built | None:
    """The experiment of a mapping; what is wrong between keys is told where these are right."""
    before, first = len(report), Choice()
    given = values.get("problem") or {}
    members = {key: values[key] for key in ("designs", "sweep") if key in values}
    if members:
        # mistakes of these keys are told below
        with contextlib.suppress(ValidationError):
            first = next(choices(MemberKeys.model_validate(members)))
    try:
        if first.changes:
            values = {**values, "problem": with_values(given, first.changes)}
        keys = ExperimentKeys.model_validate(values, context=context)
    except LookupError as error:
        report.extend([first.lost(error)])
    except ValidationError as error:
        report.extend(map(first.placed, mistakes_of(error)))
    if len(report) > before:
        return None
    return build_experiment(keys, name, report, context, given, first)
