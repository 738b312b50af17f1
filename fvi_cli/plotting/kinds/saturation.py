"""Errors of convolution quadrature of fractional derivatives."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.draw import figure
from fvi_cli.plotting.kinds.convergence import Study, error_curves, explained, step_label
from fvi_cli.plotting.ladders import finish_ladders, ladder
from fvi_cli.plotting.panels import Panel
from fvi_cli.plotting.style import method_names
from fvi_cli.plotting.words import fraction_in_words
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.norms import Norm


def saturation_figure(studies: Sequence[Study]) -> Figure:
    r"""Draw the error of convolution quadrature of :math:`D^\gamma f`, a row for every norm.

    For :math:`f \sim t^b` at 0 the order is :math:`\min(p, b-\gamma)` in the maximum norm over
    the grid and :math:`\min(p, b+1)` at a fixed time (Lubich, *Discretized fractional calculus*,
    1986). There is a column for every b.
    """
    names = method_names([one.run.method for _, finished in studies for one in finished])
    found: dict[Norm, dict[float, tuple[Study, list[FinishedRun]]]] = {}
    for study in studies:
        row = found.setdefault(study[0].norm, {})
        row.setdefault(_exponent(study), (study, []))[1].extend(study[1])
    columns = sorted({b for row in found.values() for b in row})
    rows = [
        [_panel(*row[b], b, names, is_first=b == columns[0]) if b in row else None for b in columns]
        for row in found.values()
    ]
    return figure(
        rows,
        ladder,
        height=1.68 if len(columns) > 2 else 2.6,
        is_wide=len(columns) > 1,
        sharex=True,
        finish=finish_ladders,
    )


def _panel(
    study: Study, rows: list[FinishedRun], b: float, names: dict[str, str], *, is_first: bool
) -> Panel:
    """The ladders of one exponent in one norm, with the slope of the highest order."""
    experiment, problem = study[0], _derivative(study)
    smooth = b - problem.order
    limit = {"max": smooth, "l2": smooth + 0.5, "final": b + 1.0}[experiment.norm]
    where = {"max": "largest", "l2": "mean square", "final": f"at $t={problem.final_time:g}$"}
    power = f"^{{{fraction_in_words(problem.order)}}}"
    return Panel(
        curves=error_curves(rows, names),
        title=f"{where[experiment.norm]}, $b={b:g}$",
        x=step_label(experiment),
        y=f"$|D_h{power}f-D{power}f|$" if is_first else "",
        orders=[min(limit, max(one.run.method.order for one in rows))],
        floor=explained(rows)["floor"],
    )


def _exponent(study: Study) -> float:
    """The b of f(t) ~ c t^b at 0, from the function itself, to three decimals."""
    problem = _derivative(study)
    near = problem.final_time * np.array([1e-6, 1e-5])
    values = np.abs(problem.function(near)).reshape(2, -1)[:, 0]
    return round(math.log10(values[1] / values[0]), 3) if np.all(values > 0) else math.nan


def _derivative(study: Study) -> DerivativeProblem:
    problem = study[0].problem
    if not isinstance(problem, DerivativeProblem):
        raise ValueError(f"kind: {problem.kind!r} is not fractional-derivative")
    return problem
