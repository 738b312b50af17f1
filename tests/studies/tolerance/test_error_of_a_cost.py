"""Errors beside what a tolerance costs, in l2 over meshes of any grading."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fvi_cli.config import load_config
from fvi_cli.studies.cost import measure_tolerance
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.norms import error_norm
from fvi_cli.studies.tolerance.search import solve

TEXT = """\
name: price
problem:
  kind: bagley-torvik
  damping: [{{order: 1.5, coefficient: {coefficient!r}}}]
  stiffness: {stiffness!r}
  initial: {{position: 0.0, velocity: 0.0}}
  forcing: >-
    {power!r}*({power!r} - 1)*t**({power!r} - 2) + {stiffness!r}*t**{power!r}
    + {coefficient!r}*gamma({power!r} + 1)/gamma({power!r} - 0.5)*t**({power!r} - 1.5)
  final_time: {final!r}
  exact: t**{power!r}
method: {{rk: gauss, degree: 2}}
ladder: {{steps: [{count}], grading: {grading!r}}}
store: {{every: {every}}}
report: {{norm: l2}}
"""


def drawn(seed: int, folder: Path) -> tuple[Experiment, float]:
    """An experiment, and the power of time that is its solution."""
    draw = np.random.default_rng(seed)
    power = float(draw.uniform(2.2, 4.5))
    text = TEXT.format(
        coefficient=float(draw.uniform(0.1, 2.0)),
        stiffness=float(10.0 ** draw.uniform(-1, 1)),
        power=power,
        final=float(10.0 ** draw.uniform(-1, 1)),
        count=int(draw.integers(200, 400)),
        grading=float(draw.uniform(2.5, 5.0)),
        every=int(draw.integers(2, 60)),
    )
    path = folder / "price.yaml"
    path.write_text(text)
    return load_config(path).experiments[0], power


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(8))
def test_l2_of_a_price_is_the_integral_over_time(tmp_path, seed):
    one, power = drawn(seed, tmp_path)
    (run,) = one.runs()
    scene = one.problem.scene
    tolerance = 1e-3 * scene.final_time**power
    found = measure_tolerance(run, tolerance).error
    # the same search again, and Gauss-Legendre's rule on the motion between its points
    motion = solve(scene, tolerance=tolerance).steps
    nodes, weights = np.polynomial.legendre.leggauss(4)
    ends = np.unique([*np.linspace(0.0, scene.final_time, 400), *run.times])
    half = 0.5 * np.diff(ends)
    places = (ends[:-1, None] + half[:, None] * (1 + nodes)).ravel()
    error = motion(places)[:, 0] - places**power
    integral = np.sqrt((half[:, None] * weights).ravel() @ error**2)
    assert found == pytest.approx(integral, rel=0.03)
    # the control: every point for the mean step, as if the mesh were uniform
    exact = run.times[:, None] ** power
    mean = error_norm(motion(run.times), exact, run.step_size, "l2")
    assert abs(mean / integral - 1) > 0.06
