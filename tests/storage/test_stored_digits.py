"""Five shipped runs to their stored digits: where these change, SOLVER_VERSION must be raised."""

import json
from collections import defaultdict
from pathlib import Path

import numpy as np

import fvi_cli as fvi
from fvi_cli.integrator.method import Method
from fvi_cli.storage import Store, provenance
from fvi_cli.storage.identity import SOLVER_VERSION

DIGITS = Path(__file__).parent / "kept" / "digits.json"
RUNS = {
    "damped-oscillator": (Method(cq="bdf3", degree=2, sampling="nodes"), 64),
    "bagley-torvik-3-2": (Method(cq="gauss", degree=3), 16),
    "pendulum": (Method(cq="lobatto-iiic", degree=3), 32),
    "frame": (Method(cq="gauss", degree=3), 32),
    "duffing": (Method(cq="gauss", degree=2), 64),
}


def digits_of(name: str) -> dict[str, list[float]]:
    """The last positions of a run, and for each coordinate the sum of all."""
    problem = fvi.load(name).experiments[0].problem
    motion = fvi.integrate(problem.scene, *RUNS[name])
    return {"last": motion.position[-1].tolist(), "sum": motion.position.sum(axis=0).tolist()}


def test_the_solver_version_is_raised_when_numbers_change(request):
    made = {"solver_version": SOLVER_VERSION, **{name: digits_of(name) for name in RUNS}}
    if request.config.getoption("--renew"):
        DIGITS.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
    stored = json.loads(DIGITS.read_text(encoding="utf-8"))
    changed = [
        name
        for name in RUNS
        for which, values in made[name].items()
        # the last digits differ between machines
        if not np.allclose(values, stored[name][which], rtol=1e-12, atol=1e-13)
    ]
    is_raised = stored["solver_version"] != SOLVER_VERSION
    assert not changed or is_raised, f"{changed}: raise SOLVER_VERSION, then pytest --renew"
    assert not is_raised, "SOLVER_VERSION was raised: keep the new digits by pytest --renew"


def test_runs_of_other_libraries_are_found(tmp_path, monkeypatch):
    loaded = fvi.load("duffing", overrides=["ladder.steps=[32]"])
    fvi.run(loaded, output=tmp_path)
    monkeypatch.setattr(provenance, "package_versions", lambda: defaultdict(lambda: "9.9"))
    runs = loaded.experiments[0].runs()
    assert len(Store(tmp_path / "duffing.h5").read(runs)) == len(runs)
    assert not [run for one in fvi.recall(tmp_path / "duffing.h5") for run in one.unexpected]
