"""The work on single dampers, against the loss of energy and closed forms."""

import numpy as np
import pytest
from letters import spring

import fvi_cli as fvi
from fvi_cli.config import parse_config
from fvi_cli.errors import ConfigError
from fvi_cli.integrator.trajectory import Trajectory

MATRIX = np.array([[2.0, -1.0], [-1.0, 1.0]])


def scene(**changes: object) -> fvi.Scene:
    given: dict[str, object] = {
        "mass": np.eye(2),
        "stiffness": 4.0 * MATRIX,
        "damping": [
            fvi.FractionalDamping(order=0.5, coefficient=np.diag([0.4, 0.0])),
            fvi.FractionalDamping(order=1.0, coefficient=0.1 * MATRIX),
        ],
        "laws": (
            fvi.fractional_zener(
                order=0.6, time=0.4, relaxed=1.0, unrelaxed=3.0, coefficient=MATRIX
            ),
        ),
        "initial_position": [1.0, 0.0],
        "initial_velocity": [0.0, 0.7],
        "final_time": 5.0,
        **changes,
    }
    return spring(**given)


@pytest.fixture(scope="module")
def run() -> Trajectory:
    works = {f"w{number}": f"work_{number}" for number in (1, 2, 3)}
    rate = {"rate": "0.1*(2*vx1**2 - 2*vx1*vx2 + vx2**2)"}
    return fvi.integrate(
        scene(), "gauss4", 80, output=np.linspace(0.0, 5.0, 201), quantities={**works, **rate}
    )


def test_the_works_on_all_dampers_are_the_energy_that_is_lost(run):
    found = run.observed.quantities
    total = found["w1"] + found["w2"] + found["w3"]
    assert abs(total[0]) < 1e-15
    assert run.energy[0] - run.energy == pytest.approx(total, abs=1e-9)
    # a law gives back some of what it has stored, a dashpot nothing
    assert np.diff(found["w3"]).min() < -1e-4
    assert np.diff(found["w2"]).min() >= 0.0


def test_the_work_on_a_dashpot_is_the_integral_of_its_power(run):
    found, h = run.observed.quantities, run.time[1]
    rate = found["rate"]
    simpson = h / 3.0 * (rate[0:-2:2] + 4.0 * rate[1:-1:2] + rate[2::2])
    assert found["w2"][2::2] == pytest.approx(np.cumsum(simpson), abs=2e-6)
    assert run.observed.extents["w2"].peak == pytest.approx(found["w2"][-1], rel=1e-12)


def test_a_damper_that_is_not_there_has_no_work():
    with pytest.raises(ValueError, match="unknown name 'work_4'"):
        fvi.integrate(scene(), "gauss2", 8, quantities={"w": "work_4"})
    with pytest.raises(ValueError, match=r"work_1: the power of a Riemann-Liouville"):
        fvi.integrate(
            scene(derivative="riemann-liouville", laws=()), "gauss2", 8, quantities={"w": "work_1"}
        )
    text = (
        "name: a\nproblem: {kind: pendulum, damping: [{order: 0.5, coefficient: 1}], final_time: 1}"
        "\nladder: {steps: [8]}\nmethod: {rk: gauss, degree: 2}\nquantities: {w: work_2}\n"
    )
    with pytest.raises(ConfigError, match=r"a:5:17: quantities\.w: .*unknown name 'work_2'"):
        parse_config(text, "a")
    assert parse_config(text.replace("work_2", "work_1"), "a").experiments
