"""Diagnostics as datasets and attributes of their run, and back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.results.diagnostics import Diagnostics

MAP_NAMES: Final = "momentum_maps"
"""Attribute with the names of the momentum maps along the axis ``map``, as a JSON list."""

DIAGNOSTIC_DIMENSIONS: Final[Mapping[str, tuple[str, ...]]] = {
    "dissipated_work": ("time",),
    "forcing_work": ("time",),
    "energy_defect": ("time",),
    "stored_energy": ("time",),
    "map": ("map",),
    "momentum_map": ("time", "map"),
    "momentum_map_defect": ("time", "map"),
}
DIAGNOSTIC_NAMES: Final[Mapping[str, str]] = {
    "dissipated_work": "work done against the damping since the start",
    "forcing_work": "work done by the forcing since the start",
    "energy_defect": "energy less its start, plus dissipated work, less work of the forcing",
    "stored_energy": "energy in the memory of the damping",
    "map": "momentum map, named in the attribute momentum_maps of the run",
    "momentum_map": "momentum of a symmetry",
    "momentum_map_defect": "momentum of a symmetry less its start and what damping and forcing "
    "have changed",
}


def diagnostic_datasets(diagnostics: Diagnostics | None) -> dict[str, NDArray[Any]]:
    """The datasets by name, in the order of :data:`DIAGNOSTIC_DIMENSIONS`."""
    if diagnostics is None:
        return {}
    datasets: dict[str, NDArray[Any]] = {}
    for name in DIAGNOSTIC_DIMENSIONS:
        if name == "map":
            values = np.arange(len(diagnostics.map_names)) if diagnostics.map_names else None
        else:
            values = getattr(diagnostics, name)
        if values is not None:
            datasets[name] = values
    return datasets


def diagnostic_attributes(diagnostics: Diagnostics | None) -> dict[str, str]:
    """The attributes of a run that belong to its diagnostics."""
    if diagnostics is None or not diagnostics.map_names:
        return {}
    return {MAP_NAMES: json.dumps(list(diagnostics.map_names), ensure_ascii=False)}


def diagnostics_of(
    attributes: Mapping[str, Any], datasets: Mapping[str, NDArray[Any]]
) -> Diagnostics | None:
    """The diagnostics again; None if there are none."""
    found = {name: datasets[name] for name in DIAGNOSTIC_DIMENSIONS if name in datasets}
    found.pop("map", None)
    if not found:
        return None
    return Diagnostics(**found, map_names=tuple(json.loads(attributes.get(MAP_NAMES, "[]"))))
