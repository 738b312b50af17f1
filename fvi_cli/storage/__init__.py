"""Result files: plain HDF5, written atomically, readable by xarray and netCDF4.

``<name>.h5`` holds ``/<experiment>/<case>/n000016/`` with the datasets ``time(time)``,
``position(time, dof)``, ``momentum(time, dof)``, ``energy(time)`` and attributes that name method,
run and result, and ``/<experiment>/<case>/convergence`` with ``n_steps``, ``step_size``, ``error``,
``seconds``, ``history_operations`` and ``status``; members of a sweep share a group, with an axis
``member`` in front. Runs of other values than those of the file's configuration lie in the same way
below ``/<experiment>@1a2b3c4d/``. The attributes of the root say where the file comes from.
"""

from fvi_cli.storage.comparison.reasons import NEW, Reasons
from fvi_cli.storage.contents import (
    StoredConfiguration,
    StoredFile,
    StoredRun,
    list_runs,
    read_configuration,
)
from fvi_cli.storage.files import PARTS_SUFFIX, printable
from fvi_cli.storage.opening import open_results, read_results
from fvi_cli.storage.records import place_of, variant_of
from fvi_cli.storage.snapshot import Location, key_of
from fvi_cli.storage.store import Store

__all__ = [
    "NEW",
    "PARTS_SUFFIX",
    "Location",
    "Reasons",
    "Store",
    "StoredConfiguration",
    "StoredFile",
    "StoredRun",
    "key_of",
    "list_runs",
    "open_results",
    "place_of",
    "printable",
    "read_configuration",
    "read_results",
    "variant_of",
]
