"""A tolerance in place of a ladder from the command line: chosen, stored, recalled, refused."""

import json
import re

import command_line
import h5py
import pytest

from fvi_cli.config import parse_config
from fvi_cli.errors import ConfigError
from fvi_cli.storage.hdf5 import read_attributes

CONFIG = """\
name: tuned
problem:
  kind: damped-oscillator
  damping: [{order: 0.5, coefficient: 0.3}]
  initial: {position: 1.0}
  final_time: 4.0
method: gauss6
accuracy: {tolerance: 1e-7}
"""
ADAPTIVE = CONFIG.replace("method: gauss6\n", "")


@pytest.fixture
def fvi(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tuned.yaml").write_text(CONFIG)
    (tmp_path / "found.yaml").write_text(ADAPTIVE.replace("tuned", "found"))

    def call(*arguments, expected=0):
        return command_line.fvi(*arguments, code=expected).stdout

    return call


def stored(tmp_path, name="tuned"):
    """Attributes of the only run."""
    with h5py.File(tmp_path / "results" / f"{name}.h5") as file:
        cases = file[name]
        return [
            read_attributes(group)
            for runs in cases.values()
            for name, group in runs.items()
            if name != "convergence"
        ]


def test_a_method_beside_it_fixes_the_number_of_stages(fvi, tmp_path):
    (experiment,) = parse_config(CONFIG, "tuned.yaml").experiments
    assert {method.degree for method in experiment.methods} == {6}
    assert experiment.needs_search
    fvi("run", "tuned.yaml")
    (run,) = stored(tmp_path)
    assert run["error"] <= run["estimate"] <= run["tolerance"]
    assert "gauss-s6" in run["case"]
    for method in ("bdf3", "gauss1", "[gauss4, gauss6]", "{baseline: explicit-euler}"):
        with pytest.raises(ConfigError, match="with accuracy, one method such as gauss6"):
            parse_config(CONFIG.replace("gauss6", method), "tuned.yaml")


def test_a_longest_step_is_kept(fvi, tmp_path):
    fvi("run", "found.yaml", "--set", "accuracy.max_step=0.1")
    (run,) = stored(tmp_path, "found")
    assert run["n_steps"] >= 40


def test_a_tolerance_below_the_floor_is_refused_and_the_exit_code_says_so(fvi, tmp_path):
    said = fvi("run", "tuned.yaml", "--set", "accuracy.tolerance=1e-15", expected=1)
    assert "refused" in said
    # it is stored, and says so again
    again = fvi("run", "tuned.yaml", "--set", "accuracy.tolerance=1e-15", expected=1)
    assert "refused" in again
    (run,) = stored(tmp_path)
    assert (run["status"], run["tolerance"]) == ("refused", 1e-15)


def test_steps_are_found_on_the_way(fvi, tmp_path):
    assert (
        json.loads(fvi("run", "found.yaml", "--dry-run", "--json"))["tasks"][0]["memory_bytes"]
        is None
    )
    fvi("run", "found.yaml")
    (run,) = stored(tmp_path, "found")
    assert run["error"] <= run["estimate"] <= run["tolerance"] == 1e-7
    assert run["n_steps"] < 40
    with h5py.File(tmp_path / "results" / "found.h5") as file:
        ((group,),) = (case.values() for case in file["found"].values())
        time = group["time"][:]
    assert time.size == run["n_steps"] + 1
    assert (time[0], time[-1]) == (0.0, 4.0)
    assert time[1] < 1e-3 * time[-1]


def test_relative_tolerances(fvi, tmp_path):
    config = ADAPTIVE.replace("tolerance: 1e-7", "relative: 1e-7").replace("1.0}", "1e-3}")
    (tmp_path / "small.yaml").write_text(config.replace("tuned", "small"))
    fvi("run", "small.yaml")
    (run,) = stored(tmp_path, "small")
    assert run["relative"] == 1e-7
    assert run["tolerance"] == pytest.approx(1e-10, rel=1e-6)
    assert run["error"] <= run["tolerance"]
    assert "reuse" in fvi("run", "small.yaml", "--dry-run")


def test_members_of_a_sweep_have_their_own_meshes(fvi, tmp_path):
    values = [0.5, 200.0, 200.5]
    text = f"{ADAPTIVE}sweep: {{problem.stiffness: {values}}}\n".replace("tuned", "swept")
    (tmp_path / "swept.yaml").write_text(text)
    fvi("run", "swept.yaml")
    with h5py.File(tmp_path / "results/swept.h5") as file:
        groups = [one for case in file["swept"].values() for one in case.values()]
        runs = [one for one in groups if "n_steps" in one.attrs]
        found = {one.attrs["problem.stiffness"]: one for one in runs}
        assert sorted(found) == values
        for stiffness, one in found.items():
            assert one["position"].shape[0] == one.attrs["n_steps"] + 1
            single = text[: text.index("sweep")].replace(
                "  damping", f"  stiffness: {stiffness}\n  damping"
            )
            (tmp_path / "single.yaml").write_text(single.replace("swept", "single"))
            fvi("run", "single.yaml", "--fresh")
            with h5py.File(tmp_path / "results/single.h5") as alone:
                (same,) = (
                    r
                    for case in alone["single"].values()
                    for r in case.values()
                    if "n_steps" in r.attrs
                )
                assert same["position"][:].tolist() == one["position"][:].tolist()
    # one more value: the others are recalled; another tolerance: none is
    more = text.replace("200.5]", "200.5, 7.0]")
    (tmp_path / "swept.yaml").write_text(more)
    planned = fvi("run", "swept.yaml", "--dry-run")
    assert re.search(r"reuse +Gauss, adaptive steps, 3 members", planned)
    assert re.search(r"compute +Gauss, adaptive steps, 1 members", planned)
    assert "reuse" not in fvi("run", "swept.yaml", "--dry-run", "--set", "accuracy.tolerance=1e-6")


@pytest.mark.processes
def test_workers_choose_what_this_process_would(fvi, tmp_path):
    text = f"{ADAPTIVE}sweep: {{problem.damping.0.order: [0.5, 1.5]}}\n".replace("tuned", "swept")
    (tmp_path / "swept.yaml").write_text(text)
    here = json.loads(fvi("run", "swept.yaml", "--json", "-o", "here"))["runs"]
    there = json.loads(fvi("run", "swept.yaml", "--json", "-o", "there", "--workers", "2"))["runs"]
    for one, other in zip(here, there, strict=True):
        for run in (one, other):
            del run["seconds"]
        assert one == other
