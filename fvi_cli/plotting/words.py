"""Words in figures: names of coordinates, formulas, numbers, units."""

from __future__ import annotations

import re
import textwrap
from fractions import Fraction

from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.vibration.response import GROUND

_GREEK = {"theta": r"\theta", "phi": r"\varphi", "psi": r"\psi", "omega": r"\omega"}


def fraction_in_words(value: float) -> str:
    """``5/2`` for 2.5; the decimal number if the value is no fraction with a small denominator."""
    nearest = Fraction(value).limit_denominator(12)
    return str(nearest) if abs(float(nearest) - value) < 1e-9 else f"{value:g}"


def number_in_words(value: float) -> str:
    """A number with three digits, without a power of 10 where that is usual: ``20500``."""
    words = f"{float(f'{value:.3g}'):g}".replace("-", "\N{MINUS SIGN}")
    return re.sub(r"e\+?(\N{MINUS SIGN}?)0*(\d+)", r"$\\times10^{\1\2}$", words)


def letter(name: str) -> str:
    r"""``\theta_{1}`` for ``theta1``, inside of a formula."""
    stem = name.rstrip("0123456789")
    index = name[len(stem) :]
    word = _GREEK.get(stem, stem if len(stem) == 1 else rf"\mathrm{{{stem}}}".replace("_", r"\_"))
    return f"{word}_{{{index}}}" if index else word


def load_in_words(load: str) -> str:
    """``ground acceleration``, or ``force on x1`` for ``x1``."""
    return "ground acceleration" if load.split(" ")[0] == GROUND else f"force on {load}"


def wrap(words: str, letters: float) -> str:
    """The text in lines of about so many letters; formulas without spaces and units stay whole."""
    whole = re.sub(r"\([^()]*\)", lambda unit: unit[0].replace(" ", "\N{NO-BREAK SPACE}"), words)
    return textwrap.fill(whole, int(letters), break_long_words=False, break_on_hyphens=False)


def coordinates_of(experiment: Experiment, dimension: int = 1) -> tuple[str, ...]:
    """Names of the coordinates; without names ``x``."""
    problem = experiment.problem
    return (problem.coordinates if isinstance(problem, Problem) else ()) or ("x",) * dimension


def time_label(experiment: Experiment) -> str:
    """The label of an axis of time."""
    return with_unit("time $t$", experiment.units, "time")


def position_label(experiment: Experiment, name: str) -> str:
    """The label of an axis of a coordinate."""
    return with_unit(f"position ${letter(name)}$", experiment.units, name, "length")


def velocity_label(experiment: Experiment, name: str) -> str:
    """The label of an axis of a velocity."""
    words = rf"velocity $\dot{{{letter(name)}}}$"
    return with_unit(words, experiment.units, f"v{name}", "velocity")
