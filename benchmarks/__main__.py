"""``python -m benchmarks NAME...``: measure, and write ``results/NAME.md``."""

from __future__ import annotations

import argparse
import secrets
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from benchmarks.accuracy import run_accuracy
from benchmarks.measuring import figures_table
from benchmarks.memory import memory_table, run_memory
from benchmarks.peers import peers_table, run_peers
from benchmarks.people import run_people
from benchmarks.startup import REPEATS, run_startup
from benchmarks.stepping import run_stepping, stepping_table
from benchmarks.tolerances import run_tolerances, tolerance_table
from benchmarks.truth import run_truth, truth_table
from fvi_cli.storage.provenance import package_versions, platform_name
from tests.hard_cases.judge import hard_cases_page

COSTS = "Ratios of seconds until a run with that error is done (`fvi cost` measures them)."
STARTS = f"Least seconds of {REPEATS} processes in turn, as multiples of the first."
WORK = "Processor seconds in one thread, the least of three in turn in one process."


def _truth(asked: argparse.Namespace) -> str:
    print(f"truth: seed {asked.seed}", flush=True)
    rows = run_truth(asked.per_mille, seed=asked.seed)
    asked.is_wrong = sum(row.verdict == "wrong" for row in rows) > asked.most_wrong
    return truth_table(rows)


PAGES: Mapping[str, tuple[str, Callable[[argparse.Namespace], str]]] = {
    "stepping": ("Time and error of steps", lambda asked: stepping_table(run_stepping())),
    "memory": ("Memory of runs", lambda asked: memory_table(run_memory())),
    "accuracy": ("What accuracy costs", lambda asked: figures_table(COSTS, run_accuracy())),
    "startup": ("What a command takes", lambda asked: figures_table(STARTS, run_startup())),
    "people": ("What people do", lambda asked: figures_table(WORK, run_people())),
    "peers": ("Beside other packages", lambda asked: peers_table(run_peers())),
    "hard-cases": ("Hard cases", lambda asked: hard_cases_page()),
    "truth": ("Whether printed numbers are true", _truth),
    "tolerances": (
        "Whether tolerances are kept",
        lambda asked: tolerance_table(list(run_tolerances(1e-3 * asked.per_mille))),
    ),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is named, and write its pages; 1 where numbers are wrong."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="+", metavar="NAME", choices=PAGES, help=", ".join(PAGES))
    parser.add_argument("--per-mille", type=int, default=1000, metavar="N")
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**9), metavar="S")
    parser.add_argument("--most-wrong", type=int, default=0, metavar="N")
    parser.add_argument("--output", type=Path, default=Path("results"), help="folder of the pages")
    asked = parser.parse_args(arguments, argparse.Namespace(is_wrong=False))
    versions = ", ".join(f"{k} {v}" for k, v in package_versions().items() if k in PRINTED)
    asked.output.mkdir(parents=True, exist_ok=True)
    for name in asked.names:
        title, measure = PAGES[name]
        command = name
        if name in ("truth", "tolerances"):
            command += f" --per-mille {asked.per_mille}"
        if name == "truth":
            command += f" --seed {asked.seed}"
        head = f"Made by `python -m benchmarks {command}` ({platform_name()}, {versions})."
        text = "\n".join([f"# {title}", "", head, "", measure(asked)])
        (asked.output / f"{name}.md").write_text(text, encoding="utf-8")
        print(text)
    return int(asked.is_wrong)


PRINTED = ("python", "numpy", "scipy")

if __name__ == "__main__":
    raise SystemExit(main())
