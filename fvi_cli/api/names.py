"""The public names, by where they come from."""

from __future__ import annotations

from fvi_cli.api.derivatives import Gradient, gradient
from fvi_cli.config import (
    LoadedConfig,
    json_schema,
    method_named,
    shipped_titles,
    starter_config,
)
from fvi_cli.config import shipped_configs as shipped_configurations
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.diagnostics_request import DiagnosticsRequest
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws.cole_cole import fractional_maxwell, fractional_zener
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.laws.prony import prony
from fvi_cli.effects.laws.tempered import tempered
from fvi_cli.effects.potential import ExpressionPotential, Potential, QuadraticPotential
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.effects.symmetry import Symmetry
from fvi_cli.errors import ConfigError, FviError, RequestError, StorageError
from fvi_cli.integrator.gradients.quantity import (
    Quantity,
    acceleration_at,
    misfit,
    position_at,
    quantity_at,
    smoothed_peak,
    velocity_at,
)
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh, graded_mesh, mesh_of, uniform_mesh
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.run.checkpoint import Checkpoint
from fvi_cli.integrator.stability.prediction import StabilityPrediction
from fvi_cli.integrator.trajectory import Assessment, Trajectory
from fvi_cli.render.results import as_text, compare, figures, order_tables, quantities, write
from fvi_cli.runner.compute import recall, run
from fvi_cli.runner.cost import cost
from fvi_cli.runner.fits.fit import fit
from fvi_cli.runner.forget import forget
from fvi_cli.runner.hard_cases import hard_cases
from fvi_cli.runner.outcome import Outcome
from fvi_cli.runner.parts.merge import merge_files
from fvi_cli.runner.plan import PlannedRun, plan
from fvi_cli.runner.request import load
from fvi_cli.runner.scenes import integrate, integrate_members, integrate_part, predict_stability
from fvi_cli.runner.stability import stability
from fvi_cli.runner.vibration import modes, response
from fvi_cli.scenes.chains import chain, frame, string
from fvi_cli.scenes.data import duffing, kepler, linear_oscillator, pendulum
from fvi_cli.scenes.lagrangian import double_pendulum, lagrangian_scene
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import build_problem, sandwich_beam
from fvi_cli.scenes.structures.structure import structure
from fvi_cli.storage import StoredConfiguration, StoredFile
from fvi_cli.storage import list_runs as contents
from fvi_cli.storage import read_configuration as configuration
from fvi_cli.storage.export import export_file as export
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

# kinds under their own names
bagley_torvik = damped_oscillator = linear_oscillator
lagrangian = lagrangian_scene

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
    "Potential",
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
    "bagley_torvik",
    "build_problem",
    "chain",
    "compare",
    "configuration",
    "contents",
    "cost",
    "damped_oscillator",
    "double_pendulum",
    "duffing",
    "export",
    "figures",
    "fit",
    "forget",
    "fractional_maxwell",
    "fractional_zener",
    "frame",
    "graded_mesh",
    "gradient",
    "hard_cases",
    "integrate",
    "integrate_members",
    "integrate_part",
    "json_schema",
    "kepler",
    "lagrangian",
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
    "quantities",
    "quantity_at",
    "recall",
    "response",
    "run",
    "sandwich_beam",
    "shipped_configurations",
    "shipped_titles",
    "smoothed_peak",
    "solve",
    "stability",
    "starter_config",
    "string",
    "structure",
    "study",
    "tempered",
    "uniform_mesh",
    "velocity_at",
    "write",
]
