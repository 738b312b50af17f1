"""A run is stopped as diverged where its method is unstable, and never for what its scene does."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from letters import spring
from oracles.ordinary import solve_ordinary
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.growth_bound import growth_limit, scene_bound
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.run.on_mesh import path_from
from fvi_cli.integrator.stability.modes import growing_frequencies
from fvi_cli.integrator.stability.systems import matrix_pencil
from fvi_cli.scenes.lagrangian import lagrangian_scene

# L, and what x'' is by hand
SCENES = {
    "double well": ("vx**2/2 + x**2/2 - x**4/4", lambda x, v: x - x**3),
    "free fall": ("vx**2/2 - 981*x/100", lambda x, v: -9.81 + 0 * x),
    "hill": ("vx**2/2 + 1/(1 + x**2)", lambda x, v: -2 * x / (1 + x**2) ** 2),
    "repulsion": ("vx**2/2 - 1/(x + 2)", lambda x, v: 1 / (x + 2) ** 2),
    "top of a pendulum": ("vx**2/2 - cos(x)", lambda x, v: np.sin(x)),
    "mass that moves": (
        "(1 + x**2/10)*vx**2/2 - 981*x/100",
        lambda x, v: -(9.81 + x * v * v / 10) / (1 + x**2 / 10),
    ),
}
HOW = ("single", "blocks", "adaptive", "bdf", "implicit-euler", "product-integration")


def made(kind: str, position: float, velocity: float, final_time: float = 10.0) -> Scene:
    return lagrangian_scene(
        final_time=final_time,
        coordinates=("x",),
        lagrangian=SCENES[kind][0],
        initial_position=[position],
        initial_velocity=[velocity],
    )


def run_by(scene: Scene, how: str):
    gauss = Method(cq="gauss", degree=4)
    if how == "single":
        return integrate(scene, gauss, mesh_of(scene.final_time * np.linspace(0, 1, 101) ** 1.01))
    if how == "adaptive":
        return integrate(scene, gauss, AdaptiveSteps(tolerance=1e-10))
    if how == "bdf":
        return integrate(scene, Method(cq="bdf3", degree=2), 2000)
    return integrate(scene, gauss if how == "blocks" else Baseline(name=how), 2000)


@pytest.mark.few(3)
@spread(
    kind=list(SCENES),
    start=[(1e-8, 0.0), (-1e-9, 0.0), (0.0, 1e-9), (1e-12, -1e-12), (1e-3, 1e-6)],
    how=HOW,
)
def test_what_a_potential_can_do_is_no_divergence(kind, start, how):
    if kind == "mass that moves" and "-" in how:
        # baselines refuse it
        how = "adaptive"
    scene = made(kind, *start)
    found = run_by(scene, how)
    assert found.status == "ok", found.message
    exact = solve_ordinary(lambda t, x, v, z: SCENES[kind][1](x, v), [start[0]], [start[1]], 10.0)
    if "-" not in how and np.abs(start).max() > 1e-4:
        error = np.abs(found.position - exact.position(found.time)).max()
        assert error < 1e-4 * np.abs(found.position).max()


@pytest.mark.parametrize("method", [Method(cq="bdf6", degree=1, sampling="nodes")])
@pytest.mark.parametrize("potential", ["cos(x)", "-sqrt(1 + x**2)", "cos(x)/3 - x**2/9"])
def test_unstable_methods_are_stopped(potential, method):
    scene = lagrangian_scene(
        final_time=200.0,
        coordinates=("x",),
        lagrangian=f"vx**2/2 + {potential}",
        damping=[FractionalDamping(order=1.5, coefficient=[[2.0]])],
        initial_position=[0.3],
    )
    found = integrate(scene, method, 2000)
    assert found.status == "diverged"
    assert found.failure is not None
    assert found.failure.reason in ("diverged", "not finite")
    assert found.failure.step == found.time.size - 2


def test_without_the_potential_the_bound_stops_a_true_motion():
    scene = made("double well", 1e-8, 0.0, final_time=30.0)
    blind = replace(scene_bound(scene), scene=None)
    with patch("fvi_cli.integrator.run.soundness.scene_bound", return_value=blind):
        assert integrate(scene, Method(cq="gauss", degree=2), 1000).status == "diverged"
    assert integrate(scene, Method(cq="gauss", degree=2), 1000).status == "ok"


@spread(seed=range(6), scale=[1e-6, 1.0, 1e5], orders=[(0.5,), (1.0, 1.6), (0.3, 1.2)])
def test_the_growth_of_a_linear_scene_has_a_bound(seed, scale, orders):
    """T and h go with the unit of time, which `scale` changes."""
    random = np.random.default_rng(seed)

    def form(power: float) -> np.ndarray:
        entries = random.standard_normal((2, 2))
        return scale**power * (entries + entries.T)

    damping = [FractionalDamping(order=one, coefficient=form(2.0 - one)) for one in orders]
    scene = replace(spring(T=10.0 / scale, m=np.eye(2), k=form(2.0)), damping=tuple(damping))
    found = growing_frequencies(matrix_pencil(scene), scene.final_time, 1e-3 / scale)
    assert found is not None
    exact = found.real.max(initial=0.0)
    limit = growth_limit(scene)
    assert exact <= limit * (1 + 1e-9)
    # no mode is faster than the norms of the forms allow: the bound is not that of nothing
    assert limit <= 40.0 * scale


@pytest.mark.parametrize("k", [1e-8, 1.0, 1e9])
def test_the_bound_is_the_growth_where_a_stiffness_is_negative(k):
    assert growth_limit(spring(T=1.0, k=-k, x=1.0)) == pytest.approx(np.sqrt(k))
    assert growth_limit(spring(T=1.0, k=k, x=1.0)) == 0.0


class TestFailures:
    """They carry step, time and reason, the same by every route, whatever points are kept."""

    METHOD = Method(cq="gauss", degree=2)
    SCENE = lagrangian_scene(
        final_time=4.0, coordinates=("x",), lagrangian="vx**2/2 + cos(x)", initial_velocity=[0.45]
    )

    @spread(n_steps=[300, 1000, 256], at=[256, 0, 1, 255, 257], every=[7, 100, 1])
    def test_the_step_is_named_and_the_last_point_kept(self, monkeypatch, n_steps, at, every):
        solve, seen = Engine.solve, []

        def breaking(self, state, *arguments, **options):
            seen.append(state.t)
            found = solve(self, state, *arguments, **options)
            if len(seen) == at + 1:
                found.failed = np.ones(1, dtype=bool)
            return found

        monkeypatch.setattr(Engine, "solve", breaking)
        times = self.SCENE.final_time * np.arange(n_steps + 1) / n_steps
        found = integrate(self.SCENE, self.METHOD, mesh_of(times), every=every)
        if at >= n_steps:
            assert found.status == "ok"
            return
        assert found.status == "failed"
        step = round(seen[-1] / times[1])
        assert found.failure == Failure(str(found.failure), "step failed", step, seen[-1])
        assert f"step {step}, t = {seen[-1]:.6g}: Newton's iteration did not" in found.message
        assert found.time[-1] == pytest.approx(seen[-1], abs=1e-12)
        assert found.time.size == step // every + 1 + (step % every > 0)

    @pytest.mark.parametrize("every", [1, 50])
    def test_a_step_behind_blocks_is_named(self, every):
        """The force ends at x = 2, which is in the third chunk of steps."""
        scene = lagrangian_scene(
            final_time=4.0,
            coordinates=("x",),
            lagrangian="vx**2/2 + sqrt(2 - x)/1000",
            initial_velocity=[0.9],
        )
        found = integrate(scene, self.METHOD, 20_000, every=every)
        failure, h = found.failure, 4.0 / 20_000
        assert failure is not None
        assert failure.time == pytest.approx(2.22, abs=0.02)
        assert failure.step == round(failure.time / h)
        assert f"step {failure.step}, t = {failure.time:.6g}: " in found.message
        assert found.time[-1] == pytest.approx(failure.time, abs=h / 2)

    @pytest.mark.parametrize("n_steps", [100, 1000])
    def test_the_worst_step_is_where_the_force_is_steep(self, n_steps):
        scene = lagrangian_scene(
            final_time=4.0,
            coordinates=("x",),
            lagrangian="vx**2/2 - (1 + tanh(200*(x - 2)))",
            initial_velocity=[2.5],
        )
        found = integrate(scene, self.METHOD, n_steps)
        # it takes 0.8 to the ramp
        assert found.newton.worst_step * 4.0 / n_steps == pytest.approx(0.8, abs=0.3)

    def test_a_singular_step_of_any_stretch_is_an_error(self):
        # m/h^2 + k/4 = 0 in the last of its steps
        scene = spring(T=10.0, k=-4.0, x=1.0)
        with pytest.raises(np.linalg.LinAlgError, match="no unique solution"):
            path_from(scene, Method(cq="gauss", degree=1), 10, np.ones(1), np.ones(1))


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("power", [31, 34, 40])
def test_wells_on_the_way_explain_the_energy_of_a_run_and_those_elsewhere_do_not(side, power):
    """Points lie beyond a well that none of them meets."""
    place, well = 2.0**power, 1e10 * 4.0**power
    scene = lagrangian_scene(
        coordinates=["q"],
        lagrangian=f"vq**2/2 + {well!r}*exp(-(q - {16 * side})**2)",
        initial_velocity=[1.0],
        final_time=1.0,
    )
    bound, momentum = scene_bound(scene), np.array([[np.sqrt(well)]])
    assert not bound.outside(np.array([[side * place]]), momentum, np.array([0.5])).any()
    assert bound.outside(np.array([[-side * place]]), momentum, np.array([0.5])).all()
