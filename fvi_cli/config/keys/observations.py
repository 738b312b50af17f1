"""``output``, ``quantities``, ``events``: what is asked of a motion beside its positions."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.config.keys.methods import ListedMethod
from fvi_cli.integrator.observations.asked import (
    DIRECTIONS,
    Event,
    Impact,
    Observations,
    check_observable,
    known_names,
    surface_objection,
)
from fvi_cli.integrator.observations.damper_work import work_names
from fvi_cli.integrator.observations.impacts.surface import Surface, start_objection
from fvi_cli.keys.complaints import listed as listed_words
from fvi_cli.keys.complaints import suggestion
from fvi_cli.keys.containers import ListOf, Named
from fvi_cli.keys.cursor import Cursor, is_complete
from fvi_cli.keys.records import Key, Record, optional
from fvi_cli.keys.scalars import Choice, Flag, Formula, Integer, Number, Text
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.studies.experiment import UNITS

MOST_TIMES: Final = 10_000_000
KEYS: Final = ("output", "quantities", "events", "impacts")
EXAMPLE: Final = "{step: 0.01}, {count: 1000} or {times: [0, 0.5, 2]}"

_TAKEN: Final = ("t", "time", "energy", "member", "dof", "mesh")
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_TEXT: Final = Text(what="an expression in coordinates, v<name>, a<name>, d<name>, t, parameters")

OUTPUT: Final = optional(
    "output",
    Record(
        keys=(
            optional(
                "step", Number(above=0.0), "The times 0, step, twice step and so on.", unit="time"
            ),
            optional(
                "count",
                Integer(least=2, most=MOST_TIMES),
                "So many equally spaced times from 0 to final_time, both among them.",
            ),
            optional(
                "times",
                ListOf(shape=Number(least=0.0), most=MOST_TIMES, example="[0, 0.5, 2]"),
                "The times themselves, increasing.",
                unit="time",
            ),
        ),
        refused=dict.fromkeys(("dt", "every", "interval"), "not a key: write step"),
    ),
    "Times at which a run is stored, whatever its steps: "
    f"{EXAMPLE}. Default: the points of the mesh. For Runge-Kutta methods.",
)
QUANTITIES: Final = optional(
    "quantities",
    Named(shape=_TEXT, example="{drift: x2 - x1, force: -dx1, top: ax2}"),
    "Expressions in coordinates (x), their velocities (vx), accelerations (ax, from the equation "
    "of motion) and the damping force on them (dx, minus the sum of mu D^gamma x), t, parameters "
    "and, where the ground moves, ground_acceleration; stored beside the position, with peak and "
    "RMS. For Runge-Kutta methods.",
)
EVENTS: Final = optional(
    "events",
    Named(
        shape=Record(
            keys=(
                Key(
                    "when",
                    _TEXT,
                    "Expression as under quantities; the event is its change of sign.",
                ),
                Key(
                    "direction",
                    Choice(words=DIRECTIONS),
                    "rising: from below to above 0; falling; or any.",
                    default="any",
                ),
                Key("stop", Flag(), "End the run at the first of them.", default=False),
            ),
            refused={"terminal": "not a key: write stop", "function": "not a key: write when"},
        ),
        example="{rest: {when: vx, direction: falling}}",
    ),
    "Times at which expressions change their sign, found on the motion between the mesh points; "
    "stored with position and velocity. For Runge-Kutta methods.",
)
IMPACTS: Final = optional(
    "impacts",
    Named(
        shape=Record(
            keys=(
                Key(
                    "when",
                    Text(what="an expression in coordinates, t and parameters"),
                    "The motion stays where it is positive, and bounces at its falling roots.",
                ),
                Key(
                    "restitution",
                    Number(least=0.0),
                    "The velocity along the normal is reversed and multiplied by it, 0 to 1.",
                    default=1.0,
                ),
            ),
            refused=dict.fromkeys(("e", "bounce"), "not a key: write restitution"),
        ),
        example="{floor: {when: x1, restitution: 0.8}}",
    ),
    "Surfaces on which the motion bounces. The damping remembers what was before; endless rebounds "
    "end the run, which says when. Stored like events. For Runge-Kutta methods and a ladder.",
)


IN_G: Final = "for a record in g write scale: 9.81 beside its file"
UNITS_KEY: Final = optional(
    "units",
    Named(
        shape=Text(what="the name of a unit", longest=40),
        example=f"{{length: mm, time: s}}; {IN_G}",
    ),
    "Names of units that stand beside the axes of figures: of time, length, velocity, "
    "acceleration, momentum, energy, of coordinates and of quantities. Nothing is converted.",
)


def _named(values: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """What was read under a key; nothing where none stands there, or no mapping."""
    given = values.get(key)
    return given if isinstance(given, Mapping) else {}


def check_units(values: Mapping[str, Any], problem: AnyProblem, at: Cursor) -> None:
    """Units must belong to something that is drawn."""
    coordinates = problem.coordinates if isinstance(problem, Problem) else ()
    known = (*UNITS, *coordinates, *_named(values, "quantities"))
    for name in _named(values, "units"):
        if name not in known:
            at.under("units").refuse_key(
                name,
                f"has no unit of its own{suggestion(name, known)} "
                f"(known here: {listed_words(known[:12])}); {IN_G}",
            )


def read_observations(
    values: Mapping[str, Any],
    described: Mapping[str, Any],
    problem: AnyProblem,
    methods: Sequence[ListedMethod],
    at: Cursor,
) -> Observations:
    """What the keys of an experiment ask of its motion.

    Parameters
    ----------
    values
        What was read of the experiment; may hold INVALID.
    described, problem
        Its ``problem`` mapping, and what that made.
    methods
        Those of the experiment.
    at
        The experiment; receives what is wrong.
    """
    given = [key for key in KEYS if key in values]
    if not given:
        return Observations()
    if not isinstance(problem, Problem):
        at.refuse_key(given[0], f"not for kind {problem.kind}, in which nothing moves")
        return Observations()
    _check_neighbours(values, methods, given[0], at)
    parameters = described.get("parameters", {})
    of_surfaces = known_names(problem.coordinates, (*parameters, *problem.inputs))
    names = tuple(dict.fromkeys((*of_surfaces, *work_names(problem.scene))))
    quantities: dict[str, Expression] = {}
    events: dict[str, Event] = {}
    impacts: dict[str, Impact] = {}
    for name in _named(values, "quantities"):
        found = _expression(name, names, problem, at.under("quantities"))
        if found is not None:
            quantities[name] = found
    for name, one in _named(values, "events").items():
        if not is_complete(one):
            continue
        found = _expression(name, names, problem, at.under("events"), "when")
        if found is not None:
            events[name] = Event(when=found, direction=one["direction"], stop=one["stop"])
    for name, one in _named(values, "impacts").items():
        under = at.under("impacts")
        found = _expression(name, of_surfaces, problem, under, "when") if is_complete(one) else None
        if found is None:
            continue
        if name in events:
            under.refuse_key(name, "is the name of an event already; take another")
        elif said := surface_objection(found, problem.coordinates):
            under.refuse(said, name, "when")
        elif one["restitution"] > 1.0:
            under.refuse(f"{one['restitution']:g} is above 1", name, "restitution")
        else:
            impacts[name] = Impact(when=found, restitution=one["restitution"])
            surface = Surface(
                impact=impacts[name], coordinates=problem.coordinates, parameters=parameters
            )
            if said := start_objection(problem.scene, surface):
                under.refuse(said, name, "when")
    return Observations(
        coordinates=problem.coordinates,
        times=_times(values.get("output"), problem.final_time, at.under("output")),
        quantities=quantities,
        events=events,
        impacts=impacts,
        parameters=parameters,
        inputs=problem.inputs,
        output=values.get("output"),
    )


def _check_neighbours(
    values: Mapping[str, Any], methods: Sequence[ListedMethod], key: str, at: Cursor
) -> None:
    """What does not go together with output, quantities and events."""
    for listed in methods:
        try:
            check_observable(listed.method)
        except ValueError as error:
            at.refuse_key(key, str(error))
            break
    store = values.get("store")
    if "output" in values and isinstance(store, Mapping):
        if store.get("every", 1) != 1:
            at.refuse("not together with output, which says what is kept", "store", "every")
        if "diagnostics" in store:
            at.refuse("not together with output: they are kept on the mesh", "store", "diagnostics")
    if "impacts" in values and "sweep" in values and "output" not in values:
        at.refuse_key("impacts", "in a sweep every member has a mesh of its own; give output too")
    if "impacts" in values:
        if "accuracy" in values:
            at.refuse_key("impacts", "not together with accuracy; give a ladder")
        if isinstance(values.get("ladder"), Mapping) and "grading" in values["ladder"]:
            at.refuse(
                "not together with impacts, which grade the mesh themselves", "ladder", "grading"
            )
        if isinstance(store, Mapping) and "diagnostics" in store:
            at.refuse("not together with impacts", "store", "diagnostics")


def _expression(
    name: str, names: tuple[str, ...], problem: Problem, under: Cursor, *inner: str
) -> Expression | None:
    """The expression under a name; None, with complaints, where something is wrong."""
    if not _NAME.fullmatch(name):
        under.refuse_key(name, "a name has letters, digits and _, and begins with a letter")
        return None
    if name in (*problem.coordinates, *_TAKEN):
        under.refuse_key(name, "is the name of something that is stored already; take another")
        return None
    text = Formula(variables=names).read(under.under(name, *inner))
    return Expression.parse(text, variables=names) if isinstance(text, str) else None


def _times(given: object, final_time: float, at: Cursor) -> NDArray[np.float64] | None:
    """The times that are asked for; None where there are none, or something is wrong."""
    if not isinstance(given, Mapping) or not is_complete(given):
        return None
    if len(given) != 1:
        at.refuse(f"exactly one of step, count and times is needed; it must be {EXAMPLE}")
        return None
    if "count" in given:
        return _exact_multiples(final_time, given["count"] - 1, given["count"])
    if "step" in given:
        step = given["step"]
        times_asked = final_time / step * (1 + 1e-12) + 1
        if times_asked >= MOST_TIMES + 1:
            at.refuse(
                f"{times_asked:.7g} times are too many; at most {MOST_TIMES} are allowed", "step"
            )
            return None
        count = int(times_asked)
        if count < 2:
            at.refuse(f"{step:g} is longer than final_time = {final_time:g}", "step")
            return None
        return np.minimum(_exact_multiples(step, 1, count), final_time)
    times = given["times"]
    for index, time in enumerate(times):
        if time > final_time:
            at.refuse(f"{time:g} is after final_time = {final_time:g}", "times", index)
            return None
        if index and not time > times[index - 1]:
            at.refuse(
                f"{time:g} is not after {times[index - 1]:g}; times must increase", "times", index
            )
            return None
    return np.array(times, dtype=float)


def _exact_multiples(length: float, parts: int, count: int) -> NDArray[np.float64]:
    """Multiples of length / parts, of the decimal number as it is written, each rounded once."""
    step = Fraction(repr(length)) / parts
    above, below = step.numerator, step.denominator
    # whole numbers are divided with one rounding, and much sooner than fractions are made
    return np.array([k * above / below for k in range(count)])
