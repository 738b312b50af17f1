"""What errors are measured against: an exact solution, or a refined run that states its error."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.local_error.pulses import pulses_that_move
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.method_names import method_name
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem
from fvi_cli.studies.members import members_at_a_time
from fvi_cli.studies.tolerance.rounds import likely_amplitude
from fvi_cli.studies.tolerance.runs import AdaptiveRuns, knots_of

REFERENCE_METHOD = Method(cq="gauss", degree=4, start="graded")
LEAST_STEPS = 256
MOST_STEPS = 2**14
SUFFICIENT = 2e-14
ROUGH = 1e-4
"""Local tolerance of the runs that measure how large the motion is, relative to a guess."""
TOLERANCES = (1e-13, 1e-11, 1e-9)
"""Local tolerances of runs with adaptive steps, relative to the motion; the first that does."""


MOST_GRIDS = 32
"""Grids on which values are kept; a guess: more than a usual ladder has."""

TIMES_DIFFER = 1e-12
"""Times of runs may differ by round-off, relative to the last."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """Values to compare with on the grids of a ladder."""

    values: Callable[[Array], Array]
    """Function of times, shape ``(n,)`` to ``(n, d)``: an exact solution, polynomials of a run, or
    :class:`Tabulated`; nan where nothing is known."""
    error: float
    """Estimated error of the values in the maximum norm; 0 for an exact solution, nan where nothing
    is known."""
    source: str  # as the reader of a table sees it
    _evaluated: dict[bytes, Array] = field(init=False, repr=False, default_factory=dict)

    def at(self, times: Array) -> Array:
        """The values; on the grid of a run they are the same for all methods."""
        key = times.tobytes()
        if key not in self._evaluated:
            while len(self._evaluated) >= MOST_GRIDS:
                self._evaluated.pop(next(iter(self._evaluated)))
            self._evaluated[key] = self.values(times)
        return self._evaluated[key]

    @property
    def is_known(self) -> bool:
        """Whether there is anything to compare with."""
        return not math.isnan(self.error)

    def tabulated(self, times: Array) -> Reference:
        """The same at `times` alone, such that it can be stored and sent to another process."""
        return replace(self, values=Tabulated(time=times, position=self.values(times)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Tabulated:
    """Values at increasing times, shapes ``(n,)`` and ``(n, d)``."""

    time: Array
    position: Array

    def __call__(self, times: Array) -> Array:
        """The values at some of the times; ValueError at others."""
        after = np.clip(np.searchsorted(self.time, times), 1, self.time.size - 1)
        nearest = after - (times - self.time[after - 1] < self.time[after] - times)
        off = np.abs(self.time[nearest] - times) > TIMES_DIFFER * self.time[-1]
        if off.any():
            raise ValueError(f"reference: it has no value at t = {times[off][0]:.17g}")
        return np.asarray(self.position[nearest])


def find_reference(
    problem: AnyProblem, steps: tuple[int, ...], *, grading: float = 1.0
) -> Reference:
    """The exact solution where it is known, otherwise a refined run.

    The refined run is made by the Gauss method of degree 4 with a graded start on a grid that
    contains all grids of the ladder; it is doubled until two runs agree to 2e-14 of the largest
    value, or further than that no more, or N reaches 16384. The difference of the last two is
    stated as its error, although the finer one, which is used, is usually much better.

    For graded meshes, for forces with narrow pulses, and where the smallest common grid is larger
    than that, the steps of the refined run are adaptive, and its polynomials give the values
    between them; its difference from a run of another degree and tolerance is stated as its error.

    A refined run that does not reach the end leaves nothing to compare with; the source says why.
    """
    (reference,) = find_references([problem], steps, grading=grading)
    return reference


def find_references(
    problems: Sequence[AnyProblem], steps: tuple[int, ...], *, grading: float = 1.0
) -> list[Reference]:
    """What :func:`find_reference` finds for each problem; their refined runs are made together."""
    unknown = [_scene_of(one) for one in problems if one.exact is None and _is_wanted(one)]
    common = math.lcm(*steps)
    has_grid = grading == 1.0 and common <= MOST_STEPS
    pulses = [_pulses_of(scene) for scene in unknown]
    gentle = [one for one, found in zip(unknown, pulses, strict=True) if has_grid and not found]
    together = iter(_refined_together(gentle, common))
    refined = iter(
        [
            next(together) if has_grid and not found else _refined_adaptively(scene, found)
            for scene, found in zip(unknown, pulses, strict=True)
        ]
    )
    references = []
    for problem in problems:
        if problem.exact is not None:
            values, source = problem.exact, problem.exact_source
            references.append(Reference(values=values, error=0.0, source=source))
        elif _is_wanted(problem):
            references.append(next(refined))
        else:
            references.append(unknown_reference(_scene_of(problem), "none, as asked for"))
    return references


def _is_wanted(problem: AnyProblem) -> bool:
    """Whether errors are wanted: ``exact: none`` wants none."""
    return problem.exact_source != "none"


def _pulses_of(scene: Scene) -> tuple[float, ...]:
    """Times that steps have to end at, lest they pass over pulses of the force."""
    return pulses_that_move(scene, SUFFICIENT * likely_amplitude(scene)).points


def _refined_adaptively(scene: Scene, pulses: tuple[float, ...]) -> Reference:
    """Polynomials of a run with adaptive steps, whatever the times that are asked for."""
    failure = ""
    scale = likely_amplitude(scene) or 1.0
    better, worse = (
        AdaptiveRuns(
            scene, degree, points=tuple(sorted({*knots_of(scene), *pulses})), most_steps=MOST_STEPS
        )
        for degree in (8, 10)
    )
    for tolerance in (ROUGH, *TOLERANCES):
        runs = (better.run(tolerance * scale), worse.run(3.0 * tolerance * scale))
        fine, other = (run.steps for run in runs)
        failure = next((f"{run.status}: {run.message}" for run in runs if run.status != "ok"), "")
        if failure or fine is None or other is None:
            continue
        scale = float(np.abs(runs[0].position).max()) or scale
        if tolerance == ROUGH:
            continue
        times = np.union1d(fine.time, other.time)
        difference = float(np.abs(fine(times) - other(times)).max())
        words = f"gauss-s8-none, adaptive steps, {_in_words(difference, scale)}"
        return Reference(values=fine, error=difference, source=f"refined run ({words})")
    return _no_reference(scene, f"the refined run {failure}")


def _scene_of(problem: AnyProblem) -> Scene:
    if isinstance(problem, DerivativeProblem):  # pragma: no cover - always brings its own
        raise ValueError("exact: a fractional derivative needs its exact value")
    return problem.scene


@dataclass(frozen=True, kw_only=True, eq=False)
class _Refined:
    """A refined run on `n_steps` steps, with its estimated error."""

    n_steps: int
    values: Array
    error: float


def _refined_together(scenes: Sequence[Scene], common: int) -> list[Reference]:
    return [
        _no_reference(scene, found) if isinstance(found, str) else _on_grid(scene, found, common)
        for scene, found in zip(scenes, _doubled(scenes, common), strict=True)
    ]


def _no_reference(scene: Scene, failure: str) -> Reference:
    return unknown_reference(scene, f"none (no exact solution is known, and {failure})")


def unknown_reference(scene: Scene, source: str) -> Reference:
    """No reference, and why."""
    dimension = scene.dimension
    return Reference(
        values=lambda times: np.full((times.size, dimension), np.nan),
        error=math.nan,
        source=source,
    )


def _on_grid(scene: Scene, refined: _Refined, common: int) -> Reference:
    # what lies between the points of the common grid is never asked for
    kept = np.ascontiguousarray(refined.values[:: refined.n_steps // common])

    def values(times: Array) -> Array:
        return np.asarray(kept[np.rint(times / scene.final_time * common).astype(int)])

    words = _in_words(refined.error, float(np.abs(refined.values).max(initial=0.0)))
    source = f"refined run ({method_name(REFERENCE_METHOD)}, {words})"
    return Reference(values=values, error=refined.error, source=source)


def _in_words(error: float, scale: float) -> str:
    """The estimated error by a power of ten, since its digits are those of one machine."""
    bound = max(2.0 * error, 10.0 * SUFFICIENT * scale, 1e-300)
    return f"estimated error below 1e{math.ceil(math.log10(bound))}"


def _doubled(scenes: Sequence[Scene], base: int) -> list[_Refined | str]:
    """Runs on multiples of `base`, doubled for every scene as long as it pays; or why not."""
    n_steps = base * max(1, math.ceil(LEAST_STEPS / base))
    results: list[_Refined | str] = [
        run if isinstance(run, str) else _Refined(n_steps=n_steps, values=run, error=math.inf)
        for run in _runs(scenes, n_steps)
    ]
    going = [k for k, result in enumerate(results) if not isinstance(result, str)]
    while going and 2 * n_steps <= max(MOST_STEPS, 2 * base):
        n_steps *= 2
        finer = _runs([scenes[k] for k in going], n_steps)
        still_going = []
        for k, fine in zip(going, finer, strict=True):
            coarse = results[k]
            if isinstance(fine, str) or isinstance(coarse, str):
                results[k] = fine if isinstance(fine, str) else coarse
                continue
            difference = float(np.abs(fine[::2] - coarse.values).max())
            if difference >= coarse.error:
                continue
            results[k] = _Refined(n_steps=n_steps, values=fine, error=difference)
            if difference > SUFFICIENT * float(np.abs(fine).max()):
                still_going.append(k)
        going = still_going
    return results


def _runs(scenes: Sequence[Scene], n_steps: int) -> list[Array | str]:
    """Positions of refined runs, as many together as memory allows; or what became of them."""
    positions: list[Array | str] = []
    size = members_at_a_time(n_steps, max((s.dimension for s in scenes), default=1))
    for start in range(0, len(scenes), size):
        together = scenes[start : start + size]
        positions += [
            run.position if run.status == "ok" else f"the refined run {run.status}: {run.message}"
            for run in integrate_members(together, REFERENCE_METHOD, n_steps)
        ]
    return positions
