r"""A region of complex frequencies that holds all modes, known before any of them.

On a mode, :math:`v^H T(s) v = 0`. With the mass as the unit of all matrices and
:math:`|\arg s| \le \theta < \pi`:

- Terms of positive semi-definite matrices with powers up to 1, the stiffness and relaxation laws
  have arguments between 0 and :math:`\theta`, those with powers from 1 to 2 arguments within
  :math:`\theta` below that of :math:`s^2`. Terms within an angle :math:`\theta` cannot cancel:
  their sum is at least :math:`\cos(\theta/2)` times the sum of their sizes.
- The modulus of a law is :math:`\int s/(s + x) \rho(x) dx` with :math:`\rho \ge 0`, and
  :math:`\cos(\theta/2) \le |s + x| / (|s| + x) \le 1` bounds it by its value at :math:`|s|`.

So no mode is as large as makes the first kind of the others too small, or as small as makes the
other kind too small. Terms of other matrices count with their norms against both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.matrices import SEMIDEFINITE_TOLERANCE, is_semidefinite
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness, Symbol
from fvi_cli.studies.vibration.sector import Sector

LARGEST_RATIO: Final = 0.995
"""Damping ratio up to which modes are counted, of decay and of growth."""
DISSIPATIVE_ANGLE: Final = 0.45 * math.pi
"""Where nothing feeds the scene no mode has a smaller argument than pi / 2."""
_SEARCHED = 100.0
"""Powers of e on both sides of the geometric mean of the frequencies."""
_STEP = 0.5
_BELOW = 7.0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Term:
    """A matrix in units of the mass, and the size of its symbol at |s|."""

    matrix: Array
    norm: float
    is_semidefinite: bool
    size: Callable[[float], float]
    is_law: bool
    power: float


def region_of_all_modes(
    stiffness: DynamicStiffness, *, largest_ratio: float
) -> tuple[Sector, bool]:
    """A sector for all modes with damping ratios up to a largest one, and whether it holds all.

    Where the stiffness is singular nothing may be known of slow modes; the sector then begins far
    below the slowest motion that the stiffness makes.
    """
    terms = _terms(stiffness)
    last = math.pi - math.acos(largest_ratio)
    cosine = math.cos(0.5 * last)
    first = first_angle(stiffness, largest_ratio)
    # moduli between the fastest and the slowest oscillation that one term makes against the mass
    rates = [
        math.log(term.norm) / (2.0 - term.power)
        for term in terms
        if term.norm > 0 and not term.is_law and term.power < 1.5
    ]
    rates += [0.5 * math.log(term.size(1.0) * term.norm) for term in terms if term.is_law]
    centre = sum(rates) / len(rates) if rates else 0.0
    logs = np.arange(centre - _SEARCHED, centre + _SEARCHED, _STEP).tolist()
    above = _until(logs[::-1], lambda r: _mass_outweighs(terms, r, cosine))
    below = _until(logs, lambda r: _stiffness_outweighs(terms, r, cosine))
    largest = logs[-1] if above is None else above
    least = _floor(terms, largest) if below is None else below
    sector = Sector(
        least=math.exp(min(least, largest - _STEP)),
        largest=math.exp(largest),
        first=first,
        last=last,
    )
    return sector, above is not None and below is not None


def _until(logs: Sequence[float], holds: Callable[[float], bool]) -> float | None:
    """The last of the logarithms of moduli up to which a bound holds; None: not at the first."""
    last = None
    for log in logs:
        if not holds(math.exp(log)):
            return last
        last = log
    return last


def first_angle(stiffness: DynamicStiffness, largest_ratio: float) -> float:
    """Argument of s from which on modes are counted."""
    return DISSIPATIVE_ANGLE if stiffness.scene.is_dissipative else math.acos(largest_ratio)


def _terms(stiffness: DynamicStiffness) -> list[_Term]:
    """All matrices but the mass."""
    scene = stiffness.scene
    root = np.linalg.inv(np.linalg.cholesky(stiffness.dense(0)))
    found = []
    powers: list[float | None] = [0.0] * (len(stiffness.forms) - 1 - len(scene.active_forces))
    powers += [
        one.order if isinstance(one, FractionalDamping) else None for one in scene.active_forces
    ]
    for index, power in enumerate(powers, start=1):
        matrix = root @ stiffness.dense(index) @ root.T
        values = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
        found.append(
            _Term(
                matrix=matrix,
                norm=float(np.abs(values).max()),
                is_semidefinite=is_semidefinite(stiffness.forms[index]),
                size=_size_of(stiffness.symbol(index)),
                is_law=power is None,
                power=1.0 if power is None else power,
            )
        )
    return found


def _size_of(symbol: Symbol) -> Callable[[float], float]:
    return lambda r: abs(symbol(complex(r)))


def _mass_outweighs(terms: list[_Term], r: float, cosine: float) -> bool:
    """Whether no mode has |s| = r, since s^2 M is too large."""
    helping = [one for one in terms if one.is_semidefinite and one.power >= 1.0 and not one.is_law]
    others = [one for one in terms if not any(one is other for other in helping)]
    against = sum(one.size(r) * one.norm / (cosine if one.is_law else 1.0) for one in others)
    return (cosine if helping else 1.0) * r * r > against


def _stiffness_outweighs(terms: list[_Term], r: float, cosine: float) -> bool:
    """Whether no mode has |s| = r, since what does not grow like inertia is too large."""
    low = [one for one in terms if one.is_semidefinite and one.power <= 1.0]
    others = [one for one in terms if not any(one is other for other in low)]
    still = [one for one in others if one.power == 0.0]
    if still:
        # an indefinite stiffness: its smallest singular value against all others
        values = np.abs(np.linalg.eigvalsh(still[0].matrix))
        if values.min() <= SEMIDEFINITE_TOLERANCE * values.max():
            return False
        rest = [one for one in terms if one is not still[0]]
        against = sum(one.size(r) * one.norm / (cosine if one.is_law else 1.0) for one in rest)
        return bool(values.min() > r * r + against)
    if not low:
        return False
    values = np.linalg.eigvalsh(np.sum([one.size(r) * one.matrix for one in low], axis=0))
    if values[0] <= SEMIDEFINITE_TOLERANCE * values[-1]:
        return False
    against = sum(one.size(r) * one.norm / (cosine if one.is_law else 1.0) for one in others)
    return bool(cosine * values[0] > r * r + against)


def _floor(terms: list[_Term], largest: float) -> float:
    """Where no bound is known, log |s| far below the slowest motion that the stiffness makes."""
    squares = [
        abs(value)
        for one in terms
        if one.power == 0.0
        for value in np.linalg.eigvalsh(one.matrix)
        if abs(value) > SEMIDEFINITE_TOLERANCE * one.norm
    ]
    slowest = 0.5 * math.log(min(squares)) if squares else largest
    return min(slowest, largest) - _BELOW
