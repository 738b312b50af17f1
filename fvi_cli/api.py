"""What the command line does, one call away: for notebooks and programs.

``import fvi_cli as fvi`` gives every name of this module; each is loaded when it is first used.

Examples
--------
>>> import fvi_cli as fvi
>>> config = fvi.load("damped-oscillator", overrides=["ladder.steps=[256, 512]"])
>>> outcome, = fvi.run(config)
>>> outcome.finished[0].trajectory.position.shape
(257, 1)
>>> [table] = fvi.order_tables([outcome])
>>> table.cases[0].method.case, round(table.cases[0].slope, 1)
('bdf1-nodes-s1-gauss1-none', 0.9)
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fvi_cli import campaign
from fvi_cli.campaign import Outcome
from fvi_cli.config import LoadedConfig, find_config, load_config, parse_config
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ConfigError, FviError, RequestError, StorageError
from fvi_cli.experiments.experiment import Experiment, FinishedRun, Run
from fvi_cli.experiments.order import OrderTable, order_table
from fvi_cli.experiments.order import order_tables as tables_of_orders
from fvi_cli.experiments.study import study
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.stability import StabilityPrediction, predict_stability
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.named import linear_oscillator, pendulum
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import build_problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "Baseline",
    "ConfigError",
    "Experiment",
    "ExpressionPotential",
    "FinishedRun",
    "Forcing",
    "ForcingPiece",
    "FractionalDamping",
    "FviError",
    "Inertia",
    "LoadedConfig",
    "Method",
    "OrderTable",
    "Outcome",
    "Problem",
    "QuadraticPotential",
    "RequestError",
    "Run",
    "Scene",
    "StabilityPrediction",
    "StorageError",
    "Trajectory",
    "build_problem",
    "export",
    "figures",
    "integrate",
    "linear_oscillator",
    "load",
    "order_table",
    "order_tables",
    "pendulum",
    "predict_stability",
    "recall",
    "run",
    "study",
]

Source = str | Path | Mapping[str, Any] | LoadedConfig


def load(source: Source, *, overrides: Sequence[str] = ()) -> LoadedConfig:
    """Read and check a configuration.

    Parameters
    ----------
    source
        A file, the name of a shipped configuration, or what would stand in the file as a mapping
        (with its ``name``).
    overrides
        Changes ``key.path=value`` as of ``--set``, validated like the rest.

    Raises
    ------
    ConfigError
        Every mistake at once.
    RequestError
        For a name that is neither a file nor a shipped configuration.
    """
    if isinstance(source, LoadedConfig):
        if overrides:
            raise RequestError("overrides: give them when the configuration is first loaded")
        return source
    if isinstance(source, Mapping):
        # JSON is YAML: the same checks, the same words
        text = json.dumps(source, indent=1)
        return parse_config(text, str(source.get("name", "mapping")), overrides=overrides)
    return load_config(find_config(str(source)), overrides=overrides)


def run(
    source: Source,
    *,
    output: Path | str | None = None,
    workers: int = 1,
    fresh: bool = False,
    fail_fast: bool = False,
) -> list[Outcome]:
    """Compute every run of a configuration, as ``fvi run`` does.

    Parameters
    ----------
    source
        As for :func:`load`.
    output
        Folder where ``<name>.h5`` is kept; runs that are stored there are not computed again.
        None: nothing is written or looked up.
    workers
        Number of processes. More than one needs the usual ``if __name__ == "__main__"`` guard in
        a program.
    fresh, fail_fast
        As the options of the command line.

    Returns
    -------
    list of Outcome
        One for every experiment, with its finished runs; a run that failed is among them with its
        status, not an exception.
    """
    loaded = load(source)
    settings = campaign.Settings(
        output=Path(output or "."),
        workers=workers,
        fresh=fresh or output is None,
        fail_fast=fail_fast,
        show_progress=False,
        keep=output is not None,
    )
    return campaign.answer(campaign.Request(name=loaded.name, loaded=loaded), settings)


def recall(path: Path | str) -> list[Outcome]:
    """Read every run of a result file; nothing is computed.

    Raises
    ------
    StorageError
        If it cannot be read.
    """
    (request,) = campaign.gather([str(path)])
    return campaign.answer(request, campaign.Settings(output=Path(path).parent))


def order_tables(outcomes: Sequence[Outcome]) -> list[OrderTable]:
    """Tables of orders, one for every experiment, as ``fvi convergence`` makes them."""
    return [
        table
        for outcome in outcomes
        for table in tables_of_orders(outcome.experiment, outcome.finished)
    ]


def figures(outcomes: Sequence[Outcome], *, name: str = "figure") -> dict[str, Figure]:
    """Figures of the experiments by name, as ``fvi plot`` draws them; none is written."""
    from fvi_cli.output.figures import figures_for

    return figures_for([(o.experiment, o.finished) for o in outcomes], name=name)


def export(path: Path | str, form: str, directory: Path | str) -> list[Path]:
    """Write the runs of a result file as ``csv``, ``npz`` or ``mat``, as ``fvi export`` does."""
    from fvi_cli.output.export import export_file

    return export_file(Path(path), form, Path(directory))
