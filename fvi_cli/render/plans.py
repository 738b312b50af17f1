"""Texts on runs before they are computed."""

from __future__ import annotations

from collections.abc import Sequence

from fvi_cli.render.runs import columns_of_words
from fvi_cli.runner.plan import PlannedRun, group_alike


def plans_as_text(plans: Sequence[PlannedRun]) -> str:
    """One line for every run: what is done with it, and the memory that it takes.

    Members of a sweep with the same action share a line.
    """
    header = ("experiment", "method", "n_steps", "step_size", "action", "memory")
    rows = [header]
    for alike in group_alike(plans):
        plan = alike[0]
        run, size = plan.run, plan.memory_bytes
        rows.append(
            (
                run.experiment.name,
                *_method_and_steps(plan),
                "-" if plan.finds_steps else f"{run.step_size:.6g}",
                plan.action if run.member is None else f"{plan.action} {len(alike)} members",
                "-" if size is None else f"{size / 1e6:.3g} MB",
            )
        )
    return columns_of_words(rows)


def _method_and_steps(plan: PlannedRun) -> tuple[str, str]:
    if plan.finds_steps:
        return "Gauss", "adaptive"
    return plan.run.method_label, str(plan.run.n_steps)
