"""The public names, imported from their modules."""

from fvi_cli.api.derivatives import Gradient as Gradient
from fvi_cli.api.derivatives import gradient as gradient
from fvi_cli.config import LoadedConfig as LoadedConfig
from fvi_cli.effects.damping import FractionalDamping as FractionalDamping
from fvi_cli.effects.forcing import Forcing as Forcing
from fvi_cli.effects.forcing import ForcingPiece as ForcingPiece
from fvi_cli.effects.inertia import Inertia as Inertia
from fvi_cli.effects.laws import Law as Law
from fvi_cli.effects.laws import fractional_maxwell as fractional_maxwell
from fvi_cli.effects.laws import fractional_zener as fractional_zener
from fvi_cli.effects.laws import prony as prony
from fvi_cli.effects.potential import ExpressionPotential as ExpressionPotential
from fvi_cli.effects.potential import Potential as Potential
from fvi_cli.effects.potential import QuadraticPotential as QuadraticPotential
from fvi_cli.effects.sampled import SampledForce as SampledForce
from fvi_cli.effects.scene import Scene as Scene
from fvi_cli.errors import ConfigError as ConfigError
from fvi_cli.errors import FviError as FviError
from fvi_cli.errors import RequestError as RequestError
from fvi_cli.errors import StorageError as StorageError
from fvi_cli.integrator.gradients.quantity import acceleration_at as acceleration_at
from fvi_cli.integrator.gradients.quantity import misfit as misfit
from fvi_cli.integrator.gradients.quantity import position_at as position_at
from fvi_cli.integrator.gradients.quantity import quantity_at as quantity_at
from fvi_cli.integrator.gradients.quantity import velocity_at as velocity_at
from fvi_cli.integrator.integrate import integrate as integrate
from fvi_cli.integrator.integrate import integrate_members as integrate_members
from fvi_cli.integrator.meshes.controller import AdaptiveSteps as AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh as Mesh
from fvi_cli.integrator.meshes.mesh import graded_mesh as graded_mesh
from fvi_cli.integrator.meshes.mesh import mesh_of as mesh_of
from fvi_cli.integrator.method import Baseline as Baseline
from fvi_cli.integrator.method import Method as Method
from fvi_cli.integrator.method import method_named as method_named
from fvi_cli.integrator.stability.prediction import StabilityPrediction as StabilityPrediction
from fvi_cli.integrator.stability.prediction import predict_stability as predict_stability
from fvi_cli.integrator.trajectory import Assessment as Assessment
from fvi_cli.integrator.trajectory import Trajectory as Trajectory
from fvi_cli.render.results import as_text as as_text
from fvi_cli.render.results import figures as figures
from fvi_cli.render.results import order_tables as order_tables
from fvi_cli.render.results import quantities as quantities
from fvi_cli.render.results import write as write
from fvi_cli.runner.compute import recall as recall
from fvi_cli.runner.compute import run as run
from fvi_cli.runner.outcome import Outcome as Outcome
from fvi_cli.runner.request import load as load
from fvi_cli.runner.studies import cost as cost
from fvi_cli.runner.studies import fit as fit
from fvi_cli.runner.studies import stability as stability
from fvi_cli.runner.vibration import modes as modes
from fvi_cli.runner.vibration import response as response
from fvi_cli.scenes.data import duffing as duffing
from fvi_cli.scenes.data import kepler as kepler
from fvi_cli.scenes.data import pendulum as pendulum
from fvi_cli.scenes.lagrangian import double_pendulum as double_pendulum
from fvi_cli.scenes.lagrangian import lagrangian_scene as lagrangian_scene
from fvi_cli.scenes.problem import Problem as Problem
from fvi_cli.scenes.structures import chain as chain
from fvi_cli.scenes.structures import frame as frame
from fvi_cli.scenes.structures import linear_oscillator as linear_oscillator
from fvi_cli.scenes.structures import string as string
from fvi_cli.scenes.structures import structure as structure
from fvi_cli.storage import StoredFile as StoredFile
from fvi_cli.storage import list_runs as _list_runs
from fvi_cli.storage.export import export_file as _export_file
from fvi_cli.studies.cost import CostTable as CostTable
from fvi_cli.studies.experiment import Experiment as Experiment
from fvi_cli.studies.experiment import FinishedRun as FinishedRun
from fvi_cli.studies.experiment import Run as Run
from fvi_cli.studies.fits.result import FitResult as FitResult
from fvi_cli.studies.order import OrderTable as OrderTable
from fvi_cli.studies.study import StabilityTable as StabilityTable
from fvi_cli.studies.tolerance.search import solve as solve
from fvi_cli.studies.vibration.modes import Mode as Mode
from fvi_cli.studies.vibration.modes import ModeTable as ModeTable
from fvi_cli.studies.vibration.response import ResponseTable as ResponseTable

# under their own names
contents = _list_runs
export = _export_file
bagley_torvik = damped_oscillator = linear_oscillator
lagrangian = lagrangian_scene
