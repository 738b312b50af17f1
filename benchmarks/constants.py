"""Constants that steer runs: which of them decide results, which only time, and how well.

A constant is a number with a name in capital letters at the level of a module of the rooms that
integrate. Those that the runs below read are doubled and halved, one at a time: what happens to
positions and to processor time says what they steer. Those that steer time are then swept.
"""

from __future__ import annotations

import ast
import contextlib
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType
from typing import Final

import numpy as np
from numpy.typing import NDArray

import fvi_cli
from benchmarks.measuring import table
from benchmarks.structures import beam
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.limits import largest_stable_step
from fvi_cli.integrator.stability.region import stability_map
from fvi_cli.scenes.chains import chain
from fvi_cli.scenes.lagrangian import double_pendulum
from fvi_cli.scenes.named import linear_oscillator, pendulum
from fvi_cli.studies.cost import forget

ROOMS: Final = ("integrator", "mathematics")
FACTORS: Final = (0.25, 0.5, 2.0, 4.0)
LAST_DIGITS: Final = 1e-9
"""Changes of positions up to this, relative to the largest, are those of another rounding."""
CERTAIN: Final = 1.15
"""Ratio of times from which on a constant steers time."""
REPEATS: Final = 3
MOST_WANTED: Final = 40
"""As many constants may steer runs."""

Run = Callable[[], NDArray[np.float64]]


@dataclass(frozen=True)
class Constant:
    """A number of a module.

    Parameters
    ----------
    module, name, value
        Where it stands, and what it is.
    readers
        Modules that import it, its own among them.
    """

    module: str
    name: str
    value: float
    readers: tuple[str, ...]

    @property
    def title(self) -> str:
        """Where it stands in the package."""
        return f"`{self.module.removeprefix('fvi_cli.')}.{self.name}`"

    def times(self, factor: float) -> float:
        """The value times a factor, whole where it is whole."""
        changed = self.value * factor
        return max(1, round(changed)) if isinstance(self.value, int) else changed


@dataclass(frozen=True, kw_only=True)
class Felt:
    """What doubling and halving a constant does.

    Parameters
    ----------
    constant
        Which.
    change
        Largest change of a position, relative to the largest; infinite where a run fails.
    slower, quicker
        Largest and least ratio of processor times.
    run
        The run in which a ratio is farthest from 1.
    """

    constant: Constant
    change: float
    slower: float
    quicker: float
    run: str

    @property
    def steers_time(self) -> bool:
        """Whether runs take another time."""
        return self.slower > CERTAIN or self.quicker < 1 / CERTAIN

    @property
    def steers(self) -> str:
        """In a word."""
        if self.change > LAST_DIGITS:
            return "results"
        last = " and last digits" if self.change else ""
        return f"time{last}" if self.steers_time else "last digits" if last else "nothing here"


def constants() -> list[Constant]:
    """All numbers in capital letters of the rooms."""
    package = Path(fvi_cli.__file__).parent
    readers: dict[tuple[str, str], list[str]] = {}
    found: list[tuple[str, str]] = []
    for path in sorted(package.rglob("*.py")):
        module = ".".join(("fvi_cli", *path.relative_to(package).with_suffix("").parts))
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    readers.setdefault((str(node.module), alias.name), []).append(module)
            elif path.relative_to(package).parts[0] in ROOMS:
                targets = node.targets if isinstance(node, ast.Assign) else [node]
                names = [one for target in targets for one in _names(target)]
                found += [(module, name) for name in names if name.lstrip("_").isupper()]
    kept = []
    for module, name in found:
        value = getattr(sys.modules.get(module), name, None)
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            others = readers.get((module, name), [])
            kept.append(Constant(module, name, value, (module, *others)))
    return kept


def _names(node: ast.AST) -> Iterator[str]:
    """Names that an assignment gives values to."""
    target = node.target if isinstance(node, ast.AnnAssign) else node
    for one in target.elts if isinstance(target, ast.Tuple) else [target]:
        if isinstance(one, ast.Name):
            yield one.id


@contextlib.contextmanager
def changed(constant: Constant, value: float) -> Iterator[None]:
    """The constant with another value, wherever it is read."""
    modules = [sys.modules[one] for one in constant.readers if one in sys.modules]
    try:
        for module in modules:
            setattr(module, constant.name, value)
        forget()
        yield
    finally:
        for module in modules:
            setattr(module, constant.name, constant.value)
        forget()


def runs(size: int = 1) -> dict[str, Run]:
    """Small runs of every kind; `size` times as long."""
    damping = (FractionalDamping(order=0.5, coefficient=0.3),)
    linear = linear_oscillator(
        mass=1.0, stiffness=1.0, damping=damping, initial_position=1.0, final_time=20.0
    )
    swing = pendulum(damping=damping, initial_position=2.0, final_time=20.0)
    along = (FractionalDamping(order=0.5, coefficient=0.3 * np.diag(np.arange(20.0))),)
    row = chain(masses=20, damping=along, initial_velocity=np.eye(20)[3], final_time=20.0)
    angles = double_pendulum(damping=[], initial_position=[2.0, 1.0], final_time=5.0)
    members = [
        pendulum(omega=1 + k / 64, damping=damping, initial_position=2.0, final_time=20.0)
        for k in range(64)
    ]
    large = beam(16 * size)

    def by(scene: Scene, method: Method, steps: int | AdaptiveSteps) -> Run:
        return lambda: integrate(scene, method, steps).position

    gauss = Method(cq="gauss", degree=3, start="none")
    backward = Method(cq="bdf3", degree=2)
    plane = np.geomspace(1e-2, 1e3, 24 * size)
    adaptive = AdaptiveSteps(tolerance=1e-9)
    return {
        "linear": by(linear, gauss, 4096 * size),
        "graded": by(linear, Method(cq="gauss", degree=3, start="graded"), 256 * size),
        "backward": by(linear, Method(cq="bdf2", degree=1), 4096 * size),
        "pendulum": by(swing, gauss, 1024 * size),
        "chain": by(row, gauss, 512 * size),
        "general": by(angles, Method(cq="gauss", degree=2, start="none"), 128 * size),
        "adaptive": by(swing, Method(cq="gauss", degree=6, start="none"), adaptive),
        "members": lambda: np.stack(
            [one.position for one in integrate_members(members, gauss, 128 * size)]
        ),
        "sparse": by(large, gauss, 16 * size),
        "stable step": lambda: np.array([largest_stable_step(linear, backward) or 0.0]),
        "stability region": lambda: stability_map(backward, 0.5, plane, plane).level.astype(float),
    }


def readers_of(every: dict[str, Run], known: Sequence[Constant]) -> dict[Constant, list[str]]:
    """By constants the runs that read them: their names stand in functions that are called."""
    found: dict[Constant, list[str]] = {}
    for name, run in every.items():
        seen: set[tuple[str, CodeType]] = set()

        def note(
            frame: FrameType, event: str, argument: object, seen: set[tuple[str, CodeType]] = seen
        ) -> None:
            if event == "call":
                seen.add((frame.f_globals.get("__name__", ""), frame.f_code))

        forget()
        before = sys.getprofile()
        sys.setprofile(note)
        try:
            run()
        finally:
            sys.setprofile(before)
        read = {(module, word) for module, code in seen for word in code.co_names}
        for one in known:
            if any((reader, one.name) in read for reader in one.readers):
                found.setdefault(one, []).append(name)
    return found


def _timed(run: Run) -> tuple[float, NDArray[np.float64]]:
    """Processor time of a run with warm caches, and its positions."""
    run()
    began = time.process_time()
    found = run()
    return time.process_time() - began, found


@dataclass(frozen=True)
class Usual:
    """A run as it is: processor time and positions."""

    run: Run
    seconds: float
    position: NDArray[np.float64]


def usual(run: Run, repeats: int) -> Usual:
    """The least time of several."""
    forget()
    tried = [_timed(run) for _ in range(repeats)]
    return Usual(run, min(seconds for seconds, _ in tried), tried[0][1])


def compare(
    constant: Constant, value: float, known: Usual, repeats: int = 0
) -> tuple[float, float]:
    """Change of positions, and ratio of times, when a constant has another value.

    With repeats both are timed in turns, so that another process beside disturbs them alike.
    """
    own, other, change = known.seconds if not repeats else math.inf, math.inf, 0.0
    for _ in range(max(repeats, 1)):
        if repeats:
            own = min(own, _timed(known.run)[0])
        with changed(constant, value):
            try:
                seconds, found = _timed(known.run)
            except Exception:  # whatever it is, the constant decides
                return math.inf, 1.0
        other, change = min(other, seconds), max(change, _change(found, known.position))
    return change, other / own


def _change(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Relative to the largest position; infinite where there is another number of points."""
    if found.shape != expected.shape:
        return math.inf
    off = float(np.abs(found - expected).max() / np.abs(expected).max())
    return off if math.isfinite(off) else math.inf


def feel(constant: Constant, every: dict[str, Usual], repeats: int = REPEATS) -> Felt:
    """Double and halve a constant in runs; times that differ are measured in turns."""
    change, ratios = 0.0, {("", 1.0): 1.0}
    for name, known in every.items():
        for factor in (0.5, 2.0):
            value = constant.times(factor)
            if value == constant.value:
                continue
            moved, ratio = compare(constant, value, known)
            if not 1 / CERTAIN < ratio < CERTAIN:
                _, ratio = compare(constant, value, known, repeats)
            change, ratios[name, factor] = max(change, moved), ratio
    farthest = max(ratios, key=lambda key: abs(math.log(ratios[key])))
    return Felt(
        constant=constant,
        change=change,
        slower=max(ratios.values()),
        quicker=min(ratios.values()),
        run=farthest[0],
    )


def sweep(felt: Felt, known: Usual, repeats: int = REPEATS) -> list[str]:
    """A row of times, relative to that of the value it has."""
    own = felt.constant
    cells = [compare(own, own.times(factor), known, repeats)[1] for factor in FACTORS]
    least = min((ratio, factor) for ratio, factor in zip(cells, FACTORS, strict=True))
    best = f"{own.times(least[1]):g}" if least[0] < 1 / CERTAIN else "its own"
    return [own.title, f"{own.value:g}", felt.run, *(f"{one:.2f}" for one in cells), best]


def run_constants(*, most: int | None = None, size: int = 1, repeats: int = REPEATS) -> str:
    """The page: what was counted, what every constant steers, and the sweeps.

    Parameters
    ----------
    most
        Look at so many of those that are read only; None: at all.
    size, repeats
        How long the runs are, and how often they are timed.
    """
    every, known = runs(size), constants()
    read = readers_of(every, known)
    own = {name: usual(run, repeats) for name, run in every.items()}
    felt = []
    for number, (constant, names) in enumerate(list(read.items())[:most]):
        print(f"constants: {number + 1} of {len(read)}, {constant.title}", flush=True)
        felt.append(feel(constant, {name: own[name] for name in names}, repeats))
    count = Counter(one.steers for one in felt)
    steering = len(felt) - count["nothing here"]
    said = (
        f"{len(known)} constants in {' and '.join(ROOMS)}, {len(read)} of them read by "
        f"{len(every)} runs ({', '.join(every)}), {len(felt)} doubled and halved: "
        f"{', '.join(f'{number} steer {word}' for word, number in sorted(count.items()))}. "
        f"{steering} steer anything; {MOST_WANTED} are wanted at most."
    )
    order = {"results": 0, "time and last digits": 1, "time": 2, "last digits": 3}
    felt.sort(key=lambda one: (order.get(one.steers, 4), one.constant.title))
    rows = [
        [
            one.constant.title,
            f"{one.constant.value:g}",
            one.steers,
            "fails" if math.isinf(one.change) else f"{one.change:.0e}" if one.change else "0",
            f"{one.quicker:.2f} to {one.slower:.2f}",
            one.run,
        ]
        for one in felt
    ]
    head = ("constant", "value", "steers", "change", "time, halved and doubled", "felt most in")
    times = [sweep(one, own[one.run], repeats) for one in felt if one.steers_time]
    swept = (
        "constant",
        "value",
        "run",
        *(f"x {factor:g}" for factor in FACTORS),
        "better by more than a tenth",
    )
    remark = "Processor time of a run over that with the value of the constant."
    return f"{table(said, head, rows)}\n{table(remark, swept, times)}"
