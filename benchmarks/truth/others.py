"""Relaxation laws, impacts, fits."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import argrelmin

import fvi_cli as fvi
from benchmarks.truth.judging import Claim, Claims, Random, RefusedError, UnjudgedError
from benchmarks.truth.motions import FIRST_DIGITS, met, refuse_what_is_said, repeat
from benchmarks.truth.scenes import ORACLE_TOLERANCE, Array, Scene, draw_order, draw_units
from tests.oracles.impacts import LinearBounces
from tests.oracles.linear_response import (
    Equation,
    ExactSolution,
    Input,
    LinearResponse,
    match_scene,
)
from tests.oracles.ordinary import solve_ordinary


class Modulus(NamedTuple):
    """What a law has beside its relaxed modulus: the kernel's transform times s."""

    order: float
    rest: float
    size: float

    def transform(self, s: Any) -> Any:
        """That of the kernel."""
        power = (s * self.rest) ** self.order
        return self.size * power / (1 + power) / s


def draw_relaxing(random: Random) -> Scene:
    """An oscillator with a law of three kinds, or a pendulum with a Prony series."""
    units = draw_units(random, 1, apart=0)
    tau, length, energy = units.time, float(units.lengths[0]), units.energy
    stiff, span = energy / length**2, random.uniform(2, 8)
    k, (x0, v0) = random.uniform(0.3, 4), random.normal(size=2).tolist()
    kind = str(random.choice(["zener", "maxwell", "prony", "pendulum"]))
    relaxed = random.uniform(0, 2) if kind in ("zener", "prony") else 0.0
    sizes, rests = (10 ** random.uniform(-1, 0.5, (2, 2))).tolist()
    kernels = [Modulus(1.0, rest, size) for rest, size in zip(rests, sizes, strict=True)]
    entry: dict[str, Any] = {
        "law": "prony",
        "relaxed": relaxed,
        "moduli": sizes,
        "times": [rest * tau for rest in rests],
    }
    if kind in ("zener", "maxwell"):
        order, rest, size = random.uniform(0.1, 0.97), 10 ** random.uniform(-2, 1), sizes[0]
        kernels = [Modulus(order, rest, size)]
        moduli = {"relaxed": relaxed, "unrelaxed": relaxed + size}
        entry = {"law": kind, "order": order, "time": rest * tau}
        entry |= moduli if kind == "zener" else {"modulus": size}
    problem: dict[str, Any] = {
        "damping": [{**entry, "coefficient": stiff}],
        "initial": {"position": x0 * length, "velocity": v0 * length / tau},
        "final_time": span * tau,
    }

    def solve() -> Any:
        if kind == "pendulum":
            return solve_ordinary(
                lambda t, x, v, z: -k * np.sin(x) - sizes[0] * z[0] - sizes[1] * z[1],
                x0,
                v0,
                span,
                relaxation_times=rests,
            )
        equation = Equation({2.0: 1.0, 0.0: k + relaxed}, [(one, 1.0) for one in kernels])
        response = LinearResponse(equation, [Input({1.0: x0, 0.0: v0}, position=x0)], x0)
        return ExactSolution(shapes=np.eye(1), responses=(response,))

    if kind == "pendulum":
        text = f"{energy * (tau / length) ** 2 / 2!r}*vx**2 + {energy * k!r}*cos(x/{length!r})"
        problem |= {"kind": "lagrangian", "coordinates": ["x"], "lagrangian": text}
    else:
        problem |= {"kind": "damped-oscillator", "mass": stiff * tau**2, "stiffness": stiff * k}
    return Scene(problem=problem, names=("x",), units=units, span=span, solve=solve)


def laws(random: Random, words: list[str]) -> Claims:
    """Positions to a tolerance with relaxation laws."""
    return met(random, words, draw_relaxing(random))


def impacts(random: Random, words: list[str]) -> Claims:
    """Times and number of impacts on surfaces anywhere, from the free motion and pushes."""
    units = draw_units(random, 1, apart=0)
    tau, length, energy = units.time, float(units.lengths[0]), units.energy
    order, mu = draw_order(random), float(10 ** random.uniform(-2, 0))
    gravity, k = float(random.uniform(0.3, 5)), float(random.choice([0.0, random.uniform(0.1, 2)]))
    floor, height = float(random.uniform(-3, 3)), float(random.uniform(0.3, 2))
    lift, pace = float(random.choice([0.0, 0.05 * height])), float(random.uniform(1, 4))
    bounce, span = float(random.uniform(0.3, 1)), float(random.uniform(1, 5))
    is_caputo = order > 1 or random.random() < 0.7
    derivative = "caputo" if is_caputo else "riemann-liouville"
    v0, x0 = float(random.normal()), floor + height

    try:
        model = LinearBounces(
            order=order,
            coefficient=mu,
            stiffness=k,
            gravity=gravity,
            start=x0,
            speed=v0,
            final_time=span,
            floor=floor,
            lift=lift,
            rate=pace,
            restitution=bounce,
            derivative=derivative,
            tolerance=ORACLE_TOLERANCE,
        )
    except ArithmeticError as error:
        raise UnjudgedError(str(error)) from error
    steps = int(random.integers(100, 200))
    scale = energy / length**2
    text = (
        f"{scale * tau**2 / 2!r}*vx**2 - {scale * k / 2!r}*x**2 - {energy / length * gravity!r}*x"
    )
    when = f"x - {floor * length!r} - {lift * length!r}*sin({pace / tau!r}*t)"
    config = {
        "name": "made",
        "problem": {
            "kind": "lagrangian",
            "coordinates": ["x"],
            "lagrangian": text,
            "damping": [{"order": order, "coefficient": scale * mu * tau**order}],
            "derivative": derivative,
            "initial": {"position": x0 * length, "velocity": v0 * length / tau},
            "final_time": span * tau,
            "exact": "none",
        },
        "method": {"rk": "gauss", "degree": 6},
        "ladder": {"steps": steps},
        "impacts": {"floor": {"when": when, "restitution": bounce}},
        "output": {"step": span * tau / 40},
    }
    repeat(words, config, "run")
    (outcome,) = fvi.run(config)
    (run,) = outcome.finished
    refuse_what_is_said(run)
    path = run.trajectory
    wall = floor + lift * np.sin(pace * path.time / tau)
    gap = float(np.min(path.position[:, 0] / length - wall))
    yield Claim("smallest gap (without unit)", min(gap, 0.0), 0.0, 1e-6)
    if any("rest" in remark for remark in run.trajectory.remarks):
        raise RefusedError(str(run.trajectory.remarks))
    observed = run.trajectory.observed
    if observed is None:
        raise RefusedError("nothing observed")
    found = observed.events["floor"].time / tau
    true = _impacts(model)
    yield Claim("number of impacts", float(found.size), float(len(true)), 0.5)
    if found.size == len(true):
        for n, (one, other) in enumerate(zip(found.tolist(), true, strict=True)):
            yield Claim(f"impact {n + 1} (time without unit)", one, other, FIRST_DIGITS * span)


def _impacts(model: LinearBounces) -> list[float]:
    """Times of impacts; unjudged where one is a near thing."""
    start, span = 0.0, model.final_time
    while True:
        # a step behind the last impact the gap is open again, or the flight is too short
        times = np.linspace(start, span, 3001)[1:]
        values = model.gap(times)
        if values[0] <= 0:
            raise UnjudgedError("flights too short")
        below = np.flatnonzero(values <= 0)
        n = int(below[0]) if below.size else times.size
        turns = argrelmin(values[:n])[0]
        if np.any(values[turns] < 0.01) or (n == times.size and values[-1] < 0.01):
            raise UnjudgedError("nearly an impact")
        if n == times.size:
            return [time for time, _ in model.pushes]
        start, _ = model.strike(times[n - 1], times[n])
        push = model.pushes[-1][1]
        if push < 0.05 * (1 + model.restitution) or start > 0.98 * span or len(model.pushes) > 15:
            raise UnjudgedError("a soft impact, or one at the end")


def fit(random: Random, words: list[str]) -> Claims:
    """Estimates, standard errors and intervals of fits in the linear regime of small noise."""
    truth = np.array([random.uniform(1, 4), random.uniform(0.2, 1.8), random.uniform(0.1, 0.6)])
    if abs(truth[1] - 1) < 0.1:
        truth[1] += 0.25
    noise, span = 10 ** random.uniform(-4, -2.5), float(random.uniform(8, 16))
    times = np.sort(random.uniform(0.05, span, 120))

    def motion(values: Array) -> Array:
        k, order, mu = values.tolist()
        damping = [fvi.FractionalDamping(order=order, coefficient=mu)]
        scene = fvi.linear_oscillator(
            stiffness=k, damping=damping, initial_position=1.0, final_time=span
        )
        return match_scene(scene).position(times)[:, 0]

    data = motion(truth) + noise * random.normal(size=times.size)
    best = truth
    for _ in range(3):
        # slopes at the estimate, from which they may differ at the true values
        slopes = np.stack(
            [(motion(best + e) - motion(best - e)) / 2e-4 for e in 1e-4 * np.eye(3)], axis=1
        )
        covariance = noise**2 * np.linalg.inv(slopes.T @ slopes)
        best = best + covariance / noise**2 @ slopes.T @ (data - motion(best))
    deviations = np.sqrt(np.diag(covariance))
    if np.any(deviations > 0.02):
        raise UnjudgedError("far from linear")
    names = ["problem.stiffness", "problem.damping.0.order", "problem.damping.0.coefficient"]
    bounds = [{"from": 0}, {"from": 0.05, "to": 1.95}, {"from": 0}]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.csv"
        rows = "".join(f"{t!r},{x!r}\n" for t, x in zip(times.tolist(), data.tolist(), strict=True))
        path.write_text("t,x\n" + rows, encoding="utf-8")
        config = {
            "name": "made",
            "problem": {
                "kind": "damped-oscillator",
                "stiffness": 2.0,
                "damping": [{"order": 0.7, "coefficient": 0.3}],
                "initial": {"position": 1.0},
                "final_time": span,
                "exact": "none",
            },
            "ladder": {"steps": 32},
            "fit": {
                "data": {"file": str(path), "columns": {"x": "x"}},
                "noise": float(noise),
                "parameters": dict(zip(names, bounds, strict=True)),
            },
        }
        repeat(words, config, "fit")
        words.append("data.csv: " + json.dumps([times.tolist(), data.tolist()]))
        (result,) = fvi.fit(config)
    for estimate, value, deviation in zip(result.best.estimates, best, deviations, strict=True):
        name, sd = estimate.name, float(deviation)
        # the width of a Gaussian interval, and what is left of nonlinearity
        yield Claim(f"{name}", estimate.value, float(value), 0.1 * sd)
        yield Claim(f"{name}: standard error", estimate.standard_error, sd, 0.1 * sd)
        yield Claim(f"{name}: low", estimate.low, float(value) - 1.96 * sd, 0.3 * sd)
        yield Claim(f"{name}: high", estimate.high, float(value) + 1.96 * sd, 0.3 * sd)
