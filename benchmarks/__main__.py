"""``python -m benchmarks``: measure the engine, write ``results/benchmark.md``."""

from __future__ import annotations

import argparse
import os
import secrets
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.accuracy import accuracy_table, run_accuracy
from benchmarks.memory import memory_table, run_memory
from benchmarks.peers import peers_table, run_peers
from benchmarks.people import people_table, run_people
from benchmarks.startup import run_startup, startup_table
from benchmarks.stepping import run_stepping, stepping_table
from benchmarks.tolerances import run_tolerances, tolerance_table
from benchmarks.truth import run_truth, truth_table
from fvi_cli.storage.provenance import package_versions, platform_name
from tests.hard_cases.judge import hard_cases_page

SECTIONS: dict[str, tuple[str, Callable[[int], str]]] = {
    "stepping": ("Time and error", lambda exponent: stepping_table(run_stepping(exponent))),
    "memory": ("Memory", lambda exponent: memory_table(run_memory(exponent))),
    "accuracy": ("What accuracy costs", lambda exponent: accuracy_table(run_accuracy())),
}


PAGES: dict[str, tuple[str, Callable[[argparse.Namespace], str]]] = {
    "hard-cases": ("Hard cases", lambda asked: hard_cases_page()),
    "startup": (
        "What a command takes before it begins",
        lambda asked: startup_table(run_startup()),
    ),
    "peers": ("Beside other packages", lambda asked: peers_table(run_peers())),
    "people": ("What people do", lambda asked: people_table(run_people())),
    "truth": ("Whether printed numbers are true", lambda asked: _truth_page(asked)),
    "tolerances": (
        "Whether tolerances are kept",
        lambda asked: tolerance_table(list(run_tolerances(1e-3 * asked.per_mille))),
    ),
}
"""What has a page of its own, and is measured only when it is named."""


def _truth_page(asked: argparse.Namespace) -> str:
    """The table; `asked` is told whether anything is wrong."""
    print(f"truth: seed {asked.seed}", flush=True)
    rows = run_truth(asked.per_mille, seed=asked.seed)
    asked.is_wrong = sum(row.verdict == "wrong" for row in rows) > asked.most_wrong
    return truth_table(rows)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the named sections, or all, and write the page; 1 where numbers are wrong."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "sections", nargs="*", metavar="SECTION", help=", ".join([*SECTIONS, *PAGES])
    )
    parser.add_argument(
        "--exponent",
        type=int,
        choices=range(4, 23),
        default=20,
        metavar="E",
        help="linear scenes take 2^E steps (default 20); fewer than 2^20 are a trial",
    )
    parser.add_argument(
        "--per-mille",
        type=int,
        default=1000,
        metavar="N",
        help="tolerances, truth: so many thousandths of all scenes (default 1000)",
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=secrets.randbelow(10**9),
        metavar="S",
        help="truth: of the random scenes; default: another one every time, which is printed",
    )
    parser.add_argument(
        "--most-wrong",
        type=int,
        default=0,
        metavar="N",
        help="truth: up to so many wrong scenes end the command with 0 (default 0)",
    )
    parser.add_argument("--output", type=Path, default=Path("results"), help="folder of the page")
    asked = parser.parse_args(arguments, argparse.Namespace(is_wrong=False))
    unknown = set(asked.sections) - {*SECTIONS, *PAGES}
    if unknown:
        known = ", ".join([*SECTIONS, *PAGES])
        parser.error(f"no such section: {', '.join(sorted(unknown))} ({known})")
    for name in set(asked.sections) & set(PAGES):
        title, measure = PAGES[name]
        command = name
        if name == "truth":
            command += f" --per-mille {asked.per_mille} --seed {asked.seed}"
        if name == "tolerances":
            command += f" --per-mille {asked.per_mille}"
        _write_page(asked.output / f"{name}.md", title, command, measure(asked))
    sections = [name for name in asked.sections or SECTIONS if name in SECTIONS]
    if not sections:
        return int(asked.is_wrong)
    before = _load()
    measured = [
        f"## {SECTIONS[name][0]}\n\n{SECTIONS[name][1](asked.exponent)}" for name in sections
    ]
    versions = package_versions()
    made_by = ", ".join(f"{name} {versions[name]}" for name in ("python", "numpy", "scipy"))
    head = (
        f"Made by `python -m benchmarks --exponent {asked.exponent}` on one core: "
        f"{platform_name()}, {made_by}; runnable processes before and after: {before} and "
        f"{_load()} on {os.cpu_count()} processors. Times mean little where others compute as well."
    )
    text = "\n".join(["# What the engine takes", "", head, "", *measured])
    asked.output.mkdir(parents=True, exist_ok=True)
    path = asked.output / "benchmark.md"
    path.write_text(text, encoding="utf-8")
    print(text, path, sep="\n")
    return int(asked.is_wrong)


def _write_page(path: Path, title: str, command: str, measured: str) -> None:
    """A page of its own, with the command that makes it."""
    head = f"Made by `python -m benchmarks {command}`."
    text = "\n".join([f"# {title}", "", head, "", measured])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    print(text, path, sep="\n")


def _load() -> str:
    """How many processes want a processor, on average over a minute."""
    # not every system tells
    return f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"


if __name__ == "__main__":
    raise SystemExit(main())
