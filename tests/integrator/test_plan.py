"""The plan of a run: what it says beforehand against what the run then does."""

import itertools
import tracemalloc
from collections.abc import Callable
from unittest.mock import patch

import numpy as np
import pytest
import scipy.sparse.linalg
from letters import spring, swing
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.diagnostics_request import DiagnosticsRequest
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import companions, integrate_members
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.planning.plan import plan_run
from fvi_cli.scenes.lagrangian import double_pendulum, lagrangian_scene

NODES = Method(cq="bdf2", degree=1, sampling="nodes")


def gauss(degree: int = 2, start: str = "none") -> Method:
    return Method(cq="gauss", degree=degree, start=start)


def points(order: int = 4, degree: int = 2, history: str = "auto") -> Method:
    return Method(cq=f"bdf{order}", degree=degree, forcing_quadrature="exact", history=history)


def oscillators(
    dimension: int = 1,
    orders: tuple[float, ...] = (0.5,),
    *,
    coupled: str = "no",
    forcing: str | None = None,
) -> Scene:
    """Masses on springs: uncoupled, with common modes, or with a damper that spoils the modes."""
    unit = np.eye(dimension)
    neighbours = 2 * unit - np.eye(dimension, k=1) - np.eye(dimension, k=-1)
    stiffness = unit if coupled == "no" else neighbours
    matrix = np.diag(np.linspace(1.0, 2.0, dimension)) if coupled == "all" else unit
    return spring(
        *((order, (0.3 + 0.1 * place) * matrix) for place, order in enumerate(orders)),
        T=8.0,
        m=unit,
        k=stiffness,
        x=np.linspace(1.0, 0.5, dimension),
        v=np.zeros(dimension),
        forcing=None if forcing is None else Forcing.from_text(*[forcing] * dimension),
    )


def pendulum_of(order: float | None = 0.5) -> Scene:
    damping = [] if order is None else [FractionalDamping(order=order, coefficient=0.3)]
    return swing(T=8.0, x=1.0, damping=damping)


def rods() -> Scene:
    return double_pendulum(final_time=2.0, joints=[(0.5, 0.1)], initial_position=[0.3, -0.2])


LINEAR: list[tuple[str, Scene]] = [
    ("undamped", oscillators(orders=())),
    ("half", oscillators()),
    ("first order", oscillators(orders=(1.0,))),
    ("two terms", oscillators(orders=(0.5, 1.5))),
    ("first order and half", oscillators(orders=(1.0, 0.5))),
    ("forced", oscillators(forcing="sin(t)")),
    ("uncoupled", oscillators(5)),
    ("modes", oscillators(6, coupled="modes")),
    ("coupled", oscillators(4, (0.5, 1.5), coupled="all")),
    ("many uncoupled", oscillators(150)),
]
METHODS: list[Method] = [
    NODES,
    Method(cq="bdf3", degree=2, sampling="nodes"),
    points(),
    points(2, 1, "exponentials"),
    points(3, 2, "direct"),
    gauss(),
    gauss(3, "graded"),
    Method(cq="radau-iia", degree=2),
    Method(cq="bdf2", degree=1, start="weights", forcing_quadrature="exact"),
]


@spread(method=METHODS, **{"name, scene": LINEAR})
def test_operations_of_linear_scenes_are_those_counted(name, scene, method):
    several = (7, 16, 100, 257, 1024) if scene.dimension < 100 else (40, 300)
    for n_steps in several:
        trajectory = integrate(scene, method, n_steps)
        assert trajectory.status == "ok"
        assert plan_run(scene, method, n_steps).history_operations == (
            trajectory.history_operations
        ), n_steps


@spread(method=[NODES, points(), gauss(), gauss(3, "graded")], order=[None, 0.5, 1.0, 1.5])
def test_operations_of_nonlinear_scenes_do_not_depend_on_newton(order, method):
    scene = pendulum_of(order)
    for n_steps in (10, 100, 333, 1025):
        trajectory = integrate(scene, method, n_steps)
        assert trajectory.newton.iterations > 0
        planned = plan_run(scene, method, n_steps).history_operations
        assert planned == trajectory.history_operations, n_steps
    # a finer grid takes more iterations, a larger amplitude too; the memory does the same
    wide = swing(T=8.0, x=2.9, damping=scene.damping)
    assert integrate(wide, method, 333).history_operations == (
        integrate(scene, method, 333).history_operations
    )


def test_operations_of_general_lagrangians():
    for method in (gauss(), points(), gauss(2, "graded")):
        for n_steps in (20, 140):
            trajectory = integrate(rods(), method, n_steps)
            planned = plan_run(rods(), method, n_steps)
            assert planned.history_operations == trajectory.history_operations > 0


def test_operations_of_large_coupled_scenes():
    dimension = 140
    unit = np.eye(dimension)
    one = np.zeros((dimension, dimension))
    one[0, 0] = 1.0
    scene = spring(
        (0.5, one),
        T=2.0,
        m=unit,
        k=2 * unit - np.eye(dimension, k=1) - np.eye(dimension, k=-1),
        x=np.ones(dimension),
        v=np.zeros(dimension),
    )
    for n_steps in (40, 300):
        planned = plan_run(scene, gauss(), n_steps)
        counted = integrate(scene, gauss(), n_steps).history_operations
        assert planned.history_operations == counted > 0
        # only one component is damped, and only it is remembered
        assert counted < plan_run(oscillators(2), gauss(), n_steps).history_operations * 10
    # equations of all components are factorised once, with their zeros left out
    with patch.object(scipy.sparse.linalg, "splu", wraps=scipy.sparse.linalg.splu) as factorised:
        integrate(scene, gauss(), 40)
    assert factorised.call_count == 1
    assert "one factorisation" in plan_run(scene, gauss(), 40).steps


@spread(
    **{
        "name, newest, of_first_order": [
            ("explicit-euler", -1, (0, 0)),
            ("implicit-euler", 1, (0, 0)),
            ("gruenwald-letnikov", 1, (2, -1)),
            ("product-integration", -1, (1, 0)),
        ]
    },
    orders=[(), (1.0,), (0.5,), (0.5, 1.5)],
)
def test_operations_of_baselines(name, newest, of_first_order, orders):
    # sums over all earlier steps, with the newest or without; a stencil for order one
    scene = oscillators(2, orders)
    method: AnyMethod = Baseline(name=name)
    for n in (400, 1000):
        terms = [
            of_first_order[0] * n + of_first_order[1] if order == 1 else n * (n + newest) // 2
            for order in orders
        ]
        assert plan_run(scene, method, n).history_operations == 2 * sum(terms)
        assert integrate(scene, method, n).history_operations == 2 * sum(terms)


@spread(
    few=4,
    name=["explicit-euler", "implicit-euler", "gruenwald-letnikov", "product-integration"],
    orders=[(), (1.0,), (0.5,), (0.5, 1.5), (0.3, 1.0, 1.5)],
    dimension=[1, 6],
    forcing=[None, "sin(t)"],
)
def test_peak_memory_of_baselines_within_a_half(name, orders, dimension, forcing):
    scene, method = oscillators(dimension, orders, forcing=forcing), Baseline(name=name)
    integrate(scene, method, 32)
    planned = plan_run(scene, method, 1024).memory_bytes
    traced = most_memory(lambda: integrate(scene, method, 1024))
    assert planned == pytest.approx(traced, rel=0.5)


MEMORY = [
    ("nodes", oscillators(), NODES),
    ("points", oscillators(), points()),
    ("gauss2", oscillators(), gauss()),
    ("gauss3 with a graded start", oscillators(forcing="sin(t)"), gauss(3, "graded")),
    ("undamped", oscillators(orders=()), gauss()),
    ("first order", oscillators(orders=(1.0,)), NODES),
    ("uncoupled", oscillators(4), gauss()),
    ("coupled", oscillators(4, coupled="all"), gauss()),
    ("pendulum", pendulum_of(), gauss()),
    ("undamped pendulum", pendulum_of(None), gauss()),
    ("pendulum on nodes", pendulum_of(), NODES),
]


def most_memory(run: Callable[[], object]) -> int:
    """The bytes that are taken at once."""
    tracemalloc.start()
    run()
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most


@spread(few=5, n_steps=[4096, 5000, 2**14], **{"scene, method": [case[1:] for case in MEMORY]})
def test_peak_memory_within_a_third_of_what_is_traced(scene, method, n_steps):
    integrate(scene, method, 32)
    planned = plan_run(scene, method, n_steps).memory_bytes
    traced = most_memory(lambda: integrate(scene, method, n_steps))
    assert planned == pytest.approx(traced, rel=1 / 3)


@pytest.mark.parametrize(("masses", "n_steps"), [(3, 512), (8, 64), (8, 512)])
def test_tables_of_nonlinear_blocks_are_planned_to_a_tenth(masses, n_steps):
    names = [f"x{k}" for k in range(masses)]
    springs = [f"({a} - {b})**4/4" for a, b in itertools.pairwise(names)]
    energy = " - ".join([f"{name}**2/2" for name in names] + springs)
    scene = lagrangian_scene(
        final_time=2.0,
        coordinates=names,
        lagrangian=f"{' + '.join(f'v{name}**2/2' for name in names)} - {energy}",
        initial_position=[0.1] * masses,
    )
    integrate(scene, gauss(), 8)
    planned = plan_run(scene, gauss(), n_steps).memory_bytes
    traced = most_memory(lambda: integrate(scene, gauss(), n_steps))
    assert planned == pytest.approx(traced, rel=0.1)


class TestWords:
    def test_what_is_not_there_is_not_taken(self):
        plan = plan_run(oscillators(orders=()), gauss(2, "graded"), 1000)
        assert plan.history == "not needed: the scene has no damping"
        assert plan.forcing == "none"
        assert plan.n_directions == plan.history_operations == 0
        assert "1000 steps in all" in plan.start

    def test_terms_of_one_direction_share_their_sums(self):
        two = plan_run(oscillators(orders=(0.5, 1.5)), gauss(), 1000)
        one = plan_run(oscillators(), gauss(), 1000)
        assert two.n_directions == one.n_directions == 1
        # one response to the states of both, of which there are a few more for two orders
        assert one.history_operations <= two.history_operations < 1.1 * one.history_operations
        bdf = [plan_run(oscillators(orders=o), points(), 1000) for o in ((0.5,), (0.5, 1.5))]
        alone, both = (plan.history_operations for plan in bdf)
        assert 0 < alone <= both < 1.1 * alone

    def test_modes_and_components(self):
        assert "6 uncoupled modes" in plan_run(oscillators(6, coupled="m"), gauss(), 99).steps
        assert "5 uncoupled components" in plan_run(oscillators(5), gauss(), 99).steps
        assert "4 coupled" in plan_run(oscillators(4, coupled="all"), gauss(), 99).steps

    def test_the_start(self):
        plan = plan_run(oscillators(), gauss(3, "graded"), 1000)
        assert plan.start.startswith("steps behind singular points are halved again and again")
        assert plan_run(oscillators(), gauss(3), 1000).start == "no correction"

    def test_every_line_is_there(self):
        lines = plan_run(pendulum_of(), gauss(2, "graded"), 1000).lines()
        heads = [line.split(":")[0] for line in lines]
        assert heads[:5] == ["effects", "steps", "history", "start", "forcing"]
        assert "Newton" in lines[1]
        assert "about" in lines[-1]

    def test_memory_and_work_grow(self):
        small, large = (plan_run(oscillators(), gauss(), n) for n in (2**10, 2**18))
        assert large.memory_bytes > 2 * small.memory_bytes
        assert large.work > 10 * small.work > 0


def different(count: int, forcing: str | None = None) -> list[Scene]:
    return [
        spring(
            (0.5, 0.3),
            T=8.0,
            k=1.0 + 0.1 * place,
            x=1.0,
            forcing=None if forcing is None else Forcing.from_text(forcing),
        )
        for place in range(count)
    ]


MEMBER_METHODS = [gauss(), gauss(3, "graded"), NODES, points()]


class TestMembers:
    @spread(method=MEMBER_METHODS, count=[4, 20, 150])
    def test_operations_of_each_are_those_counted(self, count, method):
        scenes = different(count)
        together = companions(scenes, method, 300)
        assert together == [count] * count
        planned = plan_run(scenes[0], method, 300, members=count)
        for found in integrate_members(scenes, method, 300):
            assert found.history_operations == planned.history_operations
        assert planned.systems == count

    @pytest.mark.parametrize("orders", [(0.5, 1.5), (1.0, 0.5)])
    def test_terms_of_one_direction(self, orders):
        scenes = [oscillators(orders=orders, forcing=f"{k} * sin(t)") for k in range(20)]
        for method in (NODES, points()):
            planned = plan_run(scenes[0], method, 300, members=20)
            assert planned.n_directions == 1
            for found in integrate_members(scenes, method, 300):
                assert found.history_operations == planned.history_operations

    def test_members_that_do_not_go_together_are_planned_alone(self):
        scenes = [*different(3), pendulum_of(), oscillators(2), *different(2)]
        assert companions(scenes, gauss(), 300) == [5, 5, 5, 1, 1, 5, 5]
        # seven pendulums are quicker one by one
        pendulum = pendulum_of()
        assert plan_run(pendulum, gauss(), 300, members=7) == plan_run(pendulum, gauss(), 300)
        assert companions(scenes, points(history="direct"), 300) == [1] * len(scenes)

    def test_many_members_take_other_blocks_than_one(self):
        scene = different(1)[0]
        alone, together = (plan_run(scene, NODES, 4096, members=k).mesh for k in (1, 100))
        assert alone.block > together.block > 1
        assert alone.operations == together.operations

    @pytest.mark.few(1)
    @pytest.mark.parametrize("method", MEMBER_METHODS, ids=lambda method: method.case)
    def test_peak_memory_of_all(self, method):
        scenes = different(60)
        integrate_members(scenes, method, 32)
        planned = plan_run(scenes[0], method, 4096, members=60).memory_bytes
        traced = most_memory(lambda: integrate_members(scenes, method, 4096))
        assert planned == pytest.approx(traced, rel=0.25)


class TestDiagnosed:
    BALANCE = DiagnosticsRequest(energy_balance=True)

    @spread(
        scene=[oscillators(), oscillators(3, coupled="all"), oscillators(orders=()), pendulum_of()],
        method=MEMBER_METHODS,
    )
    def test_operations_are_those_counted(self, scene, method):
        found = integrate(scene, method, 300, diagnostics=self.BALANCE)
        planned = plan_run(scene, method, 300, is_diagnosed=True)
        assert found.history_operations == planned.history_operations

    @pytest.mark.parametrize("method", [gauss(), points()])
    def test_general_lagrangians(self, method):
        scene = rods()
        found = integrate(scene, method, 300, diagnostics=self.BALANCE)
        planned = plan_run(scene, method, 300, is_diagnosed=True)
        assert found.history_operations == planned.history_operations
        alone = plan_run(scene, method, 300)
        assert planned.history_operations == alone.history_operations
        assert planned.steps == alone.steps

    @pytest.mark.few(1)
    @pytest.mark.parametrize("dimension", [3, 12])
    @pytest.mark.parametrize("stages", [3, 4])
    def test_peak_memory_of_many_stages(self, dimension, stages):
        self.test_peak_memory(oscillators(dimension), gauss(stages))

    @spread(few=2, method=MEMBER_METHODS, scene=[oscillators(), pendulum_of()])
    def test_peak_memory(self, scene, method):
        integrate(scene, method, 32, diagnostics=self.BALANCE)
        planned = plan_run(scene, method, 4096, is_diagnosed=True).memory_bytes
        traced = most_memory(lambda: integrate(scene, method, 4096, diagnostics=self.BALANCE))
        assert planned == pytest.approx(traced, rel=0.25)
