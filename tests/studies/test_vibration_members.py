"""Modes and responses of sweeps, and of what is fed: in tables, files and figures."""

import h5py
import numpy as np
import pytest
from command_line import configuration, fvi, rows_of

import fvi_cli as fvi_api
from fvi_cli.plotting.kinds.spectra import response_figure

MASSES = "mass: [[1, 0], [0, 1]], stiffness: [[2, -1], [-1, 2]]"


def problem(coefficient: float, order: float = 0.5) -> str:
    """Two bodies with a damper on the first."""
    return (
        f"kind: structure, {MASSES}, damping: [{{order: {order}, coefficient: {coefficient}, "
        "acts_on: [x1]}], final_time: 10, exact: none"
    )


def member_of(row: dict[str, str]) -> tuple[float, ...]:
    """Order and coefficient of the damping of a row."""
    return tuple(float(row[f"problem.damping.0.{key}"]) for key in ("order", "coefficient"))


@pytest.fixture
def swept(tmp_path):
    path = tmp_path / "swept.yaml"
    keys = "{problem.damping.0.order: [0.3, 0.7], problem.damping.0.coefficient: [0.1, 0.2, 8.0]}"
    text = configuration(problem(0.2), name="swept", steps="16")
    path.write_text(text + f"\nsweep: {keys}\n")
    return path


def test_modes_of_every_member_are_those_of_it_by_itself(swept, tmp_path):
    output = tmp_path / "out"
    shown = fvi("modes", swept, "-o", output, code=0).stdout
    assert "None is missing in 6 of 6 members" in shown
    rows = rows_of(output / "tables" / "swept-modes.csv")
    assert len(rows) == 12
    with h5py.File(output / "swept-modes.h5") as file:
        members = [group.attrs["member"].decode() for group in file["swept"].values()]
    assert len(members) == 6
    for number, (order, size) in enumerate((o, c) for o in (0.3, 0.7) for c in (0.1, 0.2, 8.0)):
        path = tmp_path / f"one-{number}.yaml"
        path.write_text(configuration(problem(size, order), name="one", steps="16"))
        (table,) = fvi_api.modes(path)
        own = [row for row in rows if member_of(row) == (order, size)]
        assert f"order = {order}" in members[number]
        assert [float(row["imaginary"]) for row in own] == pytest.approx(
            [mode.frequency.imag for mode in table.modes], rel=1e-12
        )
    fvi("modes", swept, "-o", output, "--check", code=0)


def test_responses_of_every_member_are_those_of_it_by_itself(swept, tmp_path):
    output = tmp_path / "out"
    asked = ("--frequency", "0.1:0.4:31", "--force", "x1", "--at", "x2", "-o", output)
    fvi("response", swept, *asked, code=0)
    rows = rows_of(output / "tables" / "swept-response.csv")
    members = list(dict.fromkeys(map(member_of, rows)))
    assert len(rows) == 6 * 31
    assert len(members) == 6
    tables = fvi_api.response(swept, frequency="0.1:0.4:31", force=["x1"], at=["x2"])
    for table, member in zip(tables, members, strict=True):
        own = [float(row["magnitude"]) for row in rows if member_of(row) == member]
        assert own == pytest.approx(table.magnitude[:, 0], rel=1e-12)
        assert str(member[0]) in table.member
    sizes = np.array([table.magnitude[:, 0] for table in tables])
    # the control: members are not the first one over again
    assert len({round(float(size), 12) for size in sizes[:, 5]}) == 6


def test_half_power_widths_meet_their_curves(tmp_path):
    path = tmp_path / "one.yaml"
    path.write_text(configuration(problem(0.2), name="one", steps="16"))
    frequency, at = "0.1:0.4:200", ["x1", "x2"]
    figure = response_figure(fvi_api.response(path, frequency=frequency, force=["x1"], at=at))
    curves = [line for line in figure.axes[0].lines if len(line.get_xdata()) > 2]
    widths = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 2]
    assert len(widths) >= 2
    for width in widths:
        level, ends = width.get_ydata()[0], width.get_xdata()
        met = [np.interp(ends, *one.get_data()) == pytest.approx(level, rel=0.02) for one in curves]
        assert sum(met) == 1


def test_tables_have_the_names_of_designs(tmp_path):
    path, output = tmp_path / "compared.yaml", tmp_path / "out"
    designs = "\ndesigns: {soft: {problem.damping.0.coefficient: 0.1}, stiff: {}}\n"
    path.write_text(configuration(problem(0.2), name="compared", steps="16") + designs)
    asked = {
        "modes": (),
        "response": ("--frequency", "0.1:0.4:5", "--force", "x1"),
        "stability": (),
    }
    for command, further in asked.items():
        fvi(command, path, *further, "-o", output, code=0)
        rows = rows_of(output / "tables" / f"compared-{command}.csv")
        found = dict.fromkeys((row["design"], row["problem.damping.0.coefficient"]) for row in rows)
        assert list(found) == [("soft", "0.1"), ("stiff", "0.2")]
