"""Damping terms that the data do not need: likelihood ratios of fits with and without a term."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import MotionModel
from fvi_cli.studies.fits.profile import CONFIDENCE, Minimum
from fvi_cli.studies.fits.search import least_squares_from
from fvi_cli.studies.fits.settings import DataSet, FitModel, FitParameter
from fvi_cli.studies.members import value_at, with_values

MOST_ITERATIONS = 25
SURE = 3.0
"""A term is needed without a test if its size is so many thresholds of the test away from 0."""
SIZES = ("coefficient", "unrelaxed", "modulus")
SPECTRUM = ("moduli", "times")
"""Lists of a law; the entries at one index of them count as a term of their own."""


@dataclass(frozen=True, kw_only=True)
class NeedlessTerm:
    """A term without which the data are fitted as well."""

    key: str
    parameters: int
    increase: float  # increase of the misfit without the term, in variances of the noise
    probability: float
    """Probability of this increase or a larger one if the term does not exist (likelihood ratio; F
    where the noise is estimated)."""

    @property
    def words(self) -> str:
        """The warning about the term."""
        return (
            f"{self.key} is not needed: without it ({self.parameters} parameters less) the misfit "
            f"grows by {max(self.increase, 0.0):.2g} variances of the noise (probability "
            f"{self.probability:.2g} by chance)"
        )


def needless_terms(
    best: Minimum, errors: Array, variance: float, *, is_known: bool
) -> tuple[NeedlessTerm, ...]:
    """Terms whose removal the data do not contradict."""
    model, found = best.model, []
    values, freedom = model.values(best.point), model.size - len(model.free)
    for key, lists in _terms(model.model.specification, [one.key for one in model.free]):
        gone = [i for i, one in enumerate(model.free) if _renamed(one.key, lists) is None]
        threshold = _threshold(len(gone), freedom, is_known=is_known)
        sizes = [i for i in gone if _is_size(model.free[i].key)]
        if not sizes or any(values[i] > SURE * math.sqrt(threshold) * errors[i] for i in sizes):
            continue
        increase = (_cost_without(best, lists, gone) - best.evaluation.cost) / variance
        if increase <= threshold:
            found.append(
                NeedlessTerm(
                    key=key,
                    parameters=len(gone),
                    increase=float(increase),
                    probability=_probability(increase, len(gone), freedom, is_known=is_known),
                )
            )
    return tuple(found)


def _threshold(count: int, freedom: int, *, is_known: bool) -> float:
    from scipy.special import chdtri, fdtri

    if is_known:
        return float(chdtri(count, 1.0 - CONFIDENCE))
    return float(count * fdtri(count, freedom, CONFIDENCE)) if count else 0.0


def _probability(increase: float, count: int, freedom: int, *, is_known: bool) -> float:
    from scipy.special import chdtrc, fdtrc

    rise = max(increase, 0.0)
    return float(chdtrc(count, rise) if is_known else fdtrc(count, freedom, rise / count))


_Lists = tuple[tuple[str, int], ...]
"""Pairs (key path of a list, index of the entry that is left out)."""


def _terms(specification: Mapping[str, Any], keys: Sequence[str]) -> Iterator[tuple[str, _Lists]]:
    """Terms with fitted parameters: key path of each, and the list entries that make it up."""
    seen: dict[str, _Lists] = {}
    for key in keys:
        parts = key.partition("@")[0].split(".")
        if len(parts) < 4 or not parts[2].isdecimal():
            continue
        term = ".".join(parts[:3])
        owner = value_at(specification, term)
        if not isinstance(owner, Mapping) or not {"order", "law"} & set(owner):
            continue
        seen[term] = ((".".join(parts[:2]), int(parts[2])),)
        if parts[3] in SPECTRUM and len(owner[parts[3]]) > 1:
            seen[f"{term}.{SPECTRUM[0]}.{parts[4]}"] = tuple(
                (f"{term}.{one}", int(parts[4])) for one in SPECTRUM
            )
    yield from seen.items()


def _is_size(key: str) -> bool:
    last = key.partition("@")[0].split(".")
    return last[-1] in SIZES or "moduli" in last


def _renamed(key: str, lists: _Lists) -> str | None:
    """The key path of a number after a term is left out; None: it belonged to that term."""
    for path, place in lists:
        if not key.startswith(f"{path}."):
            continue
        index, dot, rest = key[len(path) + 1 :].partition(".")
        number, at, name = index.partition("@")
        if not number.isdecimal():
            continue
        if int(number) == place:
            return None
        return f"{path}.{int(number) - (int(number) > place)}{at}{name}{dot}{rest}"
    return key


def _cost_without(best: Minimum, lists: _Lists, gone: list[int]) -> float:
    """The least misfit without a term; infinite if it cannot be computed."""
    reduced = _without(best.model, lists)
    if reduced is None:
        return math.inf
    kept = np.delete(np.arange(len(best.model.free)), gone)
    try:
        smaller = MotionModel(*reduced, best.model.deviations)
        smaller.meshes = best.model.meshes
        if not kept.size:
            return smaller.evaluate(np.zeros(0), with_jacobian=False).cost
        bounds = (best.bounds[0][kept], best.bounds[1][kept])
        found = least_squares_from(
            smaller, best.point[kept], bounds, most=MOST_ITERATIONS, tolerance=1e-4
        )
    except (ValueError, LookupError):
        return math.inf
    return math.inf if found is None else found.cost


def _without(model: MotionModel, lists: _Lists) -> tuple[FitModel, list[DataSet]] | None:
    """The model and the data without a term; None: other parameters are multiples of its own."""
    described = model.model
    changes = {}
    for path, place in lists:
        entries = list(value_at(described.specification, path))
        changes[path] = entries[:place] + entries[place + 1 :]
    parameters: list[FitParameter] = []
    for one in described.parameters:
        key = _renamed(one.key, lists)
        if key is None:
            continue
        tied = _renamed(one.tied_to, lists) if one.tied_to else ""
        if tied is None:
            return None
        parameters.append(replace(one, key=key, tied_to=tied))
    smaller = replace(
        described,
        specification=with_values(described.specification, changes),
        parameters=tuple(parameters),
    )
    data = []
    for each in model.data:
        own = {_renamed(key, lists): value for key, value in each.changes.items()}
        data.append(replace(each, changes={k: v for k, v in own.items() if k is not None}))
    return smaller, data
