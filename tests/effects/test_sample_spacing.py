"""Steps longer than the spacing of samples are remarked on, with both numbers."""

from pathlib import Path

import numpy as np
import pytest
from letters import spring

import fvi_cli as fvi
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.sampled import SampledForce


def recorded(random: np.random.Generator, final_time: float, count: int) -> Forcing:
    """A force through `count` + 1 random samples."""
    knots = np.linspace(0.0, final_time, count + 1)
    force = SampledForce.through(knots, random.standard_normal(knots.size), "linear")
    return Forcing(pieces=(ForcingPiece(components=(force,)),))


@pytest.mark.parametrize("seed", range(8))
def test_records_of_any_spacing(seed: int) -> None:
    random = np.random.default_rng([25, seed])
    final_time = float(10 ** random.uniform(-3, 4))
    count = int(random.integers(20, 2000))
    forcing = recorded(random, final_time, count)
    assert forcing.remarks(final_time, final_time / count) == ()
    assert forcing.remarks(final_time, final_time / (3 * count)) == ()
    (said,) = forcing.remarks(final_time, final_time / (count - 1))
    assert said == (
        f"steps: h = {final_time / (count - 1):.4g} is longer than the spacing "
        f"{final_time / count:.4g} of samples"
    )


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_a_gap_is_remarked_on(scale: float) -> None:
    """81 intervals from .2 to 1.01: the force in them is a straight line."""
    knots = scale * np.concatenate([np.arange(0.0, 0.205, 0.01), np.arange(1.01, 2.005, 0.01)])
    forcing = Forcing.from_samples(knots, np.cos(knots / scale))
    (said,) = forcing.remarks(2.0 * scale, 0.005 * scale)
    assert said == f"samples: component 1 has a gap of 81 intervals after t = {0.2 * scale:g}"
    # the control: up to ten intervals, and gaps behind the end
    assert forcing.remarks(0.2 * scale, 0.005 * scale) == ()
    nine = np.delete(scale * np.arange(0.0, 2.0, 0.01), slice(20, 29))
    assert Forcing.from_samples(nine, nine).remarks(scale, 0.005 * scale) == ()


def test_runs_say_so_on_the_finest_steps_of_a_ladder(tmp_path: Path) -> None:
    times = np.linspace(0.0, 10.0, 101)
    path = tmp_path / "record.csv"
    np.savetxt(path, np.stack([times, np.sin(times)], 1), delimiter=",", header="t,f", comments="")
    problem = {
        "kind": "damped-oscillator",
        "stiffness": 1.0,
        "damping": [{"order": 0.5, "coefficient": 0.1}],
        "forcing": {"file": str(path), "column": "f", "time": "t"},
        "final_time": 10.0,
        "exact": "none",
    }
    for steps, is_said in (([25, 50], [False, True]), ([50, 100], [False, False])):
        config = {"name": "made", "problem": problem, "method": "gauss2"}
        (outcome,) = fvi.run({**config, "ladder": {"steps": steps}})
        remarks = [one.trajectory.remarks for one in outcome.finished]
        assert [any("spacing 0.1 of" in one for one in own) for own in remarks] == is_said
    scene = spring((0.5, 0.1), k=1.0, T=10.0, forcing=Forcing.from_samples(times, np.sin(times)))
    for n_steps, is_said in ((99, True), (100, False)):
        run = fvi.integrate(scene, "gauss2", n_steps)
        assert any("spacing 0.1 of component 1" in one for one in run.remarks) == is_said
        assert repr(run).endswith(", 1 remark>" if is_said else " 100 steps>")
    assert fvi.integrate(scene, "gauss2", fvi.AdaptiveSteps(tolerance=1e-3)).remarks == ()
