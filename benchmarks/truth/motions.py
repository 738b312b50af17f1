"""Runs: errors, orders, tolerances, quantities, events, sweeps."""

from __future__ import annotations

import csv
import io
import json
import math
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq
from typer.testing import CliRunner

import fvi_cli as fvi
from benchmarks.truth.judging import Claim, Claims, Random, RefusedError, UnjudgedError
from benchmarks.truth.scenes import (
    Array,
    Scene,
    draw_general,
    draw_linear,
    draw_nonlinear,
)
from fvi_cli.cli.app import app

FIRST_DIGITS = 1e-3
"""Numbers whose error is not printed may err by this part of the largest value."""


ROUND_OFF = 3e-12
"""Errors below this part of the largest position are not judged."""


def draw_any(random: Random) -> Scene:
    """A scene of any kind but with laws."""
    kinds = (draw_linear, draw_nonlinear, draw_linear, draw_nonlinear, draw_general)
    return kinds[int(random.integers(len(kinds)))](random)


def command(config: Mapping[str, Any], name: str) -> dict[str, list[dict[str, str]]]:
    """The rows of every CSV table of a command in this process."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "made.yaml"
        # a JSON document is YAML as well
        path.write_text(json.dumps(config), encoding="utf-8")
        arguments = [name, str(path), "--output", folder]
        result = CliRunner().invoke(app(arguments), arguments)
        if result.exit_code == 2 or "failed, error nan" in result.stderr:
            raise RefusedError(" ".join(result.stderr.split())[:300])
        return {
            file.stem.removeprefix("made").lstrip("-"): list(
                csv.DictReader(io.StringIO(file.read_text(encoding="utf-8")))
            )
            for file in sorted((Path(folder) / "tables").glob("*.csv"))
        }


def repeat(words: list[str], config: Mapping[str, Any], *command: str) -> None:
    """Say how the draw is repeated."""
    words.append(f"fvi {' '.join(command)} with {json.dumps(config)}")


def draw_ladder(random: Random, scene: Scene, steps: list[int]) -> dict[str, Any]:
    """Method and ladder; Gauss methods on graded meshes where the force has jumps anywhere."""
    gauss: dict[str, Any] = {"rk": "gauss", "degree": int(random.integers(2, 6))}
    kind = random.random()
    if "pieces" in str(scene.problem.get("forcing")) or kind < 0.15:
        grading = float(random.uniform(1.2, 4.0))
        return {"method": gauss, "ladder": {"steps": steps, "grading": grading}}
    if kind < 0.7:
        method = gauss if kind < 0.5 else {**gauss, "start": "none"}
    elif kind < 0.78:
        method = {"rk": "lobatto-iiic", "degree": 3}
    else:
        sampling = str(random.choice(["nodes", "points"]))
        method = {"bdf": int(random.integers(1, 4)), "sampling": sampling}
    return {"method": method, "ladder": {"steps": steps}}


def refuse_what_is_said(run: Any) -> None:
    """Raise where a run is reported as failed or doubtful."""
    if "mistake of the program" in run.trajectory.message:
        raise RuntimeError(run.trajectory.message)
    if run.status not in ("ok", "floor"):
        raise RefusedError(f"{run.status}: {run.trajectory.message}")
    if run.measured is not None and run.floor > 0.01 * run.measured.largest:
        raise RefusedError(f"the reference is known to {run.floor:.2g} only")


def _error_claim(scene: Scene, run: Any, norm: str) -> Claim:
    """The printed error against that of the positions of the run."""
    trajectory = run.trajectory
    difference = np.abs(trajectory.position - scene.position(trajectory.time))
    # what is left of a reference at the end of all digits says nothing of the error
    doubt = float(np.max(scene.error) + ROUND_OFF * np.max(scene.sizes))
    true = float(np.max(difference if norm == "max" else difference[-1]))
    allowed = 0.02 * max(true, run.error) + 3 * run.floor + 3 * doubt
    return Claim(f"error ({norm}) at N = {run.run.n_steps}", run.error, true, allowed)


def convergence(random: Random, words: list[str]) -> Claims:
    """Errors and slopes of a table of orders, in every norm and with thinned storage."""
    scene = draw_any(random)
    least, norm = int(random.integers(8, 20)), str(random.choice(["max", "final"]))
    config = {
        "name": "made",
        "problem": scene.problem,
        **draw_ladder(random, scene, [least, 2 * least, 4 * least]),
        "report": {"norm": norm},
        "store": {"every": int(random.choice([1, 1, 2, 7, 1000]))},
    }
    repeat(words, config, "convergence")
    (outcome,) = fvi.run(config)
    (table,) = fvi.order_tables([outcome])
    (case,) = table.cases
    # errors are those of all points of the mesh, of which few may be kept
    (whole,) = fvi.run({**config, "store": {}})
    true: list[tuple[float, float]] = []
    for run, row in zip(whole.finished, case.rows, strict=True):
        refuse_what_is_said(run)
        claim = _error_claim(scene, run, norm)
        yield Claim(claim.name, row.error, claim.true, claim.allowed)
        if row.used_in_fit:
            if claim.true < 30 * float(np.max(scene.error)):
                return
            true.append((math.log(row.run.step_size), math.log(claim.true)))
    if len(true) >= 2:
        lengths, errors = np.array(true).T
        slope = float(np.polyfit(lengths, errors, 1)[0])
        yield Claim("slope", case.slope, slope, 0.05)


def tolerance(random: Random, words: list[str]) -> Claims:
    """Positions at any times of runs that are reported as met."""
    return met(random, words, draw_any(random))


def met(random: Random, words: list[str], scene: Scene) -> Claims:
    """Positions of one scene to a tolerance."""
    times = np.sort(random.uniform(0, scene.final_time, 30))
    relative = float(10 ** random.uniform(-9, -3))
    config = {
        "name": "made",
        "problem": {**scene.problem, "exact": "none"},
        "accuracy": {"relative": relative},
        "output": {"times": times.tolist()},
    }
    repeat(words, config, "run")
    (outcome,) = fvi.run(config)
    (run,) = outcome.finished
    refuse_what_is_said(run)
    tolerance = relative * float(np.max(scene.sizes))
    doubt = float(np.max(scene.error))
    if doubt > 0.3 * tolerance:
        raise UnjudgedError("the tolerance is near the error of the reference")
    difference = np.abs(run.trajectory.position - scene.position(times))
    n, c = np.unravel_index(np.argmax(difference), difference.shape)
    yield Claim(
        f"position of {scene.names[c]} at t = {float(times[n])!r}",
        float(run.trajectory.position[n, c]),
        float(scene.position(times)[n, c]),
        # the largest position of the program's run errs as well
        tolerance * (1 + 10 * relative) + doubt,
    )


def observed_config(random: Random, scene: Scene) -> dict[str, Any]:
    """A configuration of a single accurate run, by a ladder or a tolerance."""
    config: dict[str, Any] = {"name": "made", "problem": {**scene.problem, "exact": "none"}}
    # steps of a ladder may pass over pulses: whoever writes them knows of these
    if random.random() < 0.5 or "exp(" in str(scene.problem.get("forcing")):
        # a tolerance is one length for all components: smaller motions may lie below it
        if np.ptp(np.log10(scene.sizes)) > 4.0:
            raise UnjudgedError("components too far apart for one tolerance")
        config["accuracy"] = {"relative": 1e-7}
    else:
        config["method"] = {"rk": "gauss", "degree": int(random.integers(4, 7))}
        config["ladder"] = {"steps": int(random.integers(80, 160))}
        if "pieces" in str(scene.problem.get("forcing")):
            config["ladder"]["grading"] = 1.5
    return config


def extents(values: Callable[[Array], Array], end: float) -> dict[str, float]:
    """Largest, smallest and mean square of a function on [0, end]."""
    # behind the start, where velocities may have a fractional power
    times = np.concatenate([end * np.geomspace(1e-12, 1e-3, 40), np.linspace(0, end, 3001)])
    times = np.unique(times)
    found = values(times)
    best: dict[str, float] = {}
    for name, sign in (("greatest", 1.0), ("least", -1.0)):
        n = int(np.argmax(sign * found))
        near = np.linspace(times[max(n - 1, 0)], times[min(n + 1, times.size - 1)], 401)
        best[name] = sign * float(np.max(sign * values(near)))
    best["rms"] = math.sqrt(float(np.trapezoid(found**2, times)) / end)
    best["peak"] = max(best["greatest"], -best["least"])
    return best


def quantities(random: Random, words: list[str]) -> Claims:
    """Peaks, ranges and root mean squares of a run or a member, read from the CSV form."""
    scene = draw_any(random)
    weights = random.normal(size=(2, len(scene.names))) / np.stack([scene.sizes, scene.speeds])
    config = observed_config(random, scene)
    texts = {
        f"q{n}": " + ".join(
            f"{w!r}*{'v' * n}{name}" for w, name in zip(row.tolist(), scene.names, strict=True)
        )
        for n, row in enumerate(weights)
    }
    config["quantities"] = texts
    if random.random() < 0.5:
        config["output"] = {"step": scene.final_time / int(random.integers(1, 29))}
    end = scene.final_time
    if random.random() < 0.4:
        # an event ends the run
        level = float(random.uniform(-0.9, 0.9) * scene.sizes[0])
        config["events"] = {"e": {"when": f"{scene.names[0]} - {level!r}", "stop": True}}
        found = crossings(
            lambda times: scene.position(times)[:, 0] - level, end, float(scene.sizes[0])
        )
        end = min(found, default=end)
    many, which = 1, 0
    if random.random() < 0.2:
        many = int(random.choice([2, 5, 17]))
        which, factors = int(random.integers(many)), random.uniform(0.5, 1, many)
        factors[which] = 1.0
        velocity = np.array(scene.problem["initial"]["velocity"])
        key = "problem.initial.velocity"
        config["sweep"] = [{key: (factor * velocity).tolist()} for factor in factors]
    repeat(words, config, "quantities")
    tables = command(config, "quantities")
    rows = tables["quantities"]
    if len(rows) != many * len(texts):
        raise RefusedError(f"{len(rows)} rows for {many} members")
    for row in rows[which * len(texts) :][: len(texts)]:
        if row["status"] not in ("ok", "floor"):
            raise RefusedError(row["status"])
        yield from _extent_claims(scene, weights, row, end)


def _extent_claims(scene: Scene, weights: Array, row: Mapping[str, str], end: float) -> Claims:
    n = int(row["quantity"][1:])
    motion = (scene.position, scene.velocity)[n]
    true = extents(lambda times: motion(times) @ weights[n], end)
    for name, value in true.items():
        printed = abs(float(row[name])) if name == "peak" else float(row[name])
        yield Claim(
            f"{name} of {row['quantity']}",
            printed,
            value,
            FIRST_DIGITS * max(true["peak"], 1e-300),
        )


def crossings(values: Callable[[Array], Array], end: float, scale: float) -> list[float]:
    """Times at which a function changes its sign; unjudged where that is a near thing."""
    times = np.linspace(0, end, 8001)
    found = values(times)
    if abs(found[0]) < 1e-3 * scale or abs(found[-1]) < 1e-3 * scale:
        raise UnjudgedError("an event at an end")
    inner = found[1:-1]
    turns = (inner - found[:-2]) * (found[2:] - inner) <= 0
    if np.any(np.abs(inner[turns]) < 1e-3 * scale):
        raise UnjudgedError("nearly a tangency")

    def one(time: float) -> float:
        return float(values(np.array([time]))[0])

    where = np.flatnonzero(found[:-1] * found[1:] < 0)
    return [float(brentq(one, times[n], times[n + 1], xtol=1e-13 * end)) for n in where]


def events(random: Random, words: list[str]) -> Claims:
    """Numbers and times of events, of formulas of the motion and of time."""
    scene = draw_any(random)
    config = observed_config(random, scene)
    c = int(random.integers(len(scene.names)))
    name, size, speed = scene.names[c], scene.sizes[c], scene.speeds[c]
    kind = random.random()
    if kind < 0.4:
        level = float(random.uniform(-0.8, 0.8) * size)
        when, scale = f"{name} - {level!r}", float(size)

        def values(times: Array) -> Array:
            return np.asarray(scene.position(times)[:, c] - level)
    elif kind < 0.7:
        level = float(random.uniform(-0.8, 0.8) * speed)
        when, scale = f"v{name} - {level!r}", float(speed)

        def values(times: Array) -> Array:
            return np.asarray(scene.velocity(times)[:, c] - level)
    else:
        rate = float(10 ** random.uniform(0, 4) / scene.final_time)
        phase = float(random.uniform(0.3, 2.8))
        when = f"sin({rate!r}*t + {phase!r})"
        # known without looking for them
        number = math.floor((rate * scene.final_time + phase) / math.pi)
        true = [(k * math.pi - phase) / rate for k in range(1, number + 1)]
        if abs(math.remainder(rate * scene.final_time + phase, math.pi)) < 1e-3:
            raise UnjudgedError("an event at the end")

    config["events"] = {"e": {"when": when}}
    repeat(words, config, "quantities")
    if kind < 0.7:
        true = crossings(values, scene.final_time, scale)
    tables = command(config, "quantities")
    (row,) = tables["quantities-events"]
    yield Claim("number of events", float(row["count"]), float(len(true)), 0.5)
    if true and int(row["count"]) == len(true):
        yield Claim("first event", float(row["first"]), true[0], FIRST_DIGITS * scene.final_time)
        yield Claim("last event", float(row["last"]), true[-1], FIRST_DIGITS * scene.final_time)
