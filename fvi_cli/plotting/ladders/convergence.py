"""Global errors against step size, with diverged runs and round-off."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.looks import MethodLook, method_looks
from fvi_cli.plotting.panels import MOST_COLOURED, MOST_LINES, ladders
from fvi_cli.plotting.words import (
    fraction_in_words,
    member_label,
    swept_keys_in_words,
    swept_number,
)
from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.problem import DerivativeProblem, Problem
from fvi_cli.scenes.registry import kind_title
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.norms import Norm

Study = tuple[Experiment, Sequence[FinishedRun]]
_Part = tuple[str, Study, Mapping[str, MethodLook]]

NORM_LABELS: dict[Norm, str] = {
    "max": r"$\mathrm{max}_k\,|x_k - x(t_k)|$",
    "final": r"$|x_N - x(T)|$",
    "l2": r"$(h\,\Sigma_k\,|x_k - x(t_k)|^2)^{1/2}$",
}
MOST_CURVES = 7
"""Most curves of one panel."""
_MOST_ROWS = 3


def convergence_figure(studies: Sequence[Study]) -> Figure:
    """Draw the error of every run against its step size, one panel for every experiment.

    An experiment with more than :data:`MOST_CURVES` methods has a panel for every variant of the
    methods, such as ``degree 2``.
    """
    if not studies or not any(finished for _, finished in studies):
        raise ValueError("finished runs: none were given; a convergence figure needs at least one")
    methods = [f.run.method for _, finished in studies for f in finished]
    names = method_looks(methods)
    titles = panel_titles([experiment for experiment, _ in studies])
    parts: list[_Part] = [
        (title, study, names) for title, study in zip(titles, studies, strict=True)
    ]
    if len(studies) == 1 and len(names) > MOST_CURVES:
        parts = _by_variant(titles[0], studies[0], names) or parts
    columns = 1 if len(parts) <= _MOST_ROWS else 2
    # many curves need room
    height = 1.9 + 0.1 * min(max(len(names) - 3, 0), 7) if columns == 1 else 1.8
    panels = [
        Panel(
            title=title,
            y=error_label(experiment.norm, experiment.units, experiment.grading),
            curves=error_curves(finished, own),
            height=height,
        )
        for title, (experiment, finished), own in parts
    ]
    return ladders(
        panels,
        x=_step_label([experiment for experiment, _ in studies]),
        columns=columns,
    )


def _step_label(experiments: Sequence[Experiment]) -> str:
    """The label of the axis of step sizes; for graded meshes these are means."""
    is_graded = any(experiment.grading != 1.0 for experiment in experiments)
    words = "mean step size $h = T/N$" if is_graded else "step size $h$"
    return with_unit(words, experiments[0].units, "time")


def error_label(norm: Norm, units: Mapping[str, str], grading: float = 1.0) -> str:
    """The label of the axis of errors."""
    if norm != "l2":
        return with_unit(f"error {NORM_LABELS[norm]}", units, "length")
    is_even = grading == 1.0
    words = NORM_LABELS[norm] if is_even else r"$(\Sigma_k\,h_k\,|x_k - x(t_k)|^2)^{1/2}$"
    has_unit = {"length", "time"} <= units.keys()
    unit = rf" ({units['length']} {units['time']}$^{{1/2}}$)" if has_unit else ""
    return f"error {words}{unit}"


def error_curves(finished: Sequence[FinishedRun], names: Mapping[str, MethodLook]) -> list[Curve]:
    """Errors by method over the step size; an error of exactly zero is drawn below the floor."""
    by_case: dict[str, list[FinishedRun]] = {}
    for item in sorted(finished, key=lambda item: item.run.step_size):
        by_case.setdefault(item.run.method.case, []).append(item)
    curves = []
    for case, name in names.items():
        rows = by_case.get(case, [])
        if not rows:
            continue
        claim = rows[0].run.experiment.claim(rows[0].run.method)
        curves.append(
            Curve(
                x=np.array([one.run.step_size for one in rows]),
                y=np.array(
                    [max(one.error, one.floor / 100) if is_plotted(one) else np.nan for one in rows]
                ),
                label=name.label,
                look=name.look,
                lost=[one.run.step_size for one in rows if not is_plotted(one)],
                order=_order(rows),
                stated=claim or math.nan,
                floor=max((one.floor for one in rows if np.isfinite(one.floor)), default=0.0),
            )
        )
    return curves


def is_plotted(one: FinishedRun) -> bool:
    """Whether the error of a run can be drawn on a logarithmic axis."""
    return one.status in ("ok", "floor") and bool(np.isfinite(one.error))


def _order(rows: Sequence[FinishedRun]) -> float:
    """The order that theory expects at the smallest step above the floor."""
    return next((one.expected_order for one in rows if one.status == "ok"), math.nan)


def _by_variant(title: str, study: Study, looks: Mapping[str, MethodLook]) -> list[_Part]:
    """A panel for every variant if the methods of some families have two or three variants."""
    experiment, finished = study
    methods = {item.run.method.case: item.run.method for item in finished}
    variants = dict.fromkeys(method.variant for method in methods.values())
    if not 1 < len(variants) <= _MOST_ROWS:
        return []
    parts: list[_Part] = []
    for variant in variants:
        own = {
            # the title of the panel names the variant, so marks need not show it
            case: MethodLook(
                label=methods[case].family, look=replace(one.look, is_filled=True, dashes="-")
            )
            for case, one in looks.items()
            if methods[case].variant == variant
        }
        some = [item for item in finished if item.run.method.case in own]
        parts.append((f"{title}, {variant}" if variant else title, (experiment, some), own))
    return parts


def panel_titles(experiments: Sequence[Experiment]) -> list[str]:
    """Kind and damping orders of every experiment; its name if others have the same."""
    titles = []
    for experiment in experiments:
        problem = experiment.problem
        title = kind_title(problem.kind)
        if problem.kind == "lagrangian":
            title = experiment.name.replace("-", " ")
        if isinstance(problem, Problem) and problem.scene.laws:
            title = experiment.name
        elif isinstance(problem, Problem) and problem.scene.damping:
            orders = dict.fromkeys(fraction_in_words(term.order) for term in problem.scene.damping)
            title += rf", $\gamma = {', '.join(orders)}$"
        titles.append(title)
    return [
        title if titles.count(title) == 1 else experiment.name
        for title, experiment in zip(titles, experiments, strict=True)
    ]


def sweep_convergence_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the errors of members against the step size, one panel for each method.

    Up to :data:`MOST_LINES` members have names in the legend. For more members the colours of lines
    show the swept number, or there are the median and bands that hold 9 of 10 members and all of
    them. Runs without an error are left out.
    """
    having = [one for one in finished if np.isfinite(one.error) and one.error > 0]
    by_method: dict[AnyMethod, dict[int, list[FinishedRun]]] = {}
    for one in sorted(having, key=lambda one: one.run.step_size):
        number = -1 if one.run.member is None else one.run.member.number
        by_method.setdefault(one.run.method, {}).setdefault(number, []).append(one)
    names = method_looks(list(by_method))
    panels = [
        Panel(
            title=names[method.case].label,
            y=error_label(experiment.norm, experiment.units, experiment.grading),
            is_ensemble=True,
            height=2.1 if len(by_method) == 1 else 1.8,
            curves=[
                member_curve(
                    rows[0],
                    np.array([one.run.step_size for one in rows]),
                    np.array([one.error for one in rows]),
                )
                for _, rows in sorted(members.items())
            ],
        )
        for method, members in by_method.items()
    ]
    return ladders(
        panels,
        x=_step_label([experiment]),
        columns=min(2, len(panels)),
        above=False,
        title=members_title(experiment),
        bar=bar_of(experiment, panels),
    )


def member_curve(one: FinishedRun, x: Array, y: Array) -> Curve:
    """A curve of a member of a sweep, with the swept number if there is one."""
    by = swept_number(one.run.member)
    return Curve(x=x, y=y, label=member_label(one.run.member), by=math.nan if by is None else by)


def members_title(experiment: Experiment) -> str:
    """The title above a legend of members; with their count if not each has an entry."""
    count, words = len(experiment.members), swept_keys_in_words(experiment)
    return words if count <= MOST_LINES else f"{count} members: {words}"


def bar_of(experiment: Experiment, panels: Sequence[Panel]) -> str:
    """The name of a colour bar if it distinguishes members; else empty."""
    numbers = [curve.by for panel in panels for curve in panel.curves]
    most = max(len(panel.curves) for panel in panels)
    is_coloured = MOST_LINES < most <= MOST_COLOURED and all(map(math.isfinite, numbers))
    return members_title(experiment) if is_coloured else ""


_NORMS = ("max", "final")


def saturation_figure(studies: Sequence[Study]) -> Figure:
    r"""Draw the error of convolution quadrature of :math:`D^\gamma f`, in two norms.

    For :math:`f \sim t^b` at 0 the order is :math:`\min(p, b-\gamma)` in the maximum norm over
    the grid and :math:`\min(p, b+1)` at a fixed time (Lubich, *Discretized fractional calculus*,
    1986). There is one row for every b, and one column for every norm. If no experiment has the
    norm of a column, the error is computed from the trajectory of another one.
    """
    if not studies:
        raise ValueError("studies: none were given; a saturation figure needs at least one")
    rows: dict[float, list[Study]] = {}
    for study in studies:
        rows.setdefault(leading_exponent(_derivative(study)), []).append(study)
    names = method_looks([f.run.method for _, finished in studies for f in finished])
    first = _derivative(studies[0])
    where = {"max": "largest on the grid", "final": f"at $t = {first.final_time:g}$"}
    power = f"^{{{fraction_in_words(first.order)}}}"
    panels: list[Panel] = []
    for exponent in sorted(rows):
        orders = _orders(rows[exponent], names)
        for norm in _NORMS:
            limit = exponent - first.order if norm == "max" else exponent + 1
            most = min(limit, max(orders.values()))
            curves = [
                # no slope for curves of lower order, to which it would seem to belong
                replace(one, order=most if orders[one.label] >= most else math.nan)
                for one in _curves(rows[exponent], norm, names)
            ]
            title = rf"$b = {exponent:g}$: order $\min(p, {fraction_in_words(limit)})$"
            panels.append(
                Panel(
                    y=rf"error $|D_h{power} f - D{power} f|$",
                    title=title if len(panels) > 1 else f"{where[norm]}\n{title}",
                    height=1.25,
                    curves=curves,
                )
            )
    x = _step_label([experiment for experiment, _ in studies])
    return ladders(panels, x=x, columns=2, title=_heading(rows, first), shared=True)


def leading_exponent(problem: DerivativeProblem) -> float:
    """The b of f(t) ~ c t^b at 0, from the function itself, to three decimals."""
    near = problem.final_time * np.array([1e-6, 1e-5])
    values = np.abs(problem.function(near)).reshape(2, -1)[:, 0]
    if not np.all(values > 0):
        return float("nan")
    return round(math.log10(values[1] / values[0]), 3)


def _derivative(study: Study) -> DerivativeProblem:
    problem = study[0].problem
    if not isinstance(problem, DerivativeProblem):
        raise ValueError(f"kind: {problem.kind!r} is not fractional-derivative")
    return problem


def _orders(studies: Sequence[Study], names: Mapping[str, MethodLook]) -> dict[str, float]:
    """The order p of BDFp by the label of the curve."""
    methods = [item.run.method for _, finished in studies for item in finished]
    quadratures = {names[one.case].label: getattr(one, "cq", "") for one in methods}
    return {
        label: float(cq[3:]) if cq.startswith("bdf") else math.inf
        for label, cq in quadratures.items()
    }


def _curves(studies: Sequence[Study], norm: str, names: dict[str, MethodLook]) -> list[Curve]:
    """Ladders in one norm: of the experiment with this norm, else computed from trajectories."""
    own = [study for study in studies if study[0].norm == norm]
    rows: list[FinishedRun] = []
    for _, finished in own or studies[:1]:
        for item in finished:
            error = item.error if own else _measured(item, norm)
            status = item.status
            if status in ("ok", "floor"):
                status = "floor" if error < item.floor else "ok"
            rows.append(replace(item, error=error, status=status))
    return error_curves(rows, names)


def _measured(item: FinishedRun, norm: str) -> float:
    exact = item.run.experiment.problem.exact
    trajectory = item.trajectory
    if exact is None or trajectory.time.size == 0:
        return math.nan
    error = np.abs(trajectory.position - exact(trajectory.time))
    return float(error.max() if norm == "max" else error[-1].max())


def _heading(rows: dict[float, list[Study]], first: DerivativeProblem) -> str:
    family = all(_is_family_member(exponent, studies) for exponent, studies in rows.items())
    function = r"$f(t) = t^{\,b-1} \sin t$" if family else r"$f(t) \sim t^{\,b}$"
    order = fraction_in_words(first.order)
    return f"Caputo derivative of order {order} of {function}, and $D_h$ by BDF$p$"


def _is_family_member(exponent: float, studies: Sequence[Study]) -> bool:
    problem = _derivative(studies[0])
    time = problem.final_time * np.linspace(0.1, 1.0, 7)
    values = problem.function(time).reshape(7, -1)[:, 0]
    return bool(np.allclose(values, time ** (exponent - 1) * np.sin(time), rtol=1e-12))
