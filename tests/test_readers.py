"""The pages for three readers: what they show is what is shipped, and their numbers are so."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import fvi_cli as fvi

ROOT = Path(__file__).parents[1]
SHOWN = {
    "how-to/building": "five-storeys",
    "how-to/designs": "three-designs",
    "how-to/bench": "damper-bench",
    "how-to/analyst": "elastic-pendulum",
    "how-to/notebook": "duffing-section",
}


def page(name: str) -> str:
    return (ROOT / f"docs/{name}.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", SHOWN)
def test_the_configuration_on_the_page_is_the_one_that_comes_with_the_package(name):
    (shown,) = re.findall(r"```yaml\n(.*?)```", page(name), re.DOTALL)
    shipped = (ROOT / f"configs/{SHOWN[name]}.yaml").read_text(encoding="utf-8")
    assert shown[shown.index("name:") :] == shipped[shipped.index("\nname:") + 1 :]


def test_the_peaks_on_the_page_are_those_of_the_building():
    (outcome,) = fvi.run(fvi.load("five-storeys"))
    (table,) = re.findall(r"```text\n(experiment .*?)```", page("how-to/building"), re.DOTALL)
    lines = [line.split() for line in fvi.as_text([outcome]).splitlines()]
    printed = [line for line in lines if line[:2] == ["five-storeys", "Gauss5"]][-7:]
    # estimates of errors are those of the machine
    shown = [line.split() for line in table.strip().splitlines()[1:]]
    assert [[*a[:6], *a[7:]] for a in shown] == [[*a[:6], *a[7:]] for a in printed]
    # from accelerations what the lowest springs and dampers take from the ground
    formulas = "{base_shear: base_shear, taken: -3.2e5*x1 - force_wall_1}"
    overrides = [
        f"quantities={formulas}",
        "units={}",
        "figures=[quantities]",
        "problem.rayleigh.ratios=[1e-10, 1e-10]",
    ]
    (outcome,) = fvi.run(fvi.load("five-storeys", overrides=overrides))
    found = outcome.finished[0].trajectory.observed.quantities
    assert np.abs(found["base_shear"] - found["taken"]).max() < 1e-7 * np.abs(found["taken"]).max()


def test_the_peaks_of_the_first_building_do_not_depend_on_its_steps():
    changes = [
        "ladder.steps=[160]",
        "method.degree=[3, 4]",
        "quantities.taken=-12*x1 + dx1 + dx2 + dx3",
    ]
    (outcome,) = fvi.run(fvi.load("frame-forces", overrides=changes))
    seen = [one.trajectory.observed for one in outcome.finished]
    for coarse, fine in zip(seen[:3], seen[3:], strict=True):
        for name, one in fine.extents.items():
            assert one.peak == pytest.approx(coarse.extents[name].peak, rel=1e-6)
            assert one.rms == pytest.approx(coarse.extents[name].rms, rel=1e-6)
        # from accelerations what the lowest springs and dampers take from the ground
        taken = fine.quantities["taken"]
        assert np.abs(fine.quantities["base_shear"] - taken).max() < 1e-9 * np.abs(taken).max()


@pytest.mark.parametrize("path", sorted(ROOT.glob("results/*-fitted.yaml")), ids=lambda p: p.stem)
def test_fitted_configurations_are_valid(path):
    (experiment,) = fvi.load(path).experiments
    assert experiment.name == path.stem


def test_the_tables_of_the_bench_on_the_page_are_those_that_are_stored():
    shown = [line for line in page("how-to/bench").splitlines() if line.startswith("|")]
    stored = (ROOT / "results/tables/damper-bench-fit.md").read_text(encoding="utf-8")
    assert len(shown) == 12
    assert set(shown) <= set(stored.splitlines())


def test_the_table_of_designs_on_the_page_is_what_a_command_prints(tmp_path):
    (outcome,) = fvi.run(fvi.load("three-designs"))
    printed = fvi.as_text([outcome])
    (table,) = re.findall(r"```text\n(design .*?)```", page("how-to/designs"), re.DOTALL)

    def cells(text):
        # estimates of errors are those of the machine
        return [line.split()[:-1] for line in text.strip().splitlines()]

    assert cells(table) == cells(printed[printed.index("\ndesign") :].split("\n\n")[0])


@pytest.mark.processes
def test_the_table_of_a_problem_of_ones_own_compiles_in_a_paper(tmp_path):
    changes = ["ladder.steps=[16, 32, 64]", "problem.final_time=2.0"]
    changes += ["method={rk: gauss, degree: [2, 3]}"]
    tables = fvi.order_tables(fvi.run(fvi.load("elastic-pendulum", overrides=changes)))
    assert [case.slope for case in tables[0].cases] == pytest.approx([4.0, 6.0], abs=0.3)
    fvi.write(tables, tmp_path / "results", name="elastic-pendulum")
    if shutil.which("pdflatex") is None:
        pytest.skip("no LaTeX")
    (paper,) = re.findall(r"```latex\n(.*?)```", page("how-to/analyst"), re.DOTALL)
    (tmp_path / "paper.tex").write_text(paper, encoding="utf-8")
    made = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stdout[-2000:]
    assert "Overfull" not in made.stdout


@pytest.mark.processes
def test_the_notebook_runs_and_shows_what_it_promises(monkeypatch):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    # the kernel draws into the notebook
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = nbformat.read(ROOT / "docs/how-to/notebook.ipynb", as_version=4)
    nbclient.NotebookClient(notebook, timeout=300).execute()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    kinds = [{kind for output in cell.outputs for kind in output.get("data", {})} for cell in cells]
    html = [
        "".join(output.get("data", {}).get("text/html", "") for output in cell.outputs)
        for cell in cells
    ]
    assert "<svg" in html[1]
    assert "<table" in html[1]
    assert "p_x" in html[2]
    assert [number for number, found in enumerate(kinds) if "image/png" in found] == [4, 5, 7]


def test_the_orders_on_the_page_are_those_of_the_stored_table():
    stored = (ROOT / "results/tables/elastic-pendulum.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| elastic-pendulum \|.*\|$", stored, re.MULTILINE)
    found = [cell.strip() for cell in row.strip("|").split("|")[3:]]
    rows = re.findall(
        r"^\| (?:Gauss|BDF)\d \| (\S+) \| (.*) \|$", page("how-to/analyst"), re.MULTILINE
    )
    shown = [f"{slope}, {last}" if last[0].isdigit() else slope for slope, last in rows]
    assert shown == found
