r"""Modes of damped structures: the nonlinear eigenvalue problem T(s) v = 0.

The starting vectors are undamped modes, of the mass and the real part of :math:`K + \sum_j g_j D_j`
at the frequency in question. Inverse iteration with a Rayleigh functional leads each to a solution
(Schwetlick, Schreiber, *Nonlinear Rayleigh functionals*, 2012; T is complex symmetric, and the
convergence cubic). The argument principle counts the modes in a sector and so shows whether any is
missing. For small problems the sector holds all modes (:mod:`fvi_cli.studies.vibration.region`),
for large ones it lies around the requested modes. The sector is divided until contour integrals
find the missing modes in its parts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np

from fvi_cli.effects.matrices import as_csc, dense
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.studies.members import OfMember
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness
from fvi_cli.studies.vibration.region import LARGEST_RATIO, first_angle, region_of_all_modes
from fvi_cli.studies.vibration.sector import CountError, Sector, count_modes, modes_by_integrals

EXTRA: Final = 4
"""Number of modes computed beyond the requested ones, to see where these end."""
Reach = Literal["all", "faster", "around"]
RATIOS: Final = (LARGEST_RATIO, 0.9946, 0.9953, 0.9942)
"""Damping ratios up to which modes are counted: the next one where a mode lies at the edge."""
CELL: Final = 1.3
"""Largest extent (of log |s|, and argument in radians) of sectors for contour integrals."""
SMALLEST_CELL: Final = 1e-4
CUTS: Final = (0.5, 0.43, 0.57, 0.36, 0.64)
"""Shares at which a sector is divided: the next one where a mode lies at the cut."""
CONVERGED: Final = 1e-15
RESIDUAL_LIMIT: Final = 1e-12
MOST_SWEEPS: Final = 30
SAME: Final = 1e-5
"""Modes whose frequencies and shapes differ by less than this, relative, are one mode."""


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
class ModeTable(OfMember):
    """Modes of one scene."""

    coordinates: tuple[str, ...]
    """Names of the degrees of freedom."""
    modes: tuple[Mode, ...]
    sector: Sector | None
    """The region of complex frequencies in which modes were counted; None: they were not."""
    counted: int | None
    """How many modes are in the sector; None where that is unknown."""
    inside: int
    """How many of `modes` are in the sector."""
    reach: Reach = "around"
    """``all``: modes outside of the sector have larger damping ratios; ``faster``: no faster modes
    are outside of it; ``around``: it lies around the requested modes."""

    @property
    def is_complete(self) -> bool:
        """Whether it is known that no mode of the sector is missing."""
        return self.counted is not None and self.counted == self.inside


def find_modes(scene: Scene, count: int, *, near: float | None = None) -> ModeTable:
    """At most `count` modes, of lowest frequency or nearest to `near` (oscillations per time).

    Solutions that do not oscillate (branch cut, rigid motions) do not count as modes.

    Raises
    ------
    ValueError
        If the scene is not linear, or has no stiffness or mode at all.
    """
    stiffness = DynamicStiffness(scene)
    search = _Search(
        stiffness=stiffness, count=count, centre=0.0 if near is None else 2.0 * math.pi * near
    )
    wanted = scene.dimension if stiffness.is_small else min(count + EXTRA, scene.dimension)
    search.add(search.undamped(search.centre, wanted))
    if stiffness.is_small or search.found:
        table = search.table()
        if table.modes:
            return table
    raise ValueError(f"no mode with a damping ratio below {LARGEST_RATIO}")


def refine(stiffness: DynamicStiffness, s: complex, vector: ComplexArray) -> Mode | None:
    """The mode to which iterations from a frequency and a shape converge; None: they do not."""
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
        # convergence is cubic: a residual that falls no more is round-off
        if not is_better and residual <= RESIDUAL_LIMIT:
            break
    if best is None or best.residual > RESIDUAL_LIMIT:
        return None
    real, imaginary = best.frequency.real, best.frequency.imag
    best = Mode(
        # a real part below the last digit is no damping
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
        # the step must not cross the branch cut
        largest = 0.3 * abs(s)
        if abs(change) > largest:
            change *= largest / abs(change)
        s -= change
        if abs(change) <= CONVERGED * abs(s):
            break
    return s


def _is_known(mode: Mode, found: Iterable[Mode]) -> bool:
    """Whether a shape is one of those of its frequency, or a combination of them."""
    near = SAME * abs(mode.frequency)
    shapes = [one.shape for one in found if abs(one.frequency - mode.frequency) <= near]
    if not shapes:
        return False
    basis = np.linalg.qr(np.transpose(shapes))[0]
    left = mode.shape - basis @ (basis.conj().T @ mode.shape)
    return bool(np.linalg.norm(left) <= math.sqrt(SAME) * np.linalg.norm(mode.shape))


@dataclass(kw_only=True, eq=False)
class _Search:
    """A search for modes of a scene: those that are found so far, and counts of missing ones."""

    stiffness: DynamicStiffness
    count: int  # number of requested modes
    centre: float  # the frequency near which modes are requested, 1/time
    found: list[Mode] = field(default_factory=list)

    def add(self, starts: Iterable[tuple[complex, ComplexArray]]) -> None:
        """Refine pairs of a frequency and a shape, and keep the modes that are new."""
        for s, vector in starts:
            mode = refine(self.stiffness, s, vector)
            if mode is not None and not _is_known(mode, self.found):
                self.found.append(mode)

    def undamped(self, rate: float, wanted: int) -> list[tuple[complex, ComplexArray]]:
        """Undamped modes with the dynamic stiffness at the frequency `rate`, 1/time."""
        stiffness, d, mass = self.stiffness, self.stiffness.dimension, self.stiffness.mass
        factors = stiffness.symbols(1j * max(rate, 1e-30)).real.astype(complex)
        factors[0] = 0.0
        combined = stiffness.combined(factors)
        if isinstance(combined, np.ndarray) or d <= 4 * wanted:
            from scipy.linalg import eigh

            values, vectors = eigh(dense(combined).real, dense(mass))  # type: ignore[arg-type]
        else:
            from scipy.sparse.linalg import eigsh

            scale = float(np.abs(factors) @ stiffness.norms) / stiffness.norms[0]
            values, vectors = eigsh(
                as_csc(combined.real),  # type: ignore[attr-defined]
                k=wanted,
                M=as_csc(mass),
                # not at 0, which is an eigenvalue of a free structure
                sigma=self.centre**2 if self.centre else -1e-9 * scale,
                which="LM",
                v0=np.random.default_rng(5).standard_normal(d),
            )
        rates = np.sqrt(np.maximum(values, 0.0))
        self.turn(rates, vectors)
        order = np.argsort(np.abs(rates - self.centre), kind="stable")[:wanted]
        largest = float(rates.max(initial=0.0))
        return [
            (1j * float(rates[index]), vectors[:, index].astype(complex))
            for index in order
            if rates[index] > 1e-6 * largest
        ]

    def turn(self, rates: Array, vectors: Array) -> None:
        """Turn the shapes of every repeated frequency to those that the damping tells apart."""
        ends = np.flatnonzero(np.diff(rates) > SAME * rates[1:]) + 1
        for own in np.split(np.arange(rates.size), ends):
            if own.size > 1 and rates[own[0]] > 0:
                damping = self.stiffness.symbols(1j * float(rates[own].mean()))
                damping[0] = 0.0
                matrix: Any = self.stiffness.combined(damping.imag.astype(complex))
                inner = vectors[:, own].T @ (matrix @ vectors[:, own])
                vectors[:, own] = vectors[:, own] @ np.linalg.eigh(inner.real)[1]

    def stiffened(self) -> list[tuple[complex, ComplexArray]]:
        """Undamped modes with the dynamic stiffness at frequencies of known modes."""
        rates = sorted(abs(mode.frequency) for mode in self.found)
        wanted = min(self.count + EXTRA, self.stiffness.dimension)
        chosen = [rates[index] for index in (0, len(rates) // 2, -1) if rates]
        return [start for rate in dict.fromkeys(chosen) for start in self.undamped(rate, wanted)]

    def table(self) -> ModeTable:
        """The requested modes, after a search for those that a count says are missing."""
        sector, reach, counted = self.counted()
        for attempt in range(4):
            before = len(self.found)
            if counted is None or counted <= self.inside(sector):
                break
            if attempt == 0:
                self.add(self.stiffened())
            else:
                self.look_in(sector)
            if len(self.found) == before and attempt:
                break
            sector, reach, counted = self.counted()
        found = self.found
        if self.stiffness.is_small:
            # modes outside are rigid motions, whose s is round-off
            found = [one for one in found if sector.least < abs(one.frequency) < sector.largest]
        found = sorted(found, key=self.distance)
        return ModeTable(
            coordinates=tuple(f"x{index}" for index in range(1, self.stiffness.dimension + 1)),
            modes=tuple(sorted(found[: self.count], key=lambda mode: abs(mode.frequency))),
            sector=sector,
            counted=counted,
            inside=sum(sector.holds(mode.frequency) for mode in found),
            reach=reach,
        )

    def distance(self, mode: Mode) -> float:
        """Distance of a mode from the frequency near which modes are requested, 1/time."""
        return abs(abs(mode.frequency) - self.centre)

    def inside(self, sector: Sector) -> int:
        """How many of the found modes lie in a sector."""
        return sum(sector.holds(mode.frequency) for mode in self.found)

    def counted(self) -> tuple[Sector, Reach, int | None]:
        """The sector in which modes are counted, its reach, and its number of modes or None."""
        reach: Reach = "around"
        self.found.sort(key=self.distance)
        known = [mode.frequency for mode in self.found]
        for ratio in RATIOS:
            if self.stiffness.is_small:
                sector, is_all = region_of_all_modes(self.stiffness, largest_ratio=ratio)
                reach = "all" if is_all else "faster"
            else:
                sector = self.sector_around(ratio)
            try:
                return sector, reach, count_modes(self.stiffness, sector, known)
            except CountError:
                continue
        return sector, reach, None

    def sector_around(self, ratio: float) -> Sector:
        """A sector around the requested modes, with its arcs between modes."""
        sizes = sorted(abs(mode.frequency) for mode in self.found)
        wanted = sorted(abs(mode.frequency) for mode in self.found[: self.count])
        above = [size for size in sizes if size > wanted[-1] * (1.0 + SAME)]
        below = [size for size in sizes if size < wanted[0] * (1.0 - SAME)]
        return Sector(
            least=math.sqrt(below[-1] * wanted[0]) if self.centre and below else 0.05 * wanted[0],
            largest=math.sqrt(wanted[-1] * above[0]) if above else 1.05 * wanted[-1],
            first=first_angle(self.stiffness, ratio),
            last=math.pi - math.acos(ratio),
        )

    def look_in(self, sector: Sector) -> None:
        """Find the missing modes of a sector, in smaller and smaller parts of it."""
        try:
            missing = self.missing(sector)
        except CountError:
            # the caller has counted the other part and knows that some are here
            missing = 1
        if missing <= 0 or max(sector.extent) < SMALLEST_CELL:
            return
        if max(sector.extent) < CELL:
            self.add(modes_by_integrals(self.stiffness, sector, missing + self.inside(sector)))
            try:
                if self.missing(sector) <= 0:
                    return
            except CountError:
                pass
        for cut in CUTS:
            parts = sector.halves(cut)
            try:
                self.missing(parts[0])
            except CountError:
                continue
            for part in parts:
                self.look_in(part)
            return

    def missing(self, sector: Sector) -> int:
        """How many modes of a sector were not found."""
        known = [mode.frequency for mode in self.found]
        return count_modes(self.stiffness, sector, known) - self.inside(sector)
