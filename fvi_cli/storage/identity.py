"""The one key of a run: what was asked for, and the version of the solver.

Versions of libraries, sources, norms, names and figures are not in the key.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from typing import Any, Final
from weakref import WeakKeyDictionary

from fvi_cli.scenes.records.inputs import without_places
from fvi_cli.studies.experiment import Experiment, Run
from fvi_cli.studies.members import with_values

SOLVER_VERSION: Final = 23
"""Raise it whenever the same run gives other numbers; stored runs are then computed again."""

METHOD_KEYS: Final = ("method", "n_steps")
"""Settings in which the runs of one variant of an experiment differ."""

_IDENTITIES: WeakKeyDictionary[Run, str] = WeakKeyDictionary()
"""Keys of runs, which looking up, computing, storing and reading ask for."""


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
    if run not in _IDENTITIES:
        settings = _settings(run.experiment, run.method, run.n_steps)
        problem = canonical_json(_problem(run))
        _IDENTITIES[run] = sha256(f"{SOLVER_VERSION} {settings} {problem}")
    return _IDENTITIES[run]


def reference_identity_of(run: Run) -> str:
    """SHA-256 of the problem and the ladder, which determine the reference of a run."""
    ladder = [sorted(run.experiment.steps), run.experiment.grading]
    return sha256(canonical_json(["reference", SOLVER_VERSION, _problem(run), ladder]))


def variant_of(run: Run) -> tuple[str, str]:
    """Digest and JSON text of what all runs of an experiment share: problem, outputs, swept keys.

    In the problem ``swept`` stands for swept values.
    """
    settings = {key: one for key, one in run.settings().items() if key not in METHOD_KEYS}
    swept = {} if run.member is None else dict.fromkeys(run.member.values, "swept")
    problem = without_places(with_values(run.experiment.problem_specification, swept))
    text = canonical_json({**settings, "solver_version": SOLVER_VERSION, "problem": problem})
    return sha256(text)[:12], text


@functools.lru_cache(maxsize=1024)
def _settings(experiment: Experiment, method: Any, n_steps: int) -> str:
    settings = Run(experiment=experiment, method=method, n_steps=n_steps).settings()
    if experiment.accuracy is not None:
        settings = {key: one for key, one in settings.items() if key not in METHOD_KEYS}
    return canonical_json(settings)


def _problem(run: Run) -> Mapping[str, str]:
    """The digests of all values in the problem of a run; members share those of long lists."""
    shared, values = _digests(run.experiment), run.member.values if run.member else {}
    changed = {path.split(".")[1] for path in values}
    problem = with_values(run.experiment.problem_specification, values)
    return {k: _digest(one) if k in changed else shared[k] for k, one in problem.items()}


@functools.lru_cache(maxsize=64)
def _digests(experiment: Experiment) -> Mapping[str, str]:
    return {key: _digest(one) for key, one in experiment.problem_specification.items()}


def _digest(value: Any) -> str:
    return sha256(canonical_json(without_places(value)))
