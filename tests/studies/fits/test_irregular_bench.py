"""Fits of a damper on the bench to samples at any times: what their steps are worth."""

import itertools

import numpy as np
from oracles.fit_data import BENCH_RELAXED, BENCH_UNRELAXED, ramp

from fvi_cli.config import parse_config
from fvi_cli.integrator.gradients.gradient import run_steps
from fvi_cli.integrator.material import halved_mesh
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.studies.fits.predictions import METHOD, predict_motion
from fvi_cli.studies.fits.settings import DataSet, Series


def test_graded_steps_behind_kinks_at_any_times(tmp_path):
    inside = np.random.default_rng(8).uniform(0.05, 3.0, 14)
    times = np.sort(np.concatenate([[0.0, 3.0], inside]))
    values = 0.01 * np.sin(4.0 * times)
    lines = [f"{t!r},{u!r}" for t, u in zip(times.tolist(), values.tolist(), strict=True)]
    (tmp_path / "bench.csv").write_text("\n".join(["t,u", *lines]) + "\n")
    config = (
        "name: a\nproblem:\n  kind: material\n  law: {law: zener, order: 0.6, time: 0.3, "
        f"relaxed: {BENCH_RELAXED}, unrelaxed: {BENCH_UNRELAXED}}}\n"
        f"  displacement: {{file: {tmp_path}/bench.csv, column: u, time: t}}\n"
        "ladder: {steps: [20]}\n"
    )
    (experiment,) = parse_config(config, str(tmp_path / "a.yaml")).experiments
    scene = experiment.problem.scene
    force = Expression.parse("force", variables=("force",))
    series = Series(name="force", column="f", times=times[1:], values=times[1:], formula=force)
    data = DataSet(name="a", series=(series,), coordinates=("u",))

    def forces(mesh):
        described = scene, Observations(coordinates=("u",))
        return predict_motion(described, run_steps(scene, METHOD, mesh), data, ())[0][0]

    changes = np.diff(np.append(0.0, np.diff(values) / np.diff(times)))
    exact = [
        sum(c * ramp(t - b) for c, b in zip(changes, times, strict=False) if t > b)
        for t in times[1:].tolist()
    ]
    halved = [halved_mesh(scene.prescribed, count) for count in range(4)]
    assert all(set(times[1:]) <= {one.end for one in mesh.stretches} for mesh in halved)
    errors = [np.abs(forces(one) - exact).max() / np.abs(exact).max() for one in halved]
    assert errors[-1] < 1e-8
    assert all(after < before / 2.5 for before, after in itertools.pairwise(errors))
