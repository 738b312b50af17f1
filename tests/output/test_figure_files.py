"""Figures as files: formats, styles, names."""

import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest
from command_line import configuration, fvi
from made_runs import BDF1, NODES, made_study
from matplotlib.figure import Figure

from fvi_cli import plotting
from fvi_cli.errors import RequestError
from fvi_cli.render.figures import drawn_as, write_figures


def convergence(*methods: object, **changes: object) -> Figure:
    return plotting.convergence_figure([made_study(methods or NODES, **changes)])


def small(factor: float = 1.0) -> Figure:
    """Soon drawn."""
    figure = Figure(figsize=(2.0, 1.5))
    figure.add_subplot().plot([1.0, 2.0], [factor, 3.0 * factor], label="a")
    return figure


@pytest.mark.processes
def test_figures_do_without_pyplot_and_leave_the_settings_alone(tmp_path):
    script = """
import sys
import matplotlib
def settings():  # asking for the backend would choose one, with pyplot
    return {key: matplotlib.rcParams[key] for key in matplotlib.rcParams if key != "backend"}
before = settings()
from fvi_cli.plotting import interpolation_figure, save_figure
from pathlib import Path
save_figure(interpolation_figure(), Path(sys.argv[1]), "sketch")
print("matplotlib.pyplot" in sys.modules, settings() == before)
"""
    answer = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert answer.stdout.split() == ["False", "True"]


def test_a_users_own_settings_do_not_change_a_figure(tmp_path):
    paths = plotting.save_figure(
        plotting.interpolation_figure(), tmp_path / "plain", "sketch", ("svg",)
    )
    with mpl.rc_context({"axes.grid": True, "lines.linewidth": 5.0, "font.size": 20.0}):
        figure = plotting.interpolation_figure()
        other = plotting.save_figure(figure, tmp_path / "own", "sketch", ("svg",))
    assert [path.read_bytes() for path in paths] == [path.read_bytes() for path in other]


def test_saved_files_are_the_same_bytes_every_time(tmp_path):
    kept = []
    for folder in ("first", "second"):
        paths = plotting.save_figure(small(), tmp_path / folder, "made-up", ("pdf", "png"))
        assert [path.name for path in paths] == ["made-up.pdf", "made-up.png"]
        kept.append([path.read_bytes() for path in paths])
    assert kept[0] == kept[1]
    assert b"CreationDate" not in kept[0][0]
    assert b"atplotlib" not in kept[0][0] + kept[0][1]


def _no_space(handle: int) -> None:
    raise OSError("no space")


def test_a_failure_while_saving_leaves_the_old_files_and_nothing_else(tmp_path, monkeypatch):
    figure = small()
    plotting.save_figure(figure, tmp_path, "sketch", ("svg", "png"))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    figure.suptitle("another")
    with monkeypatch.context() as patch:
        patch.setattr("fvi_cli.storage.files.os.fsync", _no_space)
        with pytest.raises(OSError, match="no space"):
            plotting.save_figure(figure, tmp_path, "sketch", ("svg", "png"))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    plotting.save_figure(figure, tmp_path, "sketch", ("svg", "png"))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} != before


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "a b"])
def test_names_of_files_stay_in_their_folder(tmp_path, name):
    with pytest.raises(ValueError, match="letters, digits"):
        plotting.save_figure(plotting.interpolation_figure(), tmp_path, name)
    assert not list(tmp_path.iterdir())


def test_formats_are_those_that_are_asked_for(tmp_path):
    figure = small()
    paths = plotting.save_figure(figure, tmp_path, "sketch", ("svg", "png"))
    assert [path.name for path in paths] == ["sketch.svg", "sketch.png"]
    text = (tmp_path / "sketch.svg").read_text(encoding="utf-8")
    assert "<svg" in text
    assert "<dc:date>" not in text
    path = plotting.save_figure(small(), tmp_path / "again", "sketch", ("svg",))[0]
    assert path.read_text(encoding="utf-8") == text
    with pytest.raises(ValueError, match="'gif' is not one of png, pdf, svg"):
        plotting.save_figure(figure, tmp_path, "sketch", ("gif",))


def test_a_style_file_sets_fonts_and_leaves_methods_their_colours(tmp_path):
    style = tmp_path / "mine.mplstyle"
    style.write_text("axes.labelsize: 13.0  # large\nlines.linewidth: 3\n")

    def drawn() -> tuple[float, list[object], list[float]]:
        figure = convergence(*NODES[:2])
        write_figures({"made-up": figure}, tmp_path, formats=("svg",))
        curves = figure.axes[0].lines[:2]
        return (
            figure.axes[0].xaxis.label.get_fontsize(),
            [line.get_color() for line in curves],
            [line.get_linewidth() for line in curves],
        )

    plain = drawn()
    path = tmp_path / "figures" / "made-up.svg"
    picture = path.read_bytes()
    with plotting.styled(str(style)):
        size, colours, widths = drawn()
        styled = path.read_bytes()
    assert (size, colours) == (13.0, plain[1])
    assert np.array(widths) / plain[2] == pytest.approx(3.0 / 1.1)
    assert styled != picture
    # without the file everything is as before, and drawn anew
    assert drawn() == plain
    assert path.read_bytes() == picture


def test_a_style_file_sets_the_size_and_the_dots(tmp_path):
    style = tmp_path / "mine.mplstyle"
    style.write_text("figure.figsize: 5, 5\nsavefig.dpi: 80\n")

    def size() -> tuple[int, int]:
        (path,) = plotting.save_figure(convergence(BDF1), tmp_path, "made-up", ("png",))
        header = path.read_bytes()[16:24]
        return int.from_bytes(header[:4]), int.from_bytes(header[4:])

    plain = size()
    with plotting.styled(str(style)):
        styled = size()
    assert styled[0] == 400
    assert plain[0] == 669
    # twice as high at two fifths of the dots
    assert styled[1] == pytest.approx(plain[1] * 2 * 80 / 200, abs=2)


def test_the_command_takes_formats_and_a_style(tmp_path):
    config = tmp_path / "tiny.yaml"
    problem = "kind: pendulum, final_time: 1.0, initial: {position: 1.0}"
    more = "figures: [trajectory]\n"
    config.write_text(configuration(problem, name="tiny", steps="8", more=more))
    style = tmp_path / "mine.mplstyle"
    style.write_text("font.size: 12\n")
    asked = ["plot", str(config), "-q", "--output", str(tmp_path), "--style", str(style)]
    fvi(*asked, "--format", "svg", "--format", "png", code=0)
    written = {path.name for path in (tmp_path / "figures").iterdir()}
    assert written == {f"tiny-trajectory.{suffix}" for suffix in ("svg", "png")}


def test_a_style_of_matplotlib_is_known_by_its_name_and_another_one_is_refused():
    with plotting.styled("dark_background"):
        assert convergence(BDF1).get_facecolor()[:3] == (0.0, 0.0, 0.0)
    refused = pytest.raises(RequestError, match="--style: 'no-such-style' is not a valid")
    with refused, drawn_as((), "no-such-style"):
        pass


def test_a_figure_from_a_file_computes_no_reference(tmp_path, monkeypatch):
    config = tmp_path / "swing.yaml"
    problem = "kind: pendulum, final_time: 1.0, initial: {position: 1.0}"
    more = "figures: [error]\n"
    config.write_text(configuration(problem, name="swing", steps="8, 16", more=more))
    fvi("run", config, "-q", "-o", tmp_path, code=0)

    def computed(*arguments):
        raise AssertionError("a reference was computed")

    monkeypatch.setattr("fvi_cli.studies.reference.find_references", computed)
    fvi("plot", tmp_path / "swing.h5", "-q", "-o", tmp_path, code=0)
    assert (tmp_path / "figures" / "swing-error.png").is_file()
