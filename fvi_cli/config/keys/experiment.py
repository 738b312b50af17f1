"""The keys of an experiment and of a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final

from fvi_cli.config.keys.designs import Designs
from fvi_cli.config.keys.fit import Fit
from fvi_cli.config.keys.ladder import Ladder
from fvi_cli.config.keys.methods import METHODS
from fvi_cli.config.keys.observations import (
    EXAMPLE,
    Events,
    Impacts,
    Output,
    Quantities,
    Units,
)
from fvi_cli.config.keys.store import StoreKeys
from fvi_cli.config.keys.sweep import Members
from fvi_cli.keys.containers import ByForm, ListOf, Named
from fvi_cli.keys.scalars import Choice, Number, Text
from fvi_cli.keys.settings import Setting, key, record_of
from fvi_cli.scenes.registry import PROBLEM
from fvi_cli.studies.accuracy_settings import Accuracy
from fvi_cli.studies.experiment import FIGURE_KINDS
from fvi_cli.studies.figure_settings import EXAMPLE as EXAMPLE_OF_FIGURE
from fvi_cli.studies.figure_settings import FigureSettings
from fvi_cli.studies.norms import Norm
from fvi_cli.studies.stability_settings import StabilitySettings

NAME: Final = Text(
    what="letters, digits, - and _, beginning with a letter or digit",
    pattern="[A-Za-z0-9][A-Za-z0-9_-]*",
    longest=100,
)
"""A name that can be part of a file name."""

Name = Annotated[str, NAME]
_CASES: Final = "methods, such as bdf5,"
_FAILURES: Final = Choice(words=("unstable", "diverged", "failed"))


class _FigureWord(Choice):
    @property
    def expected(self) -> str:
        return f"{super().expected}; or a mapping such as {EXAMPLE_OF_FIGURE}"


_FIGURE: Final = ByForm(
    single=_FigureWord(words=FIGURE_KINDS), mappings=(record_of(FigureSettings),)
)
FIGURES: Final = ListOf(shape=_FIGURE, least=0, example="[convergence]")
_REFUSED: Final = {
    "methods": "not a key: write method",
    "steps": "not a key: write ladder: {steps: [16, 32, 64]}",
    "tolerance": "not a key: write accuracy: {tolerance: 1e-8}",
    "parameters": "not a key here: write it under problem",
    **dict.fromkeys(
        ("variants", "cases", "scenarios", "members", "design"),
        "not a key: write designs: {bare: {problem.damping: []}, ...}",
    ),
    **{
        name: f"not a key here: it stands under problem; with --set it is problem.{name}"
        for name in (
            *("kind", "masses", "stiffnesses", "stiffness", "damping", "dampers", "rayleigh"),
            *("final_time", "initial", "forcing", "ground_acceleration", "exact"),
        )
    },
    **dict.fromkeys(
        ("plot", "plots", "figure"), "not a key: write figures, such as figures: [convergence]"
    ),
}


class ReportKeys(Setting):
    """How errors are measured."""

    norm: Norm = key(
        "Norm of the error: max (over components and grid points), final (at final_time) or "
        "l2 (weighted by the step size).",
        default="max",
    )


class ExperimentKeys(Setting, refused=_REFUSED, forms=(("ladder",), ("accuracy",))):
    """An experiment."""

    name: Name | None = key(
        "Name of the experiment; file names come from it. Default: name of this file; "
        "required in a list of experiments.",
        default=None,
    )
    problem: Annotated[Any, PROBLEM] = key("What is solved.")
    method: Annotated[Any, METHODS] = key(
        "One method or several; every entry is a value or a list of values, and lists are "
        "combined. Default: {rk: gauss, degree: 3}; with accuracy Gauss methods.",
        default=None,
    )
    ladder: Ladder | None = key("Numbers of steps; this or accuracy is required.", default=None)
    accuracy: Accuracy | None = key(
        "In place of ladder: steps are chosen for a tolerance, and a second run estimates the "
        "error. Without method too, which else is one Gauss method, for its number of stages.",
        default=None,
    )
    designs: Designs = key(
        "Members by name, each with what it changes of the problem (null: the key is left out): "
        "one table and one figure compare them. With sweep: every design with every value.",
        default=None,
    )
    sweep: Members = key(
        "Members: every combination of values of some keys of the problem, or a list of mappings "
        "with the values of each member. They are computed together.",
        default=None,
    )
    report: ReportKeys = key("How errors are measured.", default={"norm": "max"})
    expect: Annotated[Mapping[str, str], Named(shape=_FAILURES, names=_CASES)] = key(
        "Failures that are known; they do not make the exit code 1.", default={}
    )
    claims: Annotated[Mapping[str, float], Named(shape=Number(), names=_CASES)] = key(
        "Orders that the source states, to compare with the measured ones.", default={}
    )
    figures: Annotated[tuple[str | FigureSettings, ...], FIGURES] = key(
        "Figures to draw. Default: convergence for a ladder of three or more numbers of steps, "
        "otherwise trajectory, energy, error and, where there are any, quantities; section draws "
        "velocity against position at events, and spectrum, of a sweep over stiffness or mass, the "
        f"largest displacement over the period. Or mappings: {EXAMPLE_OF_FIGURE}; an event in "
        "place of peak_... makes a bifurcation diagram, {section: turn, after: 50} draws the "
        "section of one event, and {ensemble: [x]} mean and spread of the members.",
        default=[],
    )
    store: StoreKeys = key("What is kept in files.", default={"every": 1})
    output: Output | None = key(
        "Times at which a run is stored, whatever its steps: "
        f"{EXAMPLE}. Default: the points of the mesh. For Runge-Kutta methods.",
        default=None,
    )
    quantities: Quantities = key(
        "Expressions in coordinates (x), their velocities (vx), accelerations (ax, from the "
        "equation of motion) and the damping force on them (dx, minus the sum of mu D^gamma x), t, "
        "parameters and, where the ground moves, ground_acceleration; stored with the position, "
        "with peak and RMS. Or a list of names that need no expression: force_1 of a damper, and "
        "drift_1, acceleration_1 (with the ground) and base_shear of a frame. For Runge-Kutta "
        "methods.",
        default=None,
    )
    events: Events = key(
        "Times at which expressions change their sign, found on the motion between the mesh "
        "points; stored with position and velocity. For Runge-Kutta methods.",
        default=None,
    )
    impacts: Impacts = key(
        "Surfaces on which the motion bounces. The damping remembers what was before; a motion at "
        "rest ends the run, which says when. Stored like events. For Runge-Kutta methods and a "
        "ladder.",
        default=None,
    )
    units: Units = key(
        "Units on the axes of figures: of time, length, velocity, acceleration, force, momentum, "
        "energy, of coordinates and of quantities. They are labels; no number is converted.",
        default=None,
    )
    stability: StabilitySettings = key(
        "What fvi stability computes for the methods and steps.", default={}
    )
    fit: Fit | None = key(
        "Which numbers of the problem fvi fit fits to which measurements.", default=None
    )


class NamedExperiment(ExperimentKeys):
    """An experiment in a list of them."""

    name: Name = key("Name of the experiment; file names come from it.")


SINGLE: Final = record_of(ExperimentKeys)
EXPERIMENT: Final = record_of(NamedExperiment)


class SeveralExperiments(Setting):
    """A list of experiments."""

    name: Name | None = key("File names come from it. Default: name of this file.", default=None)
    experiments: Annotated[tuple[NamedExperiment, ...], ListOf(shape=EXPERIMENT, most=1000)] = key(
        "Experiments, each with its name."
    )


SEVERAL: Final = record_of(SeveralExperiments)
