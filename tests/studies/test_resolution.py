"""Ladders whose finest steps are too long for records or periods say so, with both numbers."""

import json
from pathlib import Path

import command_line
import numpy as np
import pytest
from letters import spring
from spread import spread

import fvi_cli as fvi
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.integrator.local_error.pulses import Pulses
from fvi_cli.planning.path_resolution import path_remarks
from fvi_cli.planning.resolution import resolution_remarks
from fvi_cli.scenes.data import linear_oscillator, pendulum
from fvi_cli.studies.experiment import FinishedRun


@pytest.mark.parametrize("seed", range(8))
def test_records_of_any_spacing(seed: int) -> None:
    random = np.random.default_rng([25, seed])
    final_time = float(10 ** random.uniform(-3, 4))
    count = int(random.integers(20, 2000))
    knots = np.linspace(0.0, final_time, count + 1)
    force = SampledForce.through(knots, random.standard_normal(knots.size), "linear")
    scene = spring(
        (0.5, 0.1),
        k=(0.1 / final_time) ** 2,
        T=final_time,
        forcing=Forcing(pieces=(ForcingPiece(components=(force,)),)),
    )
    assert resolution_remarks(scene, count) == ()
    assert resolution_remarks(scene, 3 * count) == ()
    (said,) = resolution_remarks(scene, count - 1)
    assert f"h = {final_time / (count - 1):.4g} " in said
    assert f"spacing {final_time / count:.4g} of" in said
    assert f"take {count} steps or more" in said


@pytest.mark.parametrize("seed", range(8))
def test_periods_that_take_part(seed: int) -> None:
    random = np.random.default_rng([26, seed])
    d = int(random.integers(1, 6))
    root = random.standard_normal((d, d))
    mass = root @ root.T + d * np.eye(d)
    stiffness = np.diag(10 ** random.uniform(-3, 3, d))
    start = {"initial_position": random.standard_normal(d), "initial_velocity": np.zeros(d)}
    rates = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)
    shortest = 2 * np.pi / rates.max()
    final_time = 20.0 * float(shortest)
    scene = linear_oscillator(
        mass=mass, stiffness=stiffness, damping=[], final_time=final_time, **start
    )

    def said(method: str, n_steps: int, *, with_errors: bool) -> tuple[str, ...]:
        run = fvi.integrate(scene, method, n_steps)
        return path_remarks(scene, fvi.method_named(method), run, with_errors=with_errors)

    (long,) = said("gauss1", 79, with_errors=False)
    assert f"shortest period {shortest:.4g} of the motion" in long
    assert "take 80 steps or more" in long
    assert said("gauss1", 81, with_errors=False) == ()
    # what the method makes of steps so long decides, and of shorter ones
    assert said("gauss5", 79, with_errors=True) == ()
    assert said("gauss1", 79, with_errors=True) == (long,)
    (wrong,) = said("gauss1", 81, with_errors=True)
    assert "by Gauss1, graded the error is some" in wrong


def test_modes_that_rest_or_do_not_oscillate_do_not_count() -> None:
    def said(scene: fvi.Scene) -> tuple[str, ...]:
        method = fvi.method_named("gauss2")
        return path_remarks(scene, method, fvi.integrate(scene, method, 64))

    data = {"mass": np.eye(2), "stiffness": np.diag([1.0, 1e6]), "final_time": 10.0}
    assert said(linear_oscillator(damping=[], initial_position=[1.0, 0.0], **data)) == ()
    assert said(linear_oscillator(damping=[], initial_position=[1.0, 0.1], **data))
    # a mode that its force moves is there, however little it moves
    pushed = linear_oscillator(damping=[], forcing=Forcing.from_text("0", "5"), **data)
    assert said(pushed)
    assert said(spring((0.5, 1e6), k=1e4, T=10.0, x=1.0)) == ()
    assert said(spring((0.5, 0.1), k=1e4, T=10.0, x=1.0))


def test_sines_of_formulas_and_nonlinear_motions() -> None:
    for text, period in (
        ("3*sin(40*t)", 2 * np.pi / 40),
        ("exp(-t)*cos(2*pi*t/0.1 + 1)", 0.1),
        ("sin(t)*cos(100*t)", 2 * np.pi / 100),
    ):
        scene = spring((0.5, 0.1), k=1.0, T=10.0, forcing=text)
        (said,) = resolution_remarks(scene, 100)
        assert f"shortest period {period:.4g} of the force" in said
        assert resolution_remarks(scene, 1000) == ()
    for rate, is_said in ((20.0, True), (1.0, False)):
        swing = pendulum(final_time=10.0, omega=rate, initial_position=0.5)
        method = fvi.method_named("gauss2")
        remarks = path_remarks(swing, method, fvi.integrate(swing, method, 60))
        assert any("of the motion" in one for one in remarks) == is_said


CONFIG = """\
name: coarse
problem:
  kind: damped-oscillator
  stiffness: 100
  damping: [{order: 0.5, coefficient: 0.1}]
  initial: {position: 1.0}
  final_time: 8.0
method:
  - {rk: gauss, degree: 2}
  - {baseline: product-integration}
ladder: {steps: [STEPS]}
"""


@pytest.mark.parametrize(("steps", "is_said"), [(32, True), (512, False)])
def test_runs_and_baselines_say_so_and_keep_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: int, is_said: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("coarse.yaml").write_text(CONFIG.replace("STEPS", str(steps)))
    result = command_line.fvi("run", "coarse.yaml", code=0)
    words = "h = 0.25 is longer than a quarter of the shortest period 0.6283 of the motion"
    assert result.stderr.count(words) == (2 if is_said else 0)
    recalled = json.loads(command_line.fvi("run", "coarse.yaml", "--json", code=0).stdout)
    assert json.dumps(recalled).count(words) == (2 if is_said else 0)


@spread(few=1, seed=range(6))
def test_errors_of_ladders_know_of_pulses_that_all_steps_pass_over(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a short push J a pendulum at rest swings by J sin(w (t - t0)) / w."""
    random = np.random.default_rng([27, seed])
    final_time = float(10 ** random.uniform(-2, 3))
    rate = 2 * np.pi * 1.5 / final_time
    place = final_time * float(random.uniform(0.05, 0.3))
    width = final_time * float(10 ** random.uniform(-6, -4))
    shape, area = [
        (f"exp(-((t - {place!r})/{width!r})**2)", float(np.sqrt(np.pi))),
        (f"1/cosh((t - {place!r})/{width!r})**2", 2.0),
    ][seed % 2]
    swing = 1e-3
    config = {
        "name": "made",
        "problem": {
            "kind": "pendulum",
            "omega": rate,
            "damping": [{"order": 0.5, "coefficient": 1e-7 * rate**1.5}],
            "forcing": f"{swing * rate / (area * width)!r}*{shape}",
            "final_time": final_time,
        },
        "method": {"rk": "gauss", "degree": 2},
        "ladder": {"steps": [16, 48]},
    }

    def run() -> FinishedRun:
        (outcome,) = fvi.run(config)
        return outcome.finished[1]

    found = run()
    assert np.abs(found.trajectory.position).max() < 1e-6 * swing
    assert found.error == pytest.approx(swing, rel=0.02)
    assert any("pulse" in remark and "near t = " in remark for remark in found.trajectory.remarks)
    # the control: refined runs on grids that agree in passing over it
    monkeypatch.setattr(
        "fvi_cli.studies.reference.pulses_that_move", lambda scene, amplitude: Pulses()
    )
    assert run().error < 0.5 * swing


@pytest.mark.few(3)
@pytest.mark.parametrize(
    "text",
    [
        "5*sign(t - 2.213)",
        "5*sign(sin(2*t))",
        "max(sin(3*t), 0)",
        "abs(sin(3*t))",
        "abs(t - 2.213)",
        "5*atan(10000*(t - 2.2))",
        "5 + 0.1*exp(-((t - 2.3)/0.001)**2)",
    ],
)
def test_jumps_kinks_and_small_pulses_are_not_passed_over(text: str) -> None:
    scene = spring((0.5, 0.1), k=1.0, T=5.0, forcing=Forcing.from_text(text))
    positions = [fvi.integrate(scene, "gauss3", n).position[:: n // 100] for n in (100, 6400)]
    assert np.abs(positions[0] - positions[1]).max() < 0.01 * np.ptp(positions[1])
    assert resolution_remarks(scene, 100) == ()


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "text",
    [
        "5000*exp(-((t - 2.3)/0.001)**2)",
        "500/(1 + (1000*(t - 2.2))**2)",
        "50*exp(-200*(1 - cos(30*t)))",
        "5 + 10000*exp(-((t - 2.3)/0.001)**2)",
    ],
)
def test_pulses_that_steps_pass_over(text: str) -> None:
    scene = spring((0.5, 0.1), k=1.0, T=5.0, forcing=Forcing.from_text(text))
    said = resolution_remarks(scene, 100)
    assert "steps: h = 0.05 may pass over a pulse or jump of the force near t = " in said[0]
    wanted = int(said[0].split("take ")[1].split()[0])
    assert wanted < 5000
    assert resolution_remarks(scene, wanted) == ()
    enough, fine = (fvi.integrate(scene, "gauss3", n).position[-1] for n in (wanted, 8 * wanted))
    assert abs(enough - fine) < 0.01 * abs(fine)


OF_LAGRANGIANS = (
    "m*vx**2/2 - m*(1 + F*{pulse})*(x/u)**2/2",
    "(m*vx**2/2 - m*(x/u)**2/2)*(1 + F*{pulse})",
    "m*vx**2/2/(1 + F*{pulse}) - m*(x/u)**2/2",
    "m*vx**2/2 - m*(x/u)**2/2 - m*F*{pulse}*x**4/(u*l)**2",
    "m*vx**2/2 - m*(x/u)**2/2 - m*l**2*exp(x/l + log(F)*{pulse})/u**2",
)


@spread(few=1, seed=range(10))
def test_pulses_of_lagrangians_that_steps_pass_over(seed: int) -> None:
    random = np.random.default_rng([25, 6, seed])
    mass, length, second = (float(10 ** random.uniform(-6, 6)) for _ in range(3))
    place, width = float(random.uniform(1, 4)), float(10 ** random.uniform(-3.5, -2.5))
    scene, weak = (
        fvi.lagrangian_scene(
            coordinates=["x"],
            lagrangian=OF_LAGRANGIANS[seed % 5].replace("{pulse}", "exp(-((t/u - p)/w)**2)"),
            parameters={
                "m": mass,
                "l": length,
                "u": second,
                "p": place,
                "w": width,
                "F": height / width,
            },
            initial_position=[length],
            final_time=5 * second,
        )
        for height in (3.0, 1e-5)
    )
    coarse = fvi.integrate(scene, "gauss3", 100)
    for trajectory in (coarse, None):
        (said,) = resolution_remarks(scene, 100, trajectory=trajectory)
        assert "may pass over a pulse or jump of the Lagrangian near t = " in said
        time = float(said.split("near t = ")[1].split(",")[0])
        assert time / second == pytest.approx(place, abs=20 * width)
        wanted = int(said.split("take ")[1].split()[0])
        assert resolution_remarks(scene, wanted, trajectory=trajectory) == ()
    enough, fine = (fvi.integrate(scene, "gauss3", n).position[-1] for n in (wanted, 4 * wanted))
    assert abs(enough - fine) < 0.05 * max(abs(fine), length)
    # the control
    assert resolution_remarks(weak, 100) == ()


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(8))
def test_pulses_of_displacements_that_steps_pass_over(seed: int) -> None:
    random = np.random.default_rng([25, 7, seed])
    length, second = (float(10 ** random.uniform(-6, 6)) for _ in range(2))
    share = float(10 ** random.uniform(*((-4.5, -3.5), (-8.0, -6.0))[seed > 3]))
    u = f"((t - {second * float(random.uniform(2, 8))!r})/{second * share!r})"
    shape = (f"exp(-{u}**2)", f"tanh{u}")[seed % 2]
    said = []
    # work grows with the square of the rate: the second is low, and most work is done in it
    for height in (3.0, 3.0 * share**0.5, 0.01 * share**0.5):
        problem = {
            "kind": "material",
            "displacement": f"{length!r}*(sin(t/{second!r}) + {height!r}*{shape})",
            "law": {"law": "springpot", "order": 0.5, "coefficient": 1.0},
            "final_time": 10 * second,
        }
        (outcome,) = fvi.run({"name": "u", "problem": problem, "ladder": {"steps": [100]}})
        remarks = outcome.finished[0].trajectory.remarks
        said.append([one for one in remarks if "pulse or jump of the displacement" in one])
    # the last one is the control
    assert [len(one) for one in said] == [1, 1, 0]
