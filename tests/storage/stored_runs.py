"""Runs with made-up numbers, stored; and files compared before and after."""

import hashlib
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from made_runs import made_experiment, made_run

from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.trajectory import NewtonRecord
from fvi_cli.scenes.registry import build_problem
from fvi_cli.storage import list_runs, open_results, read_results
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run

SPECIFICATION: dict[str, Any] = {
    "kind": "bagley-torvik",
    "damping": [{"order": 0.5, "coefficient": 1.0}],
    "forcing": "6*t + 6/gamma(3.5)*t**2.5 + t**3",
    "final_time": 1.0,
    "exact": "t**3",
}
BDF = Method(cq="bdf2", degree=1, sampling="nodes")
WEIGHTS = Method(cq="bdf3", degree=2, start="weights", start_exponents=(2.5,))
GAUSS = Method(cq="gauss", degree=3, start="graded")
EULER = Baseline(name="implicit-euler")
METHODS = (BDF, WEIGHTS, GAUSS, EULER)
TEXT = "# gamma = ½\nname: sample\n" + "# filling\n" * 10_000  # more than HDF5 keeps in a header


def configuration(**changes: Any) -> SimpleNamespace:
    resolved = {"name": "sample", "experiments": [SPECIFICATION]}
    return SimpleNamespace(
        **{"text": TEXT, "resolved": resolved, "overrides": ("a.b=1",), **changes}
    )


def experiment(
    methods: Sequence[Any] = METHODS, steps: Sequence[int] = (4, 8), **changes: Any
) -> Experiment:
    stiffness = changes.pop("stiffness", 1.0)
    exact = SPECIFICATION["exact"] if stiffness == 1.0 else "auto"
    specification = {**SPECIFICATION, "stiffness": stiffness, "exact": exact}
    own = {"name": "sample", "problem_specification": specification, **changes}
    return made_experiment(methods, steps, build_problem(specification), **own)


def made_up(run: Run, *, dimension: int = 2, **changes: Any) -> FinishedRun:
    """Numbers with nothing regular in them, which belong to the run."""
    random = np.random.default_rng(run.n_steps)
    n = run.n_steps + 1
    values = {
        "time": np.linspace(0, 1, n),
        "position": random.normal(size=(n, dimension)),
        "momentum": None if run.method == EULER else random.normal(size=(n, dimension)),
        "energy": None if run.method == EULER else random.normal(size=n),
        "history_operations": 7 * n,
        "newton": NewtonRecord(iterations=5, largest=3),
        "setup_seconds": 0.25,
        "stepping_seconds": 0.125,
        "remarks": ("the start fell back: ½ a step", "another"),
        "coordinates": run.problem.coordinates,
        "error": 1 / 3 / n,
        "floor": 1e-14,
        "predicted": "stable",
        "expected_order": 1.5,
    }
    return made_run(run, **{**values, **changes})


def made_runs(*arguments: Any, **changes: Any) -> list[FinishedRun]:
    return [made_up(run) for run in experiment(*arguments, **changes).runs()]


def assert_same(one: Any, other: Any) -> None:
    """Every field of two values, bit by bit."""
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if field.name in ("trajectory", "newton"):
            assert_same(a, b)
        elif isinstance(a, np.ndarray):
            assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), field.name
        else:
            assert type(a) is type(b), field.name
            assert a == b or (a != a and b != b), field.name


def added(folder: Path, runs: list[FinishedRun]) -> None:
    """Runs in the journal, one after the other."""
    with open_results(folder, "sample") as results:
        for finished in runs:
            results.add([finished])


def store(folder: Path, runs: list[FinishedRun], **keywords: Any) -> Path:
    with open_results(folder, "sample", **keywords) as results:
        for finished in runs:
            results.add([finished])
        path = results.consolidate(configuration())
    assert path == folder / "sample.h5"
    return path


def tree(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and not p.name.endswith(".lock")
    }


def places(path: Path) -> set[tuple[str, str, int]]:
    return {(run.experiment, run.case, run.n_steps) for run in list_runs(path).runs}


def found_in(folder: Path, runs: list[FinishedRun]) -> list[bool]:
    """Which of the runs are there, as they were."""
    found = []
    with read_results(folder / "sample.h5", may_be_missing=True) as results:
        for finished in runs:
            one = results.finished(finished.run)
            found.append(one is not None)
            if one is not None:
                assert_same(one, finished)
    return found
