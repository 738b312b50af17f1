"""Constants of the rooms that integrate: what each is, and what those that were chosen steer.

A constant is a number with a name in capital letters at the level of a module. ``constants.csv``
says of each of what kind it is and where it comes from; a test holds it to the code. Those that the
runs below read are doubled and halved, one at a time: what happens to positions, and to processor
time, says what they steer.
"""

from __future__ import annotations

import ast
import contextlib
import csv
import importlib
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
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
from fvi_cli.scenes.data import linear_oscillator, pendulum
from fvi_cli.scenes.lagrangian import double_pendulum
from fvi_cli.studies.cost import clear_caches

ROOMS: Final = ("integrator", "mathematics", "effects")
LISTED: Final = Path(__file__).parent / "constants.csv"
KINDS: Final = {
    "knob": "chosen: another value is another compromise, of results or of time",
    "flat": "chosen, but at half and twice the value neither positions (1e-9) nor times (15 %) of "
    "the runs that read it are others",
    "bound": "how much is tried, kept or accepted at most, or where a search that is refined "
    "begins: what is beyond is refused, reported or done in parts",
    "round-off": "tells numbers from their rounding",
    "derived": "follows from an error bound or from other numbers",
    "definition": "mathematics, arithmetic, a format, or what a word means to users",
}
MOST_KNOBS: Final = 40
"""As many may be chosen."""
LAST_DIGITS: Final = 1e-9
"""Changes of positions up to this, relative to the largest, are those of another rounding."""
CERTAIN: Final = 1.15
"""Ratio of times from which on a constant steers time."""
REPEATS: Final = 3

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
    words
        What the code says of it.
    """

    module: str
    name: str
    value: float
    readers: tuple[str, ...]
    words: str = ""

    @property
    def place(self) -> str:
        """Where it stands in the package."""
        return f"{self.module.removeprefix('fvi_cli.')}.{self.name}"

    def times(self, factor: float) -> float:
        """The value times a factor, whole where it is whole."""
        changed = self.value * factor
        return max(1, round(changed)) if isinstance(self.value, int) else changed


def constants() -> list[Constant]:
    """All numbers in capital letters of the rooms."""
    package = Path(fvi_cli.__file__).parent
    readers: dict[tuple[str, str], list[str]] = {}
    found: list[tuple[str, str, str]] = []
    for path in sorted(package.rglob("*.py")):
        module = ".".join(("fvi_cli", *path.relative_to(package).with_suffix("").parts))
        text = path.read_text(encoding="utf-8")
        body = ast.parse(text).body
        for node, behind in zip(body, [*body[1:], None], strict=True):
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    readers.setdefault((str(node.module), alias.name), []).append(module)
            elif path.relative_to(package).parts[0] in ROOMS:
                targets = node.targets if isinstance(node, ast.Assign) else [node]
                names = [one for target in targets for one in _names(target)]
                words = _words(text.splitlines(), node, behind)
                found += [(module, name, words) for name in names if name.lstrip("_").isupper()]
    kept = []
    for module, name, words in found:
        value = getattr(importlib.import_module(module), name, None)
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            others = readers.get((module, name), [])
            kept.append(Constant(module, name, value, (module, *others), words))
    return kept


def _words(lines: Sequence[str], node: ast.stmt, behind: ast.stmt | None) -> str:
    """The text behind an assignment, or else the comment before it."""
    if isinstance(behind, ast.Expr) and isinstance(behind.value, ast.Constant):
        return " ".join(str(behind.value.value).split())
    begin = node.lineno - 1
    while begin and lines[begin - 1].startswith("#"):
        begin -= 1
    return " ".join(line.lstrip("# ") for line in lines[begin : node.lineno - 1])


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
        clear_caches()
        yield
    finally:
        for module in modules:
            setattr(module, constant.name, constant.value)
        clear_caches()


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

        clear_caches()
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


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What is listed of a constant."""

    place: str
    kind: str  # of KINDS
    origin: str
    words: str  # what it is, where the code does not say it
    change: float | None  # of positions, relative to the largest, at half and twice the value
    time: float | None  # and the ratio of processor times that is farthest from 1
    run: str  # in which


def listed() -> list[Entry]:
    """The entries of the list."""
    with LISTED.open(encoding="utf-8", newline="") as file:
        return [_entry(row) for row in csv.DictReader(file)]


def _entry(row: dict[str, str]) -> Entry:
    change, ratio = (float(row[name]) if row[name] else None for name in ("change", "time"))
    return Entry(
        place=row["place"],
        kind=row["kind"],
        origin=row["origin"],
        words=row["words"],
        change=change,
        time=ratio,
        run=row["run"],
    )


def write_list(entries: Sequence[Entry]) -> None:
    """Keep the entries."""
    with LISTED.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(vars(entries[0]))
        for one in sorted(entries, key=lambda one: one.place):
            values = vars(one).values()
            writer.writerow(
                ["" if v is None else f"{v:.2g}" if isinstance(v, float) else v for v in values]
            )


def _timed(run: Run) -> tuple[float, NDArray[np.float64]]:
    """Processor time of a run with warm caches, and its positions."""
    run()
    began = time.process_time()
    found = run()
    return time.process_time() - began, found


def compare(constant: Constant, value: float, run: Run, repeats: int) -> tuple[float, float]:
    """Change of positions, and ratio of times, when a constant has another value.

    Both are timed in turns, so that another process disturbs them alike.
    """
    own, other, change = math.inf, math.inf, 0.0
    for _ in range(repeats):
        seconds, expected = _timed(run)
        own = min(own, seconds)
        with changed(constant, value):
            try:
                seconds, found = _timed(run)
            except Exception:  # whatever it is, the constant decides
                return math.inf, 1.0
        other, change = min(other, seconds), max(change, _change(found, expected))
    return change, other / own


def _change(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Relative to the largest position; infinite where there is another number of points."""
    if found.shape != expected.shape:
        return math.inf
    off = float(np.abs(found - expected).max() / np.abs(expected).max())
    return off if math.isfinite(off) else math.inf


def measure(entry: Entry, constant: Constant, every: dict[str, Run], repeats: int) -> Entry:
    """Double and halve a constant in runs; times that differ are measured twice."""
    change, ratios = 0.0, {"": 1.0}
    for name, run in every.items():
        for factor in (0.5, 2.0):
            value = constant.times(factor)
            if value == constant.value:
                continue
            moved, ratio = compare(constant, value, run, repeats)
            if not 1 / CERTAIN < ratio < CERTAIN:
                _, ratio = compare(constant, value, run, 2 * repeats)
            change = max(change, moved)
            ratios[name] = max(ratio, ratios.get(name, 1.0), key=lambda one: abs(math.log(one)))
    run_of = max(ratios, key=lambda key: abs(math.log(ratios[key])))
    return replace(entry, change=change, time=ratios[run_of], run=run_of)


def run_constants(*, most: int | None = None, size: int = 1, repeats: int = REPEATS) -> str:
    """Measure constants that runs read, keep what was found, and give the page.

    Parameters
    ----------
    most
        How many are measured: 0 makes the page of what is known; None: all.
    size, repeats
        How long the runs are, and how often they are timed.
    """
    entries = {one.place: one for one in listed()}
    if most != 0:
        every = runs(size)
        read = readers_of(every, constants())
        for number, (constant, names) in enumerate(list(read.items())[:most]):
            print(f"constants: {number + 1} of {len(read)}, {constant.place}", flush=True)
            own = {name: every[name] for name in names}
            known = entries[constant.place]
            entries[constant.place] = measure(known, constant, own, repeats)
        write_list(list(entries.values()))
    return constants_page(list(entries.values()), constants())


def constants_page(entries: Sequence[Entry], known: Sequence[Constant]) -> str:
    """A table of each kind: where, value, what it is, where it comes from, what it steers."""
    values = {one.place: one for one in known}
    count = Counter(one.kind for one in entries)
    said = ", ".join(f"{count[kind]} of the kind {kind}" for kind in KINDS)
    tables = [
        f"{len(entries)} constants in {', '.join(ROOMS)}: {said}. At most {MOST_KNOBS} knobs are "
        "wanted. Change: of positions, relative to the largest, at half and twice the value, in "
        f"the {len(runs())} runs of `python -m benchmarks constants`; inf: another number of "
        "points, or no result. Time: the ratio of processor times that is farthest from 1, with "
        "the run. Empty: these runs do not read it, or it was not timed.\n"
    ]
    for kind, meaning in KINDS.items():
        rows = [
            [
                f"`{one.place}`",
                f"{values[one.place].value:.6g}",
                (values[one.place].words or one.words).replace("|", "\\|"),
                one.origin,
                "" if one.change is None else f"{one.change:.0e}" if one.change else "0",
                "" if one.time is None else f"{one.time:.2f} {one.run}".strip(),
            ]
            for one in entries
            if one.kind == kind and one.place in values
        ]
        head = ("constant", "value", "what it is", "from", "change", "time")
        tables.append(f"## {kind.capitalize()}\n\n{table(meaning.capitalize() + '.', head, rows)}")
    return "\n".join(tables)
