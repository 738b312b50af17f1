"""How far convolution quadrature gets by itself on a singular function, in two norms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.ladders.convergence import Study, error_curves
from fvi_cli.plotting.looks import MethodLook, method_looks
from fvi_cli.plotting.panels import ladders
from fvi_cli.plotting.words import fraction
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import FinishedRun

_NORMS = ("max", "final")


def saturation_figure(studies: Sequence[Study]) -> Figure:
    r"""Draw the error of convolution quadrature of :math:`D^\gamma f`, in two norms.

    For :math:`f \sim t^b` at 0 the order is :math:`\min(p, b-\gamma)` in the maximum norm over
    the grid and :math:`\min(p, b+1)` at a fixed time (Lubich, *Discretized fractional calculus*,
    1986). One row for every b, one column for every norm. An experiment in the other norm than
    a column's stands in for it by its trajectory.

    Raises
    ------
    ValueError
        If there is no experiment, or a problem is no fractional derivative.
    """
    if not studies:
        raise ValueError("studies: none were given; a saturation figure needs at least one")
    rows: dict[float, list[Study]] = {}
    for study in studies:
        rows.setdefault(leading_exponent(_derivative(study)), []).append(study)
    names = method_looks([f.run.method for _, finished in studies for f in finished])
    first = _derivative(studies[0])
    where = {"max": "largest on the grid", "final": f"at $t = {first.final_time:g}$"}
    panels: list[Panel] = []
    for exponent in sorted(rows):
        best = max(_largest_order(one) for one in rows[exponent])
        for norm in _NORMS:
            limit = exponent - first.order if norm == "max" else exponent + 1
            curves = _curves(rows[exponent], norm, names)
            title = rf"$b = {exponent:g}$: order $\min(p, {fraction(limit)})$"
            panels.append(
                Panel(
                    y="error",
                    title=title if len(panels) > 1 else f"{where[norm]}\n{title}",
                    height=1.25,
                    curves=[replace(one, order=min(limit, best)) for one in curves],
                )
            )
    return ladders(panels, columns=2, title=_heading(rows, first), shared=True)


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


def _largest_order(study: Study) -> float:
    orders = [getattr(item.run.method, "cq", "") for item in study[1]]
    return float(max((int(cq[3:]) for cq in orders if cq.startswith("bdf")), default=math.inf))


def _curves(studies: Sequence[Study], norm: str, names: dict[str, MethodLook]) -> list[Curve]:
    """Ladders in one norm: of the experiment that has it, else measured on the trajectories."""
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
    function = r"$t^{\,b-1} \sin t$" if family else r"$f(t) \sim t^{\,b}$"
    return f"Caputo derivative of order {fraction(first.order)} of {function} by BDF$p$"


def _is_family_member(exponent: float, studies: Sequence[Study]) -> bool:
    problem = _derivative(studies[0])
    time = problem.final_time * np.linspace(0.1, 1.0, 7)
    values = problem.function(time).reshape(7, -1)[:, 0]
    return bool(np.allclose(values, time ** (exponent - 1) * np.sin(time), rtol=1e-12))
