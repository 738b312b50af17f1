"""Checking a configuration loads no engine, and thousands of members are checked soon."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from fvi_cli.config import find_config, parse_config
from fvi_cli.errors import ConfigError
from fvi_cli.scenes import forces

HEAVY = ("scipy", "h5py", "matplotlib", "sympy", "mpmath", "fvi_cli.storage")

CHECK = """
import sys
from fvi_cli.cli.app import app
try:
    app(["check"])(["check", sys.argv[1]])
except SystemExit as end:
    assert not end.code, end
print(" ".join(sys.modules))
"""


def loaded_by_check(config: Path) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", CHECK, str(config)], capture_output=True, text=True, check=True
    )
    assert ": valid, " in done.stdout
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.processes
def test_checking_a_nonlinear_scene_loads_numpy_yaml_and_no_engine(tmp_path):
    config = tmp_path / "small.yaml"
    config.write_text("problem: {kind: duffing, final_time: 1.0}\nladder: {steps: [8, 16]}\n")
    loaded = loaded_by_check(config)
    assert {"numpy", "yaml", "fvi_cli.config.load"} <= loaded
    assert not [name for name in loaded if name.startswith(HEAVY)]
    engine = {"fvi_cli.integrator.integrate", "fvi_cli.integrator.baselines.run"}
    assert not engine & loaded


@pytest.mark.processes
def test_what_few_configurations_call_for_is_loaded_with_them():
    # control: what is not loaded above can be seen
    assert "fvi_cli.integrator.baselines.run" in loaded_by_check(
        find_config("damped-oscillator-comparison")
    )


def test_members_that_share_a_force_have_it_read_once(caplog):
    text = (
        "name: many\nproblem: {kind: duffing, forcing: sin(t), final_time: 1.0}\n"
        "ladder: {steps: [8]}\nsweep: {problem.mass: {from: 1, to: 2, number: %d}}\n"
    )
    forces._parsed.cache_clear()
    with caplog.at_level("INFO", logger="fvi_cli"):
        parse_config(text % 400, "many.yaml")
        assert not caplog.messages
        parse_config(text % 5000, "many.yaml")
    # the force, and the zero of coordinates without one
    assert forces._parsed.cache_info().misses <= 2
    assert caplog.messages == ["checking 5000 members of a sweep"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize("name", ["pipe", "/dev/zero"])
def test_a_force_from_a_pipe_or_a_device_is_refused_without_reading(tmp_path, name):
    os.mkfifo(tmp_path / "pipe")
    text = f"problem: {{kind: duffing, forcing: {{file: {name}, column: a}}, final_time: 1}}\n"
    with pytest.raises(ConfigError, match="not a file"):
        parse_config(text + "name: a\nladder: {steps: 8}\n", "f.yaml", base=tmp_path)
