"""Words beside the axes: names of coordinates, units, the time with its step size."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from fvi_cli.plotting.methods import SeriesStyle, series_styles
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.members import Member, value_in_words

MOST_LINES = 6
"""Members of a sweep that have a line of their own."""
_GREEK = {"theta": r"\theta", "phi": r"\varphi", "psi": r"\psi"}


def styled(shown: Sequence[FinishedRun]) -> list[tuple[FinishedRun, SeriesStyle, int]]:
    """Every run with the style of its method and its number."""
    styles = series_styles([item.run.method for item in shown])
    return [(item, styles[item.run.method.case], k) for k, item in enumerate(shown)]


def finest_of_first(finished: Sequence[FinishedRun]) -> list[FinishedRun]:
    """The runs of the first method on the finest grid."""
    most = max((one.run.n_steps for one in finished), default=0)
    return [
        one
        for one in finished
        if one.run.method == finished[0].run.method and one.run.n_steps == most
    ]


def coordinates_of(experiment: Experiment, dimension: int = 1) -> tuple[str, ...]:
    """Names of the coordinates; of what has none ``x``."""
    problem = experiment.problem
    return (problem.coordinates if isinstance(problem, Problem) else ()) or ("x",) * dimension


def coordinate_labels(experiment: Experiment, dimension: int) -> list[str]:
    """Coordinates as they stand beside an axis."""
    return [typeset_name(name) for name in coordinates_of(experiment, dimension)]


def typeset_name(name: str) -> str:
    r"""``$\theta_{1}$`` for ``theta1``."""
    stem = name.rstrip("0123456789")
    index = name[len(stem) :]
    letter = _GREEK.get(stem, stem if len(stem) == 1 else rf"\mathrm{{{stem}}}".replace("_", r"\_"))
    return f"${letter}_{{{index}}}$" if index else f"${letter}$"


def with_unit(label: str, experiment: Experiment, *names: str) -> str:
    """A label with the unit that the configuration gives to the first of some names that has one.

    Where a length and a time are given, a velocity has their quotient.
    """
    units = {**experiment.units}
    if "length" in units and "time" in units:
        units.setdefault("velocity", f"{units['length']}/{units['time']}")
    unit = next((units[name] for name in names if name in units), "")
    return f"{label} ({unit})" if unit else label


def in_formula(value: float) -> str:
    r"""A number inside of a formula: ``2.5 \times 10^{-5}`` for 2.5e-5."""
    mantissa, _, exponent = f"{value:.8g}".partition("e")
    if not exponent:
        return mantissa
    power = f"10^{{{int(exponent)}}}"
    return power if mantissa == "1" else rf"{mantissa} \times {power}"


def time_axis(axes: Axes, experiment: Experiment, shown: Sequence[FinishedRun]) -> None:
    """Name the axis of the time, with the step size where all runs have the same."""
    sizes = {item.run.step_size for item in shown}
    step = f" (step size $h = {in_formula(sizes.pop())}$)" if len(sizes) == 1 else ""
    label = with_unit("time $t$", experiment, "time")
    # a unit and a step size in brackets side by side are read as one
    axes.set_xlabel(label if label.endswith(")") else f"{label}{step}")
    axes.set_xlim(0.0, experiment.problem.final_time)


def member_label(member: Member | None) -> str:
    """What tells a member of a sweep from the others."""
    if member is None:
        return ""
    values = member.values
    if len(values) == 1:
        return value_in_words(next(iter(values.values())))
    return ", ".join(
        f"{key.rpartition('.')[2]} {value_in_words(value)}" for key, value in values.items()
    )
