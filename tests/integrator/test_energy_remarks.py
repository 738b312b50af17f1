"""Runs of scenes that only lose energy, and have far more than they began with."""

from __future__ import annotations

import re

import numpy as np
import pytest
from spread import spread

import fvi_cli as fvi
from fvi_cli.integrator.members import integrate_batch

METHODS = ("bdf3-none", "bdf4-none", "bdf2", "gauss3")


def swinging(
    kind: str, order: float, coefficient: float, *, unit: float, force: str = ""
) -> fvi.Scene:
    """An oscillator of mass 1 and period 2 pi in units of the time, or a pendulum; free or not."""
    damping = fvi.FractionalDamping(order=order, coefficient=coefficient * unit ** (order - 2))
    data = {"damping": (damping,), "final_time": 10.0 * unit, "initial_position": 1.0}
    potential = "x**2/2"
    if kind == "pendulum":
        potential = "-cos(x)"
    return fvi.lagrangian_scene(
        coordinates=("x",),
        lagrangian=f"vx**2/2 + (x*({force or 0}) - ({potential}))/u**2",
        parameters={"u": unit},
        **data,
    )


@pytest.mark.few(2)
@spread(
    order=[0.2, 1.0, 1.9, 1.95],
    coefficient=[0.3, 1.0],
    unit=[1e-6, 1.0, 1e6],
    kind=["oscillator", "pendulum", "forced"],
)
def test_energy_beyond_what_a_scene_has_is_said(order, coefficient, unit, kind):
    force = "sin(3*t/u)" if kind == "forced" else ""
    scene = swinging(kind, order, coefficient, unit=unit, force=force)
    for name in METHODS:
        for n_steps in (50, 80, 200):
            run = fvi.integrate(scene, fvi.method_named(name), n_steps)
            if run.status != "ok":
                continue
            # apart from the package: the exact motion is no farther than its energy permits
            reach = float(np.abs(run.position).max())
            permitted = 1.0 if kind != "forced" else 1.0 + 10.0
            said = any(one.startswith("unstable: its energy rises") for one in run.remarks)
            if reach > 10 * permitted and kind != "pendulum":
                assert said, (name, n_steps, reach)
            # the control
            if reach < 1.4 * permitted:
                assert not said, (name, n_steps, reach)


def test_the_run_that_was_ok_without_a_word():
    for kind in ("oscillator", "pendulum"):
        scene = swinging(kind, 1.95, 1.0, unit=1.0)
        run = fvi.integrate(scene, fvi.method_named("bdf3-none"), 50)
        assert np.abs(run.position).max() > 1e6
        (said,) = [one for one in run.remarks if "energy rises" in one]
        least = -1.0 if kind == "pendulum" else 0.0
        begun = 1 - np.cos(1.0) if kind == "pendulum" else 0.5
        assert run.energy is not None
        found = re.search(r"energy rises to (\S+) times what", said)
        assert found is not None
        assert float(found[1]) == pytest.approx((run.energy.max() - least) / begun, rel=0.1)
    # and in a batch the same
    scenes = [swinging("oscillator", 1.95, c, unit=1.0) for c in (0.9, 1.0, 1.1, 1e-9)]
    batch = integrate_batch(scenes, fvi.method_named("bdf3-none"), 50)
    alone = [fvi.integrate(one, fvi.method_named("bdf3-none"), 50) for one in scenes]
    assert [bool(one.remarks) for one in batch] == [bool(one.remarks) for one in alone]
    assert batch[1].remarks
    assert not batch[3].remarks


def test_negative_damping_may_gain_energy():
    scene = swinging("oscillator", 1.0, -2.0, unit=1.0)
    run = fvi.integrate(scene, fvi.method_named("gauss3"), 200)
    assert run.energy is not None
    assert run.energy.max() > 1e4 * run.energy[0]
    assert not run.remarks
