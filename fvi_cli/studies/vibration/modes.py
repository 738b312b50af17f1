r"""Modes of damped structures: the nonlinear eigenvalue problem T(s) v = 0.

Modes without damping start inverse iterations (Güttel, Tisseur, *The nonlinear eigenvalue problem*,
Acta Numer. 26, 2017, algorithm 4.9). The argument principle counts the modes around the requested
ones: along a closed contour the argument of det T(s) turns once for every zero inside. Known zeros
are divided out, so that it turns quickly only where a mode is missing, and Newton's iteration for
what remains of the determinant (Maehly, 1954) finds it.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.matrices import as_csc, dense, negative_pivots
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.mathematics.zeros import OneFunction, changes_of_argument
from fvi_cli.studies.members import OfMember
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness

LARGEST_RATIO: Final = 0.995
"""Damping ratio up to which modes are counted, of decay and of growth."""
LEAST_ANGLE: Final = 0.45 * math.pi
"""Least argument of s (radians) for dissipative scenes; their modes have pi / 2 or more."""
EXTRA: Final = 12
"""Number of modes computed beyond the requested ones, to see where these end."""
SLOWEST: Final = 1e-4
"""Slower motions, relative to the slowest of the first modes, are not counted."""
RIGID: Final = 1e-6
"""Frequencies below this share of the largest one are round-off of a singular stiffness."""
SAME: Final = 1e-5
"""Modes whose frequencies and shapes differ by less than this, relative, are one mode."""
CONVERGED: Final = 1e-15
RESIDUAL_LIMIT: Final = 1e-12
MOST_STEPS: Final = 40
TRIES: Final = 100
"""Most starts of the search for missing modes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mode:
    r"""A solution :math:`v e^{st}` of a scene without forcing."""

    frequency: complex
    """s, with positive imaginary part; its conjugate is one as well. 1/time."""
    shape: ComplexArray
    """v, shape ``(d,)``, complex; its largest entry is 1."""
    residual: float
    """Size of T(s) v relative to that of its terms."""

    @property
    def hertz(self) -> float:
        """Oscillations in the unit of time."""
        return self.frequency.imag / (2.0 * math.pi)

    @property
    def damping_ratio(self) -> float:
        r""":math:`-\mathrm{Re}\, s / |s|`."""
        return (0.0 - self.frequency.real) / abs(self.frequency)

    @property
    def loss_factor(self) -> float:
        r""":math:`\eta` of :math:`-s^2 = \Omega^2 (1 + i \eta)`."""
        square = 0.0 - self.frequency**2
        return square.imag / square.real if square.real else math.inf


@dataclass(frozen=True, kw_only=True)
class Region:
    """Complex frequencies between two moduli (1/time) and two arguments (radians)."""

    least: float
    largest: float
    first: float
    last: float

    def holds(self, s: complex) -> bool:
        """Whether s lies inside."""
        return self.least < abs(s) < self.largest and self.first < cmath.phase(s) < self.last

    @property
    def corners(self) -> ComplexArray:
        """Logarithms of s at the corners, counter-clockwise, the first one again at the end."""
        inner, outer = math.log(self.least), math.log(self.largest)
        first, last = 1j * self.first, 1j * self.last
        return np.array([inner + first, outer + first, outer + last, inner + last, inner + first])


@dataclass(frozen=True, kw_only=True, eq=False)
class ModeTable(OfMember):
    """Modes of one scene."""

    coordinates: tuple[str, ...]
    """Names of the degrees of freedom."""
    modes: tuple[Mode, ...]
    region: Region
    """The complex frequencies around the modes in which modes were counted."""
    counted: int | None
    """How many modes are in the region; None where one lies on its edge."""
    inside: int
    """How many modes of the region are found."""

    @property
    def is_complete(self) -> bool:
        """Whether it is known that no mode of the region is missing."""
        return self.counted == self.inside


def find_modes(scene: Scene, count: int, *, near: float | None = None) -> ModeTable:
    """At most `count` modes, of lowest frequency or nearest to `near` (oscillations per time).

    Solutions that do not oscillate (branch cut, rigid motions) do not count as modes.

    Raises
    ------
    ValueError
        If the scene is not linear, or has no stiffness or mode at all.
    """
    stiffness = DynamicStiffness(scene)
    centre = 0.0 if near is None else 2.0 * math.pi * near
    wanted = scene.dimension if stiffness.is_small else min(count + EXTRA, scene.dimension)
    rates, vectors = undamped_modes(stiffness, centre, wanted)
    found: list[Mode] = []
    for rate, vector in zip(rates.tolist(), vectors.T.astype(complex), strict=True):
        _add(found, refine(stiffness, 1j * rate, vector))
    region = _region_around(stiffness, centre, count, rates, found)
    counted = count_modes(stiffness, region, found)
    if counted is not None:
        _find_missing(stiffness, region, found, counted)
    found = [mode for mode in found if region.holds(mode.frequency)]
    if not found:
        words = f"no mode with a damping ratio below {LARGEST_RATIO}"
        raise ValueError(f"{words} is found, though {counted} are counted" if counted else words)
    nearest = sorted(found, key=lambda mode: abs(abs(mode.frequency) - centre))[:count]
    return ModeTable(
        coordinates=tuple(f"x{index}" for index in range(1, scene.dimension + 1)),
        modes=tuple(sorted(nearest, key=lambda mode: abs(mode.frequency))),
        region=region,
        counted=counted,
        inside=len(found),
    )


def undamped_modes(stiffness: DynamicStiffness, centre: float, wanted: int) -> tuple[Array, Array]:
    """Frequencies (1/time) and shapes ``(d, n)`` of modes without damping, nearest to a frequency.

    The stiffness is the real part of that at the frequency `centre`.
    """
    mass, d = stiffness.forms[0], stiffness.dimension
    factors = stiffness.symbols(1j * max(centre, 1e-30)).real
    factors[0] = 0.0
    matrix = stiffness.combined(factors)
    usual = math.sqrt(float(np.abs(factors) @ stiffness.norms) / stiffness.norms[0])
    if not stiffness.is_sparse or d <= 4 * wanted:
        from scipy.linalg import eigh

        squares, vectors = eigh(dense(matrix), dense(mass))
    else:
        from scipy.sparse.linalg import eigsh

        squares, vectors = eigsh(
            as_csc(matrix),
            k=wanted,
            M=as_csc(mass),
            # not at 0, which is an eigenvalue of a free structure
            sigma=centre**2 if centre else -1e-9 * usual**2,
            v0=np.random.default_rng(5).standard_normal(d),
        )
    rates = np.sqrt(np.maximum(squares, 0.0))
    order = np.argsort(np.abs(rates - centre), kind="stable")[:wanted]
    order = order[rates[order] > RIGID * rates.max()]
    return rates[order], vectors[:, order]


def refine(stiffness: DynamicStiffness, s: complex, vector: ComplexArray) -> Mode | None:
    """The mode to which inverse iterations lead; None: they do not converge to an oscillation."""
    best: Mode | None = None
    for _ in range(MOST_STEPS):
        if not (math.isfinite(abs(s)) and abs(s) > 0):
            return None
        slope = stiffness.combined(stiffness.slopes(s))
        try:
            vector = stiffness.solver(s)(slope @ vector)
        except np.linalg.LinAlgError:
            s *= 1.0 + 1e-14
            continue
        vector = vector / vector[np.abs(vector).argmax()]
        # T is symmetric, so that the left vector is the right one
        value = vector @ (stiffness.combined(stiffness.symbols(s)) @ vector)
        change = complex(value / (vector @ (slope @ vector)))
        # the step must not cross the branch cut
        s -= change * min(1.0, 0.3 * abs(s) / abs(change)) if change else 0.0
        residual = stiffness.residual(s, vector)
        is_better = best is None or residual < 0.3 * best.residual
        if best is None or residual < best.residual:
            best = Mode(frequency=s, shape=vector, residual=residual)
        # convergence is fast: a residual that falls no more is round-off
        if not is_better and residual <= RESIDUAL_LIMIT:
            break
    if best is None or best.residual > RESIDUAL_LIMIT:
        return None
    real, imaginary = best.frequency.real, best.frequency.imag
    if abs(imaginary) <= SAME * abs(best.frequency):
        return None
    return Mode(
        # a real part below the last digit is no damping
        frequency=complex(real if abs(real) > CONVERGED * abs(imaginary) else 0.0, abs(imaginary)),
        shape=best.shape.conj() if imaginary < 0 else best.shape,
        residual=best.residual,
    )


def _add(found: list[Mode], mode: Mode | None) -> None:
    """Keep a mode whose shape is no combination of those of its frequency."""
    if mode is None:
        return
    near = SAME * abs(mode.frequency)
    shapes = [one.shape for one in found if abs(one.frequency - mode.frequency) <= near]
    left = mode.shape
    if shapes:
        basis = np.linalg.qr(np.transpose(shapes))[0]
        left = mode.shape - basis @ (basis.conj().T @ mode.shape)
    if np.linalg.norm(left) > math.sqrt(SAME) * np.linalg.norm(mode.shape):
        found.append(mode)


def _region_around(
    stiffness: DynamicStiffness,
    centre: float,
    count: int,
    rates: Array,
    found: Sequence[Mode],
) -> Region:
    """A region around the requested modes, whose arcs lie half-way between modes."""
    sizes = np.array([abs(mode.frequency) for mode in found])
    away = np.sort(np.abs(sizes - centre))
    last = away[:count].max(initial=0.0)
    beyond = away[away > last * (1.0 + SAME)]
    if beyond.size and away.size > count:
        reach = 0.5 * (last + beyond[0])
        largest = centre + float(reach)
    elif stiffness.is_small:
        reach, largest = math.inf, 1.5 * upper_bound(stiffness)
    else:
        largest = 1.05 * max(*sizes, *rates)
        reach = largest - centre
    # rigid motions, whose s is round-off, are none of the first modes
    first = [size for size in (*sizes, *rates) if size > RIGID * rates.max(initial=0.0)]
    slowest = SLOWEST * min(first, default=largest)
    return Region(
        least=max(slowest, centre - float(reach)),
        largest=largest,
        first=LEAST_ANGLE if stiffness.scene.is_dissipative else math.acos(LARGEST_RATIO),
        last=math.pi - math.acos(LARGEST_RATIO),
    )


def upper_bound(stiffness: DynamicStiffness) -> float:
    r"""A bound on |s| of all modes with damping ratios up to the largest one.

    In units of the mass the terms of a mode add up to 0. With :math:`|\arg s| \le \theta`, those of
    inertia and of positive semi-definite damping of order 1 and more add up to at least
    :math:`\cos(\theta/2) |s|^2`, and a modulus is at most its value at :math:`|s|` divided by
    :math:`\cos(\theta/2)`.
    """
    scene = stiffness.scene
    root = np.linalg.inv(np.linalg.cholesky(dense(stiffness.forms[0])))
    norms = [float(np.linalg.norm(root @ form @ root.T, 2)) for form in stiffness.forms]
    first = len(norms) - len(scene.active_forces)
    for index, force in enumerate(scene.active_forces, start=first):
        if isinstance(force, FractionalDamping) and force.order >= 1 and scene.is_dissipative:
            norms[index] = 0.0
    cosine = math.cos(0.5 * (math.pi - math.acos(LARGEST_RATIO)))
    size = math.sqrt(sum(norms[1:first])) or 1.0
    for _ in range(100):
        sizes = np.abs(stiffness.symbols(size))
        if cosine**2 * size**2 > sizes[1:] @ norms[1:]:
            break
        size *= 2.0
    return size


def count_modes(
    stiffness: DynamicStiffness, region: Region, found: Sequence[Mode] = ()
) -> int | None:
    """Number of modes in a region, with their multiplicity; None: one lies on its edge."""
    # modes far below the region turn the argument evenly along it, as zeros at 0 do
    below = 0
    if stiffness.is_sparse:
        below = negative_pivots(stiffness.combined(stiffness.symbols(1j * region.least).real))
    corners, turns = region.corners, 0.0
    for begin, end in zip(corners[:-1].tolist(), corners[1:].tolist(), strict=True):

        def along(part: Array, begin: complex = begin, end: complex = end) -> ComplexArray:
            return np.asarray(begin + part * (end - begin))

        parts = np.linspace(0.0, 1.0, 8 + math.ceil(4.0 * abs(end - begin)))
        rest = OneFunction(lambda z: _log_rest(stiffness, found, z, below))
        turns += float(changes_of_argument(rest, along, parts)[0])
    if math.isnan(turns):
        return None
    known = sum(region.holds(mode.frequency) for mode in found)
    return round(turns / (2.0 * math.pi)) + known


def _log_rest(
    stiffness: DynamicStiffness, found: Sequence[Mode], z: ComplexArray, below: int = 0
) -> ComplexArray:
    """Logarithm of det T(s) after division by the known zeros and s^(2 below), with s = exp(z)."""
    s, zeros = np.exp(z), np.array([mode.frequency for mode in found], dtype=complex)
    with np.errstate(divide="ignore"):
        known = np.log((s[:, None] - zeros) * (s[:, None] - zeros.conj())).sum(axis=1)
    return np.asarray(stiffness.log_determinants(s) - known - 2 * below * z)


def _find_missing(
    stiffness: DynamicStiffness, region: Region, found: list[Mode], counted: int
) -> None:
    """Add modes of a region to those that are found, until they are as many as are counted."""
    random = np.random.default_rng(5)
    for _ in range(TRIES):
        if sum(region.holds(mode.frequency) for mode in found) >= counted:
            return
        # starts anywhere in the region, more of them where the damping is light, with the sign of
        # decay or of growth
        size = random.uniform(*np.log([region.least, region.largest]))
        around = random.uniform(-1.0, 1.0)
        side = region.first if around < 0 and region.first < LEAST_ANGLE else region.last
        z = size + 1j * (0.5 * math.pi + (side - 0.5 * math.pi) * abs(around) ** 2)
        start = _zero_near(stiffness, found, complex(z))
        if start is not None and region.holds(start):
            vector = random.standard_normal(stiffness.dimension).astype(complex)
            _add(found, refine(stiffness, start, vector))


def _zero_near(stiffness: DynamicStiffness, found: Sequence[Mode], z: complex) -> complex | None:
    """A zero of the determinant other than the known ones, by Newton's iteration for log s."""
    step = 1e-6
    for _ in range(MOST_STEPS):
        before, after = _log_rest(stiffness, found, np.array([z - step, z + step]))
        rise = complex(after - before)
        rise -= 2j * math.pi * round(rise.imag / (2.0 * math.pi))
        if not (math.isfinite(abs(rise)) and abs(rise) > 0):
            return cmath.exp(z) if abs(rise) else None
        change = 2.0 * step / rise
        z -= change * min(1.0, 1.0 / abs(change))
        if not 0.0 < z.imag < math.pi:
            return None
        if abs(change) < step:
            return cmath.exp(z)
    return None
