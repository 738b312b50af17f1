"""What the commands print and write, once runs are finished."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fvi_cli.config import SCHEMA_FILE, SCHEMA_TITLE, schema_text, starter_config
from fvi_cli.config.experiment_keys import is_name
from fvi_cli.errors import RequestError
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem
from fvi_cli.storage.atomic import replace_file
from fvi_cli.studies.order import OrderTable
from fvi_cli.studies.order import order_tables as tables_of_orders
from fvi_cli.studies.sweep_summary import sweep_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fvi_cli.planning.plan import Plan as Machinery
    from fvi_cli.runner.campaign import Outcome, Plan
    from fvi_cli.storage import StoredFile
    from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
    from fvi_cli.studies.order import OrderTable

MOST_ALIKE = 1024
"""Members of a sweep among which those are looked for that are computed with the first."""

_logger = logging.getLogger(__name__)


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows of words as columns, the first row as heading."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    return "\n".join(lines)


def runs_as_text(outcomes: Sequence[Outcome], *, every_member: bool = False) -> str:
    """One line for every finished run; of a sweep one for each method and number of steps.

    Parameters
    ----------
    outcomes
        What became of the experiments.
    every_member
        Give every member of a sweep a line as well.
    """
    rows = [("experiment", "case", "n_steps", "step_size", "error", "status", "expected")]
    summed_up = []
    for outcome in outcomes:
        if outcome.experiment.members:
            summed_up.append(_members_as_text(outcome))
        if outcome.experiment.members and not every_member:
            continue
        for finished in outcome.finished:
            run = finished.run
            member = "" if run.member is None else f" ({run.member.label})"
            rows.append(
                (
                    run.experiment.name,
                    run.method.case,
                    str(run.n_steps),
                    f"{run.step_size:.6g}",
                    f"{finished.error:.3e}",
                    f"{finished.status}{member}",
                    "may fail" if run.experiment.expects_failure(run.method) else "",
                )
            )
    texts = [aligned(rows)] if len(rows) > 1 or not summed_up else []
    texts += _assurances_as_text(outcomes)
    return "\n\n".join([*texts, *summed_up])


def _assurances_as_text(outcomes: Sequence[Outcome]) -> list[str]:
    """Tolerance, estimate and choice of runs that were chosen for a tolerance."""
    rows = [("experiment", "tolerance", "estimate", "choice")]
    for outcome in outcomes:
        for finished in outcome.finished:
            own = finished.assurance
            if own is not None:
                name = outcome.experiment.name
                rows.append((name, f"{own.tolerance:g}", f"{own.estimate:.3e}", own.choice))
    return [aligned(rows)] if len(rows) > 1 else []


def _members_as_text(outcome: Outcome) -> str:
    """One line for each method and number of steps of a sweep."""
    rows = [("experiment", "case", "n_steps", "members", "median", "largest", "status", "at")]
    rows += [
        (
            outcome.experiment.name,
            line.method.case,
            str(line.n_steps),
            str(line.members),
            f"{line.median_error:.3e}",
            f"{line.largest_error:.3e}",
            line.statuses,
            line.worst,
        )
        for line in sweep_lines(outcome.finished)
    ]
    return aligned(rows)


def plans_as_text(plans: Sequence[Plan], *, in_full: bool = False) -> str:
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
        own = planned(run, _members_with([one.run for one in alike[:MOST_ALIKE]]).get(run, 1))
        rows.append(
            (
                run.experiment.name,
                run.method.case,
                str(run.n_steps),
                f"{run.step_size:.6g}",
                plan.action if run.member is None else f"{plan.action} {len(alike)} members",
                plan.predicted,
                ", ".join(effects_of(run.problem)),
                *_costs(own),
                plan.reason,
            )
        )
    text = aligned(rows)
    return f"{text}\n\n{machinery_as_text([p.run for p in plans])}" if in_full else text


def _alike(plans: Sequence[Plan]) -> list[list[Plan]]:
    """Every plan by itself, but those of members that differ in their members only."""
    groups: dict[tuple[object, ...], list[Plan]] = {}
    for plan in plans:
        run = plan.run
        shared = (run.experiment, run.method, run.n_steps, plan.action, plan.predicted, plan.reason)
        groups.setdefault((run,) if run.member is None else shared, []).append(plan)
    return list(groups.values())


def machinery_as_text(runs: Sequence[Run]) -> str:
    """How every run is done, in a paragraph each; runs that are done alike share one."""
    paragraphs: dict[str, list[str]] = {}
    together = _members_with(runs)
    for run in runs:
        own = planned(run, together.get(run, 1))
        if own is not None:
            lines = "\n".join(f"  {line}" for line in own.lines())
            name = f"{run.experiment.name} {run.method.case} N={run.n_steps}"
            paragraphs.setdefault(lines, []).append(name)
    return "\n".join(
        f"{', '.join(dict.fromkeys(names))}\n{lines}" for lines, names in paragraphs.items()
    )


def planned(run: Run, members: int = 1) -> Machinery | None:
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
    )


def _members_with(runs: Sequence[Run]) -> dict[Run, int]:
    """With how many members, itself among them, every run of a sweep is integrated."""
    from fvi_cli.integrator.members import companions
    from fvi_cli.studies.batches import batches_of

    found: dict[Run, int] = {}
    for batch in batches_of([run for run in runs if run.member is not None]):
        problems = [run.problem for run in batch]
        scenes = [one.scene for one in problems if not isinstance(one, DerivativeProblem)]
        if len(scenes) == len(batch):
            counts = companions(scenes, batch[0].method, batch[0].n_steps)
            found.update(zip(batch, counts, strict=True))
    return found


def _costs(plan: Machinery | None) -> tuple[str, str, str]:
    if plan is None:
        return ("-", "-", "-")
    count = plan.history_operations
    return (
        "-" if count is None else str(count),
        f"{plan.memory_bytes / 1e6:.3g} MB",
        f"about {plan.seconds:.1g} s" if plan.seconds < 10 else f"about {plan.seconds:.0f} s",
    )


def effects_of(problem: AnyProblem) -> list[str]:
    """Names of what is simulated; what is absent costs nothing."""
    if isinstance(problem, DerivativeProblem):
        return [f"derivative of order {problem.order:g}"]
    from fvi_cli.planning.plan import effects_of_scene

    return list(effects_of_scene(problem.scene))


def contents_as_text(stored: StoredFile) -> str:
    """Where a result file comes from, and one line for every run in it."""
    lines = [f"{name}: {value}" for name, value in stored.provenance.items()]
    rows = [("experiment", "case", "n_steps", "step_size", "norm", "error", "status")]
    rows += [
        (
            run.experiment,
            run.case,
            str(run.n_steps),
            f"{run.step_size:.6g}",
            run.norm,
            f"{run.error:.3e}",
            run.status if run.is_complete else "incomplete",
        )
        for run in stored.runs
    ]
    text = "\n".join([*lines, "", aligned(rows)])
    swept = dict.fromkeys(
        f"{run.experiment}: {run.members} members, {run.swept}; the largest error is shown"
        for run in stored.runs
        if run.members
    )
    return "\n".join([text, *(["", *swept] if swept else [])])


def studies(outcomes: Sequence[Outcome]) -> list[tuple[Experiment, tuple[FinishedRun, ...]]]:
    """Experiments with their finished runs."""
    return [(outcome.experiment, outcome.finished) for outcome in outcomes]


def order_tables(outcomes: Sequence[Outcome]) -> list[OrderTable]:
    """A table of orders for every experiment, and for every member of a sweep."""
    return [
        table
        for outcome in outcomes
        for table in tables_of_orders(outcome.experiment, outcome.finished)
    ]


def write_benchmark(output: Path, exponent: int) -> tuple[str, Path]:
    """Measure the engine, write ``benchmark.md`` in `output`; returns the text and the path."""
    from fvi_cli.storage.provenance import package_versions, platform_name
    from fvi_cli.studies.benchmark import run_benchmark
    from fvi_cli.studies.many_benchmark import run_many_benchmark
    from fvi_cli.studies.memory_benchmark import run_memory_benchmark

    before = _load()
    times = run_benchmark(exponent=exponent)
    many = run_many_benchmark(exponent)
    # with the usual 2^20: 2^22 steps that are kept, and ten millions of which a few are
    memory = run_memory_benchmark(exponent=exponent + 2, long_steps=10**7 * 2**exponent // 2**20)
    versions = package_versions()
    made_by = ", ".join(f"{name} {versions[name]}" for name in ("python", "numpy", "scipy"))
    text = "\n".join(
        (
            "# What the engine takes",
            "",
            f"Made by `fvi benchmark --exponent {exponent}` on one core: {platform_name()}, "
            f"{made_by}; runnable processes before and after: {before} and {_load()} on "
            f"{os.cpu_count()} processors. Times mean little where others compute as well.",
            "",
            "## Time and error",
            "",
            times.to_markdown(),
            "## Many oscillators",
            "",
            many.to_markdown(),
            "## Memory",
            "",
            memory.to_markdown(),
        )
    )
    path = output / "benchmark.md"
    output.mkdir(parents=True, exist_ok=True)
    replace_file(path, text.encode())
    return text, path


def _load() -> str:
    """How many processes want a processor, on average over a minute."""
    # not every system tells
    return f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"


def write_figures(figures: Mapping[str, Figure], output: Path) -> list[Path]:
    """Write figures under ``figures/`` in `output`; returns the paths."""
    from fvi_cli.plotting import save_figure

    written: list[Path] = []
    for name, figure in figures.items():
        written += save_figure(figure, output / "figures", name)
    return written


def compare_figures(figures: Mapping[str, Figure], output: Path) -> list[str]:
    """One line for everything that the stored figures show differently."""
    from fvi_cli.plotting import compare_drawn, drawn_text

    differences = []
    for name, figure in figures.items():
        path = output / "figures" / f"{name}.json"
        missing = [
            str(other)
            for other in (path, path.with_suffix(".pdf"), path.with_suffix(".png"))
            if not other.is_file()
        ]
        differences += [f"{other}: missing" for other in missing]
        if not path.is_file():
            continue
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            differences.append(f"{path}: cannot be read")
            continue
        fresh = json.loads(drawn_text(figure))
        differences += [f"{path}: {line}" for line in compare_drawn(stored, fresh)]
    return differences


def write_starter(name: str, kind: str) -> Path:
    """Write a commented configuration into the current folder; it must not be there yet.

    The JSON schema for editors is put beside it, or brought up to date; a file of that name that
    is no schema of ours is left alone.

    Raises
    ------
    RequestError
        For an unknown kind, a name that is not allowed, or a file that exists.
    """
    if not is_name(name):
        raise RequestError(f"{name!r} is not allowed as a name; use letters, digits, - and _")
    path = Path(f"{name}.yaml")
    text = starter_config(kind, name=name)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise RequestError(f"{path}: exists already; it is left as it is") from None
    except OSError as error:
        raise RequestError(f"{path}: cannot be written: {error.strerror}") from None
    _write_schema(Path(SCHEMA_FILE))
    return path


def _write_schema(path: Path) -> None:
    """Write the schema unless it is there already, or another file is."""
    fresh = schema_text()
    try:
        stored = path.read_text(encoding="utf-8") if path.exists() else ""
        if stored == fresh or (stored and f'"{SCHEMA_TITLE}"' not in stored):
            return
        replace_file(path, fresh.encode())
    except (OSError, UnicodeDecodeError) as error:
        _logger.warning("%s: not written: %s", path, error)
    else:
        _logger.info("%s: for editors", path)
