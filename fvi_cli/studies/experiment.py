"""The experiment: what a configuration describes."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.mesh import Mesh, graded_mesh, uniform_mesh
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.problem import AnyProblem
from fvi_cli.studies.fits.settings import FitSettings
from fvi_cli.studies.members import Member
from fvi_cli.studies.norms import Measured, Norm
from fvi_cli.studies.settings import Accuracy, FigureSettings, StabilitySettings

T = TypeVar("T")
Observed = Literal["ok", "floor", "diverged", "failed", "refused"]
Predicted = Literal["stable", "unstable", "unknown"]

FigureKind = Literal[
    "convergence",
    "trajectory",
    "energy",
    "error",
    "balance",
    "phase",
    "path",
    "waterfall",
    "quantities",
    "section",
    "hysteresis",
    "spectrum",
]
"""Kinds of figures that ``Experiment.figures`` may name."""
_graded = functools.lru_cache(maxsize=64)(graded_mesh)
"""Members share one mesh, and so are a batch."""
UNITS = ("time", "length", "velocity", "acceleration", "force", "momentum", "energy")
"""Keys of ``units`` other than names of coordinates and quantities."""
STAGES_BYTES = 10_000_000
"""Velocities at the stages of a run that are kept take at most so many bytes."""
NEEDS_LADDER = (
    "accuracy chooses one run; give a ladder, for example --set ladder.steps=[64,128,256]"
)
"""Advice where a tolerance is not possible."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """One problem, several methods, a ladder of step counts."""

    name: str
    """Used for files: letters, digits, ``-`` and ``_``."""
    problem: AnyProblem
    """Scene and exact solution; for a sweep those of the first member."""
    problem_specification: Mapping[str, Any]
    """The resolved mapping that made the problem (JSON values only); it enters the identity."""
    methods: tuple[AnyMethod, ...]
    """Every combination, in the order of the configuration."""
    steps: tuple[int, ...]
    """Step counts N, increasing."""
    grading: float = 1.0
    """r of the mesh :math:`a + (b - a) (k/N)^r` between break points; 1: equal steps."""
    norm: Norm = "max"
    """Norm of the error."""
    expect: Mapping[str, str] = field(default_factory=dict)
    """Known failures: from a case name, or its first part such as ``bdf5``, to ``unstable``."""
    store_every: int = 1
    """Keep every n-th grid point in files."""
    claims: Mapping[str, float] = field(default_factory=dict)
    """Orders that the source of the experiment claims, by case name or its first part."""
    figures: tuple[str | FigureSettings, ...] = ()
    """Which figures to draw: ``convergence``, ``trajectory``, or something against a swept key."""
    members: tuple[Member, ...] = ()
    """The members of a sweep; empty: the experiment has one problem."""
    stability: StabilitySettings = field(default_factory=StabilitySettings)
    """What ``fvi stability`` computes in addition to the verdicts on the runs."""
    diagnostics: bool = False
    """What is computed and stored with every trajectory."""
    observations: Observations = field(default_factory=Observations)
    """Times, quantities and events requested of every run."""
    accuracy: Accuracy | None = None
    """A tolerance in place of `steps`, which are empty until a method and a number of steps are
    chosen; then these are the only ones."""
    fit: FitSettings | None = None
    """Parameters and measurements of the fit; None: no fit."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units for figures and tables by the words of :data:`UNITS`, names of coordinates and names
    of quantities; they are labels, numbers are not converted."""

    def __repr__(self) -> str:
        """Name, methods and steps; the scene is too long for a line."""
        steps = ", ".join(map(str, self.steps)) or "to be found"
        members = f", {len(self.members)} members" if self.members else ""
        return f"<Experiment {self.name}: {len(self.methods)} methods, N = {steps}{members}>"

    @property
    def needs_search(self) -> bool:
        """Whether method and number of steps are still to be chosen for a tolerance."""
        return self.accuracy is not None and not self.steps

    def chosen_run(self, method: AnyMethod, n_steps: int, member: Member | None = None) -> Run:
        """The run that was chosen for the tolerance; its experiment has no other run."""
        chosen = replace(self, methods=(method,), steps=(n_steps,))
        return Run(experiment=chosen, method=method, n_steps=n_steps, member=member)

    @property
    def swept(self) -> tuple[str, ...]:
        """Key paths in which the members differ."""
        return tuple(self.members[0].values) if self.members else ()

    def runs(self) -> list[Run]:
        """Every run, method by method, steps increasing, then member by member.

        Where method and number of steps are still to be chosen: one search for every scene.
        """
        if self.accuracy is not None and self.needs_search:
            first = self.chosen_run(self.accuracy.methods[0], 1)
            return [replace(first, member=member) for member in self.members or (None,)]
        return [
            Run(experiment=self, method=method, n_steps=n, member=member)
            for method in self.methods
            for n in self.steps
            for member in self.members or (None,)
        ]

    def expects_failure(self, method: AnyMethod) -> bool:
        """Whether the configuration says that this method fails here."""
        return lookup_case(self.expect, method) is not None

    def claim(self, method: AnyMethod) -> float:
        """The order that the source of the experiment claims for this method; nan: none."""
        found = lookup_case(self.claims, method)
        return math.nan if found is None else found


def lookup_case(mapping: Mapping[str, T], method: AnyMethod) -> T | None:
    """The entry whose key is the method's case or its beginning up to a ``-``; longest first."""
    case = method.case
    for key in sorted(mapping, key=len, reverse=True):
        if case == key or case.startswith(key + "-"):
            return mapping[key]
    return None


@dataclass(frozen=True, kw_only=True, eq=False, slots=True, weakref_slot=True)
class Subject:
    """The subject of a study: an experiment, or one member of its sweep."""

    experiment: Experiment
    member: Member | None = None

    @property
    def name(self) -> str:
        """The experiment, and its member in parentheses."""
        name = self.experiment.name
        return name if self.member is None else f"{name} ({self.member.label})"

    @property
    def problem(self) -> AnyProblem:
        """Scene and exact solution."""
        return self.experiment.problem if self.member is None else self.member.problem

    @property
    def problem_specification(self) -> Mapping[str, Any]:
        """The resolved mapping that made the problem."""
        if self.member is None:
            return self.experiment.problem_specification
        return self.member.specification

    @property
    def scene(self) -> Scene:
        """The scene of the problem.

        Raises
        ------
        ValueError
            For a fractional derivative, which has no motion.
        """
        scene = self.problem.scene
        if scene is None:
            raise ValueError(f"{self.experiment.name}: has no motion")
        return scene


@dataclass(frozen=True, kw_only=True, eq=False, repr=False, slots=True)
class Run(Subject):
    """One method with one number of steps, and one member where there is a sweep."""

    method: AnyMethod
    n_steps: int

    @property
    def is_search(self) -> bool:
        """Whether method and steps are chosen for a tolerance."""
        return self.experiment.accuracy is not None

    @property
    def step_size(self) -> float:
        """H = T / N, on a graded mesh the mean step; the final time is never swept."""
        return self.experiment.problem.final_time / self.n_steps

    @property
    def keeps_steps(self) -> bool:
        """Whether its steps are kept as polynomials: of single ``rk`` runs of few bytes."""
        method = self.method
        if self.member is not None or not isinstance(method, Method) or not method.is_runge_kutta:
            return False
        return 8 * self.n_steps * method.stages * self.problem.dimension <= STAGES_BYTES

    @property
    def steps(self) -> int | Mesh:
        """The steps for `integrate`: N, or the graded mesh of N steps."""
        grading, scene = self.experiment.grading, self.problem.scene
        if grading == 1.0 or scene is None:
            return self.n_steps
        return _graded(scene.final_time, self.n_steps, grading, scene.break_points)

    @property
    def times(self) -> NDArray[np.float64]:
        """The times that a complete run reports, shape ``(N + 1,)``."""
        steps, scene = self.steps, self.problem.scene
        if isinstance(steps, int) and scene is not None and scene.break_points:
            steps = uniform_mesh(scene.final_time, steps, scene.break_points)
        if isinstance(steps, Mesh):
            return steps.times
        return self.step_size * np.arange(self.n_steps + 1, dtype=float)

    @property
    def observations(self) -> Observations:
        """Requested outputs of the motion, with the parameters of this run."""
        observations = self.experiment.observations
        if observations.is_empty or self.member is None:
            return observations
        problem = self.problem
        return replace(observations, parameters=problem.numbers, inputs=problem.inputs)

    @property
    def method_label(self) -> str:
        """Name of the method for readers; the start says nothing of steps that are chosen."""
        return self.method.family if self.is_search else self.method.label

    @property
    def title(self) -> str:
        """The run in one line."""
        title = f"{self.experiment.name} {self.method_label}, N={self.n_steps}"
        return title if self.member is None else f"{title} ({self.member.label})"

    def settings(self) -> dict[str, Any]:
        """What determines the numbers apart from the problem, as JSON values."""
        experiment = self.experiment
        method = vars(self.method) | {
            key: str(value) for key, value in vars(self.method).items() if key == "quadrature"
        }
        found = {"method": method, "n_steps": self.n_steps, "store.every": experiment.store_every}
        if experiment.grading != 1.0:
            found["grading"] = experiment.grading
        if experiment.diagnostics:
            found["diagnostics"] = {"energy_balance": True}
        if experiment.accuracy is not None:
            found |= {
                "accuracy": experiment.accuracy.specification(),
                "report.norm": experiment.norm,
            }
        return found | experiment.observations.specification()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False, slots=True)
class FinishedRun:
    """A run with its trajectory and error."""

    run: Run
    """The run that was requested."""
    trajectory: Trajectory
    """Its result."""
    error: float
    """The error in the experiment's norm; nan when it has no meaning."""
    floor: float
    """Errors below this are round-off or the reference's own error."""
    status: Observed
    """Observed: ``ok``, ``floor``, ``diverged``, ``failed`` or ``refused``."""
    predicted: Predicted = "unknown"
    """``stable``, ``unstable`` or ``unknown``."""
    order_smooth: float = float("nan")
    """Order that theory expects on this scene in this norm; nan when none is stated."""
    reference: str = "unknown"
    """The reference of the error, in words."""
    measured: Measured | None = None
    """The error in every norm, and the numbers from which its floor follows; None where the error
    is an estimate or the run was not computed."""

    @property
    def used_in_fit(self) -> bool:
        """Whether slopes use it: status ``ok``, and an error above the floor."""
        return self.status == "ok" and 0 < self.error < math.inf and not self.error <= self.floor


def finest_of_members(finished: Sequence[FinishedRun]) -> list[FinishedRun]:
    """For every member the run on the finest grid by the first method."""
    found: dict[int, FinishedRun] = {}
    first: dict[int, str] = {}
    for one in finished:
        number = -1 if one.run.member is None else one.run.member.number
        # a search for a tolerance may choose another method for every member
        case = first.setdefault(number if one.run.is_search else -1, one.run.method.case)
        best = found.get(number)
        if one.run.method.case == case and (best is None or one.run.n_steps > best.run.n_steps):
            found[number] = one
    return [found[number] for number in sorted(found)]
