"""What is printed of runs before they are computed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from fvi_cli.render.runs import aligned
from fvi_cli.runner.plan import PlannedRun
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem

if TYPE_CHECKING:
    from fvi_cli.planning.plan import Plan as EnginePlan
    from fvi_cli.studies.experiment import Run

MOST_ALIKE = 1024
"""Members of a sweep among which those are looked for that are computed with the first."""


def plans_as_text(plans: Sequence[PlannedRun], *, in_full: bool = False) -> str:
    """One line for every run: what would be done with it, why, which effects it has, what it takes.

    Members of a sweep with which the same would be done share a line, which has the effects of the
    first of them and what each takes.

    Parameters
    ----------
    plans
        What would be done.
    in_full
        Add the machinery of every run below, the same one once.
    """
    header = ("experiment", "case", "n_steps", "step_size", "action", "predicted", "effects")
    rows = [(*header, "operations", "memory", "time", "reason")]
    for alike in _alike(plans):
        plan = alike[0]
        run = plan.run
        own = None
        if not plan.finds_steps:
            own = planned(run, members_with([one.run for one in alike[:MOST_ALIKE]]).get(run, 1))
        rows.append(
            (
                run.experiment.name,
                *_method_and_steps(plan),
                "-" if plan.finds_steps else f"{run.step_size:.6g}",
                plan.action if run.member is None else f"{plan.action} {len(alike)} members",
                plan.predicted,
                ", ".join([*effects_of(run.problem), *asked_of(run)]),
                *_costs(own),
                plan.reason,
            )
        )
    text = aligned(rows)
    return (
        f"{text}\n\n{machinery_as_text([p.run for p in plans if not p.finds_steps])}"
        if in_full
        else text
    )


def _method_and_steps(plan: PlannedRun) -> tuple[str, str]:
    accuracy = plan.run.experiment.accuracy
    if accuracy is None or not plan.finds_steps:
        return plan.run.method.case, str(plan.run.n_steps)
    if accuracy.mesh == "adaptive":
        return "gauss", "adaptive"
    count = len(accuracy.candidates)
    return (plan.run.method.case if count == 1 else f"one of {count}"), "equal"


def _alike(plans: Sequence[PlannedRun]) -> list[list[PlannedRun]]:
    """Every plan by itself, but those of members that differ in their members only."""
    groups: dict[tuple[object, ...], list[PlannedRun]] = {}
    for plan in plans:
        run = plan.run
        shared = (run.experiment, run.method, run.n_steps, plan.action, plan.predicted, plan.reason)
        groups.setdefault((run,) if run.member is None else shared, []).append(plan)
    return list(groups.values())


def machinery_as_text(runs: Sequence[Run]) -> str:
    """How every run is done, in a paragraph each; runs that are done alike share one."""
    paragraphs: dict[str, list[str]] = {}
    together = members_with(runs)
    for run in runs:
        own = planned(run, together.get(run, 1))
        if own is not None:
            lines = "\n".join(f"  {line}" for line in own.lines())
            name = f"{run.experiment.name} {run.method.case} N={run.n_steps}"
            paragraphs.setdefault(lines, []).append(name)
    return "\n".join(
        f"{', '.join(dict.fromkeys(names))}\n{lines}" for lines, names in paragraphs.items()
    )


def planned(run: Run, members: int = 1) -> EnginePlan | None:
    """The plan of a run that is one of so many together; None where nothing is integrated."""
    from fvi_cli.planning.plan import plan_run

    if isinstance(run.problem, DerivativeProblem):
        return None
    return plan_run(
        run.problem.scene,
        run.method,
        run.n_steps,
        every=run.experiment.store_every,
        members=members,
        diagnosed=not run.experiment.diagnostics.is_empty,
        grading=run.experiment.grading,
    )


def members_with(runs: Sequence[Run]) -> dict[Run, int]:
    """With how many members, itself among them, every run of a sweep is integrated."""
    from fvi_cli.integrator.members import companions
    from fvi_cli.runner.executors.batches import batches_of

    found: dict[Run, int] = {}
    for batch in batches_of([run for run in runs if run.member is not None]):
        problems = [run.problem for run in batch]
        scenes = [one.scene for one in problems if not isinstance(one, DerivativeProblem)]
        if len(scenes) == len(batch):
            counts = companions(scenes, batch[0].method, batch[0].n_steps)
            found.update(zip(batch, counts, strict=True))
    return found


def _costs(plan: EnginePlan | None) -> tuple[str, str, str]:
    if plan is None:
        return ("-", "-", "-")
    count = plan.history_operations
    return (
        "-" if count is None else str(count),
        f"{plan.memory_bytes / 1e6:.3g} MB",
        f"about {plan.seconds:.1g} s" if plan.seconds < 10 else f"about {plan.seconds:.0f} s",
    )


def asked_of(run: Run) -> list[str]:
    """What is asked of a motion beside its positions, in words."""
    asked = run.experiment.observations
    times = [] if asked.times is None else [f"output at {asked.times.size} times"]
    several = {
        "impacts on": asked.impacts,
        "quantities": asked.quantities,
        "events": asked.events,
    }
    return times + [f"{what} {' and '.join(found)}" for what, found in several.items() if found]


def effects_of(problem: AnyProblem) -> list[str]:
    """Names of what is simulated; what is absent costs nothing."""
    if isinstance(problem, DerivativeProblem):
        return [f"derivative of order {problem.order:g}"]
    from fvi_cli.planning.plan_words import effects_of_scene

    return list(effects_of_scene(problem.scene))
