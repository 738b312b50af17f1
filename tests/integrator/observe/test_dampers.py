"""Forces and works of single dampers, against balances and closed forms."""

import numpy as np
import pytest
from letters import spring

import fvi_cli as fvi
from fvi_cli.config import parse_config
from fvi_cli.effects.directions import read_directions
from fvi_cli.effects.matrices import Factored
from fvi_cli.integrator.observe.dampers import dampers_of
from fvi_cli.integrator.observe.request import coordinate_names
from fvi_cli.mathematics.expressions import Expression


def drawn(seed: int) -> fvi.Scene:
    """A structure of a few storeys with springpots and laws of all kinds at drawn places."""
    rng = np.random.default_rng(seed)
    d, size = int(rng.integers(1, 5)), 10.0 ** rng.uniform(-4, 4)
    names = coordinate_names(d)
    rows = np.eye(d) - np.eye(d, k=-1)
    springs = rows.T @ np.diag(rng.uniform(2.0, 9.0, d)) @ rows
    between = [f"{names[k]} - {names[k - 1]}" if k else names[0] for k in range(d)]

    def coefficient() -> object:
        chosen = rng.choice(d, size=int(rng.integers(1, d + 1)), replace=False)
        rows = read_directions([between[k] for k in sorted(chosen)], names)
        return Factored(rows=rows, inner=np.diag(rng.uniform(0.2, 1.0, len(rows))))

    laws = (
        fvi.fractional_zener(
            order=rng.uniform(0.2, 0.9),
            time=10.0 ** rng.uniform(-1, 1),
            relaxed=rng.uniform(0.0, 2.0),
            unrelaxed=rng.uniform(2.0, 4.0),
            coefficient=coefficient(),
        ),
        fvi.prony(moduli=[1.0, 0.4], times=[0.2, 2.0], relaxed=0.5, coefficient=coefficient()),
    )
    return spring(
        mass=np.diag(rng.uniform(0.5, 2.0, d)),
        stiffness=springs,
        damping=(
            fvi.FractionalDamping(order=rng.uniform(0.1, 0.9), coefficient=coefficient()),
            fvi.FractionalDamping(order=1.0, coefficient=0.05 * springs),
        ),
        laws=laws,
        forcing=fvi.Forcing.from_text(*(f"{size * rng.uniform(-1, 1)}*sin(2*t)" for _ in range(d))),
        initial_position=size * rng.normal(size=d),
        initial_velocity=size * rng.normal(size=d),
        final_time=4.0,
    )


def names_of_force(scene: fvi.Scene, place: int) -> list[str]:
    count = dampers_of(scene)[place][0].inner.shape[0]
    if count == 1:
        return [f"force_{place + 1}"]
    return [f"force_{place + 1}_{k + 1}" for k in range(count)]


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", range(10))
def test_works_are_the_loss_of_energy_and_forces_balance_the_motion(seed):
    one = drawn(seed)
    d, names = one.dimension, coordinate_names(one.dimension)
    forces = [names_of_force(one, place) for place in range(4)]
    power = "+".join(f"({part.text})*v{n}" for part, n in zip(force_texts(one), names, strict=True))
    asked = {name: name for own in forces for name in own}
    asked |= {f"v_{n}": f"v{n}" for n in names} | {f"work_{k}": f"work_{k}" for k in range(1, 5)}
    found = fvi.integrate(
        one,
        "gauss6-graded",
        60,
        output=np.linspace(0.0, 4.0, 641),
        quantities={**asked, "power": power},
    )
    values = found.observed.quantities
    work = sum(values[f"work_{k}"] for k in range(1, 5))
    taken = boole(values["power"], found.time[1])
    lost = found.energy[0] - found.energy[::4] + taken
    scale = np.abs(found.energy).max() + np.abs(taken).max()
    assert np.abs(work[::4] - lost).max() < 1e-9 * scale
    # a second route: what the equation of motion leaves to the dampers, from rates of velocities
    velocity = np.stack([values[f"v_{n}"] for n in names], axis=1)
    acceleration = rate_of(velocity, found.time[1])
    left = acceleration @ one.inertia.mass + found.position @ one.potential.stiffness
    left -= one.forcing(found.time)
    total = np.zeros_like(left)
    for place, own in enumerate(forces):
        (damper,) = dampers_of(one)[place]
        columns = np.stack([values[name] for name in own], axis=1)
        spring_part = getattr(damper, "spring", 0.0) * found.position @ damper.matrix
        total += columns @ (np.eye(d) if damper.factored is None else damper.factored.rows)
        total -= spring_part
    # near the start the motion is no polynomial
    apart = np.abs(left + total)[64:-4]
    assert apart.max() < 2e-7 * np.abs(total).max()


def force_texts(one: fvi.Scene) -> tuple[Expression, ...]:
    return one.forcing.pieces[0].components


def rate_of(values: np.ndarray, h: float) -> np.ndarray:
    """Central differences of order eight, inside."""
    found = np.zeros_like(values)
    for k, factor in enumerate((4 / 5, -1 / 5, 4 / 105, -1 / 280), start=1):
        found[4:-4] += factor / h * (values[4 + k : len(values) - 4 + k] - values[4 - k : -4 - k])
    return found


def boole(values: np.ndarray, h: float) -> np.ndarray:
    parts = [values[k : values.size - 4 + k : 4] for k in range(5)]
    sums = (
        2 * h / 45 * (7 * parts[0] + 32 * parts[1] + 12 * parts[2] + 32 * parts[3] + 7 * parts[4])
    )
    return np.concatenate([[0.0], np.cumsum(sums)])


def test_a_spring_and_a_springpot_in_one_entry_are_one_damper():
    text = (
        "name: a\nproblem:\n  kind: frame\n  masses: [1, 2]\n  stiffnesses: [3, 2]\n"
        "  damping: [{order: 0.5, coefficient: 0.1}]\n  dampers:\n"
        "  - {law: kelvin-voigt, stiffness: 0.7, coefficient: 0.2, storey: 2, name: top}\n"
        "  - {law: zener, order: 0.5, time: 1, relaxed: 1, unrelaxed: 2}\n"
        "  initial: {position: [1, 0], velocity: 0}\n  final_time: 2\n"
        "ladder: {steps: [40]}\nmethod: {rk: gauss, degree: 4}\n"
        "quantities: {a: force_top - 0.7*(x2 - x1) - 0.2*(vx2 - vx1), b: force_2 - force_top,\n"
        "  c: dx1 + force_1_1 - 0.2*(vx2 - vx1) + force_3_1 - x1 - force_3_2 + x2 - x1,\n"
        "  d: force_3_2, e: deformation_3_2 - x2 + x1}\n"
    )
    (outcome,) = fvi.run(parse_config(text, "a"))
    found = outcome.finished[0].trajectory.observed.extents
    assert all(found[name].peak < 1e-9 for name in "abce")
    assert found["d"].peak > 1e-2
