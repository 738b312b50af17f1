"""Parts of a configuration, computed by several commands and joined, are the whole."""

import contextlib
import os
import re
import shutil
import subprocess
import threading
from pathlib import Path
from types import SimpleNamespace

import command_line
import h5py
import numpy as np
import pytest

from fvi_cli.config import parse_config
from fvi_cli.runner.executors import batches
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.parts.shard import Shard
from fvi_cli.storage.atomic import file_lock
from fvi_cli.studies.experiment import FinishedRun

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
OF_TIME = {"setup_seconds", "stepping_seconds", "created", "checksum", "seconds"}


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


def test_files_that_do_not_belong_together_are_refused(results, tmp_path):
    (tmp_path / "all.yaml").write_text(CONFIG.replace("to: 4.0", "to: 5.0"))
    assert fvi("run", tmp_path / "all.yaml", "-q", "-o", tmp_path, "--shard", "1/3")[0] == 0
    own, other = (folder / "all.shard-1-of-3.h5" for folder in (results / "parts", tmp_path))
    code, told = fvi("merge", own, other, "-o", tmp_path / "new")
    assert code == 2
    assert f"{other}: is of another configuration than {own}" in told
    assert not (tmp_path / "new").exists()
    for what, said in ((tmp_path / "none.h5", "no such file"), ("all.yaml", "not a result file")):
        code, told = fvi("merge", what, "-o", tmp_path / "new")
        assert code == 2
        assert said in told


def test_what_is_damaged_or_differs_is_not_joined(results, tmp_path):
    parts = sorted((results / "parts").glob("*.h5"))
    own = [Path(shutil.copy(path, tmp_path)) for path in parts]
    content = bytearray(own[1].read_bytes())
    content[len(content) // 2] ^= 1
    own[1].write_bytes(content)
    code, told = fvi("merge", *own, "-o", tmp_path / "new")
    assert code == 2
    assert f"{own[1]}: is damaged" in told
    assert not (tmp_path / "new" / "all.h5").exists()

    def other_numbers(job, references):
        finished = execute_job(job, references)
        for one in finished:
            if isinstance(one, FinishedRun):
                one.trajectory.position[:] *= 1.001
        return finished

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fvi_cli.runner.compute.execute_job", other_numbers)
        again = ("run", results / "all.yaml", "-q", "-o", tmp_path, "--shard", "1/3", "--fresh")
        assert fvi(*again)[0] == 0
    code, told = fvi("merge", own[0], parts[0], "-o", tmp_path / "new")
    assert code == 2
    assert "has other numbers than the same run in" in told


@pytest.mark.parametrize("waits", [False, True])
def test_a_command_waits_for_another_if_it_is_told_to(waits, results, tmp_path, monkeypatch):
    source = shutil.copy(results / "parts" / "all.shard-1-of-3.h5", tmp_path)
    target = tmp_path / "new"
    held, release, said = threading.Event(), threading.Event(), []

    def hold() -> None:
        with file_lock(target / "all.h5"):
            held.set()
            release.wait(60)

    def say(line: str, *arguments: object) -> None:
        said.append(line % arguments)
        release.set()

    monkeypatch.setattr("fvi_cli.storage.atomic._logger.info", say)
    holder = threading.Thread(target=hold)
    holder.start()
    held.wait()
    code, told = fvi("merge", source, "-o", target, *(["--wait"] if waits else []))
    release.set()
    holder.join()
    assert ["waiting until it has ended" in line for line in said] == ([True] if waits else [])
    assert ("(--wait does)" in told) != waits
    assert code == (1 if waits else 2)  # the other parts are missing


# --- what the page shows, without the scheduler ---------------------------------------------------

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "million-runs.md"


def shown(kind: str) -> str:
    (found,) = re.findall(rf"```{kind}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    return str(found)


def shell(folder: Path, script: str, **variables: str) -> str:
    """What the commands of a script answer, called here with the arguments that it gives them."""
    (folder / "bin").mkdir(exist_ok=True)
    command = folder / "bin" / "fvi"
    command.write_text('#!/bin/sh\nprintf "%s\\n" "$@" >>asked\n')
    command.chmod(0o755)
    path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
    asked = folder / "asked"
    asked.unlink(missing_ok=True)
    variables = {**os.environ, **variables, "PATH": path}
    subprocess.run(["bash", "-euc", script], cwd=folder, env=variables, check=True)
    with contextlib.chdir(folder):
        code, told = fvi(*asked.read_text().splitlines())
    assert code == 0, told
    return told


@pytest.mark.skipif(shutil.which("bash") is None, reason="runs scripts of bash")
def test_the_job_array_and_the_rules_of_the_page(tmp_path):
    config = CONFIG.partition("  - name: one")[0] + "name: many\n"
    array, rules = shown("bash"), shown("snakemake")
    assert "#SBATCH --array=1-4\n" in array
    (join,) = re.findall(r"^    sbatch --wait \S+ && (.*)$", PAGE.read_text("utf-8"), re.MULTILINE)
    whole, part = re.findall(r'shell: "(.*)"', rules)
    files = [f"results/many.shard-{k}-of-4.h5" for k in range(1, 5)]
    for name in ("array", "rules"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "many.yaml").write_text(config)
    for k in "1234":
        shell(tmp_path / "array", array, SLURM_ARRAY_TASK_ID=k)
        own = part.format(input="many.yaml", wildcards=SimpleNamespace(part=k))
        shell(tmp_path / "rules", own)
    told = shell(tmp_path / "array", join)
    assert shell(tmp_path / "rules", whole.format(input=" ".join(files))) == told
    assert told == "results/many.h5: 14 of 14 runs\n"
    found = [tmp_path / name / "results" for name in ("array", "rules")]
    assert all((folder / Path(one).name).exists() for folder in found for one in files)
    assert numbers(found[0] / "many.h5") == numbers(found[1] / "many.h5")
