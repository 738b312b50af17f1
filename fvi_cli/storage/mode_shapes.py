"""Mode shapes as an HDF5 file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from fvi_cli.storage.files import explain_os_error, replacement
from fvi_cli.storage.hdf5 import LIBVER, NewGroup, write_attributes
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
            h5py.File(stream, "w", libver=LIBVER) as file,
        ):
            for number, table in enumerate(tables):
                name = f"{table.name}/{number:05d}" if table.member else table.name
                _write(NewGroup(file, name), table)


def _write(group: NewGroup, table: ModeTable) -> None:
    modes = table.modes
    group.add("mode", ("mode",), np.arange(1, len(modes) + 1))
    names = np.array([name.encode() for name in table.coordinates], dtype="S")
    group.add("coordinate", ("dof",), names)
    columns = {
        "real": [mode.frequency.real for mode in modes],
        "imaginary": [mode.frequency.imag for mode in modes],
        "frequency_hz": [mode.hertz for mode in modes],
        "damping_ratio": [mode.damping_ratio for mode in modes],
        "loss_factor": [mode.loss_factor for mode in modes],
        "residual": [mode.residual for mode in modes],
    }
    for name, values in columns.items():
        group.add(name, ("mode",), np.array(values, dtype=float))
    shapes = np.array([mode.shape for mode in modes])
    group.add("shape_real", ("mode", "dof"), shapes.real.astype(float))
    group.add("shape_imaginary", ("mode", "dof"), shapes.imag.astype(float))
    counted = -1 if table.counted is None else table.counted
    complete = "yes" if table.is_complete else "no"
    write_attributes(group.id, {"member": table.member, "counted": counted, "complete": complete})
    group.attach_scales()
