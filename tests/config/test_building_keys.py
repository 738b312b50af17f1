"""Buildings as engineers describe them: columns of files, equal dampers, ready quantities."""

import json

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.config import parse_config
from fvi_cli.effects.matrices import dense
from fvi_cli.scenes.records.inputs import kept_numbers
from fvi_cli.scenes.registry import build_scene

BUILDING = "storey,mass,stiffness\n1,2.5,60\n2,2.0,50\n3,1.5,40\n"
SHAKEN = """\
name: tower
problem:
  kind: frame
  masses: [2.5, 2.0, 1.5]
  stiffnesses: [60.0, 50.0, 40.0]
  dampers: [{name: low, storey: [1, 3], order: 0.6, coefficient: 3.0}]
  ground_acceleration: sin(3*t)
  final_time: 2.0
  exact: none
method: gauss4
ladder: {steps: [64]}
"""
FROM_FILE = SHAKEN.replace("[2.5, 2.0, 1.5]", "{file: building.csv, column: mass}").replace(
    "[60.0, 50.0, 40.0]", "{file: building.csv, column: stiffness}"
)
READY = """\
quantities:
  drift_2: drift_2
  own_drift: x2 - x1
  acceleration_3: acceleration_3
  own_acceleration: ax3 + ground_acceleration
  base_shear: base_shear
  own_shear: 2.5*ax1 + 2*ax2 + 1.5*ax3 + 6*ground_acceleration
  by_masses: mass_1*ax1 + mass_2*ax2 + mass_3*ax3 + 6*ground_acceleration
"""
LAWS = (
    {"order": 0.7, "coefficient": 0.8},
    {"law": "zener", "order": 0.6, "time": 0.3, "relaxed": 0.5, "unrelaxed": 4.0},
    {"law": "kelvin-voigt", "stiffness": 2.0, "coefficient": 0.6},
)


def loaded(tmp_path, text, building=BUILDING):
    (tmp_path / "building.csv").write_text(building, encoding="utf-8")
    return parse_config(text, "tower.yaml", base=tmp_path)


def observed_of(text):
    (outcome,) = fvi.run(parse_config(text, "tower.yaml"))
    return [one.trajectory.observed for one in outcome.finished]


def test_columns_of_a_file_are_the_lists_and_stand_with_their_digest(tmp_path):
    read = loaded(tmp_path, FROM_FILE)
    (described,) = read.resolved["experiments"]
    stored = described["problem"]["masses"]
    assert kept_numbers(stored["digest"]).tolist() == [2.5, 2.0, 1.5]
    # what was read stands for the file wherever the configuration goes
    written = parse_config(SHAKEN, "tower.yaml")
    for other in (read, parse_config(json.dumps(described), "again.yaml")):
        one, same = (each.experiments[0].problem.scene for each in (other, written))
        assert np.array_equal(one.inertia.form, same.inertia.form)
        assert np.array_equal(dense(one.potential.form), dense(same.potential.form))


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.get("law", "springpot"))
def test_a_damper_in_several_storeys_is_one_in_each(law):
    common = {
        "kind": "frame",
        "masses": [2.0, 1.5, 1.0],
        "stiffnesses": [60.0, 50.0, 40.0],
        "ground_acceleration": "sin(3*t)",
        "final_time": 2.0,
    }
    several = build_scene({**common, "dampers": [{"storey": [3, 1], **law}]})
    each = build_scene({**common, "dampers": [{"storey": k, **law} for k in (3, 1)]})
    names = {"force_1_3": "force_1", "force_1_1": "force_2", "deformation_1_1": "deformation_2"}
    one = fvi.integrate(several, "gauss4", 48, quantities={name: name for name in names})
    other = fvi.integrate(each, "gauss4", 48, quantities={name: name for name in names.values()})
    assert np.abs(one.position - other.position).max() < 1e-12 * np.abs(one.position).max()
    for name, same in names.items():
        expected = other.observed.quantities[same]
        error = np.abs(one.observed.quantities[name] - expected).max()
        assert error < 1e-11 * np.abs(expected).max()
    with pytest.raises(ValueError, match="force_1_2"):
        fvi.integrate(several, "gauss4", 48, quantities={"f": "force_1_2"})


def test_ready_quantities_are_what_their_formulas_say():
    (found,) = observed_of(SHAKEN + READY)
    pairs = ("drift_2", "own_drift"), ("acceleration_3", "own_acceleration")
    for one, other in (*pairs, ("base_shear", "own_shear"), ("base_shear", "by_masses")):
        a, b = found.quantities[one], found.quantities[other]
        assert np.abs(a - b).max() < 1e-13 * np.abs(b).max()
        assert found.extents[one].peak == pytest.approx(found.extents[other].peak, rel=1e-12)


def test_ready_quantities_serve_events_figures_units_and_fits(tmp_path):
    (found,) = observed_of(SHAKEN + "events: {over: {when: drift_1 - 0.01}}\n")
    assert found.events["over"].time.size > 0
    figure = "figures: [{plot: peak_base_shear, against: problem.dampers.0.coefficient}]\n"
    swept = SHAKEN + "sweep: {problem.dampers.0.coefficient: [3.0, 30.0]}\n" + figure
    swept += "quantities: [base_shear]\nunits: {base_shear: kN}\n"
    (experiment,) = parse_config(swept, "tower.yaml").experiments
    assert list(experiment.observations.quantities) == ["base_shear"]
    (found,) = observed_of(SHAKEN + "quantities: [acceleration_3]\n")
    rows = zip(range(65), found.quantities["acceleration_3"].tolist(), strict=True)
    (tmp_path / "roof.csv").write_text("t,a\n" + "".join(f"{k / 32},{a!r}\n" for k, a in rows))
    fit = "fit:\n  data: {file: roof.csv, columns: {acceleration_3: a}}\n  parameters: {%s: {}}\n"
    fit %= "problem.dampers.0.coefficient"
    (result,) = fvi.fit(loaded(tmp_path, SHAKEN.replace("3.0}]", "2.0}]") + fit))
    assert result.best.estimates[0].value == pytest.approx(3.0, rel=1e-6)
