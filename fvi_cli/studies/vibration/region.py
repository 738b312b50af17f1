r"""A region of complex frequencies that holds all modes, derived before any mode is known.

For a mode, :math:`v^H T(s) v = 0`. With the mass as the unit of all matrices and
:math:`|\arg s| \le \theta < \pi`:

- Terms of positive semi-definite matrices with powers up to 1, the stiffness and relaxation laws
  have arguments between 0 and :math:`\theta`, those with powers from 1 to 2 arguments within
  :math:`\theta` below that of :math:`s^2`. Terms within an angle :math:`\theta` cannot cancel:
  their sum is at least :math:`\cos(\theta/2)` times the sum of their sizes.
- The modulus of a law is :math:`\int s/(s + x) \rho(x) dx` with :math:`\rho \ge 0`, and
  :math:`\cos(\theta/2) \le |s + x| / (|s| + x) \le 1` bounds it by its value at :math:`|s|`.

So |s| of a mode is bounded from above, where the terms of inertia outweigh all others, and from
below, where the terms of stiffness do. Terms of indefinite matrices count with their norms among
the others, in both bounds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.matrices import SEMIDEFINITE_TOLERANCE, dense, is_semidefinite
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness
from fvi_cli.studies.vibration.sector import Sector

LARGEST_RATIO: Final = 0.995
"""Damping ratio up to which modes are counted, of decay and of growth."""
DISSIPATIVE_ANGLE: Final = 0.45 * math.pi
"""Least argument of s (radians) for dissipative scenes; their modes have pi / 2 or more."""
_SEARCHED = 100.0
"""Powers of e around the geometric mean of the frequencies within which bounds are searched."""
_STEP = 0.5
_BELOW = 7.0
_MARGIN = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class _Terms:
    """The n terms other than that of the mass, in units of the mass."""

    stiffness: DynamicStiffness
    matrices: Array  # (n, d, d)
    norms: Array  # (n,)
    powers: Array  # of s, (n,); 1 for laws
    is_law: NDArray[np.bool_]  # (n,)
    is_semidefinite: NDArray[np.bool_]  # (n,)

    @classmethod
    def of(cls, stiffness: DynamicStiffness) -> _Terms:
        """The terms of a scene."""
        forces = stiffness.scene.active_forces
        powers = [one.order if isinstance(one, FractionalDamping) else 1.0 for one in forces]
        is_law = [not isinstance(one, FractionalDamping) for one in forces]
        forms = stiffness.forms[1:]
        still = len(forms) - len(forces)
        root = np.linalg.inv(np.linalg.cholesky(dense(stiffness.mass)))
        matrices = np.array([root @ dense(form) @ root.T for form in forms])
        matrices = matrices.reshape(-1, *root.shape)
        values = np.linalg.eigvalsh(0.5 * (matrices + matrices.swapaxes(1, 2)))
        return cls(
            stiffness=stiffness,
            matrices=matrices,
            norms=np.abs(values).max(axis=1),
            powers=np.array([0.0] * still + powers),
            is_law=np.array([False] * still + is_law, dtype=bool),
            is_semidefinite=np.array([is_semidefinite(form) for form in forms], dtype=bool),
        )

    def sizes(self, r: float) -> Array:
        """Sizes of the factors of the matrices at |s| = r, ``(n,)``."""
        return np.asarray(np.abs(self.stiffness.symbols(complex(r))[1:]))

    def bound(self, r: float, which: NDArray[np.bool_], cosine: float) -> float:
        """An upper bound on the sum of the terms `which` at |s| = r."""
        return float((self.sizes(r) * self.norms / np.where(self.is_law, cosine, 1.0))[which].sum())

    def mass_outweighs(self, r: float, cosine: float) -> bool:
        """Whether no mode has |s| = r, since s^2 M is too large."""
        helping = self.is_semidefinite & (self.powers >= 1.0) & ~self.is_law
        own = (cosine if helping.any() else 1.0) * r * r
        return own > self.bound(r, ~helping, cosine)

    def stiffness_outweighs(self, r: float, cosine: float) -> bool:
        """Whether no mode has |s| = r, since stiffness and similar terms are too large."""
        low = self.is_semidefinite & (self.powers <= 1.0)
        indefinite = ~low & (self.powers == 0.0)
        if indefinite.any():
            # the smallest singular value of the stiffness against all other terms
            values = np.sort(np.abs(np.linalg.eigvalsh(self.matrices[indefinite][0])))
            against = r * r + self.bound(r, ~indefinite, cosine)
            return bool(values[0] > max(SEMIDEFINITE_TOLERANCE * values[-1], against))
        if not low.any():
            return False
        values = np.linalg.eigvalsh(np.tensordot(self.sizes(r)[low], self.matrices[low], axes=1))
        if values[0] <= SEMIDEFINITE_TOLERANCE * values[-1]:
            return False
        return bool(cosine * values[0] > r * r + self.bound(r, ~low, cosine))

    def slowest(self, largest: float) -> float:
        """Substitute for an unknown bound: log |s| far below the slowest mode of the stiffness."""
        values = np.abs(np.linalg.eigvalsh(self.matrices[self.powers == 0.0]))
        is_there = values > SEMIDEFINITE_TOLERANCE * self.norms[self.powers == 0.0, None]
        slowest = float(0.5 * np.log(values[is_there].min())) if is_there.any() else largest
        return min(slowest, largest) - _BELOW


def region_of_all_modes(
    stiffness: DynamicStiffness, *, largest_ratio: float
) -> tuple[Sector, bool]:
    """A sector for all modes with damping ratios up to a largest one, and whether it holds all.

    Where the stiffness is singular there may be no bound on slow modes; the sector then begins far
    below the slowest nonzero mode of the stiffness.
    """
    terms = _Terms.of(stiffness)
    last = math.pi - math.acos(largest_ratio)
    cosine = math.cos(0.5 * last)
    # frequencies at which a single term balances the mass
    is_clear = (terms.norms > 0) & ~terms.is_law & (terms.powers < 1.5)
    rates = np.concatenate(
        [
            np.log(terms.norms[is_clear]) / (2.0 - terms.powers[is_clear]),
            0.5 * np.log((terms.sizes(1.0) * terms.norms)[terms.is_law]),
        ]
    )
    centre = float(rates.sum()) / rates.size if rates.size else 0.0
    logs = np.arange(centre - _SEARCHED, centre + _SEARCHED, _STEP).tolist()
    above = _until(logs[::-1], lambda r: terms.mass_outweighs(r, cosine))
    below = _until(logs, lambda r: terms.stiffness_outweighs(r, cosine))
    largest = logs[-1] if above is None else above
    least = terms.slowest(largest) if below is None else below
    sector = Sector(
        # the bounds may be modes themselves
        least=math.exp(min(least, largest - _STEP) - _MARGIN),
        largest=math.exp(largest + _MARGIN),
        first=first_angle(stiffness, largest_ratio),
        last=last,
    )
    return sector, above is not None and below is not None


def _until(logs: Sequence[float], holds: Callable[[float], bool]) -> float | None:
    """The last logarithm of |s| up to which a bound holds; None: it fails at the first."""
    kept = list(itertools.takewhile(lambda log: holds(math.exp(log)), logs))
    return kept[-1] if kept else None


def first_angle(stiffness: DynamicStiffness, largest_ratio: float) -> float:
    """Least argument of s at which modes are counted."""
    return DISSIPATIVE_ANGLE if stiffness.scene.is_dissipative else math.acos(largest_ratio)
