"""Last loops of dampers, against the closed form of a springpot in steady motion."""

import math

import numpy as np
import pytest
from command_line import fvi as command
from spread import spread

import fvi_cli as fvi
from fvi_cli.config import parse_config
from fvi_cli.studies.loops import LEAST_POINTS, deformation_against, last_loop

ORDERS = [0.05, 0.5, 0.99, 0.998, 1.002, 1.5, *np.random.default_rng(5).uniform(0.02, 0.98, 6)]


def steady(
    rng: np.random.Generator, order: float, points: float
) -> tuple[tuple[np.ndarray, ...], tuple[float, ...]]:
    """A springpot at any phase in any units: its points, and stiffness, loss factor and energy."""
    size, rate, coefficient = 10.0 ** rng.uniform(-4, 4, 3)
    phase = rng.uniform(0, 2 * np.pi)
    time = np.arange(0, 3.3 * 2 * np.pi, 2 * np.pi / points) / rate
    at, turn = rate * time + phase, order * np.pi / 2
    modulus = coefficient * rate**order
    real = 0.0 if order == 1 else modulus * math.cos(turn)
    loss = math.inf if order == 1 else math.tan(turn)
    motion = time, size * np.sin(at), modulus * size * np.sin(at + turn)
    return motion, (real, loss, np.pi * size**2 * modulus * math.sin(turn))


@pytest.mark.parametrize("order", ORDERS)
def test_of_many_points_loops_have_their_closed_form_at_any_order(order):
    rng, worst = np.random.default_rng(11), 0.0
    for _ in range(5):
        motion, (stiffness, loss_factor, work) = steady(rng, order, rng.uniform(500, 700))
        loop = last_loop(*motion)
        assert loop.stiffness == pytest.approx(stiffness, rel=1e-4)
        assert loop.loss_factor == pytest.approx(loss_factor, rel=1e-4)
        assert loop.work == pytest.approx(work, rel=2e-6)
        _, y, f = motion
        rough = (f[y.argmax()] - f[y.argmin()]) / np.ptp(y)
        worst = max(worst, abs(rough / stiffness - 1))
    # a control: at the largest of the points the force is another one
    if abs(order - 1) < 0.003:
        assert worst > 0.1


@spread(few=2, order=ORDERS)
def test_of_few_points_a_number_is_near_or_not_given(order):
    rng = np.random.default_rng(12)
    size = 1 / max(abs(math.cos(order * np.pi / 2)), 1e-9)
    for _ in range(40):
        points = rng.uniform(3, 60)
        motion, (stiffness, _, work) = steady(rng, order, points)
        loop = last_loop(*motion)
        if points < LEAST_POINTS - 1:
            assert loop is None or math.isnan(loop.stiffness)
        if loop is None or math.isnan(loop.stiffness):
            assert points < LEAST_POINTS + 1
            continue
        assert loop.work == pytest.approx(work, rel=2e-3)
        # the error is a share of the modulus
        assert loop.stiffness == pytest.approx(stiffness, rel=4e-3 * size)


@pytest.mark.parametrize("points", [20.5, 40, 97.3, 571, 4000])
def test_a_viscous_damper_has_hardly_any_stiffness_and_one_without_force_no_loss_factor(points):
    rng = np.random.default_rng(13)
    for _ in range(10):
        motion, (_, _, work) = steady(rng, 1.0, points)
        loop = last_loop(*motion)
        assert abs(loop.loss_factor) > 300
        assert loop.work == pytest.approx(work, rel=2e-3)
        time, deformation, _ = motion
        assert math.isnan(last_loop(time, deformation, 0 * time).loss_factor)


TEXT = """\
name: few
problem: {kind: material, law: {order: 0.5, coefficient: 100.0}, final_time: 10.0,
  displacement: 0.01*sin(2*pi*t)}
method: gauss4
ladder: {steps: [STEPS]}
"""


@pytest.mark.few(2)
@pytest.mark.parametrize("steps", [12, 24, 60, 150])
def test_what_coarse_runs_do_not_know_is_not_given(steps, tmp_path):
    (tmp_path / "few.yaml").write_text(TEXT.replace("STEPS", str(steps)))
    path = str(tmp_path / "few.yaml")
    found = command("quantities", path, "-q", "--output", str(tmp_path))
    assert found.exit_code == 0, found.output
    (outcome,) = fvi.recall(tmp_path / "few.h5")
    (sheet,) = (one for one in fvi.quantities(outcome).sheets if one.name == "loops")
    (row,) = sheet.rows
    names = ("amplitude", "stiffness", "loss_factor", "work")
    assert all(math.isnan(row[name]) for name in names)


def test_with_points_between_its_steps_a_run_has_the_loop_of_its_law():
    (outcome,) = fvi.run(parse_config(TEXT.replace("STEPS", "600"), "a"))
    (item,) = outcome.finished
    loop = last_loop(item.trajectory.time, *deformation_against(item, "force"))
    modulus = 100 * (2j * np.pi) ** 0.5
    # the start dies away
    assert loop.stiffness == pytest.approx(modulus.real, rel=5e-3)
    assert loop.loss_factor == pytest.approx(1.0, rel=5e-3)
    assert loop.work == pytest.approx(np.pi * 1e-4 * modulus.imag, rel=5e-3)


def test_the_last_loop_is_one_period_where_the_motion_leaves_its_middle_for_a_while():
    time = np.linspace(0.0, 8.2, 3281)
    away = np.clip(np.minimum(time - 4.9, 7.9 - time) / 0.4, 0.0, 1.0)
    turn, shift = 2 * np.pi * time, math.atan(0.7)
    y, f = ((1 - 0.7 * away) * np.sin(turn + k * shift) + 0.6 * away for k in (0, 1))
    middle = 0.5 * (y.max() + y.min())
    rises = time[:-1][(y[:-1] <= middle) & (y[1:] > middle)]
    # a control: the last two rises lie several periods apart
    assert rises[-1] - rises[-2] > 1.9
    last = last_loop(time, y, f)
    assert last.end - last.begin == pytest.approx(1.0, abs=0.1)
    assert last.loss_factor == pytest.approx(0.7, abs=0.1)
