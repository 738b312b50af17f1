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
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.scenes.structures import ground_shares
from fvi_cli.studies.members import OfMember
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness
from fvi_cli.studies.vibration.peaks import (
    NO_MODES,
    ModesInRange,
    Peak,
    find_peaks,
    modes_in_range,
    resolving_frequencies,
)

GROUND: Final = "ground"


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
    known: ModesInRange = NO_MODES
    """The modes around which peaks were searched."""

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
        If the scene is not linear, or does not move at all under this load.
    """
    stiffness = DynamicStiffness(scene)

    def amplitudes(frequency: float) -> ComplexArray:
        s = 2j * math.pi * frequency
        try:
            return stiffness.factors(s).solve(load.astype(complex))
        except np.linalg.LinAlgError:
            raise ValueError(
                f"at {frequency:g} Hz the response is infinite: a mode without damping has this "
                "frequency"
            ) from None

    def near_modes(frequency: float) -> ComplexArray:
        """Amplitudes; at the frequency of an undamped mode those at a frequency next to it."""
        try:
            return amplitudes(frequency)
        except ValueError:
            return amplitudes(frequency * (1.0 + 1e-13))

    full = np.array([amplitudes(float(f)) for f in hertz])
    names = tuple(outputs)
    if rows is None:
        most = int(np.abs(full).max(axis=0).argmax())
        rows = np.zeros((1, load.size))
        rows[0, most] = 1.0
        names = (names[most],)
    given = rows

    def forms(hertz: float) -> Array | ComplexArray:
        return given(2j * math.pi * hertz) if callable(given) else given

    along = [forms(f) @ q + offsets for f, q in zip(hertz.tolist(), full, strict=True)]
    values: ComplexArray = np.array(along, dtype=complex)
    if not np.any(values):
        raise ValueError("the load moves no coordinate")
    known = modes_in_range(scene, float(hertz[0]), float(hertz[-1]))
    fine = resolving_frequencies(hertz, known, is_small=stiffness.is_small)
    at_fine = dict(zip(hertz.tolist(), values, strict=True))
    for one in fine.tolist():
        if one not in at_fine:
            at_fine[one] = forms(one) @ near_modes(one) + offsets
    sizes = np.abs(np.array([at_fine[one] for one in fine.tolist()]))
    peaks = []
    for index, name in enumerate(names):

        def size(frequency: float, index: int = index) -> float:
            every = forms(frequency)[index] @ near_modes(frequency)
            return float(abs(every + np.broadcast_to(offsets, len(names))[index]))

        peaks += find_peaks(name, fine, sizes[:, index], size, known)
    return ResponseTable(
        load=load_words,
        outputs=names,
        hertz=hertz,
        values=values,
        peaks=tuple(peaks),
        known=known,
    )


def harmonic_force(
    text: str, scene: Scene, coordinates: Sequence[str], ground_direction: ArrayLike = 1.0
) -> Array:
    """The amplitude of a force, shape ``(d,)``.

    `text` is a coordinate or a combination of them, with ``=amplitude`` where that is not 1; or
    ``ground``, an acceleration of 1, of which `ground_direction` gives the share per coordinate.

    Raises
    ------
    ValueError
        For any other text.
    """
    where, amplitude = _place_and_amplitude(text)
    if where == GROUND:
        along = ground_shares(ground_direction, scene.dimension)
        return np.asarray(-amplitude * times(along, scene.inertia.form))
    return np.asarray(amplitude * forms_of([where], coordinates)[0])


def ground_amplitude(texts: Sequence[str]) -> float:
    """The acceleration of the ground among forces, as :func:`harmonic_force` reads them."""
    pairs = map(_place_and_amplitude, texts)
    return sum(amplitude for where, amplitude in pairs if where == GROUND)


def _place_and_amplitude(text: str) -> tuple[str, float]:
    where, equals, size = text.partition("=")
    try:
        amplitude = float(size) if equals else 1.0
    except ValueError:
        amplitude = math.nan
    if not math.isfinite(amplitude):
        raise ValueError(f"{text!r}: write a number after =")
    return where.strip(), amplitude


def forms_of(texts: Sequence[str], coordinates: Sequence[str]) -> Array:
    """Coordinates, or combinations of them, as linear forms, shape ``(k, d)``.

    Raises
    ------
    ValueError
        For texts that are neither.
    """
    try:
        return Directions.from_text(list(texts), coordinates).rows
    except ArgumentError as error:
        raise ValueError(error.message) from None
