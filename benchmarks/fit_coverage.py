"""How often 95 % intervals of fits hold the truth, for data of many kinds.

The same noise is given to the linear problem (the derivatives at the truth, the true noise of every
column, numbers that are not negative): what it does to exact intervals is no property of fits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from benchmarks.fit_kind import Array, Kind
from benchmarks.fit_kinds import kind_named
from fvi_cli.studies.fits.fitting import fit_model
from fvi_cli.studies.fits.model import MotionModel
from fvi_cli.studies.fits.profile import CONFIDENCE, quantile
from fvi_cli.studies.fits.result import ModelFit
from fvi_cli.studies.fits.settings import DataSet, FitSettings, Series
from fvi_cli.studies.members import with_values

ROUND_OFF = 1e-9
"""Of the truth, which may lie on a bound."""


def noise_of(kind: Kind, number: int) -> list[Array]:
    """The noise of every series."""
    generator = np.random.default_rng([5, len(kind.name), number])
    return [
        deviation * generator.standard_normal(one.values.size)
        for one, deviation in zip(kind.series, kind.deviations, strict=True)
    ]


def noisy(kind: Kind, number: int) -> FitSettings:
    """The data with noise, whose size is to be estimated."""
    noise, data = iter(noise_of(kind, number)), []
    for each in kind.data:
        series = [
            Series(**{**vars(one), "values": one.values + next(noise)}) for one in each.series
        ]
        data.append(DataSet(**{**vars(each), "series": tuple(series)}))
    return FitSettings(data=tuple(data), models=())


def fitted(kind: Kind, number: int) -> ModelFit:
    """A fit of noisy data."""
    return fit_model(noisy(kind, number), kind.model, with_scan=False)


def fitted_as_advised(kind: Kind, number: int) -> tuple[ModelFit, ModelFit]:
    """A fit with straight lines between the samples of a displacement, and what it leads to.

    That is the same fit, or, where its remark asks for that, one with a cubic spline.
    """
    settings = noisy(kind, number)
    first = fit_model(settings, kind.model, with_scan=False)
    if not first.between:
        return first, first
    cubic = {"problem.displacement.interpolation": "cubic"}
    model = replace(kind.model, specification=with_values(kind.model.specification, cubic))
    return first, fit_model(settings, model, with_scan=False)


def holds_truth(kind: Kind, found: ModelFit) -> tuple[bool, ...]:
    """Which intervals hold the truth; an open end holds all."""
    return tuple(
        not (one.low > true * (1 + ROUND_OFF) or one.high < true * (1 - ROUND_OFF))
        for one, true in zip(found.estimates, kind.truth, strict=True)
    )


@cache
def _derivatives(kind: Kind) -> Array:
    """Of all values, over the true noise, by the numbers themselves at the truth."""
    model = MotionModel(kind.model, kind.data, [1.0] * len(kind.series))
    # where a number is 0, its logarithm has no derivative
    point = np.array([one.inner(v or 1e-6) for one, v in zip(model.free, kind.truth, strict=True)])
    model.remesh(point, 1e-9)
    jacobian = model.evaluate(point).jacobian
    if jacobian is None:
        raise ValueError("no derivatives")
    sizes = np.repeat(kind.deviations, [one.values.size for one in kind.series])
    return np.asarray(jacobian / model.slopes(point) / sizes[:, None])


def holds_in_theory(kind: Kind, number: int) -> tuple[bool, ...]:
    """The same for the linear problem with this noise."""
    jacobian, truth = _derivatives(kind), kind.truth
    noise = np.concatenate(
        [n / d for n, d in zip(noise_of(kind, number), kind.deviations, strict=True)]
    )
    sizes = np.linalg.norm(jacobian, axis=0)
    low = np.where(truth == 0.0, 0.0, -np.inf)
    freedom = noise.size - truth.size

    def least(columns: NDArray[np.intp]) -> float:
        if np.isinf(low[columns]).all():
            rest = noise - jacobian[:, columns] @ np.linalg.pinv(jacobian[:, columns]) @ noise
            return float(rest @ rest)
        bounds = (low[columns], np.inf)
        return 2.0 * float(lsq_linear(jacobian[:, columns] / sizes[columns], noise, bounds).cost)

    every = np.arange(truth.size)
    cost = least(every)
    rise = quantile(freedom, is_known=False) ** 2 * cost / freedom
    return tuple(bool(least(np.delete(every, index)) - cost <= rise) for index in every)


def covered(kind: Kind, numbers: Iterable[int]) -> Iterator[tuple[bool, ...]]:
    """For every noisy fit which intervals hold the truth, whether it converged and ends are open.

    The last two digits: not converged; an end that was not found.
    """
    for number in numbers:
        found = fitted(kind, number)
        ends = [end for one in found.estimates for end in (one.low, one.high)]
        yield (
            *holds_truth(kind, found),
            not found.is_converged,
            found.is_converged and bool(np.isnan(ends).any()),
        )


def covered_between(
    kind_of: Callable[[int], Kind], numbers: Iterable[int]
) -> Iterator[tuple[bool, ...]]:
    """For every noisy fit of a displacement what is said of its samples, and which intervals hold.

    Whether there is a remark, and one again where it was followed; the intervals of straight lines,
    then those where the remark is followed; whether that fit did not converge, and has open ends.
    """
    for number in numbers:
        kind = kind_of(number)
        first, last = fitted_as_advised(kind, number)
        ends = [end for one in last.estimates for end in (one.low, one.high)]
        yield (
            bool(first.between),
            bool(first.between and last.between),
            *holds_truth(kind, first),
            *holds_truth(kind, last),
            not (first.is_converged and last.is_converged),
            last.is_converged and bool(np.isnan(ends).any()),
        )


def between_lines(groups: Mapping[str, Sequence[tuple[bool, ...]]]) -> list[str]:
    """The table in Markdown of what is said of coarse samples, from the answers of every group."""
    lines = [
        "",
        "**Between the samples.** A smooth displacement is fitted with straight lines between its "
        "samples; where the remark of the fit asks for `interpolation: cubic`, again with that. "
        "Shares of fits with the remark, with one again, and of 95% intervals, of all parameters, "
        "that hold the truth: all of straight lines, those of fits without a remark, and those "
        "where the remark is followed.",
        "",
        "| samples per period | fits | remark, % | again, % | straight lines hold, % "
        "| without remark, % | remark followed, % | to within, % | not converged | open ends |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, answers in groups.items():
        rows = np.array(answers, dtype=bool)
        if not rows.size:
            continue
        count = (rows.shape[1] - 4) // 2
        able = rows[~rows[:, -2]]
        said, straight = able[:, 0], able[:, 2 : 2 + count]
        followed = able[:, 2 + count : 2 + 2 * count]
        silent = f"{100 * straight[~said].mean():.1f}" if not said.all() else "-"
        spread = 100 * float(followed.mean(axis=1).std()) / len(able) ** 0.5
        lines.append(
            f"| {name} | {len(rows)} | {100 * said.mean():.0f} | {100 * able[:, 1].mean():.0f} | "
            f"{100 * straight.mean():.1f} | {silent} | {100 * followed.mean():.1f} | "
            f"{spread:.1f} | {int(rows[:, -2].sum())} | {int(rows[:, -1].sum())} |"
        )
    return lines


def coverage_lines(held: Mapping[str, list[tuple[bool, ...]]]) -> list[str]:
    """The table in Markdown, from the answers of every kind."""
    lines = [
        "",
        f"**Intervals by kind.** Shares of {CONFIDENCE:.0%} intervals, of all parameters, that "
        "hold the truth, and those of the exact intervals of the linear problem with this noise.",
        "",
        "| kind | fits | fits hold, % | linear problem, % | difference, % | to within, % "
        "| not converged | open ends |",
        "|---|---|---|---|---|---|---|---|",
    ]
    differences: list[float] = []
    for name, answers in held.items():
        rows = np.array(answers, dtype=bool)
        if not rows.size:
            continue
        kind = kind_named(name)
        able = ~rows[:, -2]
        theory = np.array([holds_in_theory(kind, number) for number in range(len(rows))])
        differing = (rows[:, :-2].astype(float) - theory)[able].mean(axis=1)
        differences += differing.tolist()
        spread = 100 * float(np.std(differing)) / max(len(differing), 1) ** 0.5
        lines.append(
            f"| {kind.name} | {len(rows)} | {100 * rows[able, :-2].mean():.1f} | "
            f"{100 * theory[able].mean():.1f} | {100 * float(differing.mean()):+.1f} | "
            f"{spread:.1f} | {int(rows[:, -2].sum())} | {int(rows[:, -1].sum())} |"
        )
    spread = 100 * float(np.std(differences)) / max(len(differences), 1) ** 0.5
    lines += [
        "",
        f"Of {len(differences)} fits of all kinds the difference is "
        f"{100 * float(np.mean(differences)):+.2f} %, to within {spread:.2f} %.",
    ]
    return lines
