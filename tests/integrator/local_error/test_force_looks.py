"""Forces between the points of a step are looked for: pulses of formulas of t, and walls."""

import numpy as np
import pytest
from letters import in_pieces, spring
from oracles.volterra import solve_volterra

import fvi_cli as fvi
from fvi_cli.effects.forcing import Forcing
from fvi_cli.integrator.local_error import looks
from fvi_cli.integrator.meshes.samples import SAMPLES, sample_forces

SHAPES = {
    "exp": "exp(-{u}**2)",
    "tanh": "1 - tanh{u}**2",
    "cosh": "1/cosh({u})",
    "quotient": "1/(1 + {u}**2)**4",
    "gate": "(tanh({u} + 3) - tanh({u} - 3))/2",
}
BESIDE = ["", " + sin(3*{t})", " + 5*{t}", " + exp(-{t})", " + {t}**2.5", " - 40"]


def pulse(shape: str, middle: float, width: float, beside: str = "") -> Forcing:
    u = f"((t - {middle!r})/{width!r})"
    return Forcing.from_text("2*(" + SHAPES[shape].replace("{u}", u) + ")" + beside)


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(6))
def test_samples_are_few_beside_a_pulse_and_all_of_it(seed):
    random = np.random.default_rng([22, seed])
    T = float(10 ** random.uniform(-6, 6))
    for shape in SHAPES:
        width = T * float(10 ** random.uniform(-4.2, -3.8))
        middle = float(random.uniform(0.1, 0.9)) * T
        beside = BESIDE[seed % len(BESIDE)].replace("{t}", f"(t/{T!r})")
        scene = spring(T=T, forcing=pulse(shape, middle, width, beside))
        (found,) = sample_forces(scene).formulas
        kept = found.times[found.kept]
        assert kept.size < SAMPLES / 8
        near = np.abs(found.times - middle) < width
        assert np.isin(found.times[near], kept).all()


def test_gentle_forces_are_not_sampled_and_pieces_each():
    assert sample_forces(spring(T=2.0)).formulas == ()
    assert sample_forces(spring(T=2.0, forcing="sin(3*t) + t**2")).formulas == ()
    stepped = spring(T=2.0, forcing=in_pieces("exp(-t)", 1.0, "1/(1 + t)"))
    first, second = sample_forces(stepped).formulas
    assert first.times[-1] < 1.0 < second.times[0]
    assert first.times.size == second.times.size == SAMPLES // 2


CASE = ("tanh", 2.879, 0.000306)


def test_what_a_pulse_moves_is_met():
    shape, middle, width = CASE
    scene = spring((1.648, 0.86), k=1.0, T=8.0, forcing=pulse(shape, middle, width))
    run = fvi.solve(scene, tolerance=6.8e-6)
    # at rest before: the same motion, later
    lead = 20 * width
    known = solve_volterra(
        1.0,
        [(1.648, 0.86)],
        lambda x: x,
        lambda x: np.ones((len(x), 1, 1)),
        lambda t: 2.0 / np.cosh(np.clip((t - lead) / width, -300.0, 300.0))[:, None] ** 2,
        [0.0],
        [0.0],
        8.0 - middle + lead,
        tolerance=1e-12,
    )
    times = np.linspace(middle - lead, 8.0, 300)
    right = known.position(times - times[0])
    assert np.abs(right).max() > 2e-4
    assert run.outcome == "met"
    assert np.abs(run(times) - right).max() <= 6.8e-6


def test_without_the_looks_the_run_sees_no_force(monkeypatch):
    """The control: met, with the position at zero."""
    monkeypatch.setattr(looks.Looks, "missed", lambda *arguments: 0.0)
    scene = spring((1.648, 0.86), k=1.0, T=8.0, forcing=pulse(*CASE))
    run = fvi.solve(scene, tolerance=6.8e-6)
    assert run.outcome == "met"
    assert np.abs(run.position).max() < 0.01 * 2e-4
