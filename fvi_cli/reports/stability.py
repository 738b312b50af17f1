"""Tables of stability: CSV, Markdown and JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from fvi_cli.errors import StorageError
from fvi_cli.integrator.stability import TOLERATED_GROWTH
from fvi_cli.reports.document import Block, Code, Grid, Heading, Paragraph
from fvi_cli.reports.markdown import to_markdown
from fvi_cli.reports.naming import method_names
from fvi_cli.reports.plain_text import to_text
from fvi_cli.storage.atomic import replace_file
from fvi_cli.studies.stability_study import StabilityRow, StabilityTable

FORMAT = 1
MOST_LINES = 200
"""Lines of a grid; of a longer study only the numbers of unstable members are listed."""

Cell = str | int | float | None

COLUMNS = (
    "experiment",
    "member",
    "case",
    "n_steps",
    "step_size",
    "predicted",
    "growth_per_step",
    "exact_growth_per_step",
    "growing_modes",
    "largest_stable_step",
    "lasting_step",
    "observed",
    "observed_growth_per_step",
    "observed_steps",
    "predicted_over_observed_steps",
    "agrees",
    "reason",
)
REGION_COLUMNS = ("case", "order", "points", "stable_share")


def stability_rows_as_words(tables: Sequence[StabilityTable]) -> Iterator[dict[str, Cell]]:
    """Every row under :data:`COLUMNS`; growths are natural logarithms, per step."""
    for table in tables:
        for row in table.rows:
            seen = row.observation
            agrees = None if seen is None else seen.agrees
            yield {
                "experiment": table.experiment.name,
                "member": "" if row.run.member is None else row.run.member.label,
                "case": row.run.method.case,
                "n_steps": row.run.n_steps,
                "step_size": float(row.run.step_size),
                "predicted": row.prediction.verdict,
                "growth_per_step": float(row.prediction.growth_per_step),
                "exact_growth_per_step": float(row.prediction.exact_growth),
                "growing_modes": row.prediction.growing_modes,
                "largest_stable_step": float(row.largest_stable_step),
                "lasting_step": float(row.lasting_step),
                "observed": "" if seen is None else seen.verdict,
                "observed_growth_per_step": math.nan if seen is None else seen.growth_per_step,
                "observed_steps": "" if seen is None else seen.n_steps,
                "predicted_over_observed_steps": "" if seen is None else seen.predicted,
                "agrees": "" if agrees is None else "yes" if agrees else "no",
                "reason": row.prediction.reason,
            }


def stability_csv(tables: Sequence[StabilityTable]) -> str:
    """One line for every method, member and step; numbers in full precision."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in stability_rows_as_words(tables):
        writer.writerow({k: repr(v) if isinstance(v, float) else v for k, v in row.items()})
    return text.getvalue()


def stability_json(name: str, tables: Sequence[StabilityTable]) -> str:
    """The same rows, and the shares of the regions; nan is null."""
    rows = [
        {key: _json_number(value) for key, value in row.items()}
        for row in stability_rows_as_words(tables)
    ]
    regions = [
        {
            "experiment": table.experiment.name,
            "case": region.method.case,
            "order": region.order,
            "points": int(region.level.size),
            "stable_share": region.share_stable,
        }
        for table in tables
        for region in table.regions
    ]
    content = {"format": FORMAT, "name": name, "rows": rows, "regions": regions}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _json_number(value: Cell) -> Cell:
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else repr(value)
    return value


def stability_report(name: str, tables: Sequence[StabilityTable]) -> list[Block]:
    """Everything for people to read."""
    blocks: list[Block] = [
        Heading(level=1, words=f"Stability: {name}"),
        Paragraph(
            words="Every cell gives the growth of the worst mode in one step, a factor; a run is "
            f"unstable (in CAPITALS) when it outgrows the exact scene by {TOLERATED_GROWTH:.0f} "
            "and the mode is none of the exact scene. Modes called slow grow, but too slowly for "
            "that number of steps. Below the stable h runs over this time are stable, below the "
            "lasting h also those over a thousand times this time."
        ),
    ]
    for table in tables:
        blocks.append(Heading(level=2, words=(Code(table.experiment.name),)))
        blocks += _rows(table)
        blocks += _regions(table)
    return blocks


def _rows(table: StabilityTable) -> Iterator[Block]:
    names = method_names(table.experiment.methods)
    steps = sorted({row.run.n_steps for row in table.rows})
    lines: dict[tuple[str, str], list[StabilityRow]] = {}
    for row in table.rows:
        member = "" if row.run.member is None else row.run.member.label
        lines.setdefault((row.run.method.case, member), []).append(row)
    swept = any(member for _, member in lines)
    keys = ("method", "member") if swept else ("method",)
    if len(lines) > MOST_LINES:
        yield _counts(table, steps)
    else:
        cells = []
        for (case, member), rows in lines.items():
            found = {row.run.n_steps: row for row in rows}
            cells.append(
                (
                    names[case].label,
                    *((member,) if swept else ()),
                    *(_cell(found[n]) for n in steps),
                    _size(rows[0].largest_stable_step, table.experiment.problem.final_time),
                    _size(rows[0].lasting_step, table.experiment.problem.final_time),
                    *_exact(rows),
                )
            )
        header = (*keys, *(f"N = {n}" for n in steps), "stable h", "lasting h", "exact, per time")
        yield Grid(header=header, rows=tuple(cells), text_columns=len(keys), key_columns=len(keys))
    yield Paragraph(words=_agreement(table))
    for row in table.disagreements:
        yield Paragraph(words=f"Observed otherwise: {row.run.title}: {row.observation}")


def _counts(table: StabilityTable, steps: Sequence[int]) -> Grid:
    """For a study of many members: how many are unstable."""
    names = method_names(table.experiment.methods)
    cells = []
    for case, name in names.items():
        entries = []
        for n in steps:
            rows = [r for r in table.rows if r.run.method.case == case and r.run.n_steps == n]
            unstable = sum(row.verdict == "unstable" for row in rows)
            entries.append(f"{unstable} of {len(rows)}")
        cells.append((name.label, *entries))
    header = ("method: unstable members", *(f"N = {n}" for n in steps))
    return Grid(header=header, rows=tuple(cells))


def _cell(row: StabilityRow) -> str:
    if row.verdict == "unknown":
        return "unknown"
    growth = row.prediction.growth_per_step
    factor = math.exp(min(growth, 700.0))
    if row.verdict == "unstable":
        return f"UNSTABLE {factor:.3g}"
    if not growth:
        return "stable"
    return f"grows {factor:.3g}" if row.prediction.exact_growth else f"slow {factor:.6g}"


def _size(step: float, final_time: float) -> str:
    if math.isnan(step):
        return "-"
    return f"{step:.3g}" if step < final_time else "no limit"


def _exact(rows: Sequence[StabilityRow]) -> tuple[str, ...]:
    """Growth of the exact scene, from the smallest step."""
    finest = min(rows, key=lambda row: row.run.step_size)
    growth = finest.prediction.exact_growth / finest.run.step_size
    return (f"{growth:.4g}" if growth else "0",)


def _agreement(table: StabilityTable) -> str:
    seen = [row.observation for row in table.rows if row.observation is not None]
    if not seen:
        return "Not observed."
    compared = [one for one in seen if one.agrees is not None]
    agreed = sum(one.agrees is True for one in compared)
    words = f"Observed from random data: {agreed} of {len(compared)} runs as predicted."
    if len(compared) < len(seen):
        words += f" Of {len(seen) - len(compared)} runs nothing is predicted."
    return words


def _regions(table: StabilityTable) -> Iterator[Block]:
    if not table.regions:
        return
    names = method_names(table.experiment.methods)
    orders = sorted({region.order for region in table.regions})
    shares: dict[str, dict[float, float]] = {}
    for region in table.regions:
        shares.setdefault(region.method.case, {})[region.order] = region.share_stable
    first = table.regions[0]
    yield Paragraph(
        words="Share of the plane of h^2 k/m from "
        f"{first.stiffness[0]:g} to {first.stiffness[-1]:g} and mu h^(2 - order)/m from "
        f"{first.damping[0]:g} to {first.damping[-1]:g} (logarithmic) where no mode grows by more "
        "than 0.1 % in a step:"
    )
    yield Grid(
        header=("method", *(f"order {order:g}" for order in orders)),
        rows=tuple(
            (names[case].label, *(f"{100 * by_order[order]:.1f} %" for order in orders))
            for case, by_order in shares.items()
        ),
    )


def stability_text(name: str, tables: Sequence[StabilityTable]) -> str:
    """What a terminal shows."""
    return to_text(stability_report(name, tables))


def write_stability_tables(
    directory: Path, name: str, tables: Sequence[StabilityTable]
) -> list[Path]:
    """Write ``<name>-stability.csv``, ``.md`` and ``.json`` into `directory`; returns the paths.

    Raises
    ------
    StorageError
        If the folder or a file cannot be written.
    """
    texts: Mapping[str, str] = {
        "csv": stability_csv(tables),
        "md": to_markdown(stability_report(name, tables)),
        "json": stability_json(name, tables),
    }
    place = directory
    written = []
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for form, text in texts.items():
            place = directory / f"{name}-stability.{form}"
            replace_file(place, text.encode("utf-8"))
            written.append(place)
    except OSError as error:
        raise StorageError(f"{place}: cannot be written: {error.strerror}") from None
    return written


def compare_stability_tables(
    directory: Path, name: str, tables: Sequence[StabilityTable]
) -> list[str]:
    """One line for every difference between the stored table and this one.

    Verdicts must be the same, predicted growths and steps within a thousandth; what was measured
    from random data may differ in its digits.
    """
    path = directory / f"{name}-stability.csv"
    if not path.is_file():
        return [f"{path}: missing"]
    stored = list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))
    fresh = list(csv.DictReader(io.StringIO(stability_csv(tables))))
    if len(stored) != len(fresh):
        return [f"{path}: {len(stored)} rows, now {len(fresh)}"]
    differences = []
    for number, (old, new) in enumerate(zip(stored, fresh, strict=True), start=2):
        for key in COLUMNS:
            if key in _FREE:
                continue
            before, now = old.get(key), new[key]
            if before is None or not _same(key, before, now):
                differences.append(f"{path}:{number}: {key}: {before} is now {now}")
    return differences


_FREE = ("observed_growth_per_step", "observed_steps", "reason")
_NUMBERS = (
    "step_size",
    "growth_per_step",
    "exact_growth_per_step",
    "largest_stable_step",
    "lasting_step",
)


def _same(key: str, before: str, now: str) -> bool:
    if before == now or key not in _NUMBERS:
        return before == now
    try:
        return math.isclose(float(before), float(now), rel_tol=2e-3, abs_tol=1e-9)
    except ValueError:
        return False
