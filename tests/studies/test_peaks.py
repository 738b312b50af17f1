"""Peaks of responses against a sum of oscillators in thirty digits."""

import math

import numpy as np
import pytest
from oracles.peaks import Oscillator, OutsidePeak, peaks
from spread import few_of

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.vibration import response
from fvi_cli.studies.vibration.response import Peak, ResponseTable, harmonic_response

CLEAR = 0.02
"""Part of its height by which a peak stands out of its valleys, lest it is none to others."""


def resting(stiffness: Array, *damping: FractionalDamping) -> Scene:
    d = len(stiffness)
    return Scene(
        inertia=Inertia(mass=np.eye(d)),
        potential=QuadraticPotential(stiffness=stiffness),
        damping=damping,
        initial_position=np.zeros(d),
        initial_velocity=np.zeros(d),
        final_time=1.0,
    )


def drawn(seed: int) -> tuple[ResponseTable, list[OutsidePeak], list[Oscillator]]:
    """Two oscillators, seen in turned coordinates, with modes apart by multiples of their width."""
    rng = np.random.default_rng(seed)
    unit = 10.0 ** rng.uniform(-9, 9)
    loss, order = 10.0 ** rng.uniform(-8, math.log10(0.5)), rng.uniform(0.05, 1.95)
    apart = loss * 10.0 ** rng.uniform(-0.5, 2.0)
    apart = apart if apart < 0.5 else rng.uniform(0.0, 0.5)
    squares = np.array([1.0, (1.0 + apart) ** 2]) * unit**2
    # the modes have the same coefficient, so that they keep their shapes
    coefficient = loss * unit ** (2.0 - order) / math.sin(0.5 * math.pi * order)
    gains = np.array([1.0, rng.uniform(0.3, 3.0) * rng.choice([-1.0, 1.0])])
    oscillators = [
        Oscillator(stiffness=float(k), coefficient=coefficient, order=order, gain=float(gain))
        for k, gain in zip(squares, gains, strict=True)
    ]
    low, high = unit * rng.uniform(0.3, 0.6) / 6.3, unit * (1.0 + apart) * rng.uniform(1.5, 3) / 6.3
    angle = rng.uniform(0.0, math.pi)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    table = harmonic_response(
        resting(
            turn @ np.diag(squares) @ turn.T,
            FractionalDamping(order=order, coefficient=coefficient * np.eye(2)),
        ),
        turn @ gains,
        np.linspace(low, high, int(rng.integers(3, 40))),
        outputs=["sum"],
        rows=(turn @ np.ones(2))[None],
    )
    return table, peaks(oscillators, low, high), oscillators


def is_found(one: OutsidePeak, table: ResponseTable, loss: float) -> bool:
    """Whether a peak of the table has this place, size and width."""
    near = [p for p in table.peaks if abs(p.hertz / one.hertz - 1) < 1e-2 * loss]
    if len(near) != 1 or abs(near[0].magnitude / one.magnitude - 1) > 1e-5 + 1e-13 / loss:
        return False
    if math.isnan(one.low) or math.isnan(one.high):
        return True
    expected = (one.high - one.low) / one.hertz
    return abs(near[0].loss_factor / expected - 1) < 1e-4 + 1e-12 / loss


def wrong(seed: int) -> list[OutsidePeak]:
    """Clear peaks that the table lacks or has otherwise."""
    table, expected, oscillators = drawn(seed)
    loss = max(1e-8, abs(float(oscillators[0].pole().real / oscillators[0].pole().imag)))
    clear = [one for one in expected if one.prominence > CLEAR]
    assert len(table.peaks) <= max(len(expected), 1), seed
    return [one for one in clear if not is_found(one, table, loss)]


@few_of(1, 20, "block")
def test_peaks_of_close_modes_are_those_of_a_sum_of_oscillators(block):
    for seed in range(6 * block, 6 * block + 6):
        assert not wrong(seed), seed


def test_peaks_that_are_looked_for_without_modes_are_missed(monkeypatch):
    # the control
    monkeypatch.setattr(response, "modes_in_range", lambda *_: ((), False))
    assert any(map(wrong, range(6)))


def two_peaks(**options: float) -> tuple[Peak, ...]:
    table = harmonic_response(
        resting(np.diag([1.0, options["second"]]), FractionalDamping(
            order=0.5, coefficient=options["coefficient"] * np.eye(2)
        )),
        np.array([1.0, 1.4]),
        np.linspace(0.1, 0.25, 15),
        outputs=["x1 + x2"],
        rows=np.ones((1, 2)),
    )  # fmt: skip
    return table.peaks


def test_close_modes_are_two_peaks_until_they_merge():
    first, second = two_peaks(second=1.05, coefficient=0.002)
    assert first.loss_factor == pytest.approx(0.001414, rel=1e-3)
    assert second.loss_factor == pytest.approx(0.001362, rel=1e-3)
    assert len(two_peaks(second=1.0005, coefficient=0.02)) == 1


@pytest.mark.parametrize("loss", [1e-3, 1e-6, 1e-8])
def test_the_width_of_a_narrow_peak_is_its_loss_factor(loss):
    scene = resting(np.eye(1), FractionalDamping(order=1.0, coefficient=loss))
    table = harmonic_response(
        scene, np.ones(1), np.linspace(0.1, 0.25, 7), outputs=["x"], rows=np.eye(1)
    )
    (peak,) = table.peaks
    assert peak.loss_factor == pytest.approx(loss, rel=2e-6 + 1e-13 / loss)


def test_a_mode_without_damping_is_an_endless_peak():
    scene = resting(
        np.diag([1.0, 2.0]), FractionalDamping(order=0.5, coefficient=np.diag([0, 0.1]))
    )
    table = harmonic_response(
        scene, np.ones(2), np.linspace(0.1, 0.3, 9), outputs=["x"], rows=np.ones((1, 2))
    )
    assert table.peaks[0].magnitude == math.inf
    assert table.peaks[0].hertz == pytest.approx(1 / (2 * math.pi))
    assert table.peaks[0].loss_factor == 0.0
    assert len(table.peaks) == 2


def test_modes_in_a_range_of_a_chain_are_all_there_or_said_to_be_missing():
    d = 60
    stiffness = 2.0 * np.eye(d) - np.eye(d, k=1) - np.eye(d, k=-1)
    scene = resting(stiffness, FractionalDamping(order=0.5, coefficient=0.01 * stiffness))
    hertz = np.sin(np.arange(1, d + 1) * np.pi / (2 * d + 2)) / np.pi
    low = 0.9 * hertz[0]
    # 4 modes are enough, 36 are, and 36 are not
    for number, is_known in ((3, True), (21, True), (50, False)):
        high = 0.5 * (hertz[number - 1] + hertz[number])
        modes, has_all = response.modes_in_range(scene, low, high)
        assert has_all == is_known
        assert (sum(one.hertz < high for one in modes) == number) == is_known
