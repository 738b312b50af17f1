"""A command writes the files of its row in the list below, and no other."""

import pytest
from command_line import configuration, fvi

OSCILLATOR = (
    "kind: damped-oscillator, damping: [{order: 0.5, coefficient: 0.3}], "
    "initial: {position: 1.0}, final_time: 2.0"
)
LADDER = configuration(OSCILLATOR, name="made", method="[gauss2, gauss3]", steps="8, 16, 32")
SEEN = configuration(
    OSCILLATOR,
    name="made",
    more="quantities: {speed: vx, force: force_1}\noutput: {step: 0.01}\n"
    "events: {turn: {when: vx}}\n"
    "designs: {a: {}, b: {problem.stiffness: 9.0}}\nfigures: [trajectory, quantities]\n",
)
STRUCTURE = configuration(
    "kind: chain, masses: 3, mass: 1, stiffness: 4, "
    "damping: [{order: 0.5, coefficient: 0.2}], final_time: 2.0, exact: none",
    name="made",
)
WRITTEN = {
    ("run", LADDER): {"made.h5"},
    ("convergence", LADDER): {
        "made.h5",
        *(f"tables/made.{form}" for form in ("csv", "md", "tex")),
    },
    ("plot", SEEN): {
        "made.h5",
        *(f"figures/made-{kind}.png" for kind in ("trajectory", "quantities")),
    },
    ("quantities", SEEN): {
        "made.h5",
        *(f"tables/made-quantities{end}" for end in (".csv", ".md", "-events.csv")),
    },
    ("cost", LADDER): {
        *(f"tables/made-cost.{form}" for form in ("csv", "md")),
        "figures/made-cost.png",
    },
    ("stability", LADDER): {
        *(f"tables/made-stability.{form}" for form in ("csv", "md")),
        "figures/made-stability.png",
    },
    ("modes", STRUCTURE): {
        *(f"tables/made-modes.{form}" for form in ("csv", "md")),
        "figures/made-modes.png",
        "made-modes.h5",
    },
    ("response --frequency 0.05:1:40 --force x1 --at x3", STRUCTURE): {
        *(f"tables/made-response.{form}" for form in ("csv", "md")),
        "figures/made-response.png",
    },
}


def written(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("command", "text"), WRITTEN, ids=lambda one: str(one).split()[0])
def test_a_command_writes_these_files_and_no_other(command, text, tmp_path):
    config = tmp_path / "made.yaml"
    config.write_text(text, encoding="utf-8")
    name, *options = command.split()
    fvi(name, config, *options, "-q", "-o", tmp_path / "results", code=0)
    assert written(tmp_path / "results") == WRITTEN[command, text]


def test_a_figure_that_is_not_drawn_says_why(tmp_path):
    config = tmp_path / "made.yaml"
    more = "events: {far: {when: x - 9}}\nfigures: [trajectory, {section: far}]\n"
    config.write_text(configuration(OSCILLATOR, name="made", more=more), encoding="utf-8")
    done = fvi("plot", config, "-o", tmp_path / "results", code=0)
    assert "made: no section-far figure, since the event far did not happen" in done.stderr
    assert written(tmp_path / "results") == {"made.h5", "figures/made-trajectory.png"}


def test_a_fit_writes_its_table_figures_and_configuration(tmp_path):
    fvi("fit", "fit-decay", "-q", "-o", tmp_path, code=0)
    assert written(tmp_path) == {
        "tables/fit-decay-fit.csv",
        "tables/fit-decay-fit.md",
        "figures/fit-decay-fit.png",
        "figures/fit-decay-fit-profiles.png",
        "fit-decay-fitted.yaml",
    }
