"""What people do, each as a multiple of the integration in it, measured in one process."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import fvi_cli as fvi
from benchmarks.measuring import (
    Action,
    Figure,
    figure_of,
    in_own_process,
    processor_seconds,
    yardstick_seconds,
)

GAUSS2 = {"rk": "gauss", "degree": 2}


def _compared(name: str, goal: float, work: Action, reference: Action) -> Figure:
    """Least processor seconds of three calls in turn, as a ratio."""
    reference()
    pairs = [(processor_seconds(work), processor_seconds(reference)) for _ in range(3)]
    ours, theirs = (min(own) for own in zip(*pairs, strict=True))
    return figure_of(name, goal, ours, theirs)


@contextmanager
def _columns(**columns: Any) -> Iterator[str]:
    """Path of a CSV file with these columns."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "columns.csv"
        values = np.column_stack(list(columns.values()))
        np.savetxt(path, values, delimiter=",", header=",".join(columns), comments="")
        yield str(path)


def building_row(size: int = 300, samples: int = 4000) -> Figure:
    """A tall building under a drawn record, with and without quantities of a few storeys."""
    times = 0.005 * np.arange(samples + 1)
    ground = np.random.default_rng(1).normal(size=times.size) * np.exp(-0.2 * times)
    asked = {
        "output": {"step": 0.01},
        "quantities": {"drift": "x2 - x1", "top": f"ax{size}", "load": "force_1"},
    }
    with _columns(t=times, a=ground) as path:
        bare = {
            "problem": {
                "kind": "frame",
                "masses": np.full(size, 2.0e5),
                "stiffnesses": np.full(size, 4.0e8),
                "dampers": [{"storey": 1, "order": 0.6, "coefficient": 3.0e7}],
                "ground_acceleration": {"file": path, "column": "a", "time": "t", "scale": 9.81},
                "final_time": float(times[-1]),
                "exact": "none",
            },
            "method": GAUSS2,
            "ladder": {"steps": [samples]},
        }
        without = fvi.load({"name": "bare", **bare})
        observed = fvi.load({"name": "observed", **bare, **asked})
        return _compared(
            f"{size} storeys, {samples} samples: output and three quantities / the run without",
            1.5,
            lambda: fvi.run(observed),
            lambda: fvi.run(without),
        )


def members_row(name: str, goal: float, sweep: Any, **asked: Any) -> Figure:
    """Driven oscillators with fractional damping by ``fvi.run``, and in one batch."""
    config = fvi.load(
        {
            "name": "duffing",
            "problem": {
                "kind": "duffing",
                "stiffness": -1.0,
                "cubic_stiffness": 1.0,
                "damping": [{"order": 0.6, "coefficient": 0.25}],
                "parameters": {"F": 0.3},
                "forcing": "F*cos(1.1*t)",
                "initial": {"position": 0.5},
                "final_time": 60.0,
                "exact": "none",
            },
            "sweep": sweep,
            "method": {"rk": "gauss", "degree": 4},
            "ladder": {"steps": [480]},
            **asked,
        }
    )
    (experiment,) = config.experiments
    scenes = [scene for run in experiment.runs() if (scene := run.problem.scene)]
    return _compared(
        f"{name}: fvi.run / integrate_members",
        goal,
        lambda: fvi.run(config),
        lambda: fvi.integrate_members(scenes, "gauss4", 480),
    )


def sweep_row(number: int = 60) -> Figure:
    """A sweep."""
    drives = np.linspace(0.2, 0.4, number).tolist()
    return members_row(f"{number} Duffing members", 1.3, {"problem.parameters.F": drives})


def bifurcation_row(number: int = 40) -> Figure:
    """A bifurcation diagram: an event in every period of the drive."""
    drives = np.linspace(0.2, 0.4, number).tolist()
    events = {"period": {"when": "sin(1.1*t)", "direction": "rising"}}
    sweep = {"problem.parameters.F": drives}
    return members_row(f"bifurcation of {number} drives", 2.0, sweep, events=events)


def ensemble_row(number: int = 200) -> Figure:
    """An ensemble of random starts with output and a quantity."""
    starts = (0.5 + 1e-3 * np.random.default_rng(2).normal(size=number)).tolist()
    asked = {"output": {"step": 0.1}, "quantities": {"speed": "vx"}}
    sweep = [{"problem.initial.position": start} for start in starts]
    return members_row(f"ensemble of {number} starts", 2.0, sweep, **asked)


LAWS: Mapping[str, Mapping[str, Any]] = {
    "zener": {"law": "zener", "order": 0.5, "time": 0.5, "relaxed": 1.0e5, "unrelaxed": 3.0e5},
    "maxwell": {"law": "maxwell", "order": 0.5, "time": 0.5, "modulus": 3.0e5},
    "springpot": {"order": 0.5, "coefficient": 1.0e5},
    "kelvin-voigt": {"law": "kelvin-voigt", "stiffness": 1.0e5, "coefficient": 1.0e4},
}


def _model(start: Mapping[str, Any]) -> dict[str, Any]:
    """All numbers of a law as parameters of a fit."""
    ranges = {
        f"problem.law.{key}": {"from": 0.05, "to": 0.95} if key == "order" else {"from": 0.0}
        for key in start
        if key != "law"
    }
    return {"set": {"problem.law": dict(start)}, "parameters": ranges}


def fit_row(samples: int = 1500) -> Figure:
    """Four laws fitted to a bench test; transforms of 2^20 numbers are what it is measured by."""
    times = np.linspace(0.0, 12.0, samples)
    moved = 0.01 * np.sin(4.0 * times) * (1.0 + times / 6.0)
    law = {"law": "zener", "order": 0.6, "time": 0.3, "relaxed": 5.0e4, "unrelaxed": 4.0e5}
    models = {name: _model(start) for name, start in LAWS.items()}
    first = {"parameters": models["zener"]["parameters"]}
    with _columns(t=times, u=moved) as path:
        displacement = {"file": path, "column": "u", "time": "t"}
        bench = {
            "name": "bench",
            "problem": {"kind": "material", "law": law, "displacement": displacement},
            "method": "gauss4",
            "ladder": {"steps": [samples - 1]},
        }
        asked = {"output": {"times": times.tolist()}, "quantities": {"f": "force"}}
        (made,) = fvi.run(fvi.load({**bench, **asked}))
        force = made.to_dataframe("motions")["f"].to_numpy()
    noisy = force + 20.0 * np.random.default_rng(3).normal(size=samples)
    with _columns(t=times, u=moved, f=noisy) as path:
        bench["problem"] = {
            "kind": "material",
            "law": law,
            "displacement": {**displacement, "file": path},
        }
        data = {"file": path, "time": "t", "columns": {"force": "f"}}
        config = fvi.load({**bench, "fit": {"data": data, **first, "models": models}})
        seconds = processor_seconds(lambda: fvi.fit(config))
    name = f"four laws fitted to {samples} samples / transforms rfft(2^20)"
    return figure_of(name, 400.0, seconds, yardstick_seconds(2**20))


ROWS: Sequence[Callable[[], Figure]] = (
    building_row,
    sweep_row,
    bifurcation_row,
    ensemble_row,
    fit_row,
)


def run_people() -> list[Figure]:
    """Every row in a process of its own."""
    return [in_own_process(row) for row in ROWS]
