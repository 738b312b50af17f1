r"""Steady responses to harmonic forces: :math:`T(i\omega) \hat q = \hat f`, solved directly."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.directions import Directions
from fvi_cli.effects.matrices import times
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.scenes.data import per_coordinate
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness

GROUND: Final = "ground"
HALF_POWER: Final = math.sqrt(0.5)
SWEEPS: Final = 45
"""Halvings with which half-power points are found."""


@dataclass(frozen=True, kw_only=True)
class Peak:
    r"""A maximum of the magnitude.

    Parameters
    ----------
    at
        Of which output.
    hertz, magnitude
        Where, in oscillations per unit of time, and how large.
    low, high
        Frequencies at both sides where the magnitude is :math:`1/\sqrt 2` of that; nan where it
        does not fall so far in the range.
    """

    at: str
    hertz: float
    magnitude: float
    low: float
    high: float

    @property
    def loss_factor(self) -> float:
        """Half-power bandwidth relative to the frequency of the peak."""
        return (self.high - self.low) / self.hertz


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponseTable:
    r"""Response of one scene over frequencies.

    Parameters
    ----------
    name
        Of the experiment.
    load
        What acts, in words.
    outputs
        What is told of: coordinates, or combinations of them.
    hertz
        Frequencies, oscillations per unit of time, shape ``(n,)``.
    values
        Complex amplitudes :math:`\hat q` for a load :math:`\hat f e^{i \omega t}`, ``(n, k)``.
    peaks
        Maxima of the magnitudes inside of the range.
    member
        Swept values in words; empty without a sweep.
    """

    name: str
    load: str
    outputs: tuple[str, ...]
    hertz: Array
    values: ComplexArray
    peaks: tuple[Peak, ...]
    member: str = ""

    @property
    def magnitude(self) -> Array:
        """Size of the amplitudes, ``(n, k)``."""
        return np.asarray(np.abs(self.values))

    @property
    def phase(self) -> Array:
        """Argument of the amplitudes in degrees, without jumps, ``(n, k)``."""
        return np.asarray(np.degrees(np.unwrap(np.angle(self.values), axis=0)))


def harmonic_response(
    scene: Scene,
    load: Array,
    hertz: Array,
    *,
    outputs: Sequence[str],
    rows: Array | None,
    load_words: str = "",
) -> ResponseTable:
    """Amplitudes over frequencies, with peaks and their half-power widths.

    Parameters
    ----------
    scene
        A linear one.
    load
        Amplitude of the force, shape ``(d,)``.
    hertz
        Frequencies above 0, ascending.
    outputs, rows
        Names of the outputs, and the linear forms that they are, shape ``(k, d)``; None: the
        coordinate that moves most, named by `outputs`, which are then all coordinates.
    load_words
        The load in words.

    Raises
    ------
    ValueError
        If the scene is not linear, or does not move at all under this load.
    """
    stiffness = DynamicStiffness(scene)

    def amplitudes(frequency: float) -> ComplexArray:
        s = 2j * math.pi * frequency
        try:
            return stiffness.factors(s).solve(load.astype(complex))
        except np.linalg.LinAlgError:
            raise ValueError(
                f"at {frequency:g} Hz nothing limits the response: a mode without damping is there"
            ) from None

    full = np.array([amplitudes(float(f)) for f in hertz])
    names = tuple(outputs)
    if rows is None:
        most = int(np.abs(full).max(axis=0).argmax())
        rows = np.zeros((1, load.size))
        rows[0, most] = 1.0
        names = (names[most],)
    values: ComplexArray = np.asarray(full @ rows.T, dtype=complex)
    if not np.any(values):
        raise ValueError("nothing moves under this load")
    peaks = []
    for index, name in enumerate(names):

        def size(frequency: float, own: Array = rows[index]) -> float:
            return float(abs(own @ amplitudes(frequency)))

        peaks += _peaks(name, hertz, np.abs(values[:, index]), size)
    return ResponseTable(
        name="",
        load=load_words,
        outputs=names,
        hertz=hertz,
        values=values,
        peaks=tuple(peaks),
    )


def harmonic_force(
    text: str, scene: Scene, coordinates: Sequence[str], ground_direction: ArrayLike = 1.0
) -> Array:
    """The amplitude of a force, shape ``(d,)``.

    Parameters
    ----------
    text
        A coordinate or combination of them, with ``=amplitude`` where that is not 1, or
        ``ground``, an acceleration of 1.
    scene, coordinates
        On what it acts, and the names of the coordinates.
    ground_direction
        How much of the ground's acceleration each coordinate has.

    Raises
    ------
    ValueError
        For a text that says something else.
    """
    where, equals, size = text.partition("=")
    try:
        amplitude = float(size) if equals else 1.0
    except ValueError:
        amplitude = math.nan
    if not math.isfinite(amplitude):
        raise ValueError(f"{text!r}: what follows = must be a number")
    if where.strip() == GROUND:
        along = per_coordinate(ground_direction, scene.dimension)
        return np.asarray(-amplitude * times(along, scene.inertia.form))
    return np.asarray(amplitude * forms_of([where], coordinates)[0])


def forms_of(texts: Sequence[str], coordinates: Sequence[str]) -> Array:
    """Coordinates, or combinations of them, as linear forms, shape ``(k, d)``.

    Raises
    ------
    ValueError
        For texts that are none.
    """
    try:
        return Directions.from_text(list(texts), coordinates).rows
    except ValueError as error:
        raise ValueError(str(error).partition(": ")[2] or str(error)) from None


def _peaks(name: str, hertz: Array, size: Array, at: Callable[[float], float]) -> list[Peak]:
    """The maxima between the first and the last frequency."""
    rising = np.diff(size) > 0
    tops = np.flatnonzero(rising[:-1] & ~rising[1:]) + 1
    found = []
    for top in tops.tolist():
        best, largest = _maximum(at, float(hertz[top - 1]), float(hertz[top + 1]))
        limit = HALF_POWER * largest
        low = _crossing(at, hertz, size, best, limit, range(top - 1, -1, -1))
        high = _crossing(at, hertz, size, best, limit, range(top + 1, hertz.size))
        found.append(Peak(at=name, hertz=best, magnitude=largest, low=low, high=high))
    return found


def _maximum(at: Callable[[float], float], left: float, right: float) -> tuple[float, float]:
    """Place and size of the maximum between two frequencies."""
    from scipy.optimize import minimize_scalar

    found = minimize_scalar(
        lambda frequency: -at(frequency),
        bounds=(left, right),
        method="bounded",
        options={"xatol": 1e-9 * right},
    )
    return float(found.x), -float(found.fun)


def _crossing(
    at: Callable[[float], float],
    hertz: Array,
    size: Array,
    peak: float,
    limit: float,
    places: Sequence[int],
) -> float:
    """Where the magnitude falls to a limit on one side of a peak; nan where it rises before."""
    inside, before = peak, math.inf
    for place in places:
        here = float(size[place])
        if here <= limit:
            outside = float(hertz[place])
            for _ in range(SWEEPS):
                middle = 0.5 * (inside + outside)
                if at(middle) > limit:
                    inside = middle
                else:
                    outside = middle
                if abs(inside - outside) <= 1e-10 * peak:
                    break
            return 0.5 * (inside + outside)
        if here > before:
            return math.nan
        inside, before = float(hertz[place]), here
    return math.nan
