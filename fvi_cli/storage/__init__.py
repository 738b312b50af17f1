"""Result files: plain HDF5, written atomically, readable by xarray and netCDF4.

``<name>.h5`` holds ``/<experiment>/<case>/n000016/`` with the datasets ``time(time)``,
``position(time, dof)``, ``momentum(time, dof)``, ``energy(time)`` and attributes that say what was
run and what came out; members of a sweep share a group, with an axis ``member`` in front. Runs that
the configuration does not ask for lie in the same way below ``/@kept/<digest of their settings>/``,
references of errors below ``/@references/``, numbers of input files below ``/@inputs/``.
``/@configuration/`` has the configuration.
"""

from fvi_cli.storage.contents import StoredFile, StoredRun, list_runs, read_configuration
from fvi_cli.storage.store import Store, StoredConfiguration

__all__ = [
    "Store",
    "StoredConfiguration",
    "StoredFile",
    "StoredRun",
    "list_runs",
    "read_configuration",
]
