"""Laws whose displacement is given, against their closed forms."""

import functools

import mpmath
import numpy as np
import pytest
from spread import spread

import fvi_cli as fvi
from fvi_cli.config import parse_config
from fvi_cli.studies.loops import deformation_against, forces_of, last_loop


def of_ramp(order: float, b: float, t: float) -> mpmath.mpf:
    """Mittag-Leffler's function of two parameters at ``-t**order``, by its series."""
    z = -(mpmath.mpf(t) ** mpmath.mpf(order))
    return mpmath.nsum(lambda k: z**k / mpmath.gamma(mpmath.mpf(order) * k + b), [0, mpmath.inf])


RAMPS = {
    "zener": (
        "{law: zener, order: 0.6, time: 0.5, relaxed: 1.0, unrelaxed: 10.0}",
        lambda t: t + 9 * t * of_ramp(0.6, 2, t / 0.5),
    ),
    "two": (
        "[{order: 0.9, coefficient: 0.7}, {law: maxwell, order: 0.3, time: 2, modulus: 3}]",
        lambda t: 0.7 * mpmath.mpf(t) ** 0.1 / mpmath.gamma(1.1) + 3 * t * of_ramp(0.3, 2, t / 2.0),
    ),
    "kelvin-voigt": (
        "{law: kelvin-voigt, stiffness: 2.0, coefficient: 0.5}",
        lambda t: 2 * t + mpmath.mpf(0.5),
    ),
    "prony": (
        "{law: prony, moduli: [1.5], times: [0.4], relaxed: 0.5}",
        lambda t: 0.5 * t + 0.6 * (1 - mpmath.exp(-t / 0.4)),
    ),
}
"""Laws with their forces on a displacement t."""


def on_samples(law: str, times: np.ndarray, values: np.ndarray, folder, **more: str) -> str:
    lines = [f"{t!r},{u!r}" for t, u in zip(times.tolist(), values.tolist(), strict=True)]
    (folder / "bench.csv").write_text("\n".join(["t,u", *lines]) + "\n")
    rest = "".join(f"{key}: {value}\n" for key, value in more.items())
    displacement = f"{{file: {folder}/bench.csv, column: u, time: t}}"
    return f"name: a\nproblem: {{kind: material, law: {law}, displacement: {displacement}}}\n{rest}"


def drawn(law: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and values of samples of any size, and times of the output, for each law others."""
    rng = np.random.default_rng(list(law.encode()))
    times = np.sort(np.concatenate([[0.0, 3.0], rng.uniform(0, 3, 10)]))
    values = np.concatenate([[0.0], 10.0 ** rng.uniform(-6, 6) * rng.normal(size=11)])
    at = np.sort(np.concatenate([times[1:], rng.uniform(0, 3, 8), times[3] + [1e-6, 1e-3]]))
    return times, values, at


@functools.cache
def summed(law: str) -> np.ndarray:
    """Forces at the times of the output and at 0, ramp by ramp."""
    times, values, at = drawn(law)
    changes = np.diff(np.append(0.0, np.diff(values) / np.diff(times)))
    pairs = list(zip(changes, times, strict=False))
    with mpmath.workdps(30):
        return np.array(
            [float(sum(c * RAMPS[law][1](t - b) for c, b in pairs if t - b > 0)) for t in at]
        )


@spread(few=1, law=list(RAMPS), **{"degree, most": [(3, 2e-3), (8, 2e-7)]})
def test_forces_along_samples_are_sums_of_ramps(law, degree, most, tmp_path):
    times, values, at = drawn(law)
    size = np.abs(values).max()
    config = on_samples(
        RAMPS[law][0],
        times,
        values,
        tmp_path,
        ladder="{steps: [12]}",
        method=f"{{rk: gauss, degree: {degree}}}",
        output=f"{{times: {at.tolist()}}}",
    )
    (outcome,) = fvi.run(parse_config(config, str(tmp_path / "a.yaml")))
    trajectory = outcome.finished[0].trajectory
    assert trajectory.time == pytest.approx(at, rel=1e-15)
    exact = summed(law)
    found = trajectory.observed.quantities["force"]
    assert np.abs(found - exact).max() < most * np.abs(exact).max()
    assert trajectory.position[:, 0] == pytest.approx(np.interp(at, times, values), abs=1e-9 * size)
    # a control: with equal steps the first ones behind a kink err by far more
    if law == "two":
        plain = config.replace("gauss,", "gauss, start: none,")
        (outcome,) = fvi.run(parse_config(plain, str(tmp_path / "a.yaml")))
        other = outcome.finished[0].trajectory.observed.quantities["force"]
        assert np.abs(other - exact).max() > 10 * most * np.abs(exact).max()


def test_the_steady_loop_of_a_law_has_its_complex_stiffness(tmp_path):
    text = (
        "name: a\nproblem: {kind: material, displacement: '0.02*sin(6*t)', final_time: 16,\n"
        "  law: [{law: zener, order: 0.6, time: 0.2, relaxed: 1, unrelaxed: 4, name: one},\n"
        "    {order: 0.3, coefficient: 0.1}]}\n"
        "ladder: {steps: [800]}\nmethod: {rk: gauss, degree: 4}\n"
        "quantities: {one: force_one, other: force_2}\n"
    )
    (outcome,) = fvi.run(parse_config(text, "a"))
    (item,) = outcome.finished
    power = (0.2 * 6j) ** 0.6
    moduli = {"one": 1 + 3 * power / (1 + power), "other": 0.1 * 6j**0.3}
    moduli["force"] = moduli["one"] + moduli["other"]
    assert set(forces_of(item.run.experiment)) == set(moduli)
    for name, modulus in moduli.items():
        loop = last_loop(item.trajectory.time, *deformation_against(item, name))
        # the start dies away like t**-0.6
        assert loop.stiffness == pytest.approx(modulus.real, rel=2e-3)
        assert loop.loss_factor == pytest.approx(modulus.imag / modulus.real, rel=2e-3)
        assert loop.amplitude == pytest.approx(0.02, rel=1e-4)
        assert loop.work == pytest.approx(np.pi * modulus.imag * 0.02**2, rel=2e-3)


def test_the_velocity_is_that_of_the_displacement_and_no_acceleration_is_made_up():
    text = (
        "name: a\nproblem: {kind: material, displacement: '0.02*sin(6*t)', final_time: 2,\n"
        "  law: {order: 0.3, coefficient: 0.1}}\nladder: {steps: [64]}\n"
        "method: {rk: gauss, degree: 6}\nquantities: {v: vu - 0.12*cos(6*t)}\n"
    )
    (outcome,) = fvi.run(parse_config(text, "a"))
    found = outcome.finished[0].trajectory.observed.extents
    assert found["v"].peak < 1e-10
