"""What large structures take: few dampers, modes, many steps."""

from __future__ import annotations

import os
import resource
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.vibration.modes import ModeTable, find_modes

SMALL_ELEMENTS = 42
ADAPTIVE_TOLERANCE = 1e-9
STOREYS = 1000
STEPS = 400
REPEATS = 12
LARGEST_RATIO = 1.3
ELEMENTS = 850
BEAM_STEPS = 10_000
MODES = 10


@dataclass(frozen=True, kw_only=True)
class Row:
    """One measurement: what, how much, and the figure to meet."""

    what: str
    measured: str
    goal: str


def frame(*, damped: bool) -> Scene:
    """A building of a thousand storeys, with dampers in three of them or without."""
    specification: dict[str, Any] = {
        "kind": "frame",
        "storeys": STOREYS,
        "stiffness": 1e4,
        "ground_acceleration": "sin(3*t)",
        "final_time": 4.0,
    }
    if damped:
        places = ["x1", "x400 - x399", "x800 - x799"]
        specification["damping"] = [{"order": 0.5, "coefficient": 50.0, "acts_on": places}]
    return build_scene(specification)


def beam(steps: int, elements: int = ELEMENTS) -> Scene:
    """The sandwich beam, struck at its tip, for so many of the same steps."""
    return build_scene(
        {
            "kind": "sandwich-beam",
            "elements": elements,
            "initial": {"position": 0.0, "velocity": {"at": {f"w{elements}": 1.0}}},
            "final_time": 1e-5 * steps,
        }
    )


def ratio_of_dampers() -> float:
    """Processor time of stepping a frame with three dampers over that without."""
    method = Method(cq="gauss", degree=2, start="none")
    scenes = [frame(damped=False), frame(damped=True)]
    # of a run, and of its first steps, with the set-up: the least of many, in turns
    least = np.full((2, 2), np.inf)
    for _ in range(REPEATS):
        for index, scene in enumerate(scenes):
            for place, steps in enumerate((20, STEPS)):
                began = time.process_time()
                integrate(scene, method, steps)
                least[index, place] = min(least[index, place], time.process_time() - began)
    without, three = least[:, 1] - least[:, 0]
    return float(three / without)


def pushed_beam() -> Scene:
    """The beam under a pulse at its tip, and what follows for fifty times as long."""
    return build_scene(
        {
            "kind": "sandwich-beam",
            "elements": ELEMENTS,
            "initial": {"position": 0.0, "velocity": 0.0},
            "forcing": {"at": {f"w{ELEMENTS}": "exp(-((t-0.002)/0.0004)**2)"}},
            "final_time": 0.1,
        }
    )


def _transform_seconds() -> float:
    """Least processor time of one ``scipy.fft.rfft`` of length 2^20."""
    from scipy.fft import rfft

    values = np.random.default_rng(0).normal(size=2**20)
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        rfft(values)
        times.append(time.process_time() - began)
    return min(times)


def _modes(elements: int) -> tuple[ModeTable, float]:
    began = time.process_time()
    return find_modes(beam(16, elements), MODES), time.process_time() - began


def run_structures() -> list[Row]:
    """Measure everything."""
    rows = [
        Row(
            what="one `scipy.fft.rfft` of length 2^20, for comparison: processor time",
            measured=f"{1e3 * _transform_seconds():.0f} ms",
            goal="(14 ms where the figures were set)",
        ),
        Row(
            what=f"three dampers in {STOREYS} storeys, over none: processor time of {STEPS} steps",
            measured=f"{ratio_of_dampers():.2f}",
            goal=f"at most {LARGEST_RATIO}",
        ),
    ]
    small, _ = _modes(SMALL_ELEMENTS)
    table, seconds = _modes(ELEMENTS)
    worst = max(mode.residual for mode in small.modes)
    rows += [
        Row(
            what=f"{MODES} modes of a sandwich beam, {4 * SMALL_ELEMENTS} degrees of freedom, "
            f"{small.counted} counted: largest residual",
            measured=f"{worst:.0e}",
            goal="below 1e-12",
        ),
        Row(
            what=f"{MODES} modes of one of {4 * ELEMENTS:,} degrees of freedom, "
            f"{table.counted} counted: processor time",
            measured=f"{seconds:.1f} s",
            goal="at most 20 s",
        ),
    ]
    began = time.process_time()
    integrate(beam(BEAM_STEPS), Method(cq="gauss", degree=2, start="none"), BEAM_STEPS, every=10)
    rows.append(
        Row(
            what=f"{BEAM_STEPS:,} equal steps of it by Gauss2: processor time",
            measured=f"{time.process_time() - began:.0f} s",
            goal="at most 60 s",
        )
    )
    rows += _adaptive_rows()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    rows.append(
        Row(what="largest memory of all this", measured=f"{peak:.0f} MB", goal="at most 2 GB")
    )
    return rows


def _adaptive_rows() -> list[Row]:
    """The beam under a pulse, in steps that are found on the way."""
    began = time.process_time()
    run = integrate(
        pushed_beam(),
        Method(cq="gauss", degree=4, start="graded"),
        AdaptiveSteps(tolerance=ADAPTIVE_TOLERANCE),
    )
    seconds = time.process_time() - began
    finer = integrate(
        pushed_beam(),
        Method(cq="gauss", degree=6, start="graded"),
        AdaptiveSteps(tolerance=ADAPTIVE_TOLERANCE),
    )
    error = float(np.abs(run.position[-1] - finer.position[-1]).max())
    what = f"adaptive steps of Gauss4, local tolerance {ADAPTIVE_TOLERANCE:g}, pulse at its tip"
    return [
        Row(
            what=f"{what}: steps, and error at the end against Gauss6",
            measured=f"{run.n_steps}, {error:.0e} of {np.abs(finer.position).max():.0e}",
            goal="",
        ),
        Row(
            what="processor time of one of them, set-up and examination in it",
            measured=f"{1e3 * seconds / run.n_steps:.0f} ms",
            goal="",
        ),
    ]


def structures_table(rows: list[Row]) -> str:
    """The rows as Markdown."""
    lines = ["| what | measured | figure to meet |", "|---|---|---|"]
    lines += [f"| {row.what} | {row.measured} | {row.goal} |" for row in rows]
    load = f"{os.getloadavg()[0]:.0f}" if hasattr(os, "getloadavg") else "unknown"
    lines += ["", f"One core; processes that wanted one at the end: {load} on {os.cpu_count()}."]
    return "\n".join(lines) + "\n"
