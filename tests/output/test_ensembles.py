"""Mean and spread over the members of a sweep: figure, table and frame."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import fvi_cli as fvi
from fvi_cli.reports.kinds.ensembles import ensembles
from fvi_cli.reports.naming import members_in_words

CONFIG = {
    "name": "cloud",
    "problem": {
        "kind": "duffing",
        "damping": [{"order": 0.6, "coefficient": 0.25}],
        "forcing": "0.4*cos(t)",
        "initial": {"position": 0.5},
        "final_time": 4.0,
        "exact": "none",
    },
    "method": "gauss3",
    "ladder": {"steps": [40, 80]},
    "output": {"step": 0.125},
    "quantities": {"speed": "vx"},
    "figures": [{"ensemble": ["x", "speed"]}],
}
SWEEP = {"problem.initial.position": {"from": 0.2, "to": 0.9, "number": 7}}


@pytest.fixture(scope="module")
def outcome():
    (found,) = fvi.run({**CONFIG, "sweep": SWEEP})
    return found


def test_means_and_deviations_are_those_of_numpy_and_pandas(outcome):
    finest = [one for one in outcome.finished if one.run.n_steps == 80]
    x = np.array([one.trajectory.position[:, 0] for one in finest])
    (place,) = ensembles(outcome.finished, ["x"])
    assert np.array_equal(place.time, finest[0].trajectory.time)
    assert np.allclose(place.mean, np.mean(x, axis=0), rtol=1e-14)
    assert np.allclose(place.deviation, np.std(x, axis=0, ddof=1), rtol=1e-12, atol=1e-15)
    frame = outcome.to_dataframe("motions").xs(80, level="n_steps")
    by_time = frame.groupby("time")["x"].agg(["mean", "std"])
    assert np.allclose(by_time["mean"], place.mean, rtol=1e-13)
    assert np.allclose(by_time["std"], place.deviation, rtol=1e-12, atol=1e-15)


def legend(figure: Figure) -> list[str]:
    return [text.get_text() for one in figure.legends for text in one.get_texts()]


def test_the_figure_has_a_mean_and_the_edges_of_two_bands(outcome):
    figure = fvi.figures(outcome)["cloud-ensemble-x-speed"]
    assert set(legend(figure)) == {"mean", "standard deviation", "range"}
    assert [axes.get_ylabel() for axes in figure.axes] == ["position $x$", "speed"]
    for axes, one in zip(figure.axes, ensembles(outcome.finished, ["x", "speed"]), strict=True):
        (mean,) = (line for line in axes.lines if line.get_label() == "mean")
        assert np.array_equal(mean.get_ydata(), one.mean)
        outer, inner = axes.collections
        for band, low, high in (
            (inner, one.mean - one.deviation, one.mean + one.deviation),
            (outer, one.values.min(axis=0), one.values.max(axis=0)),
        ):
            edges = band.get_paths()[0].vertices[:, 1]
            assert (edges.min(), edges.max()) == pytest.approx((low.min(), high.max()))


def test_the_table_has_mean_and_spread_of_the_peaks(outcome):
    report = fvi.quantities(outcome)
    (row,) = next(one for one in report.sheets if one.name == "ensemble").rows
    peaks = outcome.to_dataframe().query("n_steps == 80")["peak_speed"]
    assert (row["quantity"], row["members"]) == ("speed", 7)
    found = [row[name] for name in ("mean", "deviation", "least", "greatest")]
    assert found == pytest.approx([peaks.mean(), peaks.std(), peaks.min(), peaks.max()])
    assert "deviation" in fvi.as_text(report)


def test_designs_with_a_sweep_have_a_mean_each():
    designs = {"free": {"problem.damping": []}, "damped": {}}
    (found,) = fvi.run({**CONFIG, "sweep": SWEEP, "designs": designs})
    swept = "problem.initial.position = 0.2 ... 0.9 (7 values)"
    assert members_in_words(found.experiment.members) == f"2 designs: free, damped; {swept}"
    free, damped = ensembles(found.finished, ["x"])
    assert (free.design, damped.design) == ("free", "damped")
    assert len(free.values) == len(damped.values) == 7
    assert not np.allclose(free.mean, damped.mean, rtol=1e-3)
    (alone,) = fvi.run({**CONFIG, "sweep": SWEEP})
    assert members_in_words(alone.experiment.members) == f"7 members, {swept}"
    assert np.allclose(damped.mean, ensembles(alone.finished, ["x"])[0].mean, rtol=1e-12)
    drawn = found.plot({"ensemble": ["x"]})
    assert set(legend(drawn)) == {"standard deviation", "free", "damped"}
    sheets = {one.name: one for one in fvi.quantities(found).sheets}
    assert {row["design"] for row in sheets["ensemble"].rows} == {"free", "damped"}


def test_positions_alone_need_no_quantities():
    config = {key: one for key, one in CONFIG.items() if key not in ("quantities", "output")}
    (found,) = fvi.run({**config, "sweep": SWEEP, "figures": [{"ensemble": ["x"]}]})
    assert "cloud-ensemble-x" in fvi.figures(found)


def test_members_without_common_times_are_not_averaged():
    config = {
        **{key: one for key, one in CONFIG.items() if key not in ("ladder", "output")},
        "sweep": {"problem.stiffness": [1.0, 5.0, 20.0]},
        "accuracy": {"tolerance": 1e-4},
    }
    (found,) = fvi.run(config)
    sizes = {one.trajectory.time.size for one in found.finished}
    with pytest.raises(fvi.RequestError, match="no times in common; give output"):
        found.plot()
    assert len(sizes) > 1
    (found,) = fvi.run({**config, "output": {"step": 0.125}})
    assert ensembles(found.finished, ["x"])[0].values.shape == (3, 33)
