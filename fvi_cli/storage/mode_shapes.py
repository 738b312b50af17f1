"""Mode shapes as an HDF5 file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from fvi_cli.storage.files import replacement
from fvi_cli.storage.hdf5 import LIBVER, attach_scales, make_group, put, write_attributes
from fvi_cli.studies.vibration.modes import ModeTable


def write_mode_shapes(path: Path, tables: Sequence[ModeTable]) -> None:
    """Write ``/<experiment>/`` with frequencies, damping and shapes of its modes.

    For a sweep there is ``/<experiment>/<number>/`` for each member, with the attribute ``member``.

    ``real``, ``imaginary`` (of s, 1/time), ``frequency_hz``, ``damping_ratio``, ``loss_factor``,
    ``residual``, all ``(mode,)``; ``shape_real``, ``shape_imaginary``, ``(mode, dof)``, the
    largest entry of each shape being 1; ``coordinate(dof)``: names. Every axis has a scale.
    """
    with replacement(path) as temporary, h5py.File(temporary, "w", libver=LIBVER) as file:
        for number, table in enumerate(tables):
            name = f"{table.name}/{number:05d}" if table.member else table.name
            _write(make_group(file, name), table)


def _write(group: h5py.Group, table: ModeTable) -> None:
    modes = table.modes
    shapes = np.array([mode.shape for mode in modes])
    columns = {
        "mode": np.arange(1, len(modes) + 1),
        "coordinate": np.array([name.encode() for name in table.coordinates], dtype="S"),
        "real": [mode.frequency.real for mode in modes],
        "imaginary": [mode.frequency.imag for mode in modes],
        "frequency_hz": [mode.hertz for mode in modes],
        "damping_ratio": [mode.damping_ratio for mode in modes],
        "loss_factor": [mode.loss_factor for mode in modes],
        "residual": [mode.residual for mode in modes],
        "shape_real": shapes.real.astype(float),
        "shape_imaginary": shapes.imag.astype(float),
    }
    for name, values in columns.items():
        put(group, name, np.asarray(values))
    counted = -1 if table.counted is None else table.counted
    complete = "yes" if table.is_complete else "no"
    write_attributes(group, {"member": table.member, "counted": counted, "complete": complete})
    of_mode = dict.fromkeys(columns, ("mode",))
    of_shapes = dict.fromkeys(("shape_real", "shape_imaginary"), ("mode", "dof"))
    attach_scales(group, of_mode | of_shapes | {"coordinate": ("dof",)})
