"""Relaxation laws under ``damping``: what they build, and what is refused at its line."""

import numpy as np
import pytest

from fvi_cli.config import parse_config
from fvi_cli.effects.laws import ColeCole
from fvi_cli.effects.scene import Scene

CONFIG = """\
name: laws
problem:
  kind: {kind}
  damping:
    - {term}
  initial: {{position: {position}, velocity: 0.0}}
  final_time: 2.0
  exact: none
{more}
method: {method}
ladder: {{steps: [8, 16]}}
"""
METHOD = "{rk: gauss, degree: 3, start: graded}"
ZENER = "{law: zener, order: 0.5, time: 0.2, relaxed: 2.0, unrelaxed: 5.0}"


def text_of(
    term: str,
    *,
    kind: str = "damped-oscillator",
    more: str = "",
    method: str = METHOD,
    position: str = "1.0",
) -> str:
    return CONFIG.format(kind=kind, term=term, more=more, method=method, position=position)


def scene_of(term: str, **others: str) -> Scene:
    (experiment,) = parse_config(text_of(term, **others), "laws.yaml").experiments
    return experiment.problem.scene


def test_a_zener_law_is_read_with_its_stiffness():
    scene = scene_of(ZENER)
    (law,) = scene.laws
    assert law.kernel == ColeCole(order=0.5, time=0.2)
    assert law.size == 3.0
    # the stiffness of the kind is 1
    np.testing.assert_array_equal(scene.potential.stiffness, [[3.0]])


@pytest.mark.parametrize(
    ("term", "modulus"),
    [
        ("{law: maxwell, order: 0.5, time: 0.2, modulus: 5.0}", 5.0 / (1 + 1 / 0.4**0.5)),
        ("{law: prony, moduli: [1.0, 0.5], times: [0.1, 1.0]}", 2 / 12 + 0.5 * 2 / 3),
    ],
)
def test_every_law_has_its_modulus(term, modulus):
    (law,) = scene_of(term).laws
    assert law.symbol(2.0) == pytest.approx(modulus)


def test_nonlinear_scenes_take_the_relaxed_modulus_into_their_potential():
    pendulum = scene_of(ZENER, kind="pendulum")
    at = np.array([0.7])
    np.testing.assert_allclose(pendulum.potential.gradient(at), np.sin(0.7) + 1.4, rtol=1e-14)
    np.testing.assert_allclose(pendulum.potential.hessian(at), [[np.cos(0.7) + 2.0]], rtol=1e-14)
    assert pendulum.potential.energy(at) == pytest.approx(1 - np.cos(0.7) + 0.49)
    general = scene_of(
        f"{ZENER[:-1]}, acts_on: [y - x]}}",
        kind="lagrangian",
        position="[0.5, 0.1]",
        more="  coordinates: [x, y]\n  lagrangian: (1 + x**2)*vx**2/2 + vy**2/2 - x**2/2",
    )
    force = general.lagrangian.forces(np.array([0.5, 0.1]), np.zeros(2), 0.0)[1]
    np.testing.assert_allclose(force, [-0.5 - 0.8, 0.8], rtol=1e-14)
    assert [law.relaxed for law in general.laws] == [0.0]
