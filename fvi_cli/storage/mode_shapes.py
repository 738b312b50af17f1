"""Mode shapes as an HDF5 file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from fvi_cli.storage.files import explain_os_error, replacement
from fvi_cli.studies.vibration.modes import ModeTable


def write_mode_shapes(path: Path, tables: Sequence[ModeTable]) -> None:
    """Write ``/<experiment>/`` with frequencies, damping and shapes of its modes.

    For a sweep there is ``/<experiment>/<number>/`` for each member, with the attribute ``member``.

    ``real``, ``imaginary`` (of s, 1/time), ``frequency_hz``, ``damping_ratio``, ``loss_factor``,
    ``residual``, all ``(mode,)``; ``shape_real``, ``shape_imaginary``, ``(mode, dof)``, the
    largest entry of each shape being 1; ``coordinate(dof)``: names. Every axis has a scale.
    """
    with explain_os_error(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with (
            replacement(path) as handle,
            os.fdopen(os.dup(handle), "w+b") as stream,
            h5py.File(stream, "w") as file,
        ):
            for number, table in enumerate(tables):
                path_of_group = f"{table.name}/{number:05d}" if table.member else table.name
                group = file.create_group(path_of_group)
                group.attrs["member"] = table.member
                _write(group, table)


def _write(group: h5py.Group, table: ModeTable) -> None:
    modes = table.modes
    group["mode"] = np.arange(1, len(modes) + 1)
    group["dof"] = np.arange(len(table.coordinates))
    for axis in ("mode", "dof"):
        group[axis].make_scale(axis)
    # names of thousands of coordinates exceed the largest attribute
    group.create_dataset(
        "coordinate", data=np.array(table.coordinates, dtype=object), dtype=h5py.string_dtype()
    ).dims[0].attach_scale(group["dof"])
    columns = {
        "real": [mode.frequency.real for mode in modes],
        "imaginary": [mode.frequency.imag for mode in modes],
        "frequency_hz": [mode.hertz for mode in modes],
        "damping_ratio": [mode.damping_ratio for mode in modes],
        "loss_factor": [mode.loss_factor for mode in modes],
        "residual": [mode.residual for mode in modes],
    }
    for name, values in columns.items():
        group[name] = np.array(values)
        group[name].dims[0].attach_scale(group["mode"])
    shapes = np.array([mode.shape for mode in modes])
    for name, part in (("shape_real", shapes.real), ("shape_imaginary", shapes.imag)):
        group[name] = part
        group[name].dims[0].attach_scale(group["mode"])
        group[name].dims[1].attach_scale(group["dof"])
    group.attrs["counted"] = -1 if table.counted is None else table.counted
    group.attrs["complete"] = "yes" if table.is_complete else "no"
