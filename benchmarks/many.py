"""How long many oscillators take in terms of one alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchmarks.measuring import in_own_process, least_seconds, number, table, yes_or_no
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.observe import integrate_requested
from fvi_cli.integrator.observations.observer import Pair
from fvi_cli.integrator.observations.request import observations
from fvi_cli.scenes.chains import chain
from fvi_cli.scenes.data import linear_oscillator, pendulum

Kind = Literal[
    "members", "pendulums", "output", "pendulum output", "uncoupled", "dampers", "one damper"
]

COUNT = 1000
"""Oscillators, or masses of a chain, with the usual exponent of 20."""
LONGEST = 12
"""They take at most 2 to this power steps."""
MOST_PENDULUM_STEPS = 2**10
ORDER, FINAL_TIME = 0.5, 20.0
REPEATS_ALONE = 9


@dataclass(frozen=True, kw_only=True)
class ManyCase:
    """Many components by one method, and how long they may take.

    Parameters
    ----------
    name
        In words.
    kind
        ``members``: scenes of their own in one batch; ``pendulums``: nonlinear ones in at most
        1024 steps; ``output``, ``pendulum output``: these at 200 times between the points, to be
        compared with the batch without; ``uncoupled``: the oscillators as one scene;
        ``dampers``: a chain with a damper beside every spring (modes); ``one damper``: a chain
        with a damper at its free end (no modes).
    start
        The method's start.
    largest_each
        Time of each component over that of one alone, at most.
    """

    name: str
    kind: Kind
    start: Literal["none", "graded"]
    largest_each: float


@dataclass(frozen=True, kw_only=True)
class ManyRow:
    """What was measured: set-up and steps together.

    Parameters
    ----------
    name, n_steps, count
        The case, N, and the number of components.
    alone_seconds, together_seconds
        One component alone, the least time of several runs, or the batch without output; all of
        them, of two.
    difference
        Largest difference of a component from what another route gives, over the largest
        position: members alone, chains with fewer steps by written-out sums.
    history_operations
        Multiply-adds spent on the memory of all components.
    largest_each
        The figure to meet.
    """

    name: str
    n_steps: int
    count: int
    alone_seconds: float
    together_seconds: float
    difference: float
    history_operations: int
    largest_each: float

    @property
    def multiple(self) -> float:
        """Time of all over that of one."""
        return self.together_seconds / self.alone_seconds

    @property
    def is_met(self) -> bool:
        """Whether the figure holds."""
        return self.multiple <= self.largest_each * self.count


def many_table(rows: Sequence[ManyRow]) -> str:
    """The table."""
    return table(
        "Set-up and steps together, in one process; difference: of a component from what another "
        "route gives, over the largest position. With output the batch is compared with itself "
        "without, in the same process.",
        (
            "case (Gauss2, gamma = 0.5)",
            "components",
            "N",
            "one or without output, ms",
            "all, s",
            "ratio",
            "at most",
            "difference",
            "met",
        ),
        [
            (
                row.name,
                str(row.count),
                str(row.n_steps),
                f"{1e3 * row.alone_seconds:.1f}",
                f"{row.together_seconds:.2f}",
                f"{row.multiple:.3g}",
                number(row.largest_each * row.count, ".3g"),
                f"{row.difference:.1e}",
                yes_or_no(row.is_met),
            )
            for row in rows
        ],
    )


def many_cases() -> tuple[ManyCase, ...]:
    """The figures: a batch at a quarter of the time of one by one, chains at most five times it."""
    return (
        ManyCase(name="oscillators, one batch", kind="members", start="none", largest_each=0.25),
        ManyCase(name="pendulums, one batch", kind="pendulums", start="none", largest_each=0.35),
        ManyCase(
            name="oscillators, one batch, graded start",
            kind="members",
            start="graded",
            largest_each=0.25,
        ),
        ManyCase(
            name="oscillators, with / without output",
            kind="output",
            start="none",
            largest_each=1.5 / COUNT,
        ),
        ManyCase(
            name="pendulums, with / without output",
            kind="pendulum output",
            start="none",
            largest_each=1.5 / COUNT,
        ),
        ManyCase(name="oscillators, one scene", kind="uncoupled", start="none", largest_each=0.25),
        ManyCase(
            name="chain, a damper beside every spring",
            kind="dampers",
            start="none",
            largest_each=5.0,
        ),
        ManyCase(
            name="chain, one damper at its end", kind="one damper", start="none", largest_each=5.0
        ),
    )


def run_many(exponent: int) -> list[ManyRow]:
    """Measure every case in a process of its own; below 2^20 steps with fewer components."""
    count = min(COUNT, max(8, COUNT * 2**exponent // 2**20))
    n_steps = 2 ** min(LONGEST, exponent)
    return [in_own_process(measure_many, case, count, n_steps) for case in many_cases()]


def measure_many(case: ManyCase, count: int, n_steps: int) -> ManyRow:
    """Measure one case in this process."""
    method = Method(cq="gauss", degree=2, start=case.start)
    members = oscillators(count)
    if case.kind in ("pendulums", "pendulum output"):
        n_steps, members = min(n_steps, MOST_PENDULUM_STEPS), pendulums(count)
    alone = least_seconds(lambda: integrate(members[0], method, n_steps), REPEATS_ALONE)
    if case.kind in ("output", "pendulum output"):
        alone = least_seconds(lambda: integrate_members(members, method, n_steps), 2)
        request = observations(("x",), output=np.linspace(0.05, FINAL_TIME, 200))
        asked = [request] * count

        def observe() -> list[Pair]:
            return integrate_requested(members, method, [n_steps] * count, asked)

        together = least_seconds(observe, 2)
        on_mesh, at_times = observe()[-1]
        ((_, last),) = integrate_requested(members[-1:], method, [n_steps], [request])
        difference = _relative(at_times.position, last.position)
        operations = count * on_mesh.history_operations
    elif case.kind in ("members", "pendulums"):
        together = least_seconds(lambda: integrate_members(members, method, n_steps), 2)
        found = integrate_members(members, method, n_steps)
        single = integrate(members[-1], method, n_steps).position
        difference = _relative(found[-1].position, single)
        operations = sum(one.history_operations for one in found)
    else:
        scene = joined(members) if case.kind == "uncoupled" else damped_chain(case.kind, count)
        together = least_seconds(lambda: integrate(scene, method, n_steps), 2)
        whole = integrate(scene, method, n_steps)
        operations = whole.history_operations
        if case.kind == "uncoupled":
            single = integrate(members[-1], method, n_steps).position
            difference = _relative(whole.position[:, -1:], single)
        else:
            few = min(n_steps, 64)
            times = scene.final_time / few * np.arange(few + 1)
            times[-1] = scene.final_time
            one_by_one = integrate(scene, method, mesh_of(np.asarray(times, dtype=float)))
            difference = _relative(integrate(scene, method, few).position, one_by_one.position)
    return ManyRow(
        name=case.name,
        n_steps=n_steps,
        count=count,
        alone_seconds=alone,
        together_seconds=together,
        difference=difference,
        history_operations=operations,
        largest_each=case.largest_each,
    )


def oscillators(count: int) -> list[Scene]:
    """Oscillators with stiffness, damping and start values of their own."""
    rng = np.random.default_rng(0)
    return [
        linear_oscillator(
            final_time=FINAL_TIME,
            stiffness=rng.uniform(0.5, 4.0),
            damping=[
                FractionalDamping(order=ORDER, coefficient=rng.uniform(0.05, 1.0) * np.eye(1))
            ],
            initial_position=rng.normal(),
            initial_velocity=rng.normal(),
        )
        for _ in range(count)
    ]


def pendulums(count: int) -> list[Scene]:
    """Pendulums of lengths, damping and start values of their own."""
    rng = np.random.default_rng(1)
    return [
        pendulum(
            final_time=FINAL_TIME,
            omega=rng.uniform(0.5, 2.0),
            damping=[FractionalDamping(order=ORDER, coefficient=rng.uniform(0.05, 1.0))],
            initial_position=rng.normal(),
            initial_velocity=rng.normal(),
        )
        for _ in range(count)
    ]


def joined(members: Sequence[Scene]) -> Scene:
    """One scene of uncoupled components, each of them a member."""
    stiffness = [
        float(m.potential.hessian(m.initial_position)[0, 0]) for m in members if m.potential
    ]
    coefficients = [float(member.damping[0].matrix[0, 0]) for member in members]
    return linear_oscillator(
        final_time=FINAL_TIME,
        mass=np.eye(len(members)),
        stiffness=np.diag(stiffness),
        damping=[FractionalDamping(order=ORDER, coefficient=np.diag(coefficients))],
        initial_position=np.concatenate([member.initial_position for member in members]),
        initial_velocity=np.concatenate([member.initial_velocity for member in members]),
    )


def damped_chain(kind: Kind, masses: int) -> Scene:
    """A chain between walls with a damper beside every spring, or with one at its last mass."""
    shape = np.sin(np.pi * np.arange(1, masses + 1) / (masses + 1))
    if kind == "dampers":
        return chain(
            final_time=FINAL_TIME, masses=masses, dampers=[(ORDER, 0.2)], initial_position=shape
        )
    coefficient = np.zeros((masses, masses))
    coefficient[-1, -1] = 0.2
    return chain(
        final_time=FINAL_TIME,
        masses=masses,
        damping=[FractionalDamping(order=ORDER, coefficient=coefficient)],
        initial_position=shape,
    )


def _relative(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())
