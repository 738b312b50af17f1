"""What errors are measured against: an exact solution, or a refined run that states its error."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem
from fvi_cli.studies.members import members_at_a_time

Array = NDArray[np.float64]

REFERENCE_METHOD = Method(cq="gauss", degree=4, start="graded")
LEAST_STEPS = 256
MOST_STEPS = 2**14
SUFFICIENT = 2e-14
TOLERANCES = (1e-13, 1e-11, 1e-9)
"""Local tolerances of runs with adaptive steps, relative to the motion; the first that does."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """Values to compare with on the grids of a ladder.

    Parameters
    ----------
    values
        Function of the times of a grid, shape ``(n,)`` to ``(n, d)``; nan where nothing is known.
    error
        Estimated error of the values in the maximum norm; 0 for an exact solution, nan where
        nothing is known.
    source
        What the reader of a table is told.
    """

    values: Callable[[Array], Array]
    error: float
    source: str

    @property
    def is_known(self) -> bool:
        """Whether there is anything to compare with."""
        return not math.isnan(self.error)


def find_reference(
    problem: AnyProblem, steps: tuple[int, ...], *, grading: float = 1.0
) -> Reference:
    """The exact solution where it is known, otherwise a refined run.

    The refined run is made by the Gauss method of degree 4 with a graded start on a grid that
    contains all grids of the ladder; it is doubled until two runs agree to 2e-14 of the largest
    value, or further than that no more, or N reaches 16384. The difference of the last two is
    stated as its error, although the finer one, which is used, is usually much better. Where the
    smallest common grid is larger than that, every grid gets a refinement of its own.

    For graded meshes the steps of the refined run are adaptive, and its polynomials give the values
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
    if grading == 1.0:
        refined = iter(_refined_together(unknown, steps))
    else:
        refined = iter([_refined_adaptively(scene) for scene in unknown])
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


def _refined_adaptively(scene: Scene) -> Reference:
    """Polynomials of a run with adaptive steps, whatever the times that are asked for."""
    told = ""
    scale = float(np.abs(scene.initial_position).max())
    scale = max(scale, scene.final_time * float(np.abs(scene.initial_velocity).max())) or 1.0
    for tolerance in (1e-4, *TOLERANCES):
        runs = [
            integrate(
                scene,
                Method(cq="gauss", degree=degree),
                AdaptiveSteps(tolerance=share * tolerance * scale, most_steps=MOST_STEPS),
                with_steps=True,
            )
            for degree, share in ((8, 1.0), (10, 3.0))
        ]
        told = next((f"{run.status}: {run.message}" for run in runs if run.status != "ok"), "")
        if told:
            continue
        scale = float(np.abs(runs[0].position).max()) or scale
        if tolerance not in TOLERANCES:
            continue
        fine, other = (run.steps for run in runs)
        if fine is None or other is None:  # pragma: no cover - they were asked for
            raise ValueError("reference: the steps were not kept")
        times = np.union1d(fine.time, other.time)
        difference = float(np.abs(fine(times) - other(times)).max())
        refined = _Refined(n_steps=fine.n_steps, values=runs[0].position, error=difference)
        return Reference(
            values=fine,
            error=difference,
            source=f"refined run (gauss-s8-none, adaptive steps, {_in_words(refined)})",
        )
    return _nothing(scene, _ReferenceFailedError(f"the refined run {told}"))


def _scene_of(problem: AnyProblem) -> Scene:
    if isinstance(problem, DerivativeProblem):  # pragma: no cover - always brings its own
        raise ValueError("exact: a fractional derivative needs its exact value")
    return problem.scene


class _ReferenceFailedError(Exception):
    """A refined run that did not reach the end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Refined:
    """A refined run on `n_steps` steps, with its estimated error."""

    n_steps: int
    values: Array
    error: float


def _refined_together(scenes: Sequence[Scene], steps: tuple[int, ...]) -> list[Reference]:
    common = math.lcm(*steps)
    is_shared = common <= MOST_STEPS
    found = _doubled(scenes, common if is_shared else min(steps))
    references = []
    for scene, refined in zip(scenes, found, strict=True):
        try:
            if isinstance(refined, _ReferenceFailedError):
                raise refined
            references.append(
                _on_common_grid(scene, refined, common)
                if is_shared
                else _on_own_grids(scene, refined, steps)
            )
        except _ReferenceFailedError as failure:
            references.append(_nothing(scene, failure))
    return references


def _nothing(scene: Scene, failure: _ReferenceFailedError) -> Reference:
    return unknown_reference(scene, f"none (no exact solution is known, and {failure})")


def unknown_reference(scene: Scene, source: str) -> Reference:
    """Nothing to compare with, and why."""
    dimension = scene.dimension
    return Reference(
        values=lambda times: np.full((times.size, dimension), np.nan),
        error=math.nan,
        source=source,
    )


def _on_common_grid(scene: Scene, refined: _Refined, common: int) -> Reference:
    # what lies between the points of the common grid is never asked for
    values = np.ascontiguousarray(refined.values[:: refined.n_steps // common])
    return Reference(
        values=lambda times: _picked(scene, times, values),
        error=refined.error,
        source=f"refined run ({REFERENCE_METHOD.case}, {_in_words(refined)})",
    )


def _on_own_grids(scene: Scene, refined: _Refined, steps: tuple[int, ...]) -> Reference:
    finest = refined.n_steps

    @functools.lru_cache(maxsize=len(steps))
    def refinement(n_steps: int) -> Array:
        (run,) = _runs([scene], n_steps * max(2, math.ceil(finest / n_steps)))
        if isinstance(run, _ReferenceFailedError):
            raise run
        return run

    for n_steps in steps:
        refinement(n_steps)

    def at(times: Array) -> Array:
        places = times / scene.final_time
        own = next(n for n in steps if np.abs(places * n - np.rint(places * n)).max() < 1e-6)
        return _picked(scene, times, refinement(own))

    return Reference(
        values=at,
        error=refined.error,
        source=f"refined runs ({REFERENCE_METHOD.case}, on every grid of its own, "
        f"{_in_words(refined)})",
    )


def _in_words(refined: _Refined) -> str:
    """The estimated error by a power of ten, since its digits are those of one machine."""
    scale = float(np.abs(refined.values).max(initial=0.0))
    told = max(2.0 * refined.error, 10.0 * SUFFICIENT * scale, 1e-300)
    return f"estimated error below 1e{math.ceil(math.log10(told))}"


def _doubled(scenes: Sequence[Scene], base: int) -> list[_Refined | _ReferenceFailedError]:
    """Runs on multiples of `base`, doubled for every scene as long as it pays there."""
    n_steps = base * max(1, math.ceil(LEAST_STEPS / base))
    results: list[_Refined | _ReferenceFailedError] = [
        run
        if isinstance(run, _ReferenceFailedError)
        else _Refined(n_steps=n_steps, values=run, error=math.inf)
        for run in _runs(scenes, n_steps)
    ]
    going = [k for k, result in enumerate(results) if isinstance(result, _Refined)]
    while going and 2 * n_steps <= max(MOST_STEPS, 2 * base):
        n_steps *= 2
        finer = _runs([scenes[k] for k in going], n_steps)
        still_going = []
        for k, fine in zip(going, finer, strict=True):
            result = results[k]
            if isinstance(fine, _ReferenceFailedError) or isinstance(result, _ReferenceFailedError):
                results[k] = fine if isinstance(fine, _ReferenceFailedError) else result
                continue
            difference = float(np.abs(fine[::2] - result.values).max())
            if difference >= result.error:
                continue
            results[k] = _Refined(n_steps=n_steps, values=fine, error=difference)
            if difference > SUFFICIENT * float(np.abs(fine).max()):
                still_going.append(k)
        going = still_going
    return results


def _picked(scene: Scene, times: Array, values: Array) -> Array:
    """The values of a fine grid at the times of a coarse one."""
    index = np.rint(times / scene.final_time * (values.shape[0] - 1)).astype(int)
    return np.asarray(values[index])


def _runs(scenes: Sequence[Scene], n_steps: int) -> list[Array | _ReferenceFailedError]:
    """Positions of refined runs, as many together as memory allows."""
    positions: list[Array | _ReferenceFailedError] = []
    size = members_at_a_time(n_steps, max((s.dimension for s in scenes), default=1))
    for start in range(0, len(scenes), size):
        together = scenes[start : start + size]
        for trajectory in integrate_members(together, REFERENCE_METHOD, n_steps):
            told = f"the refined run {trajectory.status}: {trajectory.message}"
            is_whole = trajectory.status == "ok"
            positions.append(trajectory.position if is_whole else _ReferenceFailedError(told))
    return positions
