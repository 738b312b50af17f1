"""What is predicted of a run is what is observed, on random linear scenes and methods."""

from dataclasses import replace

import numpy as np
import pytest
from letters import spring

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.prediction import predict_stability

FEWEST_STEPS = 2000


def random_matrix(random: np.random.Generator, dimension: int, size: float) -> np.ndarray:
    """A positive semi-definite matrix of this size."""
    root = random.standard_normal((dimension, dimension))
    matrix = root @ root.T
    return size * matrix / np.abs(matrix).max()


def random_case(random: np.random.Generator) -> tuple[Scene, Method]:
    """A dissipative linear scene with step size 1, and a method of any family."""
    family = str(random.choice(["nodes", "points", "gauss", "lobatto-iiic"]))
    if family in ("nodes", "points"):
        order, degree = int(random.integers(1, 7)), int(random.integers(1, 4))
        method = Method(cq=f"bdf{order}", degree=degree, sampling=family)
    else:
        method = Method(cq=family, degree=int(random.integers(1, 5)))
    dimension = int(random.choice([1, 1, 1, 2]))
    damping = [
        FractionalDamping(
            order=float(random.uniform(0.05, 1.95)),
            coefficient=random_matrix(random, dimension, 10 ** random.uniform(-2, 2)),
        )
        for _ in range(int(random.choice([1, 1, 2])))
    ]
    scene = spring(
        T=float(FEWEST_STEPS),
        m=np.eye(dimension),
        k=random_matrix(random, dimension, 10 ** random.uniform(-2, 4)),
        x=np.zeros(dimension),
        v=np.zeros(dimension),
        damping=damping,
    )
    return scene, method


def observed_growth(
    scene: Scene, method: Method, n_steps: int, random: np.random.Generator
) -> float:
    """Largest position in the last over that in the first quarter, from random data."""
    position, momentum = random.standard_normal((2, scene.dimension))
    with np.errstate(all="ignore"):
        # the mass is one
        moved = replace(scene, initial_position=position, initial_velocity=momentum)
        position = np.abs(integrate(moved, method, n_steps).position)
    if position.shape[0] <= n_steps or not np.isfinite(position).all():
        return float("inf")
    quarter = n_steps // 4
    return float(position[-quarter:].max() / position[:quarter].max())


def contradictions(seed: int, count: int) -> tuple[list[str], dict[str, int]]:
    """Cases in which prediction and observation differ, and how often each was predicted."""
    random = np.random.default_rng(seed)
    wrong: list[str] = []
    verdicts = {"stable": 0, "unstable": 0, "unknown": 0}
    for _ in range(count):
        scene, method = random_case(random)
        growth = predict_stability(scene, method, FEWEST_STEPS).growth_per_step
        # twenty times e, so that a mode that grows is seen, however slowly
        n_steps = max(FEWEST_STEPS, int(20 / growth)) if growth > 0 else FEWEST_STEPS
        scene = replace(scene, final_time=float(n_steps))
        prediction = predict_stability(scene, method, n_steps)
        verdicts[prediction.verdict] += 1
        if prediction.verdict == "unstable" and method.cq == "gauss":
            wrong.append(f"{method.case}: {prediction}")
        ratio = observed_growth(scene, method, n_steps, random)
        if (ratio > 1e3) != (prediction.verdict == "unstable"):
            wrong.append(f"{method.case}, {scene.damping}: {prediction}, but {ratio:.3g}")
    return wrong, verdicts


@pytest.mark.parametrize(
    ("seed", "count"), [(20, 20), pytest.param(7, 2000, marks=pytest.mark.slow)]
)
def test_what_is_predicted_is_observed(seed, count):
    wrong, verdicts = contradictions(seed, count)
    assert not wrong
    assert verdicts["unknown"] == 0
    assert min(verdicts["stable"], verdicts["unstable"]) >= count // 5


def test_a_wrong_prediction_would_be_noticed():
    # the control: one order more in the prediction than in the run
    random = np.random.default_rng(3)
    scene = spring((1.5, np.array([[0.04]])), T=2000.0, k=0.1, x=0.0, v=0.0)
    run_by, predicted_for = (Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in (5, 6))
    assert predict_stability(scene, run_by, 2000).verdict == "stable"
    assert predict_stability(scene, predicted_for, 2000).verdict == "unstable"
    assert observed_growth(scene, run_by, 2000, random) < 1e3
    assert observed_growth(scene, predicted_for, 2000, random) > 1e3
