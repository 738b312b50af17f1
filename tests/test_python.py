"""From Python: kinds as functions, tables and frames of outcomes, derivatives by parameters."""

import matplotlib.pyplot as plt
import numpy as np
import pandas
import pytest

import fvi_cli as fvi
from fvi_cli.errors import ArgumentError
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.registry import KINDS

NEEDED = {
    "lagrangian": {"coordinates": ["x"], "lagrangian": "vx**2/2 - x**2/2"},
    "structure": {"mass": np.diag([2.0, 1.0]), "stiffness": np.array([[3.0, -1.0], [-1.0, 1.0]])},
    "kepler": {"initial_position": [1.0, 0.0]},
}
SCENES = [name for name, kind in KINDS.items() if issubclass(kind, SceneKind)]


@pytest.mark.parametrize("name", SCENES)
def test_every_kind_is_a_function_of_its_name(name):
    function = getattr(fvi, name.replace("-", "_"))
    scene = function(**NEEDED.get(name, {}), final_time=1.0)
    assert isinstance(scene, fvi.Scene)
    assert scene.final_time == 1.0
    assert function.__doc__
    assert name.replace("-", "_") in dir(fvi)


@pytest.mark.parametrize("wrong", [{"order": 0.5, "coefficient": 1.0}, [{"order": 0.5}], 0.5])
def test_dampers_are_a_list_of_dampers(wrong):
    damper = fvi.FractionalDamping(order=0.5, coefficient=1.0)
    for given_ in (wrong, damper):
        for name, function in (("damping", fvi.pendulum), ("dampers", fvi.frame)):
            with pytest.raises(ArgumentError, match=f"{name}: it must be a list, such as .*; got"):
                function(**{name: given_}, final_time=1.0)
    one, other = (fvi.pendulum(damping=d, final_time=1.0) for d in ([damper], iter([damper])))
    assert one.damping == other.damping == (damper,)


@pytest.mark.parametrize("force", ["0.3*cos(1.2*t)", ["0.3*cos(1.2*t)"]])
def test_a_formula_is_a_force(force):
    forcing = fvi.Forcing.from_text("0.3*cos(1.2*t)")
    for name in ("duffing", "lagrangian"):
        function = getattr(fvi, name)
        given_ = {**NEEDED.get(name, {}), "final_time": 1.0}
        one, other = (function(**given_, forcing=f).forcing for f in (force, forcing))
        assert np.array_equal(one(np.linspace(0, 1, 9)), other(np.linspace(0, 1, 9)))
    shaken = fvi.frame(ground_acceleration=force, final_time=1.0)
    assert shaken.forcing.dimension == 3


CONFIG = {
    "name": "swing",
    "problem": {
        "kind": "pendulum",
        "damping": [{"order": 0.5, "coefficient": 0.2}],
        "initial": {"position": 0.1, "velocity": 1.0},
        "final_time": 6.0,
        "exact": "none",
    },
    "designs": {"free": {"problem.damping": []}, "damped": {}},
    "sweep": {"problem.omega": [1.0, 2.0]},
    "method": "gauss3",
    "ladder": {"steps": [30, 60]},
    "quantities": {"angle": "x"},
    "events": {"zero": "x"},
}


@pytest.fixture(scope="module")
def outcome():
    config = {**CONFIG, "events": {"zero": {"when": "x"}}}
    (found,) = fvi.run(config)
    return found


def test_a_frame_of_an_outcome_has_a_line_for_every_run(outcome):
    frame = outcome.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert len(frame) == 8
    assert frame["problem.omega"].dtype.kind == "f"
    for one, (_, row) in zip(outcome.finished, frame.iterrows(), strict=True):
        member, observed = one.run.member, one.trajectory.observed
        assert row["design"] == member.name
        assert row["problem.omega"] == member.values["problem.omega"]
        assert row["peak_angle"] == observed.extents["angle"].peak
        assert row["count_zero"] == observed.events["zero"].time.size
        assert row["n_steps"] == one.run.n_steps
    wide = frame[frame.n_steps == 60].pivot_table(
        index="design", columns="problem.omega", values="rms_angle"
    )
    assert wide.shape == (2, 2)


def test_a_frame_of_motions_has_the_points_of_every_run(outcome):
    frame = outcome.to_dataframe("motions")
    assert len(frame) == 4 * (31 + 61)
    one = outcome.finished[-1]
    own = frame.xs(
        (one.run.member.name, one.run.member.values["problem.omega"], 60),
        level=("design", "problem.omega", "n_steps"),
    )
    assert np.array_equal(own["x"], one.trajectory.position[:, 0])


def test_a_frame_of_events_has_a_line_for_every_occurrence(outcome):
    frame = outcome.to_dataframe("events")
    counts = outcome.to_dataframe()["count_zero"]
    assert len(frame) == counts.sum() > 0
    assert list(frame.columns[-4:]) == ["event", "time", "x", "vx"]
    assert np.abs(frame["x"]).max() < 1e-9
    one = outcome.finished[-1]
    member, seen = one.run.member, one.trajectory.observed.events["zero"]
    own = frame[
        (frame.design == member.name)
        & (frame["problem.omega"] == member.values["problem.omega"])
        & (frame.n_steps == one.run.n_steps)
    ]
    assert np.array_equal(own["time"], seen.time)
    assert np.array_equal(own["vx"], seen.velocity[:, 0])
    (quiet,) = fvi.run({key: one for key, one in CONFIG.items() if key != "events"})
    assert quiet.to_dataframe("events").empty


def test_quantities_are_a_report_of_the_outcome(outcome, tmp_path):
    report = fvi.quantities(outcome)
    runs, *_, designs = report.sheets
    assert len(runs.rows) == 8
    assert [row["design"] for row in designs.rows] == ["free", "free", "damped", "damped"]
    assert "peak angle" in fvi.as_text(report)
    written = {path.name for path in fvi.write(report, tmp_path)}
    assert written == {f"swing-quantities{end}" for end in (".csv", ".md", "-events.csv")}


def test_an_outcome_draws_one_figure(outcome):
    against = {"plot": "peak_angle", "against": "problem.omega"}
    figure = outcome.plot(against)
    assert len(figure.axes[0].lines) == 2
    assert outcome.plot("trajectory").axes
    with pytest.raises(ArgumentError, match=r"^figure: "):
        outcome.plot("portrait")
    with pytest.raises(ArgumentError, match=r"^figure\.plot: "):
        outcome.plot({"plot": "peak_angel", "against": "problem.omega"})
    with pytest.raises(fvi.RequestError, match="did not happen after t = 5\\.999"):
        outcome.plot({"section": "zero", "after": 5.999})
    plt.close("all")


def double_pendulum(l2, g):
    return fvi.double_pendulum(
        lengths=(1.0, l2),
        gravity=g,
        joints=[fvi.FractionalDamping(order=0.5, coefficient=0.1)],
        initial_position=[0.7, -0.4],
        final_time=1.5,
    )


@pytest.mark.parametrize("name", ["l2", "g"])
def test_gradients_by_the_parameters_of_a_lagrangian(name):
    values = {"l2": 0.8, "g": 1.3}
    scene, quantity = double_pendulum(**values), fvi.position_at(1.3, 1)
    found = fvi.gradient(scene, "gauss3", 40, quantity, [f"lagrangian.{name}"])
    step = 1e-4

    def at(shift):
        changed = {**values, name: values[name] + shift}
        return fvi.integrate(double_pendulum(**changed), "gauss3", 40, with_steps=True)(
            np.array([1.3])
        )[0, 1]

    centred = (8 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12 * step)
    assert found[f"lagrangian.{name}"] == pytest.approx(centred, rel=1e-7)
    assert abs(centred) > 1e-3
