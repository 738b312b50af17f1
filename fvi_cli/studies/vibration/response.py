r"""Steady responses to harmonic forces, :math:`T(i\omega) \hat q = \hat f`, and their peaks.

As a function of the frequency a response has poles at the modes; it changes over lengths of the
distance to the next pole. So it is evaluated around every mode at multiples of the width of the
mode, and no peak falls between two frequencies of the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.directions import read_directions
from fvi_cli.effects.matrices import times
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.scenes.structures import ground_shares
from fvi_cli.studies.members import OfMember
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness
from fvi_cli.studies.vibration.modes import Mode, find_modes

GROUND: Final = "ground"
MODES_OF_LARGE: Final = (4, 12, 36)
"""Numbers of modes of a large structure, tried one after the other until they cover the range."""
UNDAMPED: Final = 1e-13
"""A damping ratio below this is round-off."""
_RATIO = 1.06
"""Largest ratio of two frequencies at which a response is evaluated."""
_MULTIPLES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
"""Distances from a mode in units of its width; further ones grow by 1.4 as a factor."""


@dataclass(frozen=True, kw_only=True)
class Peak:
    r"""A maximum of the magnitude."""

    at: str
    hertz: float
    magnitude: float
    """Frequency in oscillations per unit of time, and size; infinite at a mode without damping."""
    low: float
    high: float
    r"""Frequencies on both sides where the magnitude is :math:`1/\sqrt 2` of the peak; nan where it
    does not fall so far in the range, or rises again before."""

    @property
    def loss_factor(self) -> float:
        """Half-power bandwidth relative to the frequency of the peak."""
        return (self.high - self.low) / self.hertz


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponseTable(OfMember):
    r"""Response of one scene over frequencies."""

    load: str
    outputs: tuple[str, ...]
    """Outputs to report: coordinates, or combinations of them."""
    hertz: Array
    """Frequencies, oscillations per unit of time, shape ``(n,)``."""
    values: ComplexArray
    r"""Complex amplitudes :math:`\hat q` for a load :math:`\hat f e^{i \omega t}`, ``(n, k)``."""
    peaks: tuple[Peak, ...]
    """Maxima of the magnitudes inside of the range."""
    qualities: tuple[str, ...] = ()
    """Of every output ``displacement``, ``velocity`` or ``acceleration``; empty: another."""
    has_all_modes: bool = False
    """Whether all modes in the range are known, so that no peak is missing."""
    grows: bool = False
    """Whether a mode grows: then motions do not settle into this response."""

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
    rows: Array | Callable[[complex], Array | ComplexArray] | None,
    offsets: Array | float = 0.0,
    load_words: str = "",
) -> ResponseTable:
    """Amplitudes over ascending frequencies above 0, with peaks and their half-power widths.

    `load` is the amplitude of the force, ``(d,)``. `rows` are the linear forms of the `outputs`,
    ``(k, d)``, or a function of s that returns them. None: `outputs` are all coordinates, and the
    one that moves most is reported. The load itself adds `offsets`, ``(k,)``, to the outputs.

    Raises
    ------
    ValueError
        If the scene is not linear, or a mode without damping lies at a frequency.
    """
    stiffness = DynamicStiffness(scene)

    def amplitudes(frequency: float) -> ComplexArray:
        return stiffness.solver(2j * math.pi * frequency)(load.astype(complex))

    names = tuple(outputs)
    try:
        full = [amplitudes(frequency) for frequency in hertz.tolist()]
    except np.linalg.LinAlgError:
        raise ValueError(
            "the response is infinite: a mode without damping has one of the frequencies"
        ) from None
    if rows is None:
        most = int(np.abs(full).max(axis=0).argmax())
        rows, names = np.eye(1, load.size, most), (names[most],)
    forms = rows if callable(rows) else lambda s, constant=rows: constant

    def values_at(frequency: float, motion: ComplexArray) -> ComplexArray:
        return np.asarray(forms(2j * math.pi * frequency) @ motion + offsets, dtype=complex)

    def sizes_at(frequency: float) -> Array:
        try:
            return np.abs(values_at(frequency, amplitudes(frequency)))
        except np.linalg.LinAlgError:
            return np.full(len(names), math.inf)

    values = np.array([values_at(*pair) for pair in zip(hertz.tolist(), full, strict=True)])
    modes, has_all = modes_in_range(scene, float(hertz[0]), float(hertz[-1]))
    fine = resolving_frequencies(hertz, modes)
    sizes = np.array([sizes_at(frequency) for frequency in fine.tolist()])
    endless = [mode.hertz for mode in modes if abs(mode.damping_ratio) <= UNDAMPED]
    peaks: list[Peak] = []
    for index, name in enumerate(names):

        def size(frequency: float, index: int = index) -> float:
            return float(sizes_at(frequency)[index])

        peaks += find_peaks(name, fine, sizes[:, index], size, endless)
    return ResponseTable(
        load=load_words,
        outputs=names,
        hertz=hertz,
        values=values,
        peaks=tuple(peaks),
        has_all_modes=has_all,
        grows=any(mode.frequency.real > 0 for mode in modes),
    )


def modes_in_range(scene: Scene, low: float, high: float) -> tuple[tuple[Mode, ...], bool]:
    """The modes that shape a response between two frequencies, and whether these are all."""
    d, rate = scene.dimension, 2.0 * math.pi * high
    is_small = DynamicStiffness(scene).is_small
    near = None if is_small else 0.5 * (low + high)
    for count in (4 * d,) if is_small else MODES_OF_LARGE:
        try:
            table = find_modes(scene, count, near=near)
        except ValueError:
            # no mode oscillates; for a large structure that is not certain
            return (), is_small
        if table.region.largest > rate:
            break
    return table.modes, table.is_complete and table.region.largest > rate


def resolving_frequencies(hertz: Array, modes: Sequence[Mode]) -> Array:
    """Frequencies that resolve a response between the first and the last of `hertz`, ascending."""
    low, high = float(hertz[0]), float(hertz[-1])
    number = 2 + math.ceil(math.log(high / low) / math.log(_RATIO))
    points = [hertz, np.geomspace(low, high, number)]
    for mode in modes:
        width = max(-mode.frequency.real, UNDAMPED * abs(mode.frequency)) / (2.0 * math.pi)
        steps = max(1, math.ceil(math.log((high - low) / width) / math.log(1.4)))
        away = width * np.concatenate([_MULTIPLES, 1.4 ** np.arange(1, 1 + steps)])
        points += [mode.hertz + away, mode.hertz - away]
    every = np.unique(np.concatenate(points))
    return every[(every >= low) & (every <= high)]


def find_peaks(
    name: str, hertz: Array, size: Array, at: Callable[[float], float], endless: Sequence[float]
) -> list[Peak]:
    """The maxima between the first and the last frequency; `endless` are undamped modes."""
    found: list[Peak] = []
    rising = np.diff(size) > 0
    for top in (np.flatnonzero(rising[:-1] & ~rising[1:]) + 1).tolist():
        place = float(hertz[top])
        if any(abs(place - mode) <= 100 * UNDAMPED * mode for mode in endless):
            if not (found and abs(found[-1].hertz - place) <= 200 * UNDAMPED * place):
                found.append(Peak(at=name, hertz=place, magnitude=math.inf, low=place, high=place))
            continue
        place, largest = _maximum(at, float(hertz[top - 1]), float(hertz[top + 1]))
        limit = math.sqrt(0.5) * largest
        before, after = hertz < place, hertz > place
        low = _crossing(at, hertz[before][::-1], size[before][::-1], place, limit)
        high = _crossing(at, hertz[after], size[after], place, limit)
        found.append(Peak(at=name, hertz=place, magnitude=largest, low=low, high=high))
    return found


def _maximum(at: Callable[[float], float], left: float, right: float) -> tuple[float, float]:
    """Place and size of the maximum between two frequencies."""
    from scipy.optimize import minimize_scalar

    # as a share of the interval: a tolerance relative to the frequency may exceed a narrow peak
    found = minimize_scalar(
        lambda part: -at(left + part * (right - left)),
        bounds=(0.0, 1.0),
        method="bounded",
        options={"xatol": 1e-9},
    )
    return left + float(found.x) * (right - left), -float(found.fun)


def _crossing(
    at: Callable[[float], float], hertz: Array, size: Array, peak: float, limit: float
) -> float:
    """Where the magnitude falls to a limit on one side of a peak; nan where it rises before."""
    from scipy.optimize import brentq

    # at the first point that is low enough, or beyond a valley
    ends = np.flatnonzero((size <= limit) | (np.diff(size, prepend=math.inf) > 0))
    if not ends.size:
        return math.nan
    places = [peak, peak, *hertz[: ends[0] + 1].tolist()]
    inside, outside = places[-2:]
    if size[ends[0]] > limit:
        inside = places[-3]
        outside, depth = _maximum(lambda frequency: -at(frequency), *sorted((inside, outside)))
        if -depth > limit:
            return math.nan
    length = outside - inside
    part = brentq(lambda part: at(inside + part * length) - limit, 0.0, 1.0, xtol=1e-12)
    return float(inside + part * length)


def harmonic_load(
    texts: Sequence[str],
    scene: Scene,
    coordinates: Sequence[str],
    ground_direction: ArrayLike = 1.0,
) -> tuple[Array, float]:
    """The amplitude of forces together, shape ``(d,)``, and of the acceleration of the ground.

    Each text is a coordinate or a combination of them, with ``=amplitude`` where that is not 1; or
    ``ground``, an acceleration of which `ground_direction` gives the share per coordinate.

    Raises
    ------
    ValueError
        For any other text.
    """
    load, ground = np.zeros(scene.dimension), 0.0
    for text in texts:
        where, equals, size = text.partition("=")
        try:
            amplitude = float(size) if equals else 1.0
        except ValueError:
            amplitude = math.nan
        if not math.isfinite(amplitude):
            raise ValueError(f"{text!r}: write a number after =")
        if where.strip() == GROUND:
            along = ground_shares(ground_direction, scene.dimension)
            load -= amplitude * times(along, scene.inertia.form)
            ground += amplitude
            continue
        load += amplitude * linear_form_of(where.strip(), coordinates)
    return load, ground


def linear_form_of(text: str, coordinates: Sequence[str]) -> Array:
    """A coordinate, or a combination of coordinates, as a linear form, ``(d,)``; or ValueError."""
    try:
        (form,) = read_directions([text], coordinates)
    except ArgumentError as error:
        raise ValueError(error.message) from None
    return np.asarray(form)
