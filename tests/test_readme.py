"""Everything that the README shows is run or compared."""

import contextlib
import io
import math
import re
import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest
import typer
from command_line import fvi
from letters import spring
from shown_numbers import differences_of_texts

from fvi_cli.cli.app import app
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.operators import left_operator
from fvi_cli.scenes.kinds import PROBLEM

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CI = (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def first_commands():
    return blocks("sh")[0].splitlines()


def own_commands():
    """The lines that begin with ``fvi``, in their order, below the two commands at the top."""
    return [line for block in blocks("sh")[1:] for line in block.splitlines()]


def test_the_two_commands_stand_at_the_top_and_start_from_nothing():
    run, test = first_commands()
    for command in (run, test):
        create, install, *uses = command.split(" && ")
        assert create == "python3 -m venv .venv"
        assert install.startswith(".venv/bin/pip install ")
        assert uses
        assert all(use.startswith(".venv/bin/") for use in uses)
    # the first is tried in pieces below, the second is what CI runs
    assert re.search(r"sed -n '/\^python3 -m venv \.\*pytest/p' README\.md", CI)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert any(r.startswith("pytest-xdist") for r in extras["optional-dependencies"]["test"])
    assert "fvi" in extras["scripts"]


def test_the_first_command_says_nothing_that_the_program_does_not_know(tmp_path):
    _, _, *uses = first_commands()[0].split(" && ")
    for use in uses:
        program, *arguments = shlex.split(use)
        assert program == ".venv/bin/fvi"
        result = fvi(*arguments, "--dry-run", "--output", str(tmp_path))
        assert result.exit_code == 0, result.output
        assert len(result.stdout.splitlines()) > 40
    assert list(tmp_path.iterdir()) == []


def printed(code):
    """What a program prints that is run here."""
    with contextlib.redirect_stdout(io.StringIO()) as output:
        # text of our own; a process for it would import everything once more
        exec(compile(code, "README.md", "exec"), {"__name__": "example"})
    return output.getvalue()


def test_the_example_does_what_is_said_of_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (example,) = blocks("yaml")
    assert "`my-oscillator.yaml`" in README
    (tmp_path / "my-oscillator.yaml").write_text(example, encoding="utf-8")
    commands = own_commands()
    assert [command.split()[1] for command in commands] == ["check", "run", "convergence", "plot"]
    for command in commands:
        program, *arguments = shlex.split(command)
        assert program == "fvi"
        result = fvi(*arguments)
        assert result.exit_code == 0, result.output
    assert (tmp_path / "results" / "my-oscillator.h5").is_file()
    assert (tmp_path / "results" / "tables" / "my-oscillator.md").is_file()
    assert list((tmp_path / "results" / "figures").glob("my-oscillator*.pdf"))
    _, reading = blocks("python")
    lines = printed(reading).splitlines()
    assert len(lines) == 6
    for line in lines:
        time, position = map(float, line.split()[-2:])
        assert time == 1.0
        assert position == pytest.approx(1.0, abs=0.02)
    two_masses = [
        "problem.mass=[[1, 0], [0, 1]]",
        "problem.stiffness=[[2, -1], [-1, 2]]",
        "problem.initial={position: [1, 0], velocity: 0}",
    ]
    in_pieces = "problem.forcing={pieces: [{until: 1.0, value: 8}, {value: 0}]}"
    for change in (*two_masses, in_pieces):
        key, _, value = change.removeprefix("problem.").partition("=")
        assert f"`{key}: {value}`" in README
    assert set(
        re.findall(r"`([a-z-]+)`", README.split("- Kinds of problems:")[1].split(";")[0])
    ) == (set(PROBLEM.kinds))
    (tmp_path / "other.yaml").write_text(example.replace("  exact: t**2.5\n", ""))
    for changes in (
        [*two_masses, "problem.forcing=0"],
        [in_pieces, "problem.final_time=2.0", "method=[{rk: gauss, degree: 2}]"],
        ["figures=[trajectory, energy, error]"],
    ):
        options = [word for change in changes for word in ("--set", change)]
        result = fvi("check", "other.yaml", *options)
        assert result.exit_code == 0, result.output


def test_the_python_example_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example, _ = blocks("python")
    time, position = map(float, printed(example).split())
    assert time == 16.0
    # x'' + 0.2 x' + x = 0, x(0) = 1, x'(0) = 0
    frequency = math.sqrt(0.99)
    phase = frequency * time
    exact = math.exp(-0.1 * time) * (math.cos(phase) + 0.1 / frequency * math.sin(phase))
    assert position == pytest.approx(exact, abs=1e-3)


NAMED_TABLES = re.findall(r"<!-- begin results/tables/(\S+)\.md -->", README)


def test_the_tables_of_the_paper_are_shown():
    assert {"table-1", "table-2"} < set(NAMED_TABLES)


@pytest.mark.parametrize("name", NAMED_TABLES)
def test_the_tables_are_those_in_results(name):
    path = f"results/tables/{name}.md"
    _, _, after = README.partition(f"<!-- begin {path} -->\n\n")
    shown, mark, _ = after.partition(f"\n\n<!-- end {path} -->\n")
    assert mark
    table = (ROOT / path).read_text(encoding="utf-8")
    # the orders and what is to be said of them, without the list of methods and the details
    assert (
        differences_of_texts(shown, table[table.index("\n| ") + 1 : table.index("\n\nMethods")])
        == []
    )


def test_what_is_linked_is_there():
    links = re.findall(r"\]\((?!http)([^)#]+)\)", README)
    assert links
    for link in links:
        assert (ROOT / link).exists(), link


def test_every_command_and_common_option_is_documented():
    commands = typer.main.get_command(app()).commands
    table = README[README.index("## Commands") : README.index("## Your own problem")]
    for name, command in commands.items():
        assert f"`fvi {name}" in table, name
        for parameter in command.params:
            if parameter.param_type_name == "option":
                assert any(option in README for option in parameter.opts), (name, parameter.name)
    # and the other way round
    named = set(re.findall(r"`fvi ([a-z][a-z-]*)", README))
    assert named <= set(commands)
    parameters = [parameter for command in commands.values() for parameter in command.params]
    known = {o for p in parameters for o in (*p.opts, *p.secondary_opts)} | {"--version", "--help"}
    assert set(re.findall(r"`[^`]*?(--[a-z][a-z-]*)", README)) <= known


def test_what_is_said_of_the_folders_is_true():
    listed = re.findall(r"^    (\S+/|\S+\.py) {2,}", README, re.MULTILINE)
    assert len(listed) >= 8
    for path in listed:
        assert (ROOT / path).exists(), path


def test_starting_weights_cost_an_order_on_the_damped_oscillator():
    def order(**start):
        method = Method(cq="bdf3", degree=2, sampling="nodes", **start)
        errors = []
        for n_steps in (256, 512):
            trajectory = integrate(scene, method, n_steps)
            errors.append(np.abs(trajectory.position[:, 0] - exact(trajectory.time)).max())
        return math.log2(errors[0] / errors[1])

    def exact(time):
        return np.exp(-0.1 * time) * np.sin(math.sqrt(0.99) * time) / math.sqrt(0.99)

    scene = spring((1.0, 0.2), T=16.0, v=1.0)
    assert order(start="none") == pytest.approx(2.0, abs=0.05)
    assert order(start="weights", start_exponents=(1.0, 2.0)) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("p", range(1, 7))
def test_the_first_steps_hide_half_a_kick_from_bdf2_on(p):
    # D t = 1 on an infinite grid of h = 1; what the quadrature adds to that in its first steps
    excess = left_operator(p, 1.0, 1.0, np.arange(40.0)[:, None])[1:, 0] - 1.0
    assert excess.sum() == pytest.approx(0.5 if p > 1 else 0.0, abs=1e-9)
    assert np.abs(excess[p:]).max() < 1e-12
