"""The one key of a run: what was asked for, and the version of the solver.

Versions of libraries, sources, norms, names and figures are not in the key.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from itertools import chain
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np

from fvi_cli.scenes.records.inputs import digest_of, without_places
from fvi_cli.studies.experiment import Experiment, Run
from fvi_cli.studies.members import with_values

SOLVER_VERSION: Final = 22
"""Raise it whenever the same run gives other numbers; stored runs are then computed again."""

INPUT: Final = "input@"
"""Key of a mapping that stands for a long list of numbers and holds the digest of the list."""
MOST_INLINE: Final = 64
"""Longer lists of numbers are replaced by their digests, so that members share the work."""

METHOD_KEYS: Final = ("method", "n_steps")
"""Settings in which the runs of one variant of an experiment differ."""


_IDENTITIES: WeakKeyDictionary[Run, tuple[int, str]] = WeakKeyDictionary()
"""Keys of runs, which looking up, computing, storing and reading ask for, with the version."""


def canonical_json(value: object) -> str:
    """JSON with sorted keys and without spaces: equal values give equal text."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def sha256(text: str) -> str:
    """Hexadecimal SHA-256 of a text in UTF-8."""
    return hashlib.sha256(text.encode()).hexdigest()


def identity_of(run: Run) -> str:
    """SHA-256 of the settings and the problem of a run, and of :data:`SOLVER_VERSION`.

    A member of a sweep has the identity of the same run without a sweep. A run for a tolerance has
    neither method nor steps, which it chooses.
    """
    known = _IDENTITIES.get(run)
    if known is None or known[0] != SOLVER_VERSION:
        settings = _settings(run.experiment, run.method, run.n_steps)
        text = f"{SOLVER_VERSION} {settings} {canonical_json(_problem(run))}"
        known = _IDENTITIES[run] = (SOLVER_VERSION, sha256(text))
    return known[1]


def reference_identity_of(run: Run) -> str:
    """SHA-256 of the problem and the ladder, which determine the reference of a run."""
    ladder = [sorted(run.experiment.steps), run.experiment.grading]
    return sha256(canonical_json(["reference", SOLVER_VERSION, _problem(run), ladder]))


def variant_of(run: Run) -> tuple[str, str]:
    """Digest and JSON text of what all runs of an experiment share: problem, outputs, swept keys.

    In the problem ``swept`` stands for swept values.
    """
    settings = {key: one for key, one in run.settings().items() if key not in METHOD_KEYS}
    problem = _problem(run, "swept")
    text = canonical_json({**settings, "solver_version": SOLVER_VERSION, "problem": problem})
    return sha256(text)[:12], text


@functools.lru_cache(maxsize=1024)
def _settings(experiment: Experiment, method: Any, n_steps: int) -> str:
    settings = Run(experiment=experiment, method=method, n_steps=n_steps).settings()
    if experiment.accuracy is not None:
        settings = {key: one for key, one in settings.items() if key not in METHOD_KEYS}
    return canonical_json(settings)


def _problem(run: Run, swept: str = "") -> Mapping[str, Any]:
    """The problem of a run, with digests for long lists, and no places of files.

    A word `swept` stands for swept values.
    """
    template = _text_of(run.experiment) if run.member is None else run.member.template
    values = {} if run.member is None else run.member.values
    values = dict.fromkeys(values, swept) if swept else values
    changed = frozenset(path.split(".")[1] for path in values)
    found = with_values(_extracted(template, changed), values)
    return found | {key: extract_lists(without_places(found[key])) for key in changed & {*found}}


@functools.lru_cache(maxsize=64)
def _text_of(experiment: Experiment) -> str:
    return json.dumps(dict(experiment.problem_specification))


@functools.lru_cache(maxsize=64)
def _extracted(template: str, changed: frozenset[str]) -> Mapping[str, Any]:
    """A problem with digests for its long lists, except where members differ."""
    return {
        key: one if key in changed else extract_lists(without_places(one))
        for key, one in json.loads(template).items()
    }


def extract_lists(value: Any) -> Any:
    """JSON values with a digest in place of every long list of numbers, or of rows of numbers."""
    if isinstance(value, Mapping):
        return {key: extract_lists(one) for key, one in value.items()}
    if not isinstance(value, list | tuple):
        return value
    rows = value if value and all(isinstance(one, list | tuple) for one in value) else [value]
    is_even = len({len(row) for row in rows}) == 1
    if is_even and len(rows) * len(rows[0]) > MOST_INLINE:
        kinds = set(map(type, chain.from_iterable(rows)))
        if kinds <= {int, float}:
            return {INPUT: digest_of(np.array(value, dtype="<f8"))}
    return [extract_lists(one) for one in value]
