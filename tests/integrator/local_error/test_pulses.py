"""Pulses of formulas are found before a run, wherever they are and whatever stands beside them."""

import numpy as np
import pytest
from letters import in_pieces, spring
from oracles.volterra import solve_volterra

import fvi_cli as fvi
from fvi_cli.effects.forcing import Forcing
from fvi_cli.integrator.local_error import examine, pulses
from fvi_cli.integrator.local_error.pulses import find_pulses
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.traced import trace
from fvi_cli.studies.tolerance import search

SHAPES = {
    "exp": "exp(-{u}**2)",
    "tanh": "1 - tanh{u}**2",
    "cosh": "1/cosh({u})",
    "quotient": "1/(1 + {u}**2)**4",
    "gate": "(tanh({u} + 3) - tanh({u} - 3))/2",
    "doublet": "{u}*exp(-{u}**2)",
}
BESIDE = ["", " + sin(3*{t})", " + 5*{t}", " + exp(-{t})", " + {t}**2.5", " - 40"]


def pulse(shape: str, middle: float, width: float, beside: str = "") -> Forcing:
    u = f"((t - {middle!r})/{width!r})"
    return Forcing.from_text("2*(" + SHAPES[shape].replace("{u}", u) + ")" + beside)


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", range(12))
def test_steps_have_to_end_inside_of_every_pulse(seed):
    random = np.random.default_rng([22, seed])
    for shape in SHAPES:
        final_time = float(10 ** random.uniform(-6, 6))
        width = final_time * float(10 ** random.uniform(-6, -2.5))
        middle = float(random.uniform(0.03, 1.0)) * final_time
        beside = BESIDE[seed % len(BESIDE)].replace("{t}", f"(t/{final_time!r})")
        forcing = pulse(shape, middle, width, beside)
        found = find_pulses(forcing, final_time, 1e-6 * width)
        points = np.array(found.points)
        assert found.unresolved_at is None
        assert np.sum(np.abs(points - middle) < 6 * width) >= 2, (shape, width / final_time)
        # and the way there is short
        assert points.size < 400


@pytest.mark.parametrize(
    "text",
    [
        "exp(-t)",
        "t**(-0.5)",
        "sqrt(t)",
        "tanh(t - 4)",
        "1/(2 + cos(t))",
        "exp(cos(3*t))/(1 + t)",
        "sin(t)/t",
        "exp(t)/(1 + exp(t))",
        "t**3/(exp(t) - 1)",
        "(arctan(t) - arctan(t - 1))**2",
    ],
)
def test_a_force_without_pulses_asks_for_no_points(text):
    """The control."""
    assert find_pulses(Forcing.from_text(text), 8.0, 1e-10) == pulses.Pulses()


@pytest.mark.parametrize("seed", range(8))
def test_beside_a_singular_power_nothing_hides_however_little_matters(seed):
    random = np.random.default_rng([25, seed])
    for power in (-0.7, -0.5, -0.3, 0.25, float(random.uniform(-0.7, 1.5))):
        final_time = float(10 ** random.uniform(-6, 6))
        digits = random.uniform(12, 13) if power == -0.7 else random.uniform(6, 13)
        negligible = final_time ** (1 + power) * 10.0**-digits
        forcing = Forcing.from_text(f"t**({power!r})")
        assert find_pulses(forcing, final_time, negligible) == pulses.Pulses(), power
    # far from 0 the time itself is rounded
    behind = in_pieces("1", 3.0, f"(t - 3)**({0.5 * power!r})", 6.0, "0")
    assert find_pulses(behind, 8.0, 1e-10) == pulses.Pulses()


def test_pulses_behind_break_points_and_their_trains():
    forcing = in_pieces("1", 3.0, "exp(-((t - 5)/1e-4)**2)", 6.0, "0")
    points = find_pulses(forcing, 8.0, 1e-9).points
    assert points
    assert all(4.0 < one < 6.0 for one in points)
    train = Forcing.from_text("exp(-(sin(3*t)/1e-3)**2)")
    points = np.array(find_pulses(train, 8.0, 1e-9).points)
    for number in range(1, 8):
        assert np.abs(points - number * np.pi / 3).min() < 1e-3


@pytest.mark.parametrize("text", ["1/(t - 3.1)**2", "log(abs(t - 3.1))/(t - 3.1)"])
def test_what_cannot_be_resolved_is_said(text):
    found = find_pulses(Forcing.from_text(text), 8.0, 1e-9)
    assert found.unresolved_at == pytest.approx(3.1, abs=1e-4)


def test_a_search_without_room_says_so(monkeypatch):
    monkeypatch.setattr(pulses, "MOST_PARTS", 0)
    text = "exp(-((t - 4)/0.3)**2)"
    assert find_pulses(Forcing.from_text(text), 8.0, 1e-9).unresolved_at is not None
    run = fvi.solve(spring((0.5, 0.1), k=1.0, T=8.0, forcing=text), tolerance=1e-3)
    assert run.outcome == "unreliable"
    assert "may hide a pulse near t = " in run.assessment.reason


def test_ranges_hold_what_is_seen_and_functions_are_looked_at_one_by_one():
    begin, end = np.array([0.0, 1.0]), np.array([1.0, 2.0])
    samples = np.linspace(begin, end, 17, axis=1)
    hidden = Expression.parse("40*t + exp(-((t - 0.47)/1e-4)**2)", variables=("t",))
    box, values, doubtful = trace(hidden, begin, end, samples)
    assert (values.min(axis=1) >= box.low).all()
    assert (values.max(axis=1) <= box.high).all()
    assert doubtful.tolist() == [True, False]


CASE = ("tanh", 2.879, 0.000106)


def test_what_a_pulse_moves_is_met():
    shape, middle, width = CASE
    scene = spring((1.648, 0.86), k=1.0, T=8.0, forcing=pulse(shape, middle, width))
    run = fvi.solve(scene, tolerance=6.8e-6)
    # at rest before: the same motion, later
    lead = 20 * width
    known = solve_volterra(
        1.0,
        [(1.648, 0.86)],
        lambda x: x,
        lambda x: np.ones((len(x), 1, 1)),
        lambda t: 2.0 / np.cosh(np.clip((t - lead) / width, -300.0, 300.0))[:, None] ** 2,
        [0.0],
        [0.0],
        8.0 - middle + lead,
        tolerance=1e-12,
    )
    times = np.linspace(middle - lead, 8.0, 300)
    right = known.position(times - times[0])
    assert np.abs(right).max() > 2e-4
    assert run.outcome == "met"
    assert np.abs(run(times) - right).max() <= 6.8e-6


def test_without_the_search_the_run_sees_no_force(monkeypatch):
    """The control, without that in the steps as well: met, with the position at zero."""
    monkeypatch.setattr(search, "pulses_that_move", lambda *arguments: pulses.Pulses())
    monkeypatch.setattr(examine.HiddenSearch, "search", lambda *arguments: (0.0, None))
    scene = spring((1.648, 0.86), k=1.0, T=8.0, forcing=pulse(*CASE))
    run = fvi.solve(scene, tolerance=6.8e-6)
    assert run.outcome == "met"
    assert np.abs(run.position).max() < 0.01 * 2e-4
