"""Diagnostics from YAML to file and back."""

import numpy as np
import pytest
import xarray
from command_line import configuration
from stored_runs import stored

from fvi_cli.config import parse_config
from fvi_cli.plotting.kinds.motions import balance_figure
from fvi_cli.storage import Store
from fvi_cli.storage.identity import identity_of
from fvi_cli.studies.study import study

KEPLER = configuration(
    "kind: kepler, damping: [{order: 0.5, coefficient: 0.05}], initial: {position: [1.0, "
    "0.0], velocity: [0.0, 0.8]}, final_time: 4.0",
    name="planet",
    method="[{rk: gauss, degree: 2}, {baseline: explicit-euler}]",
    steps="64",
    more="store: {every: 3, diagnostics: [energy-balance]}\n",
)
DUFFING = "name: d\nproblem: {kind: duffing, final_time: 2.0}\nladder: {steps: [4]}\n"


def kept(tmp_path, text):
    config = parse_config(text, "planet.yaml")
    stored(tmp_path / "planet.h5", list(study(config.experiments[0])))
    return config


def test_diagnostics_come_back_as_they_were_computed(tmp_path):
    config = kept(tmp_path, KEPLER)
    (computed, plain) = study(config.experiments[0])
    read = stored(tmp_path / "planet.h5", [computed, plain]).read([computed.run, plain.run])
    found = read[computed.run].trajectory.diagnostics
    assert read[plain.run].trajectory.diagnostics is None
    points = np.append(np.arange(0, 64, 3), 64)
    for name in ("dissipated_work", "forcing_work", "energy_defect"):
        expected = getattr(computed.trajectory.diagnostics, name)[points]
        assert np.array_equal(getattr(found, name), expected), name
    assert np.abs(found.energy_defect).max() < 1e-3 < found.dissipated_work[-1]


def test_other_readers_find_axes_and_names(tmp_path):
    kept(tmp_path, KEPLER)
    group = "/planet/gauss-s2-graded/n000064"
    for engine in ("h5netcdf", "netcdf4"):
        with xarray.open_dataset(tmp_path / "planet.h5", engine=engine, group=group) as data:
            assert data["energy_defect"].dims == ("mesh",)
            assert "work" in data["dissipated_work"].attrs["long_name"]


def test_runs_without_diagnostics_keep_their_identity():
    bare = "\n".join(KEPLER.splitlines()[:-1]) + "\nstore: {every: 3}\n"
    empty = bare.replace("{every: 3}", "{every: 3, diagnostics: []}")
    identities = [
        identity_of(parse_config(text, "planet.yaml").experiments[0].runs()[0])
        for text in (bare, empty, KEPLER)
    ]
    assert identities[0] == identities[1] != identities[2]
    specification = parse_config(bare, "p.yaml").experiments[0].runs()[0].specification()
    assert "diagnostics" not in specification


def test_what_is_asked_for_is_diagnosed():
    store = "store: {diagnostics: [energy-balance]}\n"
    method = "method: {rk: gauss}"
    (moving,) = parse_config(f"{DUFFING}{method}\n{store}", "d.yaml").experiments
    assert moving.diagnostics
    assert moving.methods[0].start == "graded"


def test_energy_that_the_damping_stores_is_kept(tmp_path):
    text = (
        "name: planet\nproblem: {kind: damped-oscillator, stiffness: 2, final_time: 8, "
        "damping: [{order: 0.5, coefficient: 0.7}], initial: {position: 1, velocity: 0.5}}\n"
        "method: [{rk: gauss, degree: 2}, {bdf: 2}]\nladder: {steps: [64]}\n"
        "store: {diagnostics: [energy-balance]}\n"
    )
    config = kept(tmp_path, text)
    graded, backward = config.experiments[0].runs()
    results = Store(tmp_path / "planet.h5").read([graded, backward])
    trajectory = results[graded].trajectory
    assert results[backward].trajectory.diagnostics.stored_energy is None
    stored = trajectory.diagnostics.stored_energy
    assert stored[0] == 0 < stored.max()
    # the energy of the scene alone rises now and then: the damper gives back
    assert np.diff(trajectory.energy).max() > 1e-3
    assert np.diff(trajectory.energy + stored).max() < 0
    group = f"/planet/{graded.method.case}/n000064"
    with xarray.open_dataset(tmp_path / "planet.h5", engine="h5netcdf", group=group) as data:
        assert data["stored_energy"].dims == ("mesh",)
    figure = balance_figure(config.experiments[0], [next(study(config.experiments[0]))])
    assert "stored part of $W_d$" in [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.mark.parametrize(
    "more",
    [
        "output: {step: 0.3}\n",
        "output: {step: 0.3}\nimpacts: {wall: {when: x + 0.2, restitution: 0.8}}\n",
        "impacts: {wall: {when: x + 0.2, restitution: 0.8}}\nevents: {top: {when: vx}}\n",
    ],
)
def test_works_beside_output_impacts_and_events(tmp_path, more):
    text = (
        "name: planet\nproblem: {kind: damped-oscillator, stiffness: 2, final_time: 3, "
        "damping: [{order: 0.5, coefficient: 0.7}], initial: {position: 1, velocity: 0.5}}\n"
        "method: {rk: gauss, degree: 3}\nladder: {steps: [60]}\n"
        f"store: {{diagnostics: [energy-balance]}}\nfigures: [balance]\n{more}"
    )
    experiment = parse_config(text, "planet.yaml").experiments[0]
    computed = list(study(experiment))
    read = stored(tmp_path / "planet.h5", computed).read([one.run for one in computed])
    found = [read[one.run] for one in computed]
    for one, other in zip(computed, found, strict=True):
        expected, works = one.trajectory.diagnostics, other.trajectory.diagnostics
        assert works.time.size > 60
        assert np.abs(works.energy_defect).max() < 1e-10
        for name in ("time", "dissipated_work", "energy_defect", "stored_energy"):
            assert np.array_equal(getattr(works, name), getattr(expected, name)), name
    assert balance_figure(experiment, found)
