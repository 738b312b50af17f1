"""Outputs of steady responses: accelerations, drifts, shears and forces of dampers."""

import numpy as np
import pytest

import fvi_cli as fvi

FREQUENCY = "0.3:5:40"
MASSES = (2.2, 2.0, 1.6)
BUILDING = {
    "name": "tower",
    "problem": {
        "kind": "frame",
        "masses": list(MASSES),
        "stiffnesses": [900.0, 800.0, 600.0],
        "rayleigh": {"ratios": [0.02, 0.03], "modes": [1, 3]},
        "dampers": [
            {
                "storey": [1, 3],
                "law": "zener",
                "order": 0.6,
                "time": 0.05,
                "relaxed": 20.0,
                "unrelaxed": 300.0,
            },
            {"name": "pot", "storey": 2, "order": 0.4, "coefficient": 30.0},
        ],
        "ground_acceleration": "sin(t)",
        "final_time": 1.0,
        "exact": "none",
    },
    "ladder": {"steps": [8]},
    "quantities": {"own": "1000*(x2 - x1)", "late": "x1*t"},
}


def amplitudes(*at, force=("ground",)):
    (table,) = fvi.response(BUILDING, frequency=FREQUENCY, force=force, at=at)
    return 2j * np.pi * table.hertz, dict(zip(at, table.values.T, strict=True))


@pytest.mark.parametrize("ground", [1.0, 2.5])
def test_outputs_are_what_their_names_say_at_every_frequency(ground):
    coordinates = ("x1", "x2", "x3")
    names = [
        *coordinates,
        *(f"{p}{name}" for p in "vad" for name in coordinates),
        *("drift_2", "own", "acceleration_3", "base_shear"),
        *("force_1_1", "force_pot", "deformation_1_3"),
    ]
    s, found = amplitudes(*names, force=(f"ground={ground}",))

    def agree(one, other):
        assert np.abs(one - other).max() < 1e-12 * np.abs(other).max()

    for name in coordinates:
        agree(found[f"v{name}"], s * found[name])
        agree(found[f"a{name}"], s**2 * found[name])
    agree(found["drift_2"], found["x2"] - found["x1"])
    agree(found["own"], 1000 * (found["x2"] - found["x1"]))
    agree(found["acceleration_3"], found["ax3"] + ground)
    pairs = zip(MASSES, coordinates, strict=True)
    agree(found["base_shear"], sum(mass * (found[f"a{x}"] + ground) for mass, x in pairs))
    power = (s * 0.05) ** 0.6
    agree(found["force_1_1"], (20.0 + 280.0 * power / (1 + power)) * found["x1"])
    agree(found["force_pot"], 30.0 * s**0.4 * found["drift_2"])
    agree(found["deformation_1_3"], found["x3"] - found["x2"])
    # what the ground carries is the spring and the damping of the lowest storey
    carried = sum(found[f"d{name}"] for name in coordinates) - 920.0 * found["x1"]
    agree(found["base_shear"], carried)


def test_peaks_of_accelerations_lie_where_those_are_largest():
    (table,) = fvi.response(BUILDING, frequency="1:4:40", at=["x3", "acceleration_3"])
    fine = np.linspace(1.0, 4.0, 1501)
    (dense,) = fvi.response(BUILDING, frequency="1:4:1501", at=["x3", "acceleration_3"])
    for index, name in enumerate(("x3", "acceleration_3")):
        (peak,) = (one for one in table.peaks if one.at == name)
        assert peak.hertz == pytest.approx(fine[dense.magnitude[:, index].argmax()], abs=2e-3)
        assert peak.magnitude == pytest.approx(dense.magnitude[:, index].max(), rel=1e-4)
    assert table.qualities == ("displacement", "acceleration")


def test_an_output_that_the_load_does_not_reach_is_zero():
    apart = {"kind": "structure", "mass": [[1, 0], [0, 1]], "stiffness": [[2, 0], [0, 3]]}
    problem = {**apart, "initial": {"position": [0, 0]}, "final_time": 1.0, "exact": "none"}
    config = {"name": "apart", "problem": problem, "ladder": {"steps": [8]}}
    (table,) = fvi.response(config, frequency="0.1:0.4:11", force=["x1"], at=["x1", "x2"])
    assert not table.values[:, 1].any()
    assert table.values[:, 0].all()
    assert [peak.at for peak in table.peaks] == ["x1"]
