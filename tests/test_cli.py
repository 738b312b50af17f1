"""What the command line promises: results on stdout, talk on stderr, exit codes, no tracebacks."""

import csv
import dataclasses
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import fvi
from typer.testing import CliRunner

import fvi_cli
from benchmarks.robustness import LADDER
from fvi_cli.cli.app import app
from fvi_cli.runner import request
from fvi_cli.storage.code import own_code
from fvi_cli.storage.identity import SOLVER_VERSION
from fvi_cli.studies import study
from fvi_cli.studies.tolerance import runs as tolerance_runs

QUICK = LADDER.replace("1, 2, 3]", "1, 2]").replace("16, 24, 32, 48]", "16, 32]")
# explicit in the damping: BDF6 leaves every bound at once
DIVERGING = QUICK.replace("bdf: [1, 2]", "bdf: [6, 1]").replace("quick", "diverging")
DIVERGING = DIVERGING.replace("[4, 8, 16, 32]", "[64, 128]") + "allow_unstable: true\n"


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
    assert "numpy" in modules_after("import fvi_cli.runner.run")


ASK_FOR_HELP = """
import sys
from fvi_cli.__main__ import main

sys.argv[1:] = ["--help"]
try:
    main()
except SystemExit:
    pass
"""


@pytest.mark.processes
def test_help_loads_few_modules():
    def count(statement):
        code = statement + "\nimport sys; print(len(sys.modules), file=sys.stderr)"
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
        return int(done.stderr)

    bare, of_help, of_numpy = count("pass"), count(ASK_FOR_HELP), count("import numpy")
    assert of_help - bare < 2 * (of_numpy - bare)
    # control: what a command needs is much more
    assert count("import fvi_cli.runner.run") - bare > 2 * (of_numpy - bare)


@pytest.mark.processes
def test_help_names_every_command_and_version_the_version():
    done = in_a_process("--help")
    assert done.returncode == 0
    for command in ("run", "convergence", "plot", "check", "show", "schema", "new"):
        assert re.search(rf"^  {command} ", done.stdout, re.MULTILINE)
        fvi(command, "--help", code=0)
    assert fvi("--version", code=0).stdout == f"fvi {fvi_cli.__version__}\n"


def test_without_arguments_the_help_is_shown_and_the_request_is_wrong():
    result = fvi(code=2)
    assert "Usage" in result.output


# --- run ------------------------------------------------------------------------------------------


def test_run_stores_results_and_prints_them_on_stdout(folder):
    result = fvi("run", "quick.yaml", code=0)
    *table, path = result.stdout.splitlines()
    assert path == str(Path("results") / "quick.h5")
    assert Path(path).is_file()
    assert len(table) == 1 + 8
    assert "quick: 8 runs, 0 of them stored" in result.stderr
    assert "runs" not in result.stdout


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
def test_a_mistake_of_the_program_costs_the_run_that_it_happens_in(folder, monkeypatch, key):
    def mistaken(usual):
        def made_up(scene, *arguments, **options):
            if scene.initial_position.max() > 10:
                raise ZeroDivisionError("made up")
            return usual(scene, *arguments, **options)

        return made_up

    for module, name in ((study, "integrate"), (tolerance_runs, "adaptive_engine")):
        monkeypatch.setattr(module, name, mistaken(getattr(module, name)))
    (folder / "mistaken.yaml").write_text(MISTAKEN.replace("ladder: {steps: [4, 8]}", key, 1))
    result = fvi("run", "mistaken.yaml", code=1)
    assert "bad" in result.stderr
    assert "unexpected ZeroDivisionError" in result.stderr
    assert "made up; this is a mistake of the program, please report it" in result.stderr
    assert re.search(r"^bad .* failed$", result.stdout, re.MULTILINE)
    # the others are stored; the mistake is not, so that it is tried again
    told = fvi("run", "mistaken.yaml", "--dry-run").stdout
    assert [line.split()[0] for line in told.splitlines() if "reuse" in line] == ["good", "good"]


def test_what_is_stored_is_used_again_unless_fresh(folder):
    first = fvi("run", "quick.yaml")
    second = fvi("run", "quick.yaml")
    assert "8 runs, 8 of them stored" in second.stderr
    assert second.stdout == first.stdout
    assert "8 runs, 0 of them stored" in fvi("run", "quick.yaml", "--fresh").stderr
    # control: another problem of the same name is another run
    changed = fvi("run", "quick.yaml", "--set", "problem.final_time=0.5")
    assert "8 runs, 0 of them stored" in changed.stderr


def test_quiet_says_nothing_and_verbose_names_every_run(folder):
    assert fvi("run", "quick.yaml", "-q").stderr == ""
    told = fvi("run", "quick.yaml", "-v", "--fresh").stderr
    assert told.count("quick bdf1-nodes-s1-gauss1-none N=") == 4


@pytest.mark.processes
def test_several_processes_store_the_same_table(folder):
    fvi("convergence", "quick.yaml", "--output", "one", code=0)
    fvi("convergence", "quick.yaml", "--output", "two", "--workers", "2", code=0)
    one, two = (folder / name / "tables" / "quick.csv" for name in ("one", "two"))
    assert one.read_text() == two.read_text()


def test_an_unexpected_failure_exits_1_and_the_others_are_stored(folder):
    result = fvi("run", "diverging.yaml", code=1)
    rows = [row.split() for row in result.stdout.splitlines()[1:-1]]
    assert len(rows) == 4
    assert {row[-1] for row in rows if row[1].startswith("BDF1")} == {"ok"}
    assert "diverged" in {row[-1] for row in rows if row[1].startswith("BDF6")}
    assert "failed unexpectedly" in result.stderr
    assert (folder / "results" / "diverging.h5").is_file()
    # the same, foretold
    (folder / "diverging.yaml").write_text(DIVERGING + "expect: {bdf6: unstable}\n")
    fvi("run", "diverging.yaml", code=0)


def test_what_is_predicted_to_blow_up_is_computed_only_when_asked(folder):
    (folder / "diverging.yaml").write_text(DIVERGING.replace("allow_unstable: true\n", ""))
    rows = fvi("run", "diverging.yaml", "--dry-run").stdout.splitlines()[1:]
    assert [row.split()[4:6] for row in rows] == 2 * [["refuse", "unstable"]] + 2 * [
        ["compute", "stable"]
    ]
    refused = fvi("run", "diverging.yaml", code=1)
    assert refused.stdout.count("refused") == 2
    computed = fvi("run", "diverging.yaml", "--allow-unstable", code=1)
    assert "refused" not in computed.stdout
    assert "diverged" in computed.stdout
    # the file knows what was asked for
    table = fvi("convergence", "results/diverging.h5")
    assert "missing" not in table.stderr
    assert "allow_unstable=true" in fvi("show", "results/diverging.h5", "--config").stderr


def test_fail_fast_stops_at_the_first_failure(folder):
    result = fvi("run", "diverging.yaml", "quick.yaml", "--fail-fast", code=1)
    assert len(result.stdout.splitlines()) < 1 + 4 + 1
    assert not (folder / "results" / "quick.h5").exists()
    # what failed makes no table
    fvi("convergence", "diverging.yaml", "--fail-fast", code=1)
    assert not (folder / "results" / "tables").exists()


def test_fail_fast_stops_at_a_search_that_fails(folder):
    scene = "problem: {kind: pendulum, final_time: 1.0, initial: {position: 1.0}}"
    (folder / "both.yaml").write_text(
        f"name: both\nexperiments:\n"
        f"  - {{name: searched, {scene}, accuracy: {{tolerance: 1e-20}}}}\n"
        f"  - {{name: ladder, {scene}, method: {{rk: gauss}}, ladder: {{steps: [8]}}}}\n"
    )
    whole = fvi("run", "both.yaml", code=1)
    assert "ladder" in whole.stdout
    stopped = fvi("run", "both.yaml", "--fail-fast", "--output", "stopped", code=1)
    assert "ladder" not in stopped.stdout
    assert "stopped at the first unexpected failure (--fail-fast)" in stopped.stderr


# the direct sum over the history: the longest run takes minutes, in little memory
SLOW = QUICK.replace("[4, 8, 16, 32]", "[8, 16, 400000]").replace("[1, 2]", "1")
SLOW = SLOW.replace("degree: 1", "degree: 1, history: direct")


def test_a_configuration_is_not_shown_as_results(folder):
    for arguments in (["show", "quick.yaml"], ["export", "quick.yaml", "--to", "csv"]):
        result = fvi(*arguments, code=2)
        assert "is not a result file of fvi; `fvi check` and `fvi run` take" in result.stderr
    result = fvi("show", "quick", code=2)
    assert "no such file; result files end in .h5, such as results/quick.h5" in result.stderr
    (folder / "junk.h5").write_text("junk")
    result = fvi("convergence", "junk.h5", code=2)
    assert "is not a result file of fvi" in result.stderr
    assert "delete" not in result.stderr


def reasons(result):
    """Action and reason of every row of a dry run."""
    header, *rows = result.stdout.splitlines()
    place = header.index("reason")
    return [(row.split()[4], row[place:]) for row in rows]


def test_a_dry_run_says_why(folder):
    def planned(*arguments):
        return reasons(fvi("run", "quick.yaml", "--dry-run", *arguments))

    assert planned() == 8 * [("compute", "new")]
    fvi("run", "quick.yaml", "-q")
    assert planned() == 8 * [("reuse", "stored")]
    assert planned("--fresh") == 8 * [("compute", "--fresh")]
    assert planned("--set", "problem.final_time=0.5") == 8 * [
        ("compute", "changed: problem.final_time")
    ]
    # what changes no number computes nothing
    assert planned("--set", "report.norm=final") == 8 * [("reuse", "stored")]
    assert planned("--set", "method.history=direct") == 8 * [("compute", "changed: method.history")]
    # a run elsewhere that is not asked for any more, of another method
    assert planned("--set", "method.degree=2") == 8 * [
        ("compute", "changed: method.degree, method.quadrature")
    ]
    assert planned("--set", "method.bdf=3") == 4 * [("compute", "changed: method.bdf")]
    # control: what was there stays and something is added
    assert planned("--set", "method.bdf=[1, 2, 3]") == 8 * [("reuse", "stored")] + 4 * [
        ("compute", "new")
    ]
    assert planned("--set", "ladder.steps=[4, 64]") == 2 * [("reuse", "stored"), ("compute", "new")]


def test_a_dry_run_tells_older_solvers_and_refusals(folder, monkeypatch):
    fvi("run", "quick.yaml", "-q")
    for module in ("storage.identity", "storage.records.runs", "storage.comparison.reasons"):
        monkeypatch.setattr(f"fvi_cli.{module}.SOLVER_VERSION", SOLVER_VERSION + 1)
    changed = fvi("run", "quick.yaml", "--dry-run", "--set", "problem.final_time=0.5")
    assert reasons(changed) == 8 * [("compute", "changed: problem.final_time; older solver")]
    assert reasons(fvi("run", "quick.yaml", "--dry-run")) == 8 * [("compute", "older solver")]
    told = fvi("run", "quick.yaml", "-v").stderr
    assert "quick: computed again: 8 runs, older solver" in told
    assert "quick bdf1-nodes-s1-gauss1-none N=4: older solver" in told
    (folder / "diverging.yaml").write_text(DIVERGING.replace("allow_unstable: true\n", ""))
    found = reasons(fvi("run", "diverging.yaml", "--dry-run"))
    assert [action for action, _ in found] == 2 * ["refuse"] + 2 * ["compute"]
    assert all(reason.startswith("refused: ") for _, reason in found[:2])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"numpy": "9.9"}, "numpy 9.9 in place of "),
        ({"scipy": "9.9"}, "scipy 9.9 in place of "),
        ({"mpmath": "9.9"}, "mpmath 9.9 in place of "),
        ({"sources": "0" * 64}, "other source files of fvi "),
    ],
)
def test_what_other_code_has_computed_is_computed_again(folder, monkeypatch, change, reason):
    few = ("run", "quick.yaml", "--set", "ladder.steps=[4]")
    fvi(*few, "-q")
    other = dataclasses.replace(own_code(), **change)
    for module in ("identity", "records.runs", "comparison.reasons"):
        monkeypatch.setattr(f"fvi_cli.storage.{module}.own_code", lambda: other)
    found = reasons(fvi(*few, "--dry-run"))
    assert all(action == "compute" and why.startswith(reason) for action, why in found)
    assert found
    fvi(*few, "-q")
    assert {action for action, _ in reasons(fvi(*few, "--dry-run"))} == {"reuse"}


@pytest.mark.parametrize("command", ["convergence", "plot"])
@pytest.mark.parametrize("change", ["numpy", "sources", "solver"])
def test_a_file_of_other_code_is_refused_and_never_empties_a_table(
    folder, monkeypatch, command, change
):
    fvi("run", "quick.yaml", "-q")
    fvi(command, "results/quick.h5", code=0)
    before = {
        path: path.read_bytes()
        for path in Path("results").rglob("*")
        if path.is_file() and path.suffix != ".h5"
    }
    assert before
    if change == "solver":
        for module in ("identity", "records.runs", "comparison.reasons"):
            monkeypatch.setattr(f"fvi_cli.storage.{module}.SOLVER_VERSION", SOLVER_VERSION + 1)
    else:
        other = dataclasses.replace(own_code(), **{change: "9.9"})
        for module in ("identity", "records.runs", "comparison.reasons"):
            monkeypatch.setattr(f"fvi_cli.storage.{module}.own_code", lambda: other)
    refused = fvi(command, "results/quick.h5", code=2)
    assert "none of the 8 runs of quick can be used" in refused.stderr
    assert "fvi show results/quick.h5 --config" in refused.stderr
    assert {path: path.read_bytes() for path in before} == before


def test_files_without_the_versions_of_all_libraries_say_so(folder, monkeypatch):
    """Files of earlier versions do not name all libraries."""
    older = dataclasses.replace(own_code(), mpmath="")
    assert own_code().differences(older) == ""


def test_allowing_what_is_stable_anyway_computes_nothing_again(folder):
    (folder / "diverging.yaml").write_text(DIVERGING.replace("allow_unstable: true\n", ""))
    fvi("run", "diverging.yaml", "-q")
    allowed = reasons(fvi("run", "diverging.yaml", "--dry-run", "--allow-unstable"))
    assert allowed == 2 * [("compute", "changed: allow_unstable")] + 2 * [("reuse", "stored")]
    told = fvi("run", "diverging.yaml", "--allow-unstable").stderr
    assert "4 runs, 2 of them stored" in told
    # and back: the refusals are stored beside what has been computed since
    assert reasons(fvi("run", "diverging.yaml", "--dry-run")) == 4 * [("reuse", "stored")]
    fvi("run", "diverging.yaml", "-q")
    assert reasons(fvi("run", "diverging.yaml", "--dry-run")) == 4 * [("reuse", "stored")]
    listed = fvi("show", "results/diverging.h5").stdout
    assert listed.count("refused") == 2


# --- convergence ----------------------------------------------------------------------------------


def test_convergence_writes_four_forms_of_one_table(folder):
    result = fvi("convergence", "quick.yaml", code=0)
    tables = folder / "results" / "tables"
    assert sorted(p.name for p in tables.iterdir()) == [
        f"quick.{suffix}" for suffix in ("csv", "json", "md", "tex")
    ]
    for suffix in ("csv", "json", "md", "tex"):
        assert str(Path("results/tables") / f"quick.{suffix}") in result.stdout.splitlines()
    with (tables / "quick.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    assert ",".join(rows[0]) == (
        "experiment,case,cq,sampling,degree,quadrature,start,gamma,norm,n_steps,step_size,error,"
        "pairwise_order,used_in_fit,slope,fit_residual,expected_order,predicted,status"
    )


def test_convergence_takes_a_result_file_and_computes_nothing(folder):
    fvi("run", "quick.yaml", "-q")
    fvi("convergence", "quick.yaml", "--output", "direct", code=0)
    fvi("convergence", "results/quick.h5", "--output", "stored", code=0)
    direct, stored = (folder / n / "tables" / "quick.csv" for n in ("direct", "stored"))
    assert stored.read_text() == direct.read_text()
    assert not (folder / "stored" / "quick.h5").exists()


def test_a_check_holds_until_the_table_is_changed(folder):
    fvi("convergence", "quick.yaml", "-q")
    before = {p: p.read_bytes() for p in (folder / "results").rglob("*") if p.is_file()}
    fvi("convergence", "quick.yaml", "--check", code=0)
    fvi("convergence", "quick.yaml", "--check", "--fresh", code=0)
    assert {p: p.read_bytes() for p in before} == before
    table = folder / "results" / "tables" / "quick.csv"
    with table.open(newline="") as file:
        first = next(csv.DictReader(file))
    table.write_text(table.read_text().replace(first["error"], repr(1.01 * float(first["error"]))))
    stale = fvi("convergence", "quick.yaml", "--check", "--fresh", code=3)
    assert "error" in stale.stdout


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (("convergence", "quick.yaml"), ("tables/quick.csv", "tables/quick.md")),
        (("hard-cases",), ("hard-cases.csv", "hard-cases.md")),
    ],
)
def test_a_check_without_tables_computes_nothing_and_writes_nothing(
    folder, monkeypatch, arguments, names
):
    def computed(*_, **__):
        raise AssertionError

    monkeypatch.setattr("fvi_cli.runner.compute.execute_batch", computed)
    monkeypatch.setattr("fvi_cli.runner.hard_cases.examine", computed)
    before = files(folder)
    result = fvi(*arguments, "--check", "--output", "nowhere", code=3)
    assert result.stdout.splitlines() == [f"{Path('nowhere') / name}: missing" for name in names]
    assert "runs" not in result.stderr
    assert files(folder) == before
    assert not (folder / "nowhere").exists()


# --- plot -----------------------------------------------------------------------------------------


def test_plot_draws_and_checks_figures(folder):
    result = fvi("plot", "quick.yaml", code=0)
    written = [Path(line) for line in result.stdout.splitlines()]
    assert {path.suffix for path in written} == {".pdf", ".png", ".json"}
    assert all(path.is_file() for path in written)
    fvi("plot", "quick.yaml", "--check", code=0)
    fvi("plot", "quick.yaml", "--check", "--set", "problem.final_time=0.5", code=3)


# --- the other commands ---------------------------------------------------------------------------


def test_check_validates_and_writes_nothing(folder):
    before = files(folder)
    result = fvi("check", "quick.yaml", "table-1", code=0)
    assert "quick.yaml: valid, 1 experiment, 8 runs" in result.stdout
    assert files(folder) == before


def test_show_lists_runs_and_gives_the_configuration_back(folder):
    fvi("run", "quick.yaml", "-q")
    listing = fvi("show", "results/quick.h5", code=0)
    assert listing.stdout.count("bdf2-nodes-s1-gauss1-none") == 4
    assert fvi("show", "results/quick.h5", "--config").stdout == QUICK


def test_schema_is_json(folder):
    assert json.loads(fvi("schema").stdout)["$schema"]


def test_new_writes_a_valid_configuration_once(folder):
    result = fvi("new", "mine", "--kind", "pendulum", code=0)
    assert result.stdout == "mine.yaml\n"
    fvi("check", "mine.yaml", code=0)
    again = fvi("new", "mine", code=2)
    assert "exists already" in again.stderr
    assert "kind: pendulum" in (folder / "mine.yaml").read_text()


# --- mistakes -------------------------------------------------------------------------------------

WRONG = QUICK.replace("final_time: 1.0", "final_time: -1.0").replace("bdf: [1, 2]", "bdf: [1, 7]")


@pytest.mark.parametrize("command", ["run", "convergence", "plot", "check"])
def test_every_mistake_is_told_with_its_place_and_nothing_is_written(folder, command):
    (folder / "wrong.yaml").write_text(WRONG)
    (folder / "worse.yaml").write_text("name: worse\n")
    before = files(folder)
    result = fvi(command, "wrong.yaml", "worse.yaml", "quick.yaml", "absent.yaml", code=2)
    assert result.stdout == ""
    assert re.search(r"^wrong\.yaml:7:\d+: problem\.final_time: ", result.stderr, re.MULTILINE)
    assert re.search(r"^wrong\.yaml:9:\d+: method\.?0?\.bdf", result.stderr, re.MULTILINE)
    assert re.search(r"^worse\.yaml:\d+:\d+: ", result.stderr, re.MULTILINE)
    assert "absent.yaml: no such file" in result.stderr
    assert files(folder) == before


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["run"], "CONFIG"),
        (["rum", "quick.yaml"], "rum"),
        (["run", "quick.yaml", "--nonsense"], "--nonsense"),
        (["run", "quick.yaml", "--workers", "0"], "--workers"),
        (["run", "quick.yaml", "--set", "problem.stifness=2"], "stiffness"),
        (["run", "quick.yaml", "--set", "nonsense"], "key.path=value"),
        (["run", "quick.yaml", "quick.yaml"], "given twice"),
        (["run", "damped-oscilator"], "damped-oscillator"),
        (["run", "."], "."),
        (["show", "absent.h5"], "absent.h5"),
        (["show", "quick.yaml"], "quick.yaml"),
        (["convergence", "absent.h5"], "absent.h5"),
        (["convergence", "text.h5"], "text.h5"),
        (["new", "../mine"], "../mine"),
        (["new", "mine", "--kind", "pendulums"], "pendulum"),
        (["run", "quick.yaml", "--output", "quick.yaml"], "quick.yaml"),
        (["convergence", "quick.yaml", "--output", "quick.yaml/below"], "quick.yaml"),
    ],
)
def test_a_mistake_of_the_user_exits_2_with_a_hint(folder, arguments, told):
    (folder / "text.h5").write_text("no HDF5")
    before = files(folder)
    result = fvi(*arguments, code=2)
    assert told in result.stderr
    assert files(folder) == before


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
    command = [sys.executable, "-m", "fvi_cli", "schema"]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert done.stderr == ""
    assert done.returncode == 141


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
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        try:
            part = os.read(leader, 4096)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        drawn += part
    stdout, _ = process.communicate(timeout=60)
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


@pytest.mark.processes
def test_on_80_columns_the_bar_is_whole_with_many_runs_of_long_names(folder):
    text = QUICK.replace("name: quick", "name: a-configuration-whose-name-is-quite-long")
    text = text.replace("bdf: [1, 2]", "bdf: [1, 2, 3]").replace("[4, 8, 16, 32]", "{to: 5}")
    ladder = ", ".join(str(n) for n in range(4, 36, 2))
    (folder / "quick.yaml").write_text(text.replace("{to: 5}", f"[{ladder}]"))
    drawn, _ = on_a_terminal("run", "quick.yaml", columns=80)
    lines = re.split(r"[\r\n]+", re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", drawn))
    bars = [line for line in lines if "━" in line]
    assert any(re.match("━{20} 48/48 ", line) for line in bars)
    for line in bars:
        assert re.match(r"[━╸╺ ]{20} \d+/48 \d+:\d\d(, about \d+:\d\d left)? \S", line)
        assert len(line) <= 80
    assert "-:-" not in drawn


@pytest.mark.processes
@pytest.mark.parametrize("workers", ["1", "2"])
def test_within_a_long_run_the_bar_says_how_far_it_is(folder, workers):
    (folder / "quick.yaml").write_text(SLOW.replace("400000", "66000"))
    drawn, _ = on_a_terminal("run", "quick.yaml", "--workers", workers)
    shares = [int(share) for share in re.findall(r"N=66000: +(\d+) %", drawn)]
    assert len(set(shares)) > 3
    assert shares == sorted(shares)
    assert "3/3" in drawn
    assert re.search(r", about \d+:\d\d left", re.sub(r"\x1b\[[\d;]*m", "", drawn))
