"""Errors of convolution quadrature of fractional derivatives, in two norms."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.draw import figure
from fvi_cli.plotting.kinds.convergence import Study, error_curves, explained, step_label
from fvi_cli.plotting.ladders import finish_ladders, ladder
from fvi_cli.plotting.looks import method_names
from fvi_cli.plotting.panels import Panel
from fvi_cli.plotting.words import fraction_in_words
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import FinishedRun

_NORMS = ("max", "final")


def saturation_figure(studies: Sequence[Study]) -> Figure:
    r"""Draw the error of convolution quadrature of :math:`D^\gamma f`, in two norms.

    For :math:`f \sim t^b` at 0 the order is :math:`\min(p, b-\gamma)` in the maximum norm over
    the grid and :math:`\min(p, b+1)` at a fixed time (Lubich, *Discretized fractional calculus*,
    1986). There is a column for every b and a row for every norm.
    """
    if not studies:
        raise ValueError("studies: none were given; a saturation figure needs at least one")
    by_exponent: dict[float, list[Study]] = {}
    for study in studies:
        by_exponent.setdefault(leading_exponent(_derivative(study)), []).append(study)
    names = method_names([one.run.method for _, finished in studies for one in finished])
    first = _derivative(studies[0])
    where = {"max": "largest", "final": f"at $t = {first.final_time:g}$"}
    power = f"^{{{fraction_in_words(first.order)}}}"
    label = rf"error $|D_h{power} f - D{power} f|$"
    rows = [
        [
            _panel(by_exponent[b], b, norm, names, f"{where[norm]}, $b = {b:g}$", label * (not k))
            for k, b in enumerate(sorted(by_exponent))
        ]
        for norm in _NORMS
    ]
    return figure(
        rows,
        ladder,
        height=1.68 if len(by_exponent) > 2 else 2.6,
        is_wide=len(by_exponent) > 1,
        sharex=True,
        legend="below",
        finish=finish_ladders,
    )


def _panel(
    studies: Sequence[Study],
    exponent: float,
    norm: str,
    names: Mapping[str, str],
    title: str,
    label: str,
) -> Panel:
    """The ladders of one exponent in one norm, with the slope of the highest order."""
    rows, order = _in_norm(studies, norm), _derivative(studies[0]).order
    limit = exponent - order if norm == "max" else exponent + 1
    highest = max(one.run.method.order for one in rows)
    return Panel(
        curves=error_curves(rows, names),
        title=title,
        x=step_label(studies[0][0]),
        y=label,
        orders=[min(limit, highest)],
        floor=explained(rows)["floor"],
    )


def leading_exponent(problem: DerivativeProblem) -> float:
    """The b of f(t) ~ c t^b at 0, from the function itself, to three decimals."""
    near = problem.final_time * np.array([1e-6, 1e-5])
    values = np.abs(problem.function(near)).reshape(2, -1)[:, 0]
    return round(math.log10(values[1] / values[0]), 3) if np.all(values > 0) else math.nan


def _derivative(study: Study) -> DerivativeProblem:
    problem = study[0].problem
    if not isinstance(problem, DerivativeProblem):
        raise ValueError(f"kind: {problem.kind!r} is not fractional-derivative")
    return problem


def _in_norm(studies: Sequence[Study], norm: str) -> list[FinishedRun]:
    """Runs in one norm: of the experiment with this norm, else measured on stored values."""
    own = [study for study in studies if study[0].norm == norm]
    rows: list[FinishedRun] = []
    for _, finished in own or studies[:1]:
        for item in finished:
            error = item.error if own else _error(item, norm)
            status = item.status
            if status in ("ok", "floor"):
                status = "floor" if error < item.floor else "ok"
            rows.append(replace(item, error=error, status=status))
    return rows


def _error(item: FinishedRun, norm: str) -> float:
    exact, trajectory = item.run.experiment.problem.exact, item.trajectory
    if exact is None or trajectory.time.size == 0:
        return math.nan
    error = np.abs(trajectory.position - exact(trajectory.time))
    return float(error.max() if norm == "max" else error[-1].max())
