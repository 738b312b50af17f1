"""Texts on runs before they are computed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from fvi_cli.integrator.method_names import MethodName, method_names
from fvi_cli.planning.plan import effects_of_scene
from fvi_cli.render.runs import columns_of_words
from fvi_cli.runner.plan import Forecast, PlannedRun, forecast_runs, group_alike
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem

if TYPE_CHECKING:
    from fvi_cli.planning.plan import Plan
    from fvi_cli.studies.experiment import Run


def plans_as_text(plans: Sequence[PlannedRun], *, in_full: bool = False) -> str:
    """One line for every run: action, reason, effects, and the time that it takes.

    Members of a sweep with the same action and reason share a line, with the effects of the first
    member and the time of all. `in_full`: followed by the plan of the engine for every run.
    """
    header = ("experiment", "method", "n_steps", "step_size", "action", "predicted", "effects")
    rows = [(*header, "operations", "memory", "time", "reason")]
    forecasts = forecast_runs(plans)
    names = method_names([plan.run.method for plan in plans])
    for alike in group_alike(plans):
        plan = alike[0]
        run = plan.run
        rows.append(
            (
                run.experiment.name,
                *_method_and_steps(plan, names),
                "-" if plan.finds_steps else f"{run.step_size:.6g}",
                plan.action if run.member is None else f"{plan.action} {len(alike)} members",
                plan.predicted,
                ", ".join([*effects_of(run.problem), *describe_observations(run)]),
                *_costs([forecasts.get(one.run) for one in alike]),
                plan.reason,
            )
        )
    text = columns_of_words(rows)
    if not in_full:
        return text
    return f"{text}\n\n{machinery_as_text({run: one.plan for run, one in forecasts.items()})}"


def _method_and_steps(plan: PlannedRun, names: Mapping[str, MethodName]) -> tuple[str, str]:
    accuracy, name = plan.run.experiment.accuracy, names[plan.run.method.case].label
    if accuracy is None or not plan.finds_steps:
        return name, str(plan.run.n_steps)
    if accuracy.mesh == "adaptive":
        return "Gauss", "adaptive"
    count = len(accuracy.candidates)
    return (name if count == 1 else f"one of {count}"), "equal"


def machinery_as_text(plans: Mapping[Run, Plan]) -> str:
    """The plan of the engine for every run, a paragraph each; equal plans share one."""
    paragraphs: dict[str, list[str]] = {}
    for run, plan in plans.items():
        lines = "\n".join(f"  {line}" for line in plan.lines())
        name = run.title
        paragraphs.setdefault(lines, []).append(name)
    return "\n".join(
        f"{', '.join(dict.fromkeys(names))}\n{lines}" for lines, names in paragraphs.items()
    )


def _costs(forecasts: Sequence[Forecast | None]) -> tuple[str, str, str]:
    first = forecasts[0]
    if first is None:
        return ("-", "-", "-")
    count = first.plan.history_operations
    seconds = sum(
        math.nan if one is None or one.seconds is None else one.seconds for one in forecasts
    )
    return (
        "-" if count is None else str(count),
        f"{first.plan.memory_bytes / 1e6:.3g} MB",
        "-" if math.isnan(seconds) else f"about {seconds:.{1 if seconds < 10 else 3}g} s",
    )


def describe_observations(run: Run) -> list[str]:
    """Requested outputs of a motion besides its positions, in words."""
    observations = run.experiment.observations
    times = [] if observations.times is None else [f"output at {observations.times.size} times"]
    several = {
        "impacts on": observations.impacts,
        "quantities": observations.quantities,
        "events": observations.events,
    }
    return times + [f"{what} {' and '.join(found)}" for what, found in several.items() if found]


def effects_of(problem: AnyProblem) -> list[str]:
    """Names of the effects that are simulated."""
    if isinstance(problem, DerivativeProblem):
        return [f"derivative of order {problem.order:g}"]
    return list(effects_of_scene(problem.scene))
