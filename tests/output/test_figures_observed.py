"""Figures of quantities and sections draw what was observed."""

import numpy as np
import pytest
from spread import spread

import fvi_cli as fvi
from fvi_cli.plotting import left_out
from fvi_cli.plotting.style import new_figure, panel_grid
from fvi_cli.plotting.words import in_formula, quantity_in_words
from fvi_cli.reports.naming import key_label

CONFIG = {
    "name": "seen",
    "problem": {
        "kind": "duffing",
        "damping": [{"order": 0.5, "coefficient": 0.2}],
        "forcing": "cos(t)",
        "initial": {"position": 1.0},
        "final_time": 40.0,
        "exact": "none",
    },
    "method": {"rk": "gauss", "degree": [3, 4]},
    "ladder": {"steps": [200]},
    "quantities": {"force": "dx", "a": "ax"},
    "events": {"period": {"when": "sin(t)", "direction": "rising"}},
    "figures": ["quantities", "section", "error"],
}


@pytest.fixture(scope="module")
def outcome() -> fvi.Outcome:
    return fvi.run(CONFIG)[0]


def test_quantities_over_time_with_their_peaks(outcome):
    figures = fvi.figures(outcome)
    assert set(figures) == {"seen-quantities", "seen-section"}
    panels = figures["seen-quantities"].axes
    assert [axes.get_ylabel() for axes in panels] == ["force", "a"]
    observed = outcome.finished[-1].trajectory.observed
    for axes, name in zip(panels, ("force", "a"), strict=True):
        drawn = axes.lines[-2].get_ydata()
        assert np.array_equal(drawn, observed.quantities[name])
        (peak_time,), (height,) = axes.lines[-1].get_data()
        assert abs(height) == observed.extents[name].peak
        assert peak_time == observed.extents[name].peak_time


def test_a_section_has_a_point_for_every_event(outcome):
    (axes,) = fvi.figures(outcome)["seen-section"].axes
    observed = outcome.finished[0].trajectory.observed
    assert axes.lines[0].get_xdata().size == observed.events["period"].time.size == 6
    assert axes.get_xlabel() == "position $x$"


def test_round_off_does_not_fill_a_panel():
    chain = {"kind": "chain", "masses": 2, "initial": {"position": [1.0, 0.0]}, "final_time": 20.0}
    config = {**CONFIG, "problem": {**chain, "exact": "none"}, "method": {"rk": "gauss"}}
    config |= {"events": {"turn": {"when": "vx1"}}, "figures": ["section"], "quantities": {}}
    (figure,) = fvi.figures(fvi.run(config)).values()
    low, high = figure.axes[0].get_ylim()
    assert high - low > 1e-3


MEMBERS = {
    **CONFIG,
    "problem": {
        **CONFIG["problem"],
        "parameters": {"amplitude": 1.0},
        "forcing": "amplitude*cos(t)",
        "final_time": 20.0,
    },
    "method": {"rk": "gauss", "degree": 3},
    "ladder": {"steps": [60]},
    "quantities": {"force": "dx"},
    "units": {"length": "mm", "time": "ms", "force": "N"},
}


@pytest.mark.few(1)
@pytest.mark.parametrize("count", [3, 8])
def test_members_of_a_sweep(count):
    amplitudes = {"from": 0.5, "to": 1.2, "number": count}
    swept = {**MEMBERS, "sweep": {"problem.parameters.amplitude": amplitudes}}
    (outcome,) = fvi.run(swept)
    figures = fvi.figures(outcome)
    assert set(figures) == {"seen-quantities", "seen-section"}
    panel, *bars = figures["seen-quantities"].axes
    assert len(bars) == (count > 6)
    assert panel.get_ylabel() == "force (N)"
    assert panel.get_xlabel() == "time $t$ (ms), step size $h = 0.33333$ ms"
    seen = [one.trajectory.observed for one in outcome.finished]
    if count <= 6:
        for number, one in enumerate(seen):
            line, peak = panel.lines[2 * number : 2 * number + 2]
            assert np.array_equal(line.get_ydata(), one.quantities["force"])
            assert abs(peak.get_ydata()[0]) == one.extents["force"].peak
    first, *others = figures["seen-section"].axes
    assert len(first.lines) == count
    drawn = [line.get_ydata() if others else line.get_xdata() for line in first.lines]
    for line, one in zip(drawn, seen, strict=True):
        assert np.array_equal(line, one.events["period"].position[:, 0])
    if others:
        assert first.get_xlabel() == "amplitude"
        assert {line.get_xdata()[0] for line in first.lines} == set(np.linspace(0.5, 1.2, count))
        assert others[0].get_ylabel() == r"velocity $\dot x$ (mm/ms)"


@spread(few=1, count=[2, 8], name=["x", "phi", "r1"])
def test_figures_of_sweeps_name_coordinates_and_events(count, name):
    problem = {
        "kind": "lagrangian",
        "coordinates": [name],
        "parameters": {"k": 1.0},
        "lagrangian": f"v{name}**2/2 - k*{name}**2/2",
        "initial": {"position": 1.0},
        "final_time": 10.0,
        "exact": "none",
    }
    config = {
        "name": "named",
        "problem": problem,
        "method": {"rk": "gauss", "degree": 3},
        "ladder": {"steps": [40]},
        "sweep": {"problem.parameters.k": {"from": 0.5, "to": 1.0, "number": count}},
        "events": {"zero": {"when": name}, "turn": {"when": f"v{name}"}},
        "figures": ["trajectory", "section"],
    }
    figures = fvi.figures(fvi.run(config))
    typeset = {"x": "x", "phi": r"\varphi", "r1": "r_{1}"}[name]
    axes = figures["named-trajectory"].axes[0]
    assert axes.get_ylabel() == f"position ${typeset}(t)$"
    (legend,) = figures["named-section"].legends
    words = [text.get_text() for text in legend.get_texts()]
    if count == 2:
        assert words == ["zero, 0.5", "turn, 0.5", "zero, 1", "turn, 1"]
    else:
        assert words == ["zero", "turn"]


def test_units_are_labels_and_belong_to_something():
    (plain,) = fvi.run({**MEMBERS, "units": {}})
    (named,) = fvi.run({**MEMBERS, "figures": ["trajectory", "energy", "phase"]})
    one, other = plain.finished[0], named.finished[0]
    assert np.array_equal(one.trajectory.position, other.trajectory.position)
    assert one.run.specification() == other.run.specification()
    drawn = {name: figure.axes[0] for name, figure in fvi.figures(named).items()}
    assert drawn["seen-trajectory"].get_ylabel() == "position $x(t)$ (mm)"
    assert drawn["seen-energy"].get_ylabel() == "energy $H(x, p)$ (N mm)"
    assert drawn["seen-phase"].get_xlabel() == "position $x$ (mm)"
    assert drawn["seen-phase"].get_ylabel() == "momentum $p$ (N ms)"
    with pytest.raises(fvi.RequestError, match=r"units.forse: .* did you mean 'force'\?"):
        fvi.load({**MEMBERS, "units": {"forse": "N"}})


def test_small_steps_are_written_as_powers_of_ten():
    assert in_formula(2.5e-5) == r"2.5 \times 10^{-5}"
    assert in_formula(1e-6) == "10^{-6}"
    assert in_formula(0.125) == "0.125"


def test_a_column_that_ends_early_has_numbers_below_its_last_panel():
    columns, used = panel_grid(new_figure(3.0), 3, 2, sharex=True)
    assert columns == [[used[0], used[2]], [used[1]]]
    told = [axes.xaxis.get_tick_params()["labelbottom"] for axes in used]
    assert told == [False, True, True]


def test_what_a_figure_leaves_out_is_said():
    many = {f"q{k}": f"{k}*dx" for k in range(1, 10)}
    config = {**CONFIG, "quantities": many, "method": {"rk": "gauss", "degree": 3}}
    (outcome,) = fvi.run({**config, "figures": ["quantities"]})
    study = (outcome.experiment, outcome.finished)
    assert left_out([study]) == ["seen: the quantities figure shows 8 of 9 quantities"]
    (figure,) = fvi.figures(outcome).values()
    assert len(figure.axes) == 8
    assert figure.legends[0].get_title().get_text() == "the first 8 of 9 quantities"
    # the control: fewer are all drawn
    (outcome,) = fvi.run({**CONFIG, "figures": ["quantities"]})
    assert left_out([(outcome.experiment, outcome.finished)]) == []


@pytest.mark.few(1)
@pytest.mark.parametrize("coefficients", [[0.1, 0.2, 0.8], [0.05, 1.6]])
def test_every_member_of_a_sweep_for_a_tolerance_is_drawn(coefficients):
    config = {key: value for key, value in CONFIG.items() if key not in ("method", "ladder")}
    problem = {**CONFIG["problem"], "final_time": 10.0}
    config |= {"accuracy": {"tolerance": 1e-5}, "problem": problem, "events": {}}
    config |= {"sweep": {"problem.damping.0.coefficient": coefficients}, "output": {"step": 0.2}}
    outcomes = fvi.run({**config, "figures": ["trajectory", "quantities"]})
    # the control: they took different numbers of steps
    assert len({one.run.n_steps for one in outcomes[0].finished}) > 1
    for figure in fvi.figures(outcomes).values():
        for axes in figure.axes:
            labels = [str(line.get_label()) for line in axes.lines]
            assert [one for one in labels if one != "peak"] == [f"{c:g}" for c in coefficients]


@pytest.mark.parametrize(
    ("key", "label"),
    [
        ("problem.stiffness", "stiffness (N/m)"),
        ("problem.damping.0.moduli.1", "modulus 2 of the damping (N/m)"),
        ("problem.damping.0.times.0", "relaxation time 1 of the damping (s)"),
        ("problem.damping.0.coefficient", r"coefficient of the damping (N s$^\gamma$/m)"),
        ("problem.damping.0.order", r"order $\gamma$ of the damping"),
    ],
)
def test_entries_of_a_configuration_have_the_unit_that_follows(key, label):
    units = {"time": "s", "length": "m", "force": "N"}
    assert key_label(key, units) == label
    assert " (" not in key_label(key, {})


@pytest.mark.parametrize("order", [0.1, 0.75, 1])
def test_a_unit_has_the_order_that_stands_beside_its_coefficient(order):
    units = {"time": "s", "length": "m", "force": "N"}
    problem = {"damping": [{"order": order, "coefficient": 2.0}]}
    key, beside = "problem.damping.0.coefficient", "problem.damping.0.order"
    assert f"N s$^{{{order:g}}}$/m" in key_label(key, units, problem)
    # the control: an order that is varied has its letter
    assert r"N s$^\gamma$/m" in key_label(key, units, problem, [beside])
    assert r"order $\gamma$" in key_label(beside, units, problem, [beside])


@pytest.mark.parametrize("storeys", [2, 3, 12])
def test_quantities_of_a_frame_name_their_storeys(storeys):
    problem = {"kind": "frame", "storeys": storeys, "ground_acceleration": "sin(t)"}
    problem |= {"mass": 1.0, "stiffness": 40.0, "final_time": 1.0, "exact": "none"}
    own = {"drift_20": "vx1", f"drift_{storeys}": f"drift_{storeys}", "base_shear": "base_shear"}
    config = {"name": "named", "problem": problem, "ladder": {"steps": [20]}, "quantities": own}
    (experiment,) = fvi.load(config).experiments
    told = [quantity_in_words(experiment, name) for name in own]
    # the control: a quantity of one's own keeps its name
    assert told == ["drift 20", f"drift of storey {storeys}", "base shear"]
