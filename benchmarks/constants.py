"""What the constants that steer time are worth: each is halved and doubled on the same runs."""

from __future__ import annotations

import ast
import contextlib
import importlib
import inspect
import math
import pkgutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

import fvi_cli.integrator
from benchmarks.measuring import number, table
from fvi_cli.api import gradient
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.quantity import position_at
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.limits import largest_stable_step
from fvi_cli.integrator.stability.region import stability_map
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.chains import chain
from fvi_cli.scenes.named import linear_oscillator, pendulum
from fvi_cli.studies.cost import forget

ENGINE = "fvi_cli.integrator."
TIMED: Mapping[str, tuple[str, ...]] = {
    "engine.algebra": ("LARGEST_INVERSE", "FEW"),
    "engine.blocks": (
        "STEPS_OF_LINEAR",
        "STEPS_OF_NEWTON",
        "SIZE_OF_LINEAR",
        "SIZE_OF_NEWTON",
        "SIZE_IN_BATCH",
        "CACHE",
        "LEAST",
        "NEWTON_REUSE",
        "GENERAL_REUSE",
        "PATIENCE",
        "USUAL",
        "EXCESS",
        "QUICK",
    ),
    "engine.engine": ("KEPT_TABLES", "OFTEN"),
    "engine.recurrence": ("LARGEST_STATE", "LEAST_BLOCKS", "LARGE_STATE", "STEPS_OF_LARGE"),
    "engine.structures": ("GROUP", "LARGEST_DENSE", "LEAST_BLOCK", "KEPT", "KEPT_UNKNOWNS"),
    "loop.loop": ("CHUNK", "LARGEST_CHUNK"),
    "loop.recorder": ("WAITING",),
    "memory.exponentials": ("STEPS_KEPT",),
    "damping.damping": ("LEAST_BLOCK_STEPS",),
    "damping.damper_forces": ("PIECE",),
    "gradients.linearised": ("LARGEST_STEP", "LARGEST_BLOCK", "AT_ONCE"),
    "gradients.past": ("EQUAL_STEPS",),
    "members": ("LARGEST_STEP", "FEWEST_LINEAR", "MOST_TOGETHER"),
    "stability.determinants": ("ENTRIES_AT_ONCE",),
    "stability.growing_modes": ("FEW",),
    "stability.limits": ("BLOCK",),
}
"""By module: what is swept. All others steer results, or say how much is looked at."""

FACTORS = (0.5, 2.0)
NOTABLE = 1.05
"""Ratio of two times that is more than the noise of a quiet machine."""
ALIKE = 1e-9
"""Relative difference of results up to which a constant steers time alone."""
REPEATS = 5

GAUSS = Method(cq="gauss", degree=3)
POINTS = Method(cq="bdf3", degree=2, sampling="points")
HALF = (FractionalDamping(order=0.5, coefficient=0.3 * np.eye(1)),)

Workload = Callable[[], Array]


@dataclass(frozen=True, kw_only=True)
class Constant:
    """A number of a module, by name."""

    module: ModuleType
    name: str

    @property
    def value(self) -> float:
        """As it is now."""
        found = getattr(self.module, self.name)
        if isinstance(found, bool) or not isinstance(found, int | float):
            raise TypeError(f"{self}: {found!r} is no number")
        return found

    def __str__(self) -> str:
        """Without the package."""
        return f"{self.module.__name__.removeprefix(ENGINE)}.{self.name}"

    @contextlib.contextmanager
    def scaled(self, factor: float) -> Iterator[None]:
        """Everywhere that number times a factor, and nothing kept from before."""
        value = self.value
        other = max(1, round(value * factor)) if isinstance(value, int) else value * factor
        homes = [
            one
            for name, one in list(sys.modules.items())
            if name.startswith("fvi_cli.") and (one is self.module or self._is_imported(one))
        ]
        forget()
        for home in homes:
            setattr(home, self.name, other)
        try:
            yield
        finally:
            for home in homes:
                setattr(home, self.name, value)
            forget()

    def _is_imported(self, other: ModuleType) -> bool:
        """Whether another module has this name, and has it from here."""
        return self.name in vars(other) and any(
            isinstance(node, ast.ImportFrom)
            and node.module == self.module.__name__
            and any(alias.name == self.name for alias in node.names)
            for node in ast.walk(ast.parse(inspect.getsource(other)))
        )


@dataclass(frozen=True, kw_only=True)
class ConstantRow:
    """What one factor makes of one constant.

    Parameters
    ----------
    constant, value, factor
        Its name, what it is, and what it is multiplied by.
    ratios
        Time with the other value over that with this one, by workload.
    change
        Largest relative change of a result.
    """

    constant: str
    value: float
    factor: float
    ratios: Mapping[str, float]
    change: float

    @property
    def mean(self) -> float:
        """Geometric mean of the ratios."""
        return math.exp(sum(map(math.log, self.ratios.values())) / len(self.ratios))


def timed_constants() -> list[Constant]:
    """All of :data:`TIMED`."""
    return [
        Constant(module=importlib.import_module(ENGINE + module), name=name)
        for module, names in TIMED.items()
        for name in names
    ]


def other_constants() -> int:
    """How many other numbers the modules of the integrator name."""
    modules = [one.name for one in pkgutil.walk_packages(fvi_cli.integrator.__path__, ENGINE)]
    count = 0
    for name in modules:
        module = importlib.import_module(name)
        for node in ast.parse(inspect.getsource(module)).body:
            targets = [
                one.id
                for target in (node.targets if isinstance(node, ast.Assign) else [])
                for one in ast.walk(target)
                if isinstance(one, ast.Name) and one.id.isupper()
            ]
            values = (getattr(module, one) for one in targets)
            count += sum(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    return count - sum(map(len, TIMED.values()))


def workloads(exponent: int = 12) -> dict[str, Workload]:
    """Runs of every kind; linear ones take 2^exponent steps, others fewer."""
    n = 2**exponent
    few = max(8, n // 16)
    linear = linear_oscillator(final_time=n / 50, damping=HALF, initial_position=1.0)
    swinging = pendulum(final_time=n / 100, damping=HALF, initial_position=1.0)
    dampers = chain(
        masses=32, final_time=n / 50, dampers=((0.5, 0.1),), initial_position=np.ones(32)
    )
    coupled, large = (_tied(masses, few / 50) for masses in (24, 100))
    short = replace(swinging, final_time=few / 100)
    many = [_moved(swinging, place) for place in np.linspace(0.5, 1.5, 64)]
    grid = np.geomspace(1e-2, 1e3, 24)

    def end(scene: Scene, method: Method, steps: int | AdaptiveSteps) -> Array:
        last: Array = integrate(scene, method, steps).position[-1]
        return last

    return {
        "linear": lambda: end(linear, GAUSS, n),
        "linear, backward differences": lambda: end(linear, POINTS, n),
        "modes of a chain": lambda: end(dampers, GAUSS, n // 4),
        "chain with one damper": lambda: end(coupled, GAUSS, few),
        "100 masses with one damper": lambda: end(large, GAUSS, few // 4),
        "pendulum": lambda: end(swinging, GAUSS, n // 4),
        "pendulum, backward differences": lambda: end(swinging, POINTS, n // 4),
        "pendulum, adaptive": lambda: end(short, GAUSS, AdaptiveSteps(tolerance=1e-6)),
        "64 pendulums": lambda: np.concatenate(
            [one.position[-1] for one in integrate_members(many, GAUSS, few)]
        ),
        "64 oscillators": lambda: np.concatenate(
            [
                one.position[-1]
                for one in integrate_members(
                    [_moved(linear, place) for place in np.linspace(0.5, 1.5, 64)], GAUSS, few
                )
            ]
        ),
        "gradient": lambda: _flat(gradient(swinging, GAUSS, few, position_at(1.0)).derivatives),
        "largest stable step": lambda: np.array([largest_stable_step(linear, POINTS) or 0.0]),
        "stability region": lambda: stability_map(POINTS, 0.5, grid, grid).level.astype(float),
    }


def _tied(masses: int, final_time: float) -> Scene:
    """A chain with a damper at its free end: no modes."""
    place = np.diag((np.arange(masses) == masses - 1).astype(float))
    return chain(
        masses=masses,
        ends="left",
        final_time=final_time,
        initial_position=np.ones(masses),
        damping=(FractionalDamping(order=0.5, coefficient=place),),
    )


def _flat(numbers: Mapping[str, float | Array]) -> Array:
    return np.concatenate([np.ravel(one) for one in numbers.values()])


def _moved(scene: Scene, place: float) -> Scene:
    return replace(scene, initial_position=np.full(scene.dimension, place))


def run_constants(
    constants: Sequence[Constant] | None = None,
    actions: Mapping[str, Workload] | None = None,
    repeats: int = REPEATS,
    clock: Callable[[], float] = time.process_time,
) -> list[ConstantRow]:
    """Sweep every constant on every workload, both values in turn in this process."""
    actions = workloads() if actions is None else actions
    rows = []
    for constant in timed_constants() if constants is None else constants:
        for factor in FACTORS:
            measured = {
                name: _compared(constant, factor, action, repeats, clock)
                for name, action in actions.items()
            }
            rows.append(
                ConstantRow(
                    constant=str(constant),
                    value=constant.value,
                    factor=factor,
                    ratios={name: ratio for name, (ratio, _) in measured.items()},
                    change=max(change for _, change in measured.values()),
                )
            )
    return rows


def _compared(
    constant: Constant, factor: float, action: Workload, repeats: int, clock: Callable[[], float]
) -> tuple[float, float]:
    """Ratio of least times, and how far the results differ."""
    least = [math.inf, math.inf]
    results = [np.empty(0), np.empty(0)]
    for _ in range(repeats):
        for index, part in enumerate((1.0, factor)):
            with constant.scaled(part):
                began = clock()
                results[index] = action()
                least[index] = min(least[index], clock() - began)
    largest = float(np.abs(results[0]).max(initial=0.0))
    difference = float(np.abs(results[1] - results[0]).max(initial=0.0))
    return least[1] / least[0], difference / largest if largest else difference


def constants_table(rows: Sequence[ConstantRow], others: int) -> str:
    """Markdown: the times, and whether another value would be better."""
    names = {row.constant for row in rows}
    felt = sum(
        any(_is_notable(ratio) for row in rows if row.constant == name
            for ratio in row.ratios.values())
        for name in names
    )  # fmt: skip
    remark = (
        f"{len(names)} constants of the integrator steer time, and {others} other numbers have a "
        f"name. Each is halved and doubled on {len(rows[0].ratios)} runs, both values in turn in "
        f"one process, everything made anew; told is the processor time with the other value over "
        f"that with this one. {felt} of them are felt by more than "
        f"{100 * (NOTABLE - 1):.0f} per cent somewhere. Results must not change by more than "
        f"{ALIKE:.0e}, relative."
    )
    head = ("constant", "value", "times", "mean", "least", "by", "most", "by", "change", "verdict")
    return table(remark, head, map(_cells, rows))


def _is_notable(ratio: float) -> bool:
    return not 1 / NOTABLE < ratio < NOTABLE


def _cells(row: ConstantRow) -> list[str]:
    least = min(row.ratios, key=lambda name: row.ratios[name])
    most = max(row.ratios, key=lambda name: row.ratios[name])
    verdict = "another is better" if row.mean < 1 / NOTABLE else "kept"
    if not any(map(_is_notable, row.ratios.values())):
        verdict = "not felt"
    if not row.change <= ALIKE:
        verdict = "steers results"
    return [
        f"`{row.constant}`",
        f"{row.value:g}",
        f"{row.factor:g}",
        number(row.mean, ".2f"),
        number(row.ratios[least], ".2f"),
        least,
        number(row.ratios[most], ".2f"),
        most,
        f"{row.change:.0e}",
        verdict,
    ]
