"""Whatever a file holds, xarray finds the same numbers in it, by h5netcdf and by netCDF4."""

import warnings
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr

from fvi_cli.config import parse_config
from fvi_cli.runner.compute import run

OSCILLATOR = """
    problem:
      kind: bagley-torvik
      mass: [[1, 0], [0, 2]]
      stiffness: [[2, -1], [-1, 2]]
      damping: [{order: 1.5, coefficient: [[0.5, 0], [0, 30]]}]
      initial: {position: [1, 0], velocity: 0}
      final_time: 1.0
    ladder: {steps: [4, 8]}
"""
CONFIG = f"""
name: everything
experiments:
  - name: plain
    {OSCILLATOR.strip()}
    method: [{{rk: gauss, degree: 2}}, {{baseline: implicit-euler}}]
    store: {{diagnostics: [energy-balance]}}
  - name: thinned
    {OSCILLATOR.strip()}
    method: {{rk: gauss, degree: 2, start: none}}
    store: {{every: 2}}
  - name: not-finished
    {OSCILLATOR.strip()}
    method: [{{bdf: 6, sampling: nodes}}]
  - name: swept
    {OSCILLATOR.strip()}
    method: {{rk: gauss, degree: 2}}
    sweep: {{problem.damping.0.order: [0.5, 1.5]}}
  - name: derivative
    problem: {{kind: fractional-derivative, order: 0.5, function: t**2, final_time: 1.0}}
    method: {{bdf: 2, sampling: nodes}}
    ladder: {{steps: [4, 8]}}
"""


def groups_of(path: Path) -> dict[str, dict[str, Any]]:
    """Every group with arrays, as h5py reads it."""
    found: dict[str, dict[str, Any]] = {}

    def look(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset):
            group, _, own = f"/{name}".rpartition("/")
            text = node.asstr() if h5py.check_string_dtype(node.dtype) else node
            found.setdefault(group or "/", {})[own] = text[()]

    with h5py.File(path) as file:
        file.visititems(look)
    return found


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
def test_a_file_is_opened_with_the_numbers_in_it(tmp_path, engine):
    run(parse_config(CONFIG, "everything.yaml"), output=tmp_path)
    path = tmp_path / "everything.h5"
    expected, statuses = groups_of(path), set()
    with warnings.catch_warnings():
        # names with dots and the like are remarked on by some versions
        warnings.simplefilter("ignore")
        opened = {name: data.load() for name, data in xr.open_groups(path, engine=engine).items()}
    assert {name for name, data in opened.items() if data.variables} == set(expected)
    for name, arrays in expected.items():
        data = opened[name]
        assert set(data.variables) == set(arrays)
        for own, values in arrays.items():
            found = np.asarray(data[own])
            if found.dtype.kind in "fiu":
                np.testing.assert_array_equal(found, values)  # nan is nan
            else:
                read = [one.decode() if isinstance(one, bytes) else one for one in found.tolist()]
                assert read == np.asarray(values).tolist()
        status = data.attrs.get("status", b"")
        statuses |= {status.decode() if isinstance(status, bytes) else status}
    assert {"ok", "diverged"} <= statuses
