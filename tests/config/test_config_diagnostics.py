"""Diagnostics from YAML to file and back."""

import numpy as np
import pytest
from command_line import configuration
from stored_runs import stored

from fvi_cli.config import parse_config
from fvi_cli.plotting.kinds.motions import balance_figure
from fvi_cli.storage.identity import identity_of
from fvi_cli.studies.study import execute

KEPLER = configuration(
    "kind: kepler, initial: {position: [1, 0], velocity: [0, 0.8]}, final_time: 4.0",
    name="planet",
    method="gauss2",
    more="store: {every: 3, diagnostics: [energy-balance]}\n",
)


def test_runs_without_diagnostics_keep_their_identity():
    bare = "\n".join(KEPLER.splitlines()[:-1]) + "\nstore: {every: 3}\n"
    empty = bare.replace("{every: 3}", "{every: 3, diagnostics: []}")
    identities = [
        identity_of(parse_config(text, "planet.yaml").experiments[0].runs()[0])
        for text in (bare, empty, KEPLER)
    ]
    assert identities[0] == identities[1] != identities[2]
    specification = parse_config(bare, "p.yaml").experiments[0].runs()[0].settings()
    assert "diagnostics" not in specification


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
    computed = list(map(execute, experiment.runs()))
    read = stored(tmp_path / "planet.h5", computed).read([one.run for one in computed])
    found = [read[one.run] for one in computed]
    for one, other in zip(computed, found, strict=True):
        expected, works = one.trajectory.diagnostics, other.trajectory.diagnostics
        assert works.time.size > 60
        assert np.abs(works.energy_defect).max() < 1e-10
        for name in ("time", "dissipated_work", "energy_defect", "stored_energy"):
            assert np.array_equal(getattr(works, name), getattr(expected, name)), name
    assert balance_figure(experiment, found)
