"""Laws from a damper on the bench: force against displacement, and complex stiffness."""

import numpy as np
import pytest

import fvi_cli as fvi

TRUTH = {"order": 0.6, "time": 0.3, "relaxed": 5.0e4, "unrelaxed": 4.0e5}
"""What tests/oracles/fit_data.py made the shipped measurements with."""


@pytest.mark.slow
def test_the_intervals_of_the_shipped_test_hold_its_law():
    (found,) = fvi.fit("damper-bench", overrides=["fit.models={Zener: {}}"])
    for one in found.best.estimates:
        assert one.low < TRUTH[one.name.removeprefix("problem.law.")] < one.high
    assert found.best.is_converged


def test_the_complex_stiffness_gives_the_law_back(tmp_path):
    hertz = np.geomspace(0.05, 20.0, 30)
    power = (2j * np.pi * hertz * TRUTH["time"]) ** TRUTH["order"]
    low, high = TRUTH["relaxed"], TRUTH["unrelaxed"]
    stiffness = low + (high - low) * power / (1 + power)
    rows = zip(hertz.tolist(), stiffness.real.tolist(), stiffness.imag.tolist(), strict=True)
    lines = "".join(f"{f!r},{a!r},{b!r}\n" for f, a, b in rows)
    (tmp_path / "dma.csv").write_text("f,storage,loss\n" + lines)
    law = {"law": "zener", "order": 0.4, "time": 1.0, "relaxed": 1.0e5, "unrelaxed": 3.0e5}
    (found,) = fvi.fit(
        {
            "name": "dma",
            "problem": {
                "kind": "material",
                "law": law,
                "displacement": "sin(t)",
                "final_time": 1.0,
            },
            "fit": {
                "data": {
                    "file": str(tmp_path / "dma.csv"),
                    "frequency": "f",
                    "columns": {"force": {"real": "storage", "imaginary": "loss"}},
                },
                "parameters": {f"problem.law.{name}": {"from": 0} for name in TRUTH}
                | {"problem.law.order": {"from": 0.05, "to": 0.95}},
            },
        }
    )
    for one in found.best.estimates:
        name = one.name.removeprefix("problem.law.")
        assert abs(one.value / TRUTH[name] - 1) < 1e-6
