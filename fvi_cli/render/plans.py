"""Texts on runs before they are computed."""

from __future__ import annotations

from collections.abc import Sequence

from fvi_cli.render.runs import columns_of
from fvi_cli.runner.compute import PlannedRun


def plans_as_text(plans: Sequence[PlannedRun]) -> str:
    """One line for every run: what is done with it, and the memory that it takes.

    Members of a sweep with the same action share a line.
    """
    groups: dict[tuple[object, ...], list[PlannedRun]] = {}
    for one in plans:
        alone = one.run if one.run.member is None else None
        key = (one.run.experiment, one.run.method, one.run.n_steps, one.action, alone)
        groups.setdefault(key, []).append(one)
    rows = []
    for alike in groups.values():
        plan, run, size = alike[0], alike[0].run, alike[0].memory_bytes
        rows.append({
            "experiment": run.experiment.name,
            "method": "Gauss" if run.is_search else run.method_label,
            "n_steps": "adaptive" if run.is_search else run.n_steps,
            "step_size": None if run.is_search else run.step_size,
            "action": f"{plan.action} {len(alike)} members" if run.member else plan.action,
            "memory": None if size is None else f"{size / 1e6:.3g} MB",
        })  # fmt: skip
    return columns_of(rows, step_size=".6g")
