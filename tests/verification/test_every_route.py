"""One table of routes to one discrete motion, and of scenes of every kind with drawn numbers.

Single steps, blocks of any length, meshes of given points, sums written out, batches in any
company, thinned runs, runs with diagnostics and sparse matrices must end with the
same status; they differ by round-off while the motion is below 1e3 times what it was at first, or
have the same bits. Orders, methods, numbers of steps, breaks of the force and scales are drawn.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest
from drawn_scenes import GENERAL, KINDS, LAWS, LINEAR, STRUCTURES, scene_of, shape_of, sparse
from spread import spread
from written_out import every_lag_written_out, integrate_written_out

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import batch_kind, integrate, integrate_members
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method, RuleSpecification
from fvi_cli.integrator.run import loop
from fvi_cli.integrator.run.on_mesh import Kept, integrate_scenes, mesh_for
from fvi_cli.integrator.trajectory import Trajectory

FIELDS = ("position", "momentum", "time", "energy")
ROUND_OFF = 1e-11
SLOWER = (*GENERAL, *STRUCTURES)
MEMBERS = 18
"""So many nonlinear scenes are stepped together, and more linear ones than are needed."""


@dataclass(frozen=True)
class Case:
    """A method, a number of steps, and members of a sweep, of which the first is looked at."""

    kind: str
    method: Method
    n_steps: int
    scenes: tuple[Scene, ...]

    @property
    def scene(self) -> Scene:
        return self.scenes[0]

    @cached_property
    def usual(self) -> Trajectory:
        return integrate(self.scene, self.method, self.n_steps)

    def round_off(self, place: int) -> float:
        """What a few units in the last place of a member's start do to its motion."""
        scene = self.scenes[place]
        usual = integrate(scene, self.method, self.n_steps)
        others = (
            replace(
                scene,
                initial_position=scene.initial_position * (1 + change),
                initial_velocity=scene.initial_velocity * (1 - change),
            )
            for change in (1e-15, 2e-15, 4e-15)
        )
        return max(
            largest_difference(usual, integrate(other, self.method, self.n_steps))
            for other in others
        )

    @property
    def has_smoothed_momenta(self) -> bool:
        """Whether a run with all of its steps replaces the momenta that it marches with."""
        return self.scene.derivative != "caputo" and max(self.scene_orders, default=0.0) > 1

    @property
    def scene_orders(self) -> list[float]:
        return [term.order for term in self.scene.damping]


def draw_method(rng: np.random.Generator, kind: str) -> Method:
    if kind in LAWS or rng.random() < 0.6 or kind == "double pendulum":
        # unstable runs of a double pendulum come to steps whose equations have several solutions
        family = str(rng.choice(["gauss", "gauss", "gauss", "lobatto-iiic"]))
        most = 9 if family == "gauss" and kind in LINEAR and kind not in STRUCTURES else 5
        least = 2 if family == "lobatto-iiic" else 1
        start = str(rng.choice(["none", "none", "graded"])) if family == "gauss" else "none"
        degree, loads = int(rng.integers(least, most)), str(rng.choice(["exact", "galerkin"]))
        return Method(cq=family, degree=degree, start=start, forcing_quadrature=loads)
    order, sampling = int(rng.integers(1, 7)), str(rng.choice(["nodes", "points"]))
    rule = RuleSpecification(rule="lobatto", points=4) if rng.random() < 0.2 else None
    exact = str(rng.choice(["exact", "galerkin"]))
    return Method(
        cq=f"bdf{order}",
        degree=int(rng.integers(1, 4)),
        sampling=sampling,
        quadrature=rule,
        forcing_quadrature=exact,
    )


def draw(kind: str, seed: int) -> Case:
    rng = np.random.default_rng([seed, *kind.encode()])
    # on steps as long as half a turn the equations have several solutions, and each route finds one
    few = kind in SLOWER
    n_steps = int(rng.choice([33, 70] if few else [5, 33, 70, 128, 300]))
    shape, method = shape_of(kind, rng, n_steps), draw_method(rng, kind)
    count = 3 if few else MEMBERS
    return Case(kind, method, n_steps, tuple(scene_of(kind, shape, rng) for _ in range(count)))


def sound(found: Trajectory) -> int:
    """Points up to which positions are below 1e3 times the first."""
    size = np.abs(found.position).max(axis=1)
    first = size[0] + 1e-3 * size[: min(20, size.size)].max()
    outside = np.flatnonzero(~(size < 1e3 * first))
    return int(outside[0]) if outside.size else size.size


def largest_difference(one: Trajectory, other: Trajectory, n_fields: int = 2) -> float:
    """Of positions and momenta, over the largest of each."""
    count = min(sound(one), other.position.shape[0])
    pairs = [(getattr(run, name)[:count] for run in (one, other)) for name in FIELDS[:n_fields]]
    return max(float(np.abs(a - b).max() / np.abs(a).max(initial=1e-300)) for a, b in pairs)


def check_same(case: Case, one: Trajectory, other: Trajectory, place: int = 0) -> None:
    assert one.status == other.status, (one.message, other.message)
    if one.status == "ok":
        assert one.time == pytest.approx(other.time, rel=1e-13, abs=1e-14)
    difference = largest_difference(one, other)
    assert difference <= ROUND_OFF or difference <= 10 * case.round_off(place)


def check_identical(one: Trajectory, other: Trajectory) -> None:
    assert one.status == other.status
    for name in FIELDS[:3]:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    # products with large matrices are rounded by how many points there are
    assert one.energy == pytest.approx(other.energy, rel=1e-14, abs=0, nan_ok=True)


# --- the routes -----------------------------------------------------------------------------------


def by_blocks_of(most: int) -> Callable[[Case], None]:
    def check(case: Case) -> None:
        mesh = mesh_for(case.scene, case.method, case.n_steps)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(loop, "block_length", lambda engine, _: 1 if engine.is_single else most)
            (found,) = integrate_scenes([case.scene], case.method, mesh, Kept())
        check_same(case, case.usual, found)

    return check


def check_given_points(case: Case) -> None:
    if not case.method.is_runge_kutta or case.method.start != "none":
        return
    times = case.scene.final_time / case.n_steps * np.arange(case.n_steps + 1)
    times[-1] = case.scene.final_time
    check_same(
        case,
        case.usual,
        integrate(case.scene, case.method, mesh_of(times, case.scene.break_points)),
    )


def check_written_out(case: Case) -> None:
    if not case.method.is_runge_kutta:
        with every_lag_written_out():
            direct = integrate(case.scene, case.method, case.n_steps)
        check_same(case, case.usual, direct)
    elif case.usual.status == "ok" and case.method.start == "none" and case.kind not in LAWS:
        other = integrate_written_out(case.scene, case.method, case.n_steps)
        n_fields = 1 if case.has_smoothed_momenta else 2
        assert largest_difference(case.usual, other, n_fields) <= ROUND_OFF


def check_members(case: Case) -> None:
    dense = {"with_steps": case.method.is_runge_kutta}
    found = integrate_members(case.scenes, case.method, case.n_steps, **dense)
    check_same(case, case.usual, found[0])
    for place in (1, len(found) - 1):
        alone = integrate(case.scenes[place], case.method, case.n_steps, **dense)
        check_same(case, alone, found[place], place)
        if case.method.is_runge_kutta and alone.status == "ok":
            until = alone.time[sound(alone) - 1]
            a, b = (one(np.linspace(0.0, until, 50)) for one in (alone, found[place]))
            assert np.abs(a - b).max() <= ROUND_OFF * np.abs(a).max()


def check_company(case: Case) -> None:
    kind = batch_kind(case.scene, case.method, case.n_steps)
    if kind is None:
        return
    scenes = [one for one in case.scenes if batch_kind(one, case.method, case.n_steps) == kind]
    together = integrate_members(scenes, case.method, case.n_steps)
    for places in ([0], [-1, 0], [*range(len(scenes))] * 2):
        packed = integrate_members([scenes[k] for k in places], case.method, case.n_steps)
        for place, one in zip(places, packed, strict=True):
            check_same(case, together[place], one, place)


def check_watched(case: Case) -> None:
    asked = case.method.is_runge_kutta
    options = {"diagnostics": asked, "with_steps": case.method.is_runge_kutta}
    check_identical(case.usual, integrate(case.scene, case.method, case.n_steps, **options))


def check_sparse(case: Case) -> None:
    if case.kind in STRUCTURES:
        check_same(case, case.usual, integrate(sparse(case.scene), case.method, case.n_steps))


ROUTES: dict[str, Callable[[Case], None]] = {
    "single steps": by_blocks_of(1),
    "blocks of eight": by_blocks_of(8),
    "given points": check_given_points,
    "written out": check_written_out,
    "members": check_members,
    "company": check_company,
    "watched": check_watched,
    "sparse": check_sparse,
}
FOUND = [("few dampers", 1009), ("few dampers", 1003), ("double pendulum", 1001)]
"""On which routes once disagreed, or ended."""


def check_all(kind: str, seed: int) -> None:
    case = draw(kind, seed)
    for check in ROUTES.values():
        check(case)


@pytest.mark.few(1)
@pytest.mark.parametrize(("kind", "seed"), FOUND)
def test_routes_that_once_disagreed_agree(kind, seed):
    check_all(kind, seed)


@spread(few=3, kind=list(KINDS), seed=range(1000, 1060))
def test_all_routes_agree(kind, seed):
    check_all(kind, seed)


@pytest.mark.parametrize("route", [name for name in ROUTES if name not in ("company", "sparse")])
def test_every_route_sees_another_motion(route):
    """The control: the usual run is that of a scene with a billionth more damping."""
    given = next(
        case
        for case in (draw("oscillator", seed) for seed in range(100))
        if case.scene.damping
        and case.usual.status == "ok"
        and case.method.start == "none"
        and (case.method.is_runge_kutta or route != "given points")
    )
    ROUTES[route](given)
    (first, *others) = given.scene.damping
    more = replace(first, coefficient=(1 + 1e-7) * first.matrix)
    wrong = replace(given, scenes=(replace(given.scene, damping=(more, *others)),))
    given.__dict__["usual"] = wrong.usual
    with pytest.raises(AssertionError):
        ROUTES[route](given)
