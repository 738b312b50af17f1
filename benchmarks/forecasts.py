"""Whether ``--dry-run`` says how long runs will take: scenes at random, forecast and computed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.measuring import in_own_process, number, table, yes_or_no
from fvi_cli.runner.compute import run
from fvi_cli.runner.plan import forecast_runs, plan
from fvi_cli.runner.request import requested

OBSERVED = ("events", "impacts", "section", "output", "quantities")
SCENES_OF_EACH = 2
FACTOR = 3.0
"""By so much forecasts may be off."""
Config = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class ForecastRow:
    """One scene: processor seconds of the short runs, forecast, and of the runs themselves."""

    kind: str
    observed: str
    members: int
    n_steps: str
    asking: float
    forecast: float
    computed: float

    @property
    def ratio(self) -> float:
        """Forecast over computed."""
        return self.forecast / self.computed

    @property
    def is_met(self) -> bool:
        """Whether the forecast is right within :data:`FACTOR`."""
        return 1 / FACTOR <= self.ratio <= FACTOR


def drawn_config(
    rng: np.random.Generator, observed: str, *, most_members: int = 100, most_steps: int = 2000
) -> Config:
    """An experiment of one member, or many, of which something is observed."""
    kinds = ["pendulum", "duffing", "damped-oscillator", "lagrangian", "chain"]
    kind = "lagrangian" if observed == "impacts" else str(rng.choice(kinds))
    omega, end = rng.uniform(0.5, 3.0), float(rng.uniform(5.0, 100.0))
    order = float(np.round(rng.uniform(0.1, 1.7), 2))
    problem: Config = {
        "kind": kind,
        "damping": [{"order": order, "coefficient": float(rng.uniform(0.05, 0.5))}],
        "initial": {"position": float(rng.uniform(0.5, 1.5))},
        "final_time": end,
    }
    x, swept = "x", "problem.damping.0.coefficient"
    if kind == "chain":
        masses = int(rng.integers(2, 12))
        del problem["damping"]
        problem |= {
            "masses": masses,
            "dampers": [{"order": order, "coefficient": float(rng.uniform(0.05, 0.5))}],
            "initial": {"position": [1.0] + (masses - 1) * [0.0]},
        }
        x, swept = "x1", "problem.dampers.0.coefficient"
    if kind == "lagrangian":
        falls = observed == "impacts"
        potential = "10*x" if falls else "x**4/4 - x**2/2"
        problem |= {"coordinates": ["x"], "lagrangian": f"vx**2/2 - {potential}"}
        problem["final_time"] = end = min(end, 10.0) if falls else end
    if kind == "duffing":
        problem |= {"stiffness": -1.0, "cubic_stiffness": 1.0}
    if kind in ("duffing", "damped-oscillator") and (observed == "section" or rng.random() < 0.6):
        problem["forcing"] = f"{rng.uniform(0.1, 0.6):.3g}*cos({omega:.3g}*t)"
    if rng.random() < 0.6:
        problem["exact"] = "none"
    each = int(rng.integers(4, 30))
    n_steps = int(min(each * end, most_steps))
    degree = int(rng.choice([2, 3, 4, 6]))
    config: Config = {
        "name": "drawn",
        "problem": problem,
        "method": {"rk": "gauss", "degree": degree},
        "ladder": {"steps": [n_steps] if rng.random() < 0.5 else [n_steps, 2 * n_steps]},
    }
    members = int(np.exp(rng.uniform(0.0, np.log(most_members))))
    if members > 1:
        config["sweep"] = {swept: {"from": 0.05, "to": 0.6, "number": members}}
    several: dict[str, Config] = {
        "events": {"events": {"zero": {"when": x, "direction": "rising"}}},
        "section": {"events": {"period": {"when": f"sin({omega:.3g}*t)", "direction": "rising"}}},
        "impacts": {
            "impacts": {"table": {"when": "x", "restitution": float(rng.uniform(0.4, 1.0))}},
            "output": {"step": end / 200},
        },
        "output": {"output": {"step": float(rng.uniform(0.01, 1.0)) * end / 100}},
        "quantities": {
            "output": {"step": end / 200},
            "quantities": {"speed": f"v{x}**2/2", "far": f"{x}**2"},
        },
    }
    return config | several[observed]


def measure_forecast(config: Config) -> ForecastRow:
    """Forecast an experiment and compute it, both in this process."""
    request = requested(config)
    (experiment,) = request.loaded.experiments
    began = time.process_time()
    forecasts = forecast_runs(plan(request))
    asked = time.process_time()
    run(request, keep=False)
    done = time.process_time()
    found = [one.seconds for one in forecasts.values()]
    known = [one for one in found if one is not None]
    return ForecastRow(
        kind=str(config["problem"]["kind"]),
        observed=", ".join(
            one for one in ("events", "impacts", "output", "quantities") if one in config
        ),
        members=max(1, len(experiment.members)),
        n_steps=", ".join(map(str, experiment.steps)),
        asking=asked - began,
        forecast=sum(known) if len(known) == len(found) else float("nan"),
        computed=done - asked,
    )


def forecast_table(rows: Sequence[ForecastRow]) -> str:
    """Markdown: what was forecast, what it took, and whether that is near enough."""
    return table(
        "Processor seconds of all runs of an experiment with what its errors are measured against, "
        "as `--dry-run` forecasts them and as they were computed by the same process afterwards.",
        ("kind", "observed", "members", "N", "forecast", "computed", "ratio", "asking", "met"),
        [
            (
                *(row.kind, row.observed, str(row.members), row.n_steps),
                *(
                    number(one, ".2f")
                    for one in (row.forecast, row.computed, row.ratio, row.asking)
                ),
                yes_or_no(row.is_met),
            )
            for row in rows
        ],
    )


def run_forecasts(seed: int, each: int = SCENES_OF_EACH) -> list[ForecastRow]:
    """All scenes of a seed, each in a process of its own."""
    rng = np.random.default_rng(seed)
    configs = [drawn_config(rng, observed) for observed in OBSERVED for _ in range(each)]
    return [in_own_process(measure_forecast, one) for one in configs]
