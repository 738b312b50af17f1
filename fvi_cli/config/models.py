"""Keys of an experiment, and of a file that holds several."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from fractions import Fraction as ExactFraction
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fvi_cli.config.fits.keys import FitKeys, SweptKey
from fvi_cli.config.methods import Methods
from fvi_cli.integrator.observe.request import Direction
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.scenes.keys.values import (
    BY_FORM,
    ONE_OR_MANY,
    WORD,
    Formula,
    Increasing,
    Keys,
    NotNegative,
    Positive,
    Range,
    from_key,
    key,
)
from fvi_cli.scenes.registry import AnyKind
from fvi_cli.studies.experiment import FigureKind
from fvi_cli.studies.norms import Norm
from fvi_cli.studies.settings import EXAMPLE as FIGURE_EXAMPLE
from fvi_cli.studies.settings import Accuracy, FigureSettings, StabilitySettings

MOST_STEPS: Final = 2**30
MOST_TIMES: Final = 10_000_000
MOST_MEMBERS: Final = 100_000
NO_MOTION: Final = {
    "fractional-derivative": "it has no motion",
    "material": "its motion is given",
}
NOT_FOR: Final = {
    "fractional-derivative": ("accuracy", "output", "quantities", "events", "impacts", "fit"),
    "material": ("accuracy", "impacts"),
}
"""By kind of problem the keys of an experiment that do not apply to it."""
EXCLUSIVE: Final = (("accuracy", "ladder"), ("impacts", "accuracy"))
LADDER: Final = "{steps: [16, 32, 64]} or {from: 4, to: 6, base: 2}"

NAME: Final = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"
LONGEST_NAME: Final = 100
FileName = Annotated[str, Field(pattern=NAME, max_length=LONGEST_NAME)]
"""A name that can be part of a file name."""
Steps = Annotated[int, Field(ge=1, le=MOST_STEPS)]
Word = Annotated[str, Field(pattern=WORD)]


class Ladder(Keys):
    """Numbers of steps: a list, or the powers of a base."""

    steps: Annotated[Increasing[Steps], Field(max_length=100), ONE_OR_MANY] | None = key(
        "Numbers N of steps, increasing; the step size is final_time / N.", None
    )
    from_: Annotated[int, Field(ge=0, le=30)] | None = from_key(
        "In place of steps: the first exponent k of N = base**k.", None
    )
    to: Annotated[int, Field(ge=0, le=30)] | None = key("The last exponent.", None)
    base: Annotated[int, Field(ge=2, le=MOST_STEPS)] | None = key("The base; default: 2.", None)
    grading: Annotated[float, Field(ge=1)] | None = key(
        "r of the mesh a + (b - a) (k/N)**r on every stretch [a, b] between break points, at most "
        "20; rk: gauss with start: none only. Default: 1, equal steps.",
        None,
    )

    def mistakes(self) -> Iterator[Wrong]:
        """Both forms, half a form, or too many steps."""
        powers = {"from": self.from_, "to": self.to, "base": self.base}
        if self.steps is not None:
            for name, value in powers.items():
                if value is not None:
                    yield Wrong((name,), "not together with steps", of_key=True)
        elif self.from_ is None or self.to is None:
            missing = "from" if self.from_ is None else "to"
            yield Wrong((), f"{missing} is missing; it must be {LADDER}")
        elif self.to < self.from_:
            yield Wrong(("to",), f"{self.to} is less than from = {self.from_}")
        elif (base := self.base or 2) ** self.to > MOST_STEPS:
            words = f"{base}**{self.to} steps are too many; at most {MOST_STEPS} are allowed"
            yield Wrong(("to",), words)

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers of steps."""
        if self.from_ is not None and self.to is not None:
            return tuple((self.base or 2) ** k for k in range(self.from_, self.to + 1))
        return tuple(self.steps or ())


class Report(Keys):
    """How errors are measured."""

    norm: Norm = key(
        "Norm of the error: max (over components and grid points), final (at final_time) or l2 "
        "(weighted by the step size).",
        "max",
    )


class Store(Keys):
    """The points and diagnostics that files keep."""

    every: Steps = key("Keep every n-th grid point in files.", 1)
    diagnostics: list[Literal["energy-balance"]] | None = key(
        "What is stored in addition to the motion: energy-balance (dissipated work, work of the "
        "forcing, defect of the balance). Default: nothing.",
        None,
    )


class Output(Keys):
    """Times at which a run is stored, whatever its steps."""

    step: Positive | None = key("The times 0, step, twice step and so on.", None, unit="time")
    times: Annotated[Increasing[NotNegative], Field(max_length=MOST_TIMES)] | None = key(
        "The times themselves, increasing.", None, unit="time"
    )

    def mistakes(self) -> Iterator[Wrong]:
        """Both forms, or none."""
        if (self.step is None) == (self.times is None):
            yield Wrong((), "one of step and times is needed: {step: 0.01} or {times: [0, 0.5]}")

    def instants(self, final_time: float) -> NDArray[np.float64] | Wrong:
        """The times of a run up to T, or what is wrong with them."""
        for number, time in enumerate(self.times or ()):
            if time > final_time:
                words = f"{time:g} is after final_time = {final_time:g}"
                return Wrong(("times", number), words)
        if self.step is None:
            return np.array(self.times, dtype=float)
        count = final_time / self.step * (1 + 1e-12) + 1
        if count >= MOST_TIMES + 1:
            words = f"{count:.7g} times are too many; at most {MOST_TIMES} are allowed"
            return Wrong(("step",), words)
        # exact multiples of the decimal number as written, each rounded once
        step = ExactFraction(repr(self.step))
        above, below = step.numerator, step.denominator
        return np.minimum([k * above / below for k in range(int(count))], final_time)


class EventKeys(Keys):
    """Times at which an expression changes its sign."""

    when: Formula = key("Expression as under quantities; the event is its change of sign.")
    direction: Direction = key("rising: from below to above 0; falling; or any.", "any")
    stop: bool = key("End the run at the first of them.", False)


class ImpactKeys(Keys):
    """A surface on which the motion bounces."""

    when: Formula = key(
        "Expression in coordinates, t and parameters: the motion stays where it is positive, and "
        "bounces at its falling roots."
    )
    restitution: Annotated[float, Field(ge=0, le=1)] = key(
        "The velocity along the normal is reversed and multiplied by it, 0 to 1.", 1.0
    )


Changes = dict[SweptKey, Any]
Values = Annotated[list[Any], Field(min_length=1)]


class MemberKeys(Keys):
    """What makes members."""

    designs: Annotated[dict[str, Changes | None], Field(min_length=1)] | None = key(
        "Members by name, each with what it changes of the problem (null: the key is left out): "
        "one table and one figure compare them. With sweep: every design with every value.",
        None,
    )
    sweep: (
        Annotated[
            dict[SweptKey, Annotated[Range | Values, BY_FORM]] | list[Changes],
            BY_FORM,
            Field(min_length=1),
        ]
        | None
    ) = key(
        "Members: every combination of values of some keys of the problem, or a list of mappings "
        "with the values of each member. They are computed together.",
        None,
    )

    def mistakes(self) -> Iterator[Wrong]:
        """Keys that members share, that lie inside each other, and too many members."""
        for name, changes in (self.designs or {}).items():
            yield from _shared(changes or {}, ("designs", name))
        if self.designs and not self.changed:
            words = "a change is missing, such as {bare: {problem.damping: []}}"
            yield Wrong(("designs",), words)
        rows = self.sweep if isinstance(self.sweep, list) else []
        for number, row in enumerate(rows):
            if row.keys() != rows[0].keys() or not row:
                words = f"every member must have the same keys: {', '.join(rows[0])}"
                yield Wrong(("sweep", number), words)
        yield from _shared(rows[0] if rows else self.swept, ("sweep", 0)[: 1 + bool(rows)])
        for path in self.swept:
            if other := next((one for one in self.changed if _meet(one, path)), None):
                words = f"designs change {other}; sweep other keys"
                yield Wrong(("sweep", path), words, of_key=True)
        if self.number > MOST_MEMBERS:
            words = f"{self.number} members are too many; at most {MOST_MEMBERS} are allowed"
            yield Wrong(("sweep",), words)

    @property
    def swept(self) -> Mapping[str, Range | list[Any]]:
        """The values of which every combination is a member."""
        return self.sweep if isinstance(self.sweep, dict) else {}

    @property
    def changed(self) -> tuple[str, ...]:
        """The outermost keys that designs change."""
        every = [path for one in (self.designs or {}).values() for path in one or ()]
        paths = dict.fromkeys(every)
        return tuple(p for p in paths if not any(p.startswith(f"{one}.") for one in paths))

    @property
    def number(self) -> int:
        """How many members there are; 0 without designs and sweep."""
        lengths = (v.number if isinstance(v, Range) else len(v) for v in self.swept.values())
        rows = len(self.sweep) if isinstance(self.sweep, list) else math.prod(lengths)
        return rows * (len(self.designs) if self.designs else self.sweep is not None)


def _meet(one: str, other: str) -> bool:
    """Whether two keys are equal, or one lies inside the other."""
    return f"{one}.".startswith(f"{other}.") or f"{other}.".startswith(f"{one}.")


def _shared(paths: Iterable[str], place: tuple[str | int, ...]) -> Iterator[Wrong]:
    """Keys that cannot differ between members."""
    for path in paths:
        inner = next((one for one in paths if one != path and path.startswith(f"{one}.")), None)
        if inner is not None:
            yield Wrong((*place, path), f"lies inside of {inner}", of_key=True)


class ExperimentKeys(MemberKeys):
    """An experiment."""

    name: FileName | None = key(
        "Name of the experiment; file names come from it. Default: name of this file; required in "
        "a list of experiments.",
        None,
    )
    problem: AnyKind = key("What is solved.")
    method: Methods | None = key(
        "One method or several; every entry is a value or a list of values, and lists are "
        "combined. Default: {rk: gauss, degree: 3}; with accuracy Gauss methods.",
        None,
    )
    ladder: Ladder | None = key("Numbers of steps; this or accuracy is required.", None)
    accuracy: Accuracy | None = key(
        "In place of ladder: steps are chosen for a tolerance, and a second run estimates the "
        "error. Without method too, which else is one Gauss method, for its number of stages.",
        None,
    )
    report: Report = key("How errors are measured.", Report())
    expect: dict[str, Literal["unstable", "diverged", "failed"]] = key(
        "Failures that are known; they do not make the exit code 1.", {}
    )
    claims: dict[str, float] = key(
        "Orders that the source states, to compare with the measured ones.", {}
    )
    figures: list[Annotated[FigureKind | FigureSettings, BY_FORM]] = key(
        "Figures to draw. Default: convergence for a ladder of three or more numbers of steps, "
        "otherwise trajectory, energy, error and, where there are any, quantities; section draws "
        "velocity against position at events, and spectrum, of a sweep over stiffness or mass, the "
        f"largest displacement over the period. Or mappings: {FIGURE_EXAMPLE}; an event in "
        "place of peak_... makes a bifurcation diagram, {section: turn, after: 50} draws the "
        "section of one event, and {ensemble: [x]} mean and spread of the members.",
        [],
    )
    store: Store = key("What is kept in files.", Store())
    output: Output | None = key(
        "Times at which a run is stored, whatever its steps: {step: 0.01} or {times: [0, 0.5, 2]}. "
        "Default: the points of the mesh. For Runge-Kutta methods.",
        None,
    )
    quantities: Annotated[dict[Word, Formula] | list[Word], BY_FORM] | None = key(
        "Expressions in coordinates (x), their velocities (vx), accelerations (ax, from the "
        "equation of motion) and the damping force on them (dx, minus the sum of mu D^gamma x), t, "
        "parameters and, where the ground moves, ground_acceleration; stored with the position, "
        "with peak and RMS. Or a list of names that need no expression: force_1 of a damper, and "
        "drift_1, acceleration_1 (with the ground) and base_shear of a frame. For Runge-Kutta "
        "methods.",
        None,
    )
    events: dict[Word, EventKeys] | None = key(
        "Times at which expressions change their sign, found on the motion between the mesh "
        "points; stored with position and velocity. For Runge-Kutta methods.",
        None,
    )
    impacts: dict[Word, ImpactKeys] | None = key(
        "Surfaces on which the motion bounces. The damping remembers what was before; a motion at "
        "rest ends the run, which says when. Stored like events. For Runge-Kutta methods and a "
        "ladder.",
        None,
    )
    units: dict[str, Annotated[str, Field(max_length=40)]] | None = key(
        "Units on the axes of figures: of time, length, velocity, acceleration, force, momentum, "
        "energy, of coordinates and of quantities. They are labels; no number is converted.",
        None,
    )
    stability: StabilitySettings = key(
        "What fvi stability computes for the methods and steps.", StabilitySettings()
    )
    fit: FitKeys | None = key(
        "Which numbers of the problem fvi fit fits to which measurements.", None
    )

    def mistakes(self) -> Iterator[Wrong]:
        """Neither a ladder nor a tolerance, and keys that exclude each other."""
        yield from super().mistakes()
        given = {name for name, value in self if value is not None}
        kind = self.problem.kind
        for name in NOT_FOR.get(kind, ()):
            if name in given:
                yield Wrong((name,), f"not for kind {kind}: {NO_MOTION[kind]}", of_key=True)
        for name, other in EXCLUSIVE:
            if {name, other} <= given:
                yield Wrong((name,), f"not together with {other}: give one", of_key=True)
        if not given & {"ladder", "accuracy"} and kind != "material":
            words = f"missing; it must be {LADDER}, or give accuracy: {{tolerance: 1e-8}} instead"
            yield Wrong(("ladder",), words)
        if self.output is not None and self.store.every != 1:
            words = "not together with output, which chooses the stored times; leave out one"
            yield Wrong(("store", "every"), words)
        if self.store.diagnostics and (kind in NO_MOTION or self.number):
            words = "for a motion without designs and sweep; give each member its own experiment"
            yield Wrong(("store", "diagnostics"), words)
        if self.impacts is not None and self.number and self.output is None:
            words = "in a sweep, and of designs, every member has a mesh of its own; give output"
            yield Wrong(("impacts",), words, of_key=True)
        if self.impacts is not None and self.ladder is not None and self.ladder.grading is not None:
            words = "not together with impacts, which grade the mesh themselves"
            yield Wrong(("ladder", "grading"), words)


class SeveralExperiments(Keys):
    """A file with several experiments."""

    name: FileName | None = key("File names come from it. Default: name of this file.", None)
    experiments: Annotated[list[dict[str, Any]], Field(min_length=1, max_length=1000)] = key(
        "Experiments, each with its name."
    )
