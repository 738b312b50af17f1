"""The keys of an experiment and of a file."""

from __future__ import annotations

from typing import Final, get_args

from fvi_cli.config.keys.accuracy import ACCURACY
from fvi_cli.config.keys.fit import FIT
from fvi_cli.config.keys.ladder import LADDER
from fvi_cli.config.keys.methods import METHODS
from fvi_cli.config.keys.observations import EVENTS, IMPACTS, OUTPUT, QUANTITIES, UNITS_KEY
from fvi_cli.config.keys.stability import STABILITY
from fvi_cli.config.keys.store import STORE
from fvi_cli.config.keys.sweep import SweepShape
from fvi_cli.keys.containers import ListOf, Named
from fvi_cli.keys.records import Key, Record, optional
from fvi_cli.keys.scalars import Choice, Flag, Number, Text
from fvi_cli.scenes.kinds import PROBLEM
from fvi_cli.studies.experiment import FIGURE_KINDS
from fvi_cli.studies.norms import Norm

NAME: Final = Text(
    what="letters, digits, - and _, beginning with a letter or digit",
    pattern="[A-Za-z0-9][A-Za-z0-9_-]*",
    longest=100,
)
"""A name that can be part of a file name."""

_REPORT: Final = Record(
    keys=(
        Key(
            "norm",
            Choice(words=get_args(Norm)),
            "Norm of the error: max (over components and grid points), final (at final_time) or "
            "l2 (weighted by the step size).",
            default="max",
        ),
    )
)
_CASES: Final = "methods, such as bdf5,"

_KEYS: Final = (
    Key("problem", PROBLEM, "What is solved."),
    optional(
        "method",
        METHODS,
        "One method or several; every entry is a value or a list of values, and lists are "
        "combined. Default: {rk: gauss, degree: 3}; with accuracy Gauss methods.",
    ),
    optional("ladder", LADDER, "Numbers of steps; this or accuracy is required."),
    optional(
        "accuracy",
        ACCURACY,
        "In place of ladder: method (one of those given, or of Gauss methods) and number of steps "
        "are chosen for a tolerance, which an estimate is held against.",
    ),
    optional(
        "sweep",
        SweepShape(),
        "Members: every combination of values of some keys of the problem, or a list of mappings "
        "with the values of each member. They are computed together.",
    ),
    Key("report", _REPORT, "How errors are measured.", default={"norm": "max"}),
    Key(
        "expect",
        Named(shape=Choice(words=("unstable", "diverged", "failed")), names=_CASES),
        "Failures that are known; they do not make the exit code 1.",
        default={},
    ),
    Key(
        "claims",
        Named(shape=Number(), names=_CASES),
        "Orders that the source claims, to stand beside what is measured.",
        default={},
    ),
    Key(
        "figures",
        ListOf(shape=Choice(words=FIGURE_KINDS), least=0, example="[convergence]"),
        "Figures to draw. Default: convergence for a ladder of three or more numbers of steps, "
        "otherwise trajectory, energy, error and, where there are any, quantities; section draws "
        "velocity against position at events, and spectrum, of a sweep over stiffness or mass, the "
        "largest displacement over the period.",
        default=[],
    ),
    Key("allow_unstable", Flag(), "Compute runs that are predicted to blow up.", default=False),
    Key("store", STORE, "What is kept in files.", default={"every": 1}),
    OUTPUT,
    QUANTITIES,
    EVENTS,
    IMPACTS,
    UNITS_KEY,
    Key(
        "stability",
        STABILITY,
        "What fvi stability looks at, beside the methods and steps.",
        default={"observe": True},
    ),
    optional("fit", FIT, "Which numbers of the problem fvi fit fits to which measurements."),
)
_REFUSED: Final = {
    "methods": "not a key: write method",
    "steps": "not a key: write ladder: {steps: [16, 32, 64]}",
    "tolerance": "not a key: write accuracy: {tolerance: 1e-8}",
    "parameters": "not a key here: write it under problem",
    "plot": "not a key: write figures, such as figures: [convergence]",
    "plots": "not a key: write figures, such as figures: [convergence]",
    "figure": "not a key: write figures, such as figures: [convergence]",
}


def _experiment(name: Key) -> Record:
    return Record(keys=(name, *_KEYS), refused=_REFUSED, alternatives=("ladder", "accuracy"))


EXPERIMENT: Final = _experiment(
    Key("name", NAME, "Name of the experiment; file names come from it.")
)
SINGLE: Final = _experiment(
    optional(
        "name",
        NAME,
        "Name of the experiment; file names come from it. Default: name of this file; "
        "required in a list of experiments.",
    )
)
SEVERAL: Final = Record(
    keys=(
        optional("name", NAME, "File names come from it. Default: name of this file."),
        Key(
            "experiments",
            ListOf(shape=EXPERIMENT, most=1000),
            "Experiments, each with its name.",
        ),
    )
)
