"""What the command line does, one call away: for notebooks and programs.

``import fvi_cli as fvi`` gives every name of this module; each is loaded when it is first used.

=================== ===========================================================================
command             call
=================== ===========================================================================
``fvi check``       :func:`load`
``fvi list``        :func:`shipped_titles`
``fvi run``         :func:`run`; ``--dry-run``: :func:`plan`
``fvi show``        :func:`contents`, :func:`configuration`; every run: :func:`recall`
``fvi convergence`` :func:`order_tables` of what :func:`run` or :func:`recall` gives
``fvi plot``        :func:`figures` of the same
``fvi quantities``  ``trajectory.observed`` of the same
``fvi stability``   :func:`stability`
``fvi modes``       :func:`modes`
``fvi response``    :func:`response`
``fvi cost``        :func:`cost`
``fvi fit``         :func:`fit`
``fvi hard-cases``  :func:`hard_cases`
``fvi export``      :func:`export`
``fvi merge``       :func:`merge_files`
``fvi forget``      :func:`forget`
``fvi new``         :func:`starter_config`
``fvi guide``       ``fvi_cli.config.guide_page``
``fvi schema``      :func:`json_schema`
=================== ===========================================================================

:func:`as_text` is what a command prints of a result, :func:`write` puts it into files and
:func:`compare` tells, as ``--check`` does, in what stored files differ. Without any configuration,
:func:`integrate` computes a :class:`Scene` by a :class:`Method`, or by the name of one, and
:func:`gradient` differentiates a number of its run by its parameters; :func:`solve` computes it to
a tolerance.

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
>>> sorted(fvi.figures([outcome]))[0]
'damped-oscillator-convergence'
>>> [table] = fvi.stability(config, observe=False)
>>> {row.verdict for row in table.rows}
{'stable'}
"""

from __future__ import annotations

from fvi_cli.api.calls import (
    configuration,
    contents,
    cost,
    export,
    fit,
    forget,
    hard_cases,
    load,
    modes,
    plan,
    recall,
    response,
    run,
    stability,
)
from fvi_cli.api.gradient import Gradient, gradient
from fvi_cli.config import (
    LoadedConfig,
    json_schema,
    method_named,
    shipped_titles,
    starter_config,
)
from fvi_cli.config import shipped_configs as shipped_configurations
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws.cole_cole import fractional_maxwell, fractional_zener
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.laws.prony import prony
from fvi_cli.effects.laws.tempered import tempered
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.effects.symmetry import Symmetry
from fvi_cli.errors import ConfigError, FviError, RequestError, StorageError
from fvi_cli.integrator.balances.diagnostics import Asked as DiagnosticsRequest
from fvi_cli.integrator.gradients.quantity import (
    Quantity,
    acceleration_at,
    misfit,
    position_at,
    quantity_at,
    smoothed_peak,
    velocity_at,
)
from fvi_cli.integrator.loop.checkpoint import Checkpoint
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh, graded_mesh, mesh_of, uniform_mesh
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.stability.prediction import StabilityPrediction
from fvi_cli.integrator.trajectory import Assessment, Trajectory
from fvi_cli.render.results import as_text, compare, figures, order_tables, write
from fvi_cli.runner.outcome import Outcome
from fvi_cli.runner.parts.merge import merge_files
from fvi_cli.runner.plan import PlannedRun
from fvi_cli.runner.scenes import integrate, integrate_members, integrate_part, predict_stability
from fvi_cli.scenes.lagrangian import lagrangian_scene
from fvi_cli.scenes.named import linear_oscillator, pendulum
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import build_problem
from fvi_cli.storage import StoredConfiguration, StoredFile
from fvi_cli.studies.cost import CostTable
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.fits.result import FitResult
from fvi_cli.studies.hard_cases.case import HardCaseReport
from fvi_cli.studies.order import OrderTable, order_table
from fvi_cli.studies.stability_study import StabilityTable
from fvi_cli.studies.study import study
from fvi_cli.studies.tolerance.search import solve
from fvi_cli.studies.vibration.modes import Mode, ModeTable
from fvi_cli.studies.vibration.response import ResponseTable

__all__ = [
    "AdaptiveSteps",
    "Assessment",
    "Baseline",
    "Checkpoint",
    "ConfigError",
    "CostTable",
    "DiagnosticsRequest",
    "Experiment",
    "ExpressionPotential",
    "FinishedRun",
    "FitResult",
    "Forcing",
    "ForcingPiece",
    "FractionalDamping",
    "FviError",
    "Gradient",
    "HardCaseReport",
    "Inertia",
    "Law",
    "LoadedConfig",
    "Mesh",
    "Method",
    "Mode",
    "ModeTable",
    "OrderTable",
    "Outcome",
    "PlannedRun",
    "Problem",
    "QuadraticPotential",
    "Quantity",
    "RequestError",
    "ResponseTable",
    "Run",
    "SampledForce",
    "Scene",
    "StabilityPrediction",
    "StabilityTable",
    "StorageError",
    "StoredConfiguration",
    "StoredFile",
    "Symmetry",
    "Trajectory",
    "acceleration_at",
    "as_text",
    "build_problem",
    "compare",
    "configuration",
    "contents",
    "cost",
    "export",
    "figures",
    "fit",
    "forget",
    "fractional_maxwell",
    "fractional_zener",
    "graded_mesh",
    "gradient",
    "hard_cases",
    "integrate",
    "integrate_members",
    "integrate_part",
    "json_schema",
    "lagrangian_scene",
    "linear_oscillator",
    "load",
    "merge_files",
    "mesh_of",
    "method_named",
    "misfit",
    "modes",
    "order_table",
    "order_tables",
    "pendulum",
    "plan",
    "position_at",
    "predict_stability",
    "prony",
    "quantity_at",
    "recall",
    "response",
    "run",
    "shipped_configurations",
    "shipped_titles",
    "smoothed_peak",
    "solve",
    "stability",
    "starter_config",
    "study",
    "tempered",
    "uniform_mesh",
    "velocity_at",
    "write",
]
