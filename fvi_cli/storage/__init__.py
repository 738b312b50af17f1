"""Result files: plain HDF5, written atomically, readable by xarray and netCDF4.

``<name>.h5`` holds ``/<experiment>/<case>/n000016/`` with the datasets ``time(time)``,
``position(time, dof)``, ``momentum(time, dof)``, ``energy(time)`` and attributes that name method,
run and result, and ``/<experiment>/<case>/convergence`` with ``n_steps``, ``step_size``, ``error``,
``seconds``, ``history_operations`` and ``status``. The attributes of the root say where the file
comes from.
"""

from fvi_cli.storage.contents import (
    StoredConfiguration,
    StoredFile,
    StoredRun,
    list_runs,
    read_config_text,
    read_configuration,
)
from fvi_cli.storage.reasons import NEW, Reasons
from fvi_cli.storage.records import place_of
from fvi_cli.storage.results import (
    Results,
    StoredRuns,
    holds_runs,
    open_results,
    read_results,
)

__all__ = [
    "NEW",
    "Reasons",
    "Results",
    "StoredConfiguration",
    "StoredFile",
    "StoredRun",
    "StoredRuns",
    "holds_runs",
    "list_runs",
    "open_results",
    "place_of",
    "read_config_text",
    "read_configuration",
    "read_results",
]
