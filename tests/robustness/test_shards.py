"""Parts of a configuration, computed by several commands and joined, are the whole."""

from pathlib import Path

import command_line
import h5py
import numpy as np
import pytest

from fvi_cli.config import parse_config
from fvi_cli.runner.executors import batches
from fvi_cli.runner.parts.shard import Shard

CONFIG = """\
experiments:
  - name: many
    problem: {kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0, exact: none}
    method: {rk: gauss, degree: 1}
    ladder: {steps: [2, 4]}
    sweep: {problem.stiffness: {from: 1.0, to: 4.0, number: 7}}
  - name: one
    problem: {kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0}
    method: {bdf: [1, 2], sampling: nodes}
    ladder: {steps: [4, 8, 16]}
  - name: chosen
    problem: {kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0}
    accuracy: {tolerance: 1e-3}
name: all
"""
RUNS = 2 * 7 + 6 + 1
OF_TIME = {"setup_seconds", "stepping_seconds", "created", "seconds"}


def fvi(*arguments: object) -> tuple[int, str]:
    done = command_line.fvi(*arguments)
    return done.exit_code, done.output


@pytest.fixture(autouse=True)
def few_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batches, "LARGEST_PACK", 3)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole, and its three parts."""
    folder = tmp_path_factory.mktemp("shards")
    (folder / "all.yaml").write_text(CONFIG)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batches, "LARGEST_PACK", 3)
        for output, *shard in [("whole",), *(("parts", "--shard", f"{k}/3") for k in (1, 2, 3))]:
            code, told = fvi("run", folder / "all.yaml", "-q", "-o", folder / output, *shard)
            assert code == 0, told
    return folder


def numbers(path: Path) -> dict[str, object]:
    """Everything in a file but times."""
    found: dict[str, object] = {}

    def note(name: str, node: h5py.Group | h5py.Dataset) -> None:
        # runs are numbered as they were finished
        if name.rpartition("/")[2] in OF_TIME or name.startswith("@index"):
            return
        if isinstance(node, h5py.Dataset):
            found[name] = repr(np.asarray(node[()]).tolist())
        found[f"{name}?"] = {
            key: str(value)
            for key, value in node.attrs.items()
            if key not in OF_TIME and not key.endswith("_LIST")
        }

    with h5py.File(path) as file:
        file.visititems(note)
        found["config"] = [file.attrs[key] for key in ("config", "resolved_config")]
    return found


def test_every_run_is_in_one_part_and_packs_stay_whole():
    experiments = parse_config(CONFIG, "all.yaml").experiments
    whole = [run for one in experiments for run in one.runs()]
    for count in (1, 2, 3, 7, 100):
        seen: list[object] = []
        for number in range(1, count + 1):
            shard = Shard(number=number, count=count)
            found = [run for own in shard.runs_of(experiments).values() for run in own]
            runs = [run for run in found if not run.is_search]
            seen += [(run.experiment, run.method, run.n_steps, run.member) for run in runs]
            seen += [run.experiment.name for run in found if run.is_search]
            members = [run for run in runs if run.member is not None]
            packs = {batches.pack_of(run) for run in members}
            # every pack with all of its steps, the last of seven members by itself
            assert len(members) == sum(2 * (1 if pack[1] == 2 else 3) for pack in packs)
        assert len(seen) == len(set(seen)) == len(whole)
    halves = [Shard(number=k, count=2).runs_of(experiments) for k in (1, 2)]
    work = [sum(run.n_steps for own in half.values() for run in own) for half in halves]
    assert max(work) <= 1.2 * min(work)


def test_parts_that_are_joined_are_the_whole_bit_by_bit(results):
    parts = sorted((results / "parts").glob("*.h5"))
    assert [path.name for path in parts] == [f"all.shard-{k}-of-3.h5" for k in (1, 2, 3)]
    target = results / "joined" / "all.h5"
    code, told = fvi("merge", *parts[:2], "-o", target.parent)
    assert code == 1
    assert "runs are missing in all files; run their part, then merge again" in told
    before = [path.read_bytes() for path in parts]
    code, told = fvi("merge", *reversed(parts), target, "-o", target.parent)
    assert (code, told) == (0, f"{target}: {RUNS} of {RUNS} runs\n")
    assert [path.read_bytes() for path in parts] == before
    assert numbers(target) == numbers(results / "whole" / "all.h5")
    # and is reused
    code, told = fvi("run", results / "all.yaml", "-o", target.parent, "--dry-run")
    assert "compute" not in told
    written = target.stat().st_mtime_ns
    assert fvi("merge", *parts, "-o", target.parent)[0] == 0
    assert target.stat().st_mtime_ns == written


def test_a_part_finds_what_it_has_computed(results):
    output = ("-o", results / "parts", "--shard", "2/3", "--dry-run")
    code, told = fvi("run", results / "all.yaml", *output)
    assert code == 0
    assert "reuse" in told
    assert "compute" not in told
