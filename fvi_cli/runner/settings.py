"""Settings of a computation: the options of a command."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fvi_cli.errors import RequestError
from fvi_cli.keys.complaints import excerpt
from fvi_cli.runner.executors.cluster import DaskCluster
from fvi_cli.runner.executors.executor import Executor, InProcess
from fvi_cli.runner.executors.processes import LocalProcesses
from fvi_cli.runner.parts.shard import WHOLE, Shard
from fvi_cli.runner.request import Request
from fvi_cli.studies.experiment import Experiment, Run

_SCHEMES = ("tcp", "tls", "ucx", "ws", "wss", "inproc")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How the runs of a request are computed, as the options of a command say.

    Raises
    ------
    RequestError
        If processes and a scheduler are given at the same time.
    """

    output: Path  # folder of results
    workers: int = 1  # number of processes of this machine
    dask: str | None = None  # address of a Dask scheduler; its workers replace local processes
    fresh: bool = False  # ignore stored runs
    show_progress: bool = True  # show progress
    keep: bool = True  # write results; otherwise no file is written
    # return the points of members of a sweep; a summary does not need them once they are stored
    keeps_motions: bool = True
    shard: Shard = WHOLE  # compute only this part of every configuration, into a file of its own

    def __post_init__(self) -> None:
        if self.dask is not None and self.workers > 1:
            raise RequestError("--workers and --dask: give one of them; a scheduler has its own")
        scheme, separator, _ = (self.dask or "").partition("://")
        if separator and scheme not in _SCHEMES:
            raise RequestError(
                f"--dask {excerpt(str(self.dask))}: is not the address of a scheduler, such as "
                "tcp://host:8786"
            )

    def executor(self) -> Executor:
        """The executor of runs."""
        if self.dask is not None:
            return DaskCluster(address=self.dask)
        if self.workers > 1:
            return LocalProcesses(workers=self.workers)
        return InProcess()

    def runs_of(self, request: Request) -> dict[Experiment, list[Run]]:
        """The runs and searches of this part of a configuration; for a result file all."""
        shard = self.shard if request.stored is None else WHOLE
        return shard.runs_of(request.loaded.experiments)

    def path_of(self, request: Request) -> Path:
        """Where the runs of `request` are, or would be, stored."""
        return request.stored or self.output / self.shard.file_name(request.name)
