"""Words in figures: names of coordinates, formulas, members, units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from fractions import Fraction

from fvi_cli.integrator.observe.dampers import damper_values
from fvi_cli.reports.naming import key_in_words, key_label, with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.members import Member, value_in_words
from fvi_cli.studies.vibration.response import GROUND

_FEW_KEYS = 2  # up to so many keys in which designs differ are listed
_GREEK = {"theta": r"\theta", "phi": r"\varphi", "psi": r"\psi", "omega": r"\omega"}


def fraction_in_words(value: float) -> str:
    """``5/2`` for 2.5; the decimal number if the value is no fraction with a small denominator."""
    nearest = Fraction(value).limit_denominator(12)
    return str(nearest) if abs(float(nearest) - value) < 1e-9 else f"{value:g}"


def typeset(name: str) -> str:
    """``weights $t^{5/2}$`` for ``weights t^2.5``."""
    return re.sub(
        r"t\^([\d.]+)", lambda power: f"$t^{{{fraction_in_words(float(power[1]))}}}$", name
    )


def typeset_name(name: str) -> str:
    r"""``$\theta_{1}$`` for ``theta1``."""
    stem = name.rstrip("0123456789")
    index = name[len(stem) :]
    letter = _GREEK.get(stem, stem if len(stem) == 1 else rf"\mathrm{{{stem}}}".replace("_", r"\_"))
    return f"${letter}_{{{index}}}$" if index else f"${letter}$"


def typeset_sum(words: str) -> str:
    """``$x_{10} - x_{9}$`` for ``x10 - x9``; other texts are returned unchanged."""
    if not re.fullmatch(r"[A-Za-z]\w*(\s*[-+]\s*[A-Za-z]\w*)*", words):
        return words
    inner = re.sub(r"[A-Za-z]\w*", lambda found: typeset_name(found[0]).strip("$"), words)
    return f"${inner}$"


def load_in_words(load: str) -> str:
    """``ground acceleration``, or ``force on $x_{1}$`` for ``x1``."""
    on_ground = load.split(" ")[0] == GROUND
    return "ground acceleration" if on_ground else f"force on {typeset_sum(load)}"


def quantity_in_words(experiment: Experiment, name: str) -> str:
    """``base shear`` for ``base_shear``; ``drift of storey 1``; ``force of wall 3``."""
    scene = experiment.problem.scene
    kind, _, rest = name.partition("_")
    words = rest.replace("_", " ")
    storey, has_name = re.fullmatch(r"(\w+)_(\d+)", name), name in experiment.observations.ready
    if storey and has_name and experiment.problem.kind == "frame":
        return f"{storey[1].replace('_', ' ')} of storey {storey[2]}"
    # a quantity of the user's own may begin in the same way, e.g. force_max
    if not words or scene is None or name not in damper_values(scene):
        return name.replace("_", " ")
    what = "work on" if kind == "work" else f"{kind} of"
    return f"{what} {'damper ' if words[0].isdecimal() else ''}{words}"


def number_in_words(value: float) -> str:
    """A number with three digits, without a power of 10 where it is usual: ``20500``."""
    return f"{float(f'{value:.3g}'):g}".replace("-", "\N{MINUS SIGN}")


def wrap(words: str, letters: float) -> str:
    """The text in lines of about so many letters; formulas and units stay whole."""
    lines = [""]
    for word in re.findall(r"(?:\$[^$]*\$|\([^()$]*\)|[^\s$])+", words):
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and len(re.sub(r"\\[a-z]+|[${}^_]", "", longer)) > letters:
            lines.append(word)
        else:
            lines[-1] = longer
    return "\n".join(lines)


def coordinates_of(experiment: Experiment, dimension: int = 1) -> tuple[str, ...]:
    """Names of the coordinates; without names ``x``."""
    problem = experiment.problem
    return (problem.coordinates if isinstance(problem, Problem) else ()) or ("x",) * dimension


def time_label(experiment: Experiment) -> str:
    """The label of an axis of time."""
    return with_unit("time $t$", experiment.units, "time")


def step_words(experiment: Experiment, shown: Sequence[FinishedRun]) -> str:
    """``$h = 0.5$ s`` where all runs have the same equal steps; else empty."""
    is_even = experiment.grading == 1.0 and experiment.accuracy is None
    sizes = {item.run.step_size for item in shown if is_even}
    unit = experiment.units.get("time", "")
    return f"$h = {sizes.pop():.4g}$ {unit}".rstrip() if len(sizes) == 1 else ""


def position_label(experiment: Experiment, name: str) -> str:
    """The label of an axis of a coordinate."""
    return with_unit(f"position {typeset_name(name)}", experiment.units, name, "length")


def velocity_label(experiment: Experiment, name: str) -> str:
    """The label of an axis of a velocity."""
    words = rf"velocity $\dot {{{typeset_name(name).strip('$')}}}$"
    return with_unit(words, experiment.units, f"v{name}", "velocity")


def member_label(member: Member | None) -> str:
    """A label that distinguishes a member of a sweep from the others."""
    if member is None:
        return ""
    values = member.unnamed
    if len(values) == 1 and not member.name:
        return value_in_words(next(iter(values.values())))
    words = (f"{key_in_words(key)} {value_in_words(value)}" for key, value in values.items())
    return ", ".join(filter(None, (member.name, *words)))


def swept_number(member: Member | None) -> float | None:
    """The swept number of a member; None unless a single number is swept."""
    values = [] if member is None or member.name else list(member.values.values())
    is_number = len(values) == 1 and isinstance(values[0], int | float)
    return float(values[0]) if is_number else None


def swept_label(experiment: Experiment, key: str) -> str:
    """The label of an axis for a swept key, with its unit."""
    problem = experiment.members[0].specification
    return key_label(key, experiment.units, problem, experiment.swept)


def swept_keys_in_words(experiment: Experiment) -> str:
    """The keys of a sweep in words, with units; for designs the keys in which they differ."""
    named = experiment.members[0].named if experiment.members else ()
    words = [swept_label(experiment, key) for key in experiment.swept if key not in named]
    of = " and the ".join(map(key_in_words, named)) if len(named) <= _FEW_KEYS else ""
    designs = f"designs of the {of}" if of else "designs"
    return ", ".join([designs, *words] if named else words)
