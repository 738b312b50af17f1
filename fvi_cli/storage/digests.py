"""Digests of runs, by which they are looked up, and of long lists of numbers (inputs).

The digest of a run covers all that determines its numbers; norms, names, figures, fits and
permissions do not.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Callable, Mapping
from itertools import chain
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.scenes.records.inputs import (
    digest_of,
    inputs_in,
    is_file,
    is_kept,
    keep_numbers,
    numbers_of,
    without_places,
)
from fvi_cli.studies.experiment import Experiment, Run
from fvi_cli.studies.members import with_values, without_values

FORMAT = 4
"""Number of the file format; a program reads files of its own number."""

SOLVER_VERSION = 20
"""Raise it whenever the same run gives other numbers; stored runs are then computed again."""

INPUT: Final = "input@"
"""Key of a mapping that replaces a long list of numbers and holds the digest of the list."""

MOST_INLINE: Final = 64
"""Up to so many numbers of a list are written in place; longer lists are kept once, by digest."""

Inputs = dict[str, NDArray[Any]]
"""Lists of numbers by their digest."""


def canonical_json(value: object) -> str:
    """JSON with sorted keys and without spaces: equal values give equal text."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def sha256(text: str) -> str:
    """Hexadecimal SHA-256 of a text in UTF-8."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def identity_of(run: Run) -> str:
    """SHA-256 of what was asked: the settings and the problem of a run, and the solver's version.

    A run for a tolerance has the identity of the search that chooses its method and steps.
    """
    settings = _settings_text(run.experiment, run.method, run.n_steps)
    return sha256(f"{SOLVER_VERSION} {settings}{canonical_json(problem_of(run))}")


def specification_of(run: Run) -> tuple[str, Inputs]:
    """The specification of a run as JSON text, and the long lists that it names by digest.

    For a member of a sweep ``swept`` replaces the swept values: it is equal for all members.
    """
    return _specification(run.experiment, run.method, run.n_steps, *_template_of(run))


@functools.lru_cache(maxsize=256)
def _specification(
    experiment: Experiment, method: Any, n_steps: int, template: str, keys: tuple[str, ...]
) -> tuple[str, Inputs]:
    settings = Run(experiment=experiment, method=method, n_steps=n_steps).settings()
    problem, inputs = _stowed_template(template, _changed(keys))
    own = {"problem": without_values(problem, keys), "solver_version": SOLVER_VERSION}
    return canonical_json({**own, **settings}), inputs


@functools.lru_cache(maxsize=1024)
def _settings_text(experiment: Experiment, method: Any, n_steps: int) -> str:
    settings = Run(experiment=experiment, method=method, n_steps=n_steps).settings()
    if experiment.accuracy is not None:
        del settings["method"], settings["n_steps"]
    return canonical_json(settings)


def problem_template_of(run: Run) -> tuple[Mapping[str, Any], Inputs]:
    """The problem with ``swept`` in place of swept values, and the long lists that it names."""
    template, keys = _template_of(run)
    problem, inputs = _stowed_template(template, _changed(keys))
    return without_values(problem, keys), inputs


def problem_of(run: Run) -> Mapping[str, Any]:
    """The problem of a run, with digests in place of its long lists and of places of files."""
    template, keys = _template_of(run)
    changed = _changed(keys)
    found = _placeless_template(template, changed)
    if run.member is None:
        return found
    own = with_values(found, run.member.values)
    return own | {
        name: without_places(extract_inputs(own[name])) for name in changed if name in own
    }


@functools.lru_cache(maxsize=64)
def _placeless_template(template: str, changed: frozenset[str]) -> Mapping[str, Any]:
    """A problem with its lists extracted and without places of files, but where members differ."""
    found = _stowed_template(template, changed)[0]
    return {key: one if key in changed else without_places(one) for key, one in found.items()}


def _template_of(run: Run) -> tuple[str, tuple[str, ...]]:
    """A problem as JSON text, and the keys in which members that share it differ."""
    if run.member is None:
        return _text_of(run.experiment), ()
    return run.member.template, tuple(run.member.values)


@functools.lru_cache(maxsize=64)
def _text_of(experiment: Experiment) -> str:
    return json.dumps(dict(experiment.problem_specification))


@functools.lru_cache(maxsize=64)
def _changed(keys: tuple[str, ...]) -> frozenset[str]:
    """The first-level keys below ``problem`` in which members differ."""
    return frozenset(path.split(".")[1] for path in keys)


@functools.lru_cache(maxsize=64)
def _stowed_template(template: str, changed: frozenset[str]) -> tuple[Mapping[str, Any], Inputs]:
    """A problem with its lists extracted, except where members differ; and the lists."""
    values = json.loads(template)
    inputs = dict(inputs_in(values))
    return {k: v if k in changed else extract_inputs(v, inputs) for k, v in values.items()}, inputs


def extract_inputs(value: Any, inputs: Inputs | None = None) -> Any:
    """JSON values with a digest in place of every long list.

    The lists, and the numbers of files, are added to `inputs`.
    """
    if isinstance(value, Mapping):
        if inputs is not None and is_file(value):
            inputs[value["digest"]] = numbers_of(value)
        return {key: extract_inputs(one, inputs) for key, one in value.items()}
    if not isinstance(value, list | tuple):
        return value
    numbers = _numbers(value)
    if numbers is None:
        return [extract_inputs(one, inputs) for one in value]
    digest = digest_of(numbers)
    if inputs is not None:
        inputs[digest] = numbers
    return {INPUT: digest}


def _numbers(value: list[Any] | tuple[Any, ...]) -> NDArray[Any] | None:
    """A long list, or list of lists, as an array; None where an array would change its values."""
    rows = value if value and all(isinstance(one, list | tuple) for one in value) else [value]
    if len({len(row) for row in rows}) != 1 or len(rows) * len(rows[0]) <= MOST_INLINE:
        return None
    kinds = set(map(type, chain.from_iterable(rows)))
    if kinds == {float} or (kinds == {int} and all(abs(n) < 2**63 for n in chain(*rows))):
        return np.array(value, dtype="<f8" if kinds == {float} else "<i8")
    return None


def insert_inputs(value: Any, lookup: Callable[[str], NDArray[Any] | None]) -> Any:
    """The inverse of :func:`extract_inputs`; KeyError for a list that `lookup` does not know."""
    if isinstance(value, Mapping):
        if value.keys() != {INPUT}:
            if is_file(value) and not is_kept(value["digest"]):
                numbers = lookup(value["digest"])
                if numbers is None or keep_numbers(numbers) != value["digest"]:
                    raise KeyError(value["digest"])
            return {key: insert_inputs(one, lookup) for key, one in value.items()}
        found = lookup(value[INPUT])
        if found is None:
            raise KeyError(value[INPUT])
        return found.tolist()
    return [insert_inputs(one, lookup) for one in value] if isinstance(value, list) else value
