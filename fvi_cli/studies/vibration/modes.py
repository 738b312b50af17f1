r"""Modes of damped structures: the nonlinear eigenvalue problem T(s) v = 0.

Starts are modes without damping, of the mass and the real part of :math:`K + \sum_j g_j D_j` at the
frequency in question. Each is led to a solution by inverse iteration with a Rayleigh functional
(Schwetlick, Schreiber, *Nonlinear Rayleigh functionals*, 2012; T is complex symmetric, and the
convergence cubic). Whether any is missing is counted by the argument principle: of small problems
on a sector that holds all modes, whatever was found (:mod:`fvi_cli.studies.vibration.region`), of
large ones on a sector around those that are asked for. The sector is divided until the missing
modes are found in their parts by contour integrals.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from fvi_cli.effects.matrices import as_csc, dense
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import ComplexArray
from fvi_cli.studies.members import Member, label_of
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness
from fvi_cli.studies.vibration.region import LARGEST_RATIO, first_angle, region_of_all_modes
from fvi_cli.studies.vibration.sector import CountError, Sector, count_modes, modes_by_integrals

EXTRA: Final = 4
"""Modes beyond those that are wanted, to see where they end."""
Reach = Literal["all", "faster", "around"]
RATIOS: Final = (LARGEST_RATIO, 0.9946, 0.9953, 0.9942)
"""Damping ratios up to which modes are counted: the first, unless a mode lies at the edge."""
CELL: Final = 1.3
"""Extent of the parts of a sector in which contour integrals find modes."""
SMALLEST_CELL: Final = 1e-4
CUTS: Final = (0.5, 0.43, 0.57, 0.36, 0.64)
"""Where a sector is divided: at the first, unless a mode lies there."""
CONVERGED: Final = 1e-15
RESIDUAL_LIMIT: Final = 1e-12
MOST_SWEEPS: Final = 30
SAME: Final = 1e-5
"""Relative distance of frequencies, and of shapes, of modes that are one."""


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
    def decay_rate(self) -> float:
        """Minus the real part of s, 1/time."""
        return -self.frequency.real

    @property
    def damping_ratio(self) -> float:
        r""":math:`-\mathrm{Re}\, s / |s|`."""
        return (0.0 - self.frequency.real) / abs(self.frequency)

    @property
    def loss_factor(self) -> float:
        r""":math:`\eta` of :math:`-s^2 = \Omega^2 (1 + i \eta)`."""
        square = 0.0 - self.frequency**2
        return square.imag / square.real if square.real else math.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class ModeTable:
    """Modes of one scene."""

    name: str
    coordinates: tuple[str, ...]
    """Names of the degrees of freedom."""
    modes: tuple[Mode, ...]
    sector: Sector | None
    """The region of complex frequencies in which modes were counted; None: they were not."""
    counted: int | None
    """How many are in it; None where that is unknown."""
    inside: int
    """How many of `modes` are in it."""
    reach: Reach = "around"
    """``all``: outside of it are no modes but those of larger damping ratios; ``faster``: nor are
    faster ones; ``around``: it was chosen around the modes that were asked for."""
    of_member: Member | None = None
    """The member of a sweep, or design, to which it belongs."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Labels of units for figures."""

    @property
    def member(self) -> str:
        """Swept values in words; empty without a sweep."""
        return label_of(self.of_member)

    @property
    def is_complete(self) -> bool:
        """Whether it is known that none is missing."""
        return self.counted is not None and self.counted == self.inside


def find_modes(scene: Scene, count: int, *, near: float | None = None) -> ModeTable:
    """At most `count` modes of lowest frequency, or nearest to one in oscillations per time.

    Returns
    -------
    ModeTable
        Without a name. Solutions that do not oscillate (branch cut, rigid motions) are none.

    Raises
    ------
    ValueError
        If the scene is not linear, or has no stiffness or mode at all.
    """
    stiffness = DynamicStiffness(scene)
    centre = 0.0 if near is None else 2.0 * math.pi * near
    wanted = scene.dimension if stiffness.is_small else min(count + EXTRA, scene.dimension)
    found: list[Mode] = []
    for s, vector in _undamped(stiffness, _stored(stiffness, centre), wanted, centre):
        _keep(found, refine(stiffness, s, vector))
    if stiffness.is_small or found:
        table = _completed(stiffness, found, count, centre)
        if table.modes:
            return table
    raise ValueError(f"no mode with a damping ratio below {LARGEST_RATIO}")


def refine(stiffness: DynamicStiffness, s: complex, vector: ComplexArray) -> Mode | None:
    """The mode to which a frequency and a shape lead; None where they lead to none."""
    best: Mode | None = None
    for _ in range(MOST_SWEEPS):
        if not (math.isfinite(abs(s)) and abs(s) > 0):
            return None
        try:
            right = np.asarray(stiffness.combined(stiffness.slopes(s)) @ vector)  # type: ignore[operator]
            vector = stiffness.factors(s).solve(right)
        except np.linalg.LinAlgError:
            s *= 1.0 + 1e-14
            continue
        vector = vector / vector[np.abs(vector).argmax()]
        moved = _functional(stiffness, s, vector)
        if moved is None:
            return None
        s = moved
        residual = stiffness.residual(s, vector)
        is_better = best is None or residual < 0.3 * best.residual
        if best is None or residual < best.residual:
            best = Mode(frequency=s, shape=vector, residual=residual)
        # cubic convergence: what gets no better is round-off
        if not is_better and residual <= RESIDUAL_LIMIT:
            break
    if best is None or best.residual > RESIDUAL_LIMIT:
        return None
    real, imaginary = best.frequency.real, best.frequency.imag
    best = Mode(
        # what is less than the last digit is no damping
        frequency=complex(real if abs(real) > CONVERGED * abs(imaginary) else 0.0, abs(imaginary)),
        shape=best.shape.conj() if imaginary < 0 else best.shape,
        residual=best.residual,
    )
    return best if best.frequency.imag > SAME * abs(best.frequency) else None


def _functional(stiffness: DynamicStiffness, s: complex, vector: ComplexArray) -> complex | None:
    """The zero near s of v^T T(s) v."""
    forms = np.array(
        [complex(vector @ np.asarray(form @ vector)) for form in stiffness.forms]  # type: ignore[operator]
    )
    for _ in range(MOST_SWEEPS):
        value, slope = stiffness.symbols(s) @ forms, stiffness.slopes(s) @ forms
        if slope == 0 or not math.isfinite(abs(value)):
            return None
        change = complex(value / slope)
        # no farther than the plane without the branch cut allows
        largest = 0.3 * abs(s)
        if abs(change) > largest:
            change *= largest / abs(change)
        s -= change
        if abs(change) <= CONVERGED * abs(s):
            break
    return s


def _keep(found: list[Mode], mode: Mode | None) -> None:
    """Add a mode that is not there yet."""
    if mode is None:
        return
    for other in found:
        if abs(other.frequency - mode.frequency) <= SAME * abs(mode.frequency):
            parallel = abs(np.vdot(other.shape, mode.shape)) / (
                np.linalg.norm(other.shape) * np.linalg.norm(mode.shape)
            )
            if parallel > 1.0 - SAME:
                return
    found.append(mode)


def _stiffened(
    stiffness: DynamicStiffness, found: Sequence[Mode], count: int, centre: float
) -> list[tuple[complex, ComplexArray]]:
    """Modes without damping, with the stiffness that it has at the frequencies of known modes."""
    rates = sorted(abs(mode.frequency) for mode in found)
    wanted = min(count, stiffness.dimension)
    return [
        start
        for rate in dict.fromkeys(rates[index] for index in (0, len(rates) // 2, -1) if rates)
        for start in _undamped(stiffness, _stored(stiffness, rate), wanted, centre)
    ]


def _stored(stiffness: DynamicStiffness, rate: float) -> ComplexArray:
    """Factors of the matrices in the real part of T without mass, at a real frequency."""
    factors = stiffness.symbols(1j * max(rate, 1e-30)).real.astype(complex)
    factors[0] = 0.0
    return factors


def _undamped(
    stiffness: DynamicStiffness, factors: ComplexArray, count: int, centre: float
) -> list[tuple[complex, ComplexArray]]:
    """Frequencies and shapes of the mass and a combination of the other matrices."""
    d, mass = stiffness.dimension, stiffness.mass
    combined = stiffness.combined(factors)
    if isinstance(combined, np.ndarray) or d <= 4 * count:
        from scipy.linalg import eigh

        values, vectors = eigh(dense(combined).real, dense(mass))  # type: ignore[arg-type]
    else:
        from scipy.sparse.linalg import eigsh

        scale = float(np.abs(factors) @ stiffness.norms) / stiffness.norms[0]
        # beside the spectrum, since a free structure has modes at 0
        shift = centre**2 if centre else -1e-9 * scale
        values, vectors = eigsh(
            as_csc(combined.real),  # type: ignore[attr-defined]
            k=count,
            M=as_csc(mass),
            sigma=shift,
            which="LM",
            v0=np.random.default_rng(5).standard_normal(d),
        )
    rates = np.sqrt(np.maximum(values, 0.0))
    order = np.argsort(np.abs(rates - centre), kind="stable")[:count]
    largest = float(rates.max(initial=0.0))
    return [
        (1j * float(rates[index]), vectors[:, index].astype(complex))
        for index in order
        if rates[index] > 1e-6 * largest
    ]


def _completed(
    stiffness: DynamicStiffness, found: list[Mode], count: int, centre: float
) -> ModeTable:
    """The modes that are wanted, with those that a count says are missing."""
    sector, reach, counted = _counted(stiffness, found, count, centre)
    for attempt in range(4):
        inside = [mode for mode in found if sector.holds(mode.frequency)]
        if counted is None or counted <= len(inside):
            break
        before = len(found)
        if attempt == 0:
            for s, vector in _stiffened(stiffness, found, count + EXTRA, centre):
                _keep(found, refine(stiffness, s, vector))
        else:
            _search(stiffness, sector, found)
        if len(found) == before and attempt:
            break
        sector, reach, counted = _counted(stiffness, found, count, centre)
    if stiffness.is_small:
        # what is outside is a rigid motion, whose s is round-off
        found = [one for one in found if sector.least < abs(one.frequency) < sector.largest]
    found.sort(key=lambda mode: abs(abs(mode.frequency) - centre))
    chosen = sorted(found[:count], key=lambda mode: abs(mode.frequency))
    names = tuple(f"x{index}" for index in range(1, stiffness.dimension + 1))
    return ModeTable(
        name="",
        coordinates=names,
        modes=tuple(chosen),
        sector=sector,
        counted=counted,
        inside=sum(sector.holds(mode.frequency) for mode in found),
        reach=reach,
    )


def _counted(
    stiffness: DynamicStiffness, found: list[Mode], count: int, centre: float
) -> tuple[Sector, Reach, int | None]:
    """The sector in which modes are counted, and how many it holds; None: that is not known."""
    reach: Reach = "around"
    found.sort(key=lambda mode: abs(abs(mode.frequency) - centre))
    known = [mode.frequency for mode in found]
    for ratio in RATIOS:
        if stiffness.is_small:
            sector, is_all = region_of_all_modes(stiffness, largest_ratio=ratio)
            reach = "all" if is_all else "faster"
        else:
            sector = _sector_of(stiffness, found, count, centre, ratio)
        try:
            return sector, reach, count_modes(stiffness, sector, known)
        except CountError:
            continue
    return sector, reach, None


def _search(stiffness: DynamicStiffness, sector: Sector, found: list[Mode]) -> None:
    """Find the modes of a sector that are missing, in ever smaller parts of it."""
    try:
        missing = _missing(stiffness, sector, found)
    except CountError:
        # the caller has counted the other part and knows that some are here
        missing = 1
    if missing <= 0 or max(sector.extent) < SMALLEST_CELL:
        return
    if max(sector.extent) < CELL:
        inside = sum(sector.holds(mode.frequency) for mode in found)
        for s, vector in modes_by_integrals(stiffness, sector, missing + inside):
            _keep(found, refine(stiffness, s, vector))
        try:
            if _missing(stiffness, sector, found) <= 0:
                return
        except CountError:
            pass
    for cut in CUTS:
        parts = sector.halves(cut)
        try:
            _missing(stiffness, parts[0], found)
        except CountError:
            continue
        for part in parts:
            _search(stiffness, part, found)
        return


def _missing(stiffness: DynamicStiffness, sector: Sector, found: Sequence[Mode]) -> int:
    """How many modes of a sector were not found."""
    counted = count_modes(stiffness, sector, [mode.frequency for mode in found])
    return counted - sum(sector.holds(mode.frequency) for mode in found)


def _sector_of(
    stiffness: DynamicStiffness, found: Sequence[Mode], count: int, centre: float, ratio: float
) -> Sector:
    """A sector around the modes that are wanted, with its arcs between modes."""
    sizes = sorted(abs(mode.frequency) for mode in found)
    wanted = sorted(abs(mode.frequency) for mode in found[:count])
    above = [size for size in sizes if size > wanted[-1] * (1.0 + SAME)]
    below = [size for size in sizes if size < wanted[0] * (1.0 - SAME)]
    largest = math.sqrt(wanted[-1] * above[0]) if above else 1.05 * wanted[-1]
    least = 0.05 * wanted[0]
    if centre and below:
        least = math.sqrt(below[-1] * wanted[0])
    first, last = first_angle(stiffness, ratio), math.pi - math.acos(ratio)
    return Sector(least=least, largest=largest, first=first, last=last)
