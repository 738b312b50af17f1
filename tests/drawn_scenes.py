"""Scenes of every kind that the engine steps, their numbers drawn.

What decides which scenes may be stepped together (orders, derivative, breaks of the force) is
drawn by one generator, what distinguishes the members of a sweep by another.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from letters import spring, swing
from scipy.sparse import csr_array

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws import Law, fractional_zener, prony
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.scenes.data import duffing
from fvi_cli.scenes.lagrangian import double_pendulum, lagrangian_scene

Array = np.ndarray
Rng = np.random.Generator

ORDERS = (0.07, 0.3, 0.5, 0.8, 0.95, 1.0, 1.1, 1.25, 1.5, 1.75, 1.9)
SIZES = (0.02, 0.4, 3.0)
LARGE = 90
"""Degrees of freedom of structures whose matrices are dense or sparse."""


def positive(rng: Rng, d: int, least: float, most: float) -> Array:
    """A symmetric matrix with eigenvalues between the two."""
    rotation = np.linalg.qr(rng.normal(size=(d, d)))[0]
    matrix = rotation @ np.diag(rng.uniform(least, most, d)) @ rotation.T
    return 0.5 * (matrix + matrix.T)


def second_differences(d: int) -> Array:
    return 2 * np.eye(d) - np.eye(d, k=1) - np.eye(d, k=-1)


@dataclass(frozen=True, kw_only=True)
class Shape:
    """What the members of a sweep have in common.

    Parameters
    ----------
    d, final_time, n_steps
        Degrees of freedom, T and N.
    orders, derivative
        Of the damping; those above 1 begin at 0 under Riemann-Liouville.
    size
        How strong it is.
    breaks
        After which steps the force is another one; None without a force.
    scale
        Of the motion, where the scene is linear.
    """

    d: int
    final_time: float
    n_steps: int
    orders: tuple[float, ...]
    derivative: str
    size: float
    breaks: tuple[int, ...] | None
    scale: float


def shape_of(kind: str, rng: Rng, n_steps: int) -> Shape:
    several = {"coupled", "modes", "uncoupled"}
    orders = tuple(float(one) for one in rng.choice(ORDERS, int(rng.integers(0, 4)), replace=False))
    forced = int(rng.integers(3))
    return Shape(
        d=int(rng.integers(2, 6)) if kind in several else DIMENSIONS.get(kind, 1),
        # on long steps the equations of a double pendulum have several solutions
        final_time=float(rng.uniform(1.0, 3.0 if kind == "double pendulum" else 8.0)),
        n_steps=n_steps,
        orders=orders or ((0.5,) if kind in LAWS else ()),
        derivative="riemann-liouville" if rng.random() < 0.3 and kind not in LAWS else "caputo",
        size=0.3 if kind == "growing" else float(rng.choice(SIZES)),
        breaks=None if not forced else () if forced == 1 else (int(rng.integers(1, n_steps)),),
        scale=float(10.0 ** rng.uniform(-3, 3)) if kind in LINEAR else 1.0,
    )


def force_of(shape: Shape, rng: Rng) -> Forcing:
    def piece(amplitude: float) -> ForcingPiece:
        shapes = ("cos({}*t)", "t", "sqrt(t)*cos({}*t)") if shape.d < LARGE else ("cos({}*t)",)
        texts = [
            f"{shape.scale * amplitude * rng.uniform(-1, 1)!r}*"
            + shapes[k % len(shapes)].format(k % 7 + 1)
            for k in range(shape.d)
        ]
        return Forcing.from_text(*texts).pieces[0]

    h = shape.final_time / shape.n_steps
    pieces = [replace(piece(0.6), until=h * end) for end in shape.breaks or ()]
    return Forcing(pieces=(*pieces, piece(1.0)))


def scene_of(kind: str, shape: Shape, rng: Rng) -> Scene:
    """A member of a kind and a shape."""
    d = shape.d
    of_mass = kind in ("modes", "double pendulum")
    damping = []
    for order in shape.orders:
        matrix = np.eye(d) * rng.uniform(0.5, 1.0) if of_mass else positive(rng, d, 0.1, 1.0)
        matrix = np.diag(np.diagonal(matrix)) if kind == "uncoupled" else matrix
        if kind == "few dampers":
            matrix = np.diag([1.0 if place in (5, LARGE - 20) else 0.0 for place in range(d)])
        damping.append(FractionalDamping(order=order, coefficient=shape.size * matrix))
    still = shape.derivative != "caputo" and any(order > 1 for order in shape.orders)
    data = {
        "final_time": shape.final_time,
        "damping": damping,
        "initial_position": np.zeros(d) if still else 0.7 * shape.scale * rng.normal(size=d),
        "initial_velocity": shape.scale * rng.normal(size=d),
        "derivative": shape.derivative,
    }
    if shape.breaks is not None:
        data["forcing"] = force_of(shape, rng)
    scene = KINDS[kind](shape, rng, data)
    return replace(scene, laws=(LAWS[kind](rng),)) if kind in LAWS else scene


def matrices(mass: Array, stiffness: Array, data: dict) -> Scene:
    return spring(m=mass, k=stiffness, **data)


def hard_springs(shape: Shape, data: dict) -> Scene:
    """Hard springs between unit masses."""
    names = [f"q{k}" for k in range(shape.d)]
    kinetic = " + ".join(f"v{name}**2/2" for name in names)
    springs = " + ".join(
        f"(({a})-({b}))**2/2 + (({a})-({b}))**4/4"
        for a, b in zip(["0", *names], [*names, "0"], strict=True)
    )
    return lagrangian_scene(coordinates=names, lagrangian=f"{kinetic} - ({springs})", **data)


def rider(data: dict) -> Scene:
    lagrangian = "vx**2*(1 + x*x)/2 - x**2/2 - x**4/8"
    return lagrangian_scene(coordinates=("x",), lagrangian=lagrangian, **data)


def oscillator(rng: Rng, data: dict) -> Scene:
    return spring(m=rng.uniform(0.5, 2.0), k=float(10 ** rng.uniform(-1, 3)), **data)


LAWS: dict[str, Callable[[Rng], Law]] = {
    "zener": lambda rng: fractional_zener(
        order=0.6,
        time=rng.uniform(0.2, 0.4),
        relaxed=0.5,
        unrelaxed=2.0,
        coefficient=rng.uniform(0.2, 2.0),
    ),
    "prony": lambda rng: prony(
        moduli=[1.0, rng.uniform(0.2, 2.0)], times=[0.2, 2.0], coefficient=1.0
    ),
}
KINDS: dict[str, Callable[[Shape, Rng, dict], Scene]] = {
    "oscillator": lambda shape, rng, data: oscillator(rng, data),
    **dict.fromkeys(LAWS, lambda shape, rng, data: oscillator(rng, data)),
    "growing": lambda shape, rng, data: spring(k=-float(rng.uniform(0.1, 4.0)), **data),
    "coupled": lambda shape, rng, data: matrices(
        positive(rng, shape.d, 0.5, 2.0), positive(rng, shape.d, 0.2, 30.0), data
    ),
    "modes": lambda shape, rng, data: matrices(
        np.eye(shape.d), positive(rng, shape.d, 0.2, 30.0), data
    ),
    "uncoupled": lambda shape, rng, data: matrices(
        np.diag(rng.uniform(0.5, 2.0, shape.d)), np.diag(rng.uniform(0.2, 30.0, shape.d)), data
    ),
    **dict.fromkeys(
        ("structure", "few dampers"),
        lambda shape, rng, data: matrices(
            np.diag(rng.uniform(0.5, 2.0, shape.d)), 100 * second_differences(shape.d), data
        ),
    ),
    "pendulum": lambda shape, rng, data: swing(omega=rng.uniform(0.5, 3.0), **data),
    "duffing": lambda shape, rng, data: duffing(stiffness=float(rng.choice([-1.0, 1.0])), **data),
    "chain of five": lambda shape, rng, data: hard_springs(shape, data),
    "double pendulum": lambda shape, rng, data: double_pendulum(**data),
    "rider": lambda shape, rng, data: rider(data),
}
DIMENSIONS = {"chain of five": 5, "double pendulum": 2, "structure": LARGE, "few dampers": LARGE}
GENERAL = ("chain of five", "double pendulum", "rider")
NONLINEAR = ("pendulum", "duffing", *GENERAL)
LINEAR = tuple(kind for kind in KINDS if kind not in NONLINEAR)
STRUCTURES = ("structure", "few dampers")


def sparse(scene: Scene) -> Scene:
    """The same linear scene by sparse matrices."""
    return replace(
        scene,
        inertia=Inertia(mass=csr_array(scene.inertia.mass)),
        potential=QuadraticPotential(stiffness=csr_array(scene.potential.stiffness)),
        damping=tuple(
            FractionalDamping(order=term.order, coefficient=csr_array(term.coefficient))
            for term in scene.damping
        ),
    )
