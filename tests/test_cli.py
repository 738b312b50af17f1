"""What the command line promises: results on stdout, talk on stderr, exit codes, no tracebacks."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import LADDER, fvi, rows_of
from spread import spread
from typer.testing import CliRunner

import fvi_cli
from fvi_cli.cli.app import app
from fvi_cli.runner import progress, request
from fvi_cli.storage.identity import SOLVER_VERSION
from fvi_cli.studies import study
from fvi_cli.studies.tolerance import search

QUICK = LADDER.replace("1, 2, 3]", "1, 2]").replace("16, 24, 32, 48]", "16, 32]")
# explicit in the damping: BDF6 leaves every bound at once
DIVERGING = QUICK.replace("bdf: [1, 2]", "bdf: [6, 1]").replace("quick", "diverging")
DIVERGING = DIVERGING.replace("[4, 8, 16, 32]", "[64, 128]")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    package = str(Path(fvi_cli.__file__).parents[1])
    inherited = os.environ.get("PYTHONPATH")
    # for processes: the package that is tested here, from a checkout as well
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [inherited, package])))
    (tmp_path / "quick.yaml").write_text(QUICK)
    (tmp_path / "diverging.yaml").write_text(DIVERGING)
    return tmp_path


def in_a_process(*arguments, **options):
    command = [sys.executable, "-m", "fvi_cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


def files(folder):
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())


# --- the outside ----------------------------------------------------------------------------------


def modules_after(statement):
    code = f"import sys; {statement}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    return {name.partition(".")[0] for name in done.stdout.split()}


@pytest.mark.processes
def test_the_command_line_loads_nothing_heavy():
    heavy = {"numpy", "scipy", "matplotlib", "h5py", "yaml", "sympy", "mpmath"}
    assert not heavy & modules_after("import fvi_cli.cli.app")
    # control: the same look at a module that does need NumPy
    assert "numpy" in modules_after("import fvi_cli.runner.compute")


@pytest.mark.processes
def test_help_names_every_command_and_version_the_version():
    done = in_a_process("--help")
    assert done.returncode == 0
    for command in ("run", "convergence", "plot", "check", "show", "new"):
        assert re.search(rf"^. {command} ", done.stdout, re.MULTILINE)
        fvi(command, "--help", code=0)
    assert fvi("--version", code=0).stdout == f"fvi {fvi_cli.__version__}\n"


# --- run ------------------------------------------------------------------------------------------


MISTAKEN = """\
name: mistaken
experiments:
  - name: bad
    problem:
      kind: bagley-torvik
      damping: [{order: 0.5, coefficient: 1.0}]
      initial: {position: 11.0, velocity: 0.0}
      final_time: 1.0
    ladder: {steps: [4, 8]}
  - name: good
    problem: {kind: pendulum, initial: {position: 1.0, velocity: 0.0}, final_time: 1.0}
    ladder: {steps: [4, 8]}
"""


@pytest.mark.parametrize("key", ["ladder: {steps: [4, 8]}", "accuracy: {tolerance: 1e-3}"])
def test_a_mistake_of_the_program_costs_its_own_batch(folder, monkeypatch, key):
    def mistaken(usual):
        def made_up(scenes, *arguments, **options):
            (scene,) = scenes if isinstance(scenes, list) else [scenes]
            if scene.initial_position.max() > 10:
                raise ZeroDivisionError("made up")
            return usual(scenes, *arguments, **options)

        return made_up

    for module, name in ((study, "integrate_members"), (search, "adaptive_run")):
        monkeypatch.setattr(module, name, mistaken(getattr(module, name)))
    (folder / "mistaken.yaml").write_text(MISTAKEN.replace("ladder: {steps: [4, 8]}", key, 1))
    result = fvi("run", "mistaken.yaml", code=1)
    assert "bad" in result.stderr
    assert "ZeroDivisionError" in result.stderr
    assert re.search(r"^bad .* failed$", result.stdout, re.MULTILINE)
    # the others are stored; the mistake is not, so that it is tried again
    told = fvi("run", "mistaken.yaml", "--dry-run").stdout
    assert [line.split()[0] for line in told.splitlines() if "reuse" in line] == ["good", "good"]


@pytest.mark.processes
def test_several_processes_store_the_same_table(folder):
    fvi("convergence", "quick.yaml", "--output", "one", code=0)
    fvi("convergence", "quick.yaml", "--output", "two", "--workers", "2", code=0)
    one, two = (rows_of(folder / name / "tables" / "quick.csv") for name in ("one", "two"))
    for row in (*one, *two):
        row.pop("seconds")
    assert one == two


def actions(result):
    """What would be done, in every row of a dry run."""
    header, *rows = result.stdout.splitlines()
    return [row[header.index("action") :].split()[0] for row in rows]


def becomes_another(monkeypatch):
    """What is stored so far is that of another version of the solver."""
    monkeypatch.setattr("fvi_cli.storage.identity.SOLVER_VERSION", SOLVER_VERSION + 1)


def test_runs_of_another_solver_are_computed_again(folder, monkeypatch):
    fvi("run", "quick.yaml", "-q")
    assert actions(fvi("run", "quick.yaml", "--dry-run")) == 8 * ["reuse"]
    becomes_another(monkeypatch)
    assert actions(fvi("run", "quick.yaml", "--dry-run")) == 8 * ["compute"]
    assert "quick: 8 runs, 0 of them stored" in fvi("run", "quick.yaml", "-v").stderr
    shown = fvi("show", "results/quick.h5").stdout
    assert shown.count(f"solver_version = {SOLVER_VERSION}") == 8


@spread(few=1, command=["convergence", "plot"])
def test_a_file_of_another_solver_is_refused_and_never_empties_a_table(
    folder, monkeypatch, command
):
    fvi("run", "quick.yaml", "-q")
    fvi(command, "results/quick.h5", code=0)
    before = {
        path: path.read_bytes()
        for path in Path("results").rglob("*")
        if path.is_file() and path.suffix != ".h5"
    }
    assert before
    becomes_another(monkeypatch)
    refused = fvi(command, "results/quick.h5", code=2)
    assert "8 runs of quick are not stored for these settings" in refused.stderr
    assert "fvi show results/quick.h5 --config" in refused.stderr
    assert {path: path.read_bytes() for path in before} == before


# --- convergence ----------------------------------------------------------------------------------


def test_a_check_without_tables_says_so_and_writes_none(folder):
    result = fvi("convergence", "quick.yaml", "--check", "--output", "nowhere", code=3)
    assert f"{Path('nowhere/tables/quick.csv')}: missing" in result.stdout.splitlines()
    assert not (folder / "nowhere").exists()


# --- mistakes -------------------------------------------------------------------------------------


def test_an_unexpected_error_shows_its_traceback_only_when_asked(folder, monkeypatch):
    def broken(*arguments, **options):
        raise RuntimeError("the moon is full")

    monkeypatch.setattr(request, "gather", broken)
    result = fvi("check", "quick.yaml", code=1)
    assert "the moon is full" in result.stderr
    assert "-v" in result.stderr
    verbose = CliRunner().invoke(app(["check"]), ["check", "quick.yaml", "-v"])
    assert verbose.exit_code == 1
    assert "Traceback" in verbose.stderr


@pytest.mark.processes
def test_a_reader_that_goes_away_is_no_error_message(folder):
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "fvi_cli", "guide"]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert done.stderr == ""
    assert done.returncode == 0


def on_a_terminal(*arguments, columns=160):
    """What is drawn on a terminal, and what goes to standard output."""
    pty = pytest.importorskip("pty")
    leader, follower = pty.openpty()
    command = [sys.executable, "-m", "fvi_cli", *arguments]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": str(columns)}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=follower, text=True, env=environment
    )
    os.close(follower)
    drawn = b""
    while True:
        try:
            part = os.read(leader, 4096)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        drawn += part
    stdout, _ = process.communicate()
    os.close(leader)
    assert process.returncode == 0
    return drawn.decode(), stdout


@pytest.mark.processes
def test_a_progress_bar_is_drawn_on_a_terminal_only(folder):
    drawn, stdout = on_a_terminal("run", "quick.yaml")
    assert "8/8" in drawn
    assert "8/8" not in stdout
    # control: no terminal, no bar
    assert "8/8" not in in_a_process("run", "quick.yaml", "--fresh").stderr


def test_a_line_says_now_and_then_how_much_is_done(monkeypatch, capsys):
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", 0.01)
    with progress.progress_bar("many", 8, wanted=True) as done:
        for _ in range(3):
            done(1)
        time.sleep(0.2)
    assert "many: 3 of 8 done" in capsys.readouterr().err
