"""Result files: plain HDF5, written atomically, readable by xarray and netCDF4.

``<name>.h5`` holds ``/<experiment>/<case>/n000016/`` with the datasets ``time(time)``,
``position(time, dof)``, ``momentum(time, dof)``, ``energy(time)`` and attributes that name method,
run and result; members of a sweep share a group, with an axis ``member`` in front. Runs with other
values than those of the file's configuration are stored in the same way below
``/<experiment>@1a2b3c4d/``, long lists of numbers of configurations below ``/@inputs/``, and
``/@index/`` lists the paths of all runs. Attributes of the root hold provenance.
"""

from fvi_cli.storage.contents import (
    StoredConfiguration,
    StoredFile,
    has_configuration,
    list_runs,
    read_configuration,
)
from fvi_cli.storage.files import escape_text
from fvi_cli.storage.groups.listing import StoredRun
from fvi_cli.storage.store import Store, open_results, read_results

__all__ = [
    "Store",
    "StoredConfiguration",
    "StoredFile",
    "StoredRun",
    "escape_text",
    "has_configuration",
    "list_runs",
    "open_results",
    "read_configuration",
    "read_results",
]
