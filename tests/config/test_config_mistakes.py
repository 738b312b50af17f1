"""Every kind of mistake: what is said of it, and where."""

import itertools
from pathlib import Path

import pytest

from fvi_cli.config import load_config, parse_config
from fvi_cli.errors import ConfigError

VALID = """\
name: example
problem:
  kind: bagley-torvik
  mass: 1.0
  stiffness: 1.0
  damping: [{order: 1.5, coefficient: 1.0}]
  derivative: caputo
  forcing: 1 + t
  initial: {position: 1.0, velocity: 1.0}
  final_time: 1.0
  exact: t + 1
method:
  - {bdf: [1, 2], sampling: nodes, degree: 1}
ladder: {steps: [2, 4, 8]}
report: {norm: max}
expect: {bdf2: unstable}
allow_unstable: false
"""
PENDULUM = "name: p\nproblem: {kind: pendulum, final_time: 2.0}\nladder: {steps: [4]}\n"
DERIVATIVE = (
    "name: d\nproblem: {kind: fractional-derivative, order: 0.5, function: t**2, final_time: 1.0, "
    "exact: t}\nmethod: {bdf: 1}\nladder: {steps: [4]}\n"
)


def complaints_about(text: str, **options: object) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "f.yaml", **options)
    return caught.value.complaints


def test_the_configuration_in_which_mistakes_are_made_is_valid():
    assert [parse_config(text, "f.yaml").name for text in (VALID, PENDULUM, DERIVATIVE)] == [
        "example",
        "p",
        "d",
    ]


MARK = "»"
# (what is replaced, by what, with a mark at the place; how the complaint begins; what it says)
MISTAKES = [
    # names of keys
    ("  mass: 1.0", "  »mas: 1.0", "problem.mas: not known", "did you mean 'mass'?"),
    ("report: {norm", "»raport: {norm", "raport: not known", "'report'"),
    ("{norm: max}", "{»nrom: max}", "report.nrom: not known", "'norm'"),
    ("sampling: nodes", "»sampeling: points", "method.0.sampeling: not", "'sampling'"),
    ("ladder: {", "»accuracy: {tolerance: 1e-8}\nladder: {", "accuracy: not together", "ladder"),
    ("ladder: {steps: [2, 4, 8]}", "accuracy: {tolerance: »0}", "accuracy.tolerance: 0", "greater"),
    ("ladder: {steps: [2, 4, 8]}", "accuracy: »1e-8", "accuracy: 1e-8", "a mapping with tolerance"),
    ("ladder: {steps: [2, 4, 8]}", "accuracy: »{}", "accuracy.tolerance: missing", ""),
    ("order: 1.5", "»alpha: 0.75", "problem.damping.0.alpha:", "write order: 1.5"),
    ("order: 1.5", "»alpha: 0.75", "problem.damping.0.alpha:", "factor two"),
    ("  mass: 1.0", "  »alpha: 0.25", "problem.alpha:", "write order: 0.5, under"),
    ("order: 1.5", "»gamma: 1.5", "problem.damping.0.gamma:", "called order"),
    ("coefficient: 1.0", "»mu: 1.0, coefficient: 1", "problem.damping.0.mu:", ""),
    ("  exact: t + 1", "  »omega: 1.0", "problem.omega: not known", ""),
    # kinds of value
    ("mass: 1.0", "mass: »yes", "problem.mass: the text 'yes' is not", "number"),
    ("mass: 1.0", "mass: »true", "problem.mass: true is not allowed", "number"),
    ("mass: 1.0", "mass: »'1.0'", "problem.mass: the text '1.0'", "written 1.0"),
    ("mass: 1.0", "mass: »1_000", "problem.mass: the text '1_000'", "written 1000"),
    ("mass: 1.0", "mass:»", "problem.mass: nothing stands here", "number"),
    ("mass: 1.0", "mass: »0", "problem.mass: 0 is not allowed", "greater than 0"),
    ("mass: 1.0", "mass: »{a: 1}", "problem.mass: a mapping with a is not", "matrix"),
    ("allow_unstable: false", "allow_unstable: »no", "allow_unstable: the", "true"),
    ("name: example", "name: »a b", "name: the text 'a b'", "letters, digits"),
    ("name: example", "name: »../a", "name: the text '../a'", "letters, digits"),
    ("name: example", "name:»", "name: nothing stands here", "letters, digits"),
    ("name: example", "name: »" + "a" * 101, "name: 101 characters", "at most 100"),
    ("kind: bagley-torvik", "kind: »bagley", "problem.kind: the", "'bagley-torvik'?"),
    ("[{order: 1.5, coefficient: 1.0}]", "»1.5", "problem.damping: 1.5", "a list"),
    ("derivative: caputo", "derivative: »capito", "problem.derivative:", "'caputo'?"),
    ("norm: max", "norm: »2", "report.norm: 2 is not", "max, final or l2"),
    ("{steps: [2, 4, 8]}", "»[2, 4]", "ladder: a list is not allowed", "{steps"),
    # ranges
    ("order: 1.5", "order: »2", "problem.damping.0.order: 2 is not", "0 and 2"),
    ("order: 1.5", "order: »0", "problem.damping.0.order: 0 is not", "0 and 2"),
    ("coefficient: 1.0", "coefficient: ».inf", "problem.damping.0.coeff", "finite"),
    ("coefficient: 1.0", "coefficient: ».nan", "problem.damping.0.coeff", "finite"),
    ("coefficient: 1.0", "coefficient: »1e999", "problem.damping.0.coe", "finite"),
    ("final_time: 1.0", "final_time: »-1", "problem.final_time: -1", "than 0"),
    ("[1, 2]", "[1, »7]", "method.0.bdf.1: 7 is not", "an integer from 1 to 6"),
    ("[1, 2]", "[»0, 2]", "method.0.bdf.0: 0 is not", "an integer from 1 to 6"),
    ("[1, 2]", "[»2.0, 1]", "method.0.bdf.0: 2.0 is not", "write 2"),
    ("degree: 1", "degree: »21", "method.0.degree: 21 is not", "1 to 20"),
    ("[2, 4, 8]", "[2, »4.5]", "ladder.steps.1: 4.5 is not", "1 to 1073741824"),
    ("[2, 4, 8]", "[»0, 4]", "ladder.steps.0: 0 is not", "an integer from 1"),
    ("[2, 4, 8]", "[2, »1073741825]", "ladder.steps.1: 1073741825", "1 to 107"),
    ("[2, 4, 8]", "[2, »1e3]", "ladder.steps.1: 1e3 is not", "write 1000"),
    ("[2, 4, 8]", "[4, »2]", "ladder.steps.1: 2 is not greater than 4", "increase"),
    ("[2, 4, 8]", "[4, »4]", "ladder.steps.1: 4 is not greater than 4", "increase"),
    ("[2, 4, 8]", "»[]", "ladder.steps: 0 entries", "1 to 100"),
    ("[2, 4, 8]", "[2, »'4']", "ladder.steps.1: the text '4'", "written 4"),
    # ladders by exponents
    ("{steps: [2, 4, 8]}", "{from: 3, to: »1}", "ladder.to: 1 is less", ""),
    ("{steps: [2, 4, 8]}", "»{from: 3}", "ladder: to is missing", "from: 4"),
    ("{steps: [2, 4, 8]}", "{from: 1, to: »20, base: 3}", "ladder.to: 3**20", ""),
    ("{steps: [2, 4, 8]}", "{steps: 2, »to: 4}", "ladder.to: not together", ""),
    # expressions, to the character
    ("forcing: 1 + t", "forcing: 1 + »x", "problem.forcing: unknown name 'x'", ""),
    ("forcing: 1 + t", "forcing: '1 + »x'", "problem.forcing: unknown name", ""),
    ("forcing: 1 + t", "forcing: t»^2", "problem.forcing: '^' is not", "**"),
    ("forcing: 1 + t", "forcing: sin(2»t)", "problem.forcing: '*' is missing", "write 2*t"),
    ("forcing: 1 + t", "forcing: 3»(1 + t)", "problem.forcing: '*' is missing", "write 3*("),
    ("forcing: 1 + t", "forcing: »2,5*t", "problem.forcing: one expression", "point: 2.5"),
    ("order: 1.5", "order: 1, »5:", "problem.damping.0.5: not known", "point, no comma: write 1.5"),
    ("order: 1.5", "order: »'1,5'", "problem.damping.0.order: the text", "1.5 with a decimal"),
    ("[2, 4, 8]}", "[2, 4, 8], grading: »0.5}", "ladder.grading: 0.5", "1 or greater"),
    ("[2, 4, 8]}", "[2, 4, 8], »grading: 2}", "ladder.grading: bdf1-nodes", "use rk: gauss"),
    ("degree: 1}", "start: »graded}", "method.0.start: graded is for rk: gauss", "none"),
    ("degree: 1}", "start: »series}", "method.0.start: series is no longer", "write graded"),
    ("- {bdf: [1, 2], sampling: nodes, degree: 1}", "- {rk: gauss, history: »fft}\n  - {bdf: 2}",
     "method.0.history: fft is no longer", "write auto"),
    ("report: {norm", "»plot: [energy]\nreport: {norm", "plot: not a key", "write figures"),
    ("forcing: 1 + t", "forcing: 9**»9**9**9", "problem.forcing: ", "larger than"),
    ("forcing: 1 + t", "forcing: »t.real", "problem.forcing: only numbers", ""),
    ("forcing: 1 + t", "forcing: »true", "problem.forcing: true is not", "number"),
    ("forcing: 1 + t", "forcing: »sqrt(0.5 - t)", "problem.forcing: is not a", "t = 0.5"),
    ("forcing: 1 + t", "forcing: »1/(t - 0.25)", "problem.forcing: is infinite at t = 0.25", ""),
    ("forcing: 1 + t", "forcing: »1/(2*t) + 1", "problem.forcing: grows like t**-1", "above -1"),
    ("forcing: 1 + t", "forcing: [»{pieces: [{value: 1}]}]",
     "problem.forcing.0: a mapping with pieces is not allowed in a list", "may be a list"),
    ("exact: t + 1", "exact: »1/t", "problem.exact: is infinite at t = 0", "finite"),
    # between keys
    ("{position: 1.0, velocity: 1.0}", "{position: [0, 0, 0], velocity: »[0, 1]}",
     "problem.initial.velocity: is for 2 coordinates, but initial.position for 3", ""),
    ("mass: 1.0", "mass: [[1, 2], [»3, 4]]", "problem.mass.1.0: 3 is not", "symmetric"),
    ("mass: 1.0", "mass: »[[1, 0], [0, 0]]", "problem.mass: the smallest", "positive"),
    ("mass: 1.0", "mass: [[1, 0], »[0]]", "problem.mass.1: 1 entries", "2 numbers"),
    ("mass: 1.0", "mass: »[1, 2]", "problem.mass: 2 numbers where 2", "[[1, 0], [0, 2]]"),
    ("expect: {bdf2", "expect: {»bdf3", "expect.bdf3: no method here", "bdf1-nodes"),
    ("{bdf2: unstable}", "{bdf2: »bad}", "expect.bdf2: the text 'bad'", "diverged"),
    # methods
    ("degree: 1}", "degree: 2, quadrature: »{rule: gauss, points: 1}}",
     "method.0.quadrature: ", "too weak"),
    ("degree: 1}", "degree: 1, »rk: gauss}", "method.0.rk: not together", "bdf"),
    ("degree: 1}", "»stages: 1}", "method.0.stages: only rk has stages", ""),
    ("degree: 1}", "start: »wieghts}", "method.0.start:", "'weights'?"),
    ("degree: 1}", "start: {weights: [»-1]}}", "method.0.start.weights.0:", "0 or"),
    ("degree: 1}", "start: »{weights: [1, 1]}}", "method.0.start: every", "once"),
    ("degree: 1}", "history: »foo}", "method.0.history: the text 'foo'", "auto"),
    ("- {bdf: [1, 2], sampling: nodes, degree: 1}", "- {rk: gauss, start: »weights}\n  - {bdf: 2}",
     "method.0.start: weights correct BDF only", "graded or none"),
    ("- {bdf: [1, 2], sampling: nodes, degree: 1}",
     "- {baseline: explicit-euler, »degree: 1}\n  - {bdf: 2}",
     "method.0.degree: a baseline takes no other key", ""),
    # YAML
    ("  mass: 1.0", "  »kind: pendulum", "problem.kind: given twice", "line 3"),
    ("  mass: 1.0", "  mass: »!!float 1", "problem.mass: the tag", "not allowed"),
    ("  mass: 1.0", "  mass: »!evil 1", "problem.mass: the tag '!evil'", "plain value"),
    ("  mass: 1.0", "  »<<: {mass: 1}", "problem: merging with <<", "repeat"),
    ("  mass: 1.0", "  ? »[1]\n  : 2", "problem: a list or mapping is not", "key"),
    ("  mass: 1.0", '  mass: »"\\ud800"', "problem.mass: half of a char", ""),
]  # fmt: skip


def placed(text: str) -> tuple[str, str]:
    """The text without its mark, and the place of the mark."""
    before, after = text.split(MARK)
    line = before.count("\n") + 1
    column = len(before) - (before.rfind("\n") + 1) + 1
    return before + after, f"f.yaml:{line}:{column}"


def assert_told(text: str, begins: str, says: str) -> None:
    """One complaint stands at the mark in `text`, begins and says so."""
    text, place = placed(text)
    told = complaints_about(text)
    found = [line for line in told if line.startswith(f"{place}: {begins}")]
    assert len(found) == 1, (place, told)
    assert says in found[0]


@pytest.mark.parametrize(("old", "new", "begins", "says"), MISTAKES)
def test_a_mistake_is_told_with_its_place_and_what_is_allowed(old, new, begins, says):
    assert VALID.count(old) == 1
    assert_told(VALID.replace(old, new), begins, says)


def test_a_method_that_is_listed_twice_is_told_where_it_is_asked_for():
    found = complaints_about(VALID.replace("degree: 1}", "degree: [1, 1]}"))
    assert found[0].startswith("f.yaml:13:5: method.0: bdf1-nodes-s1-gauss1-none is given twice")


MISSING = [
    # what is left out, where the mapping begins that lacks it, how the complaint begins
    ("  final_time: 1.0\n", "3:3", "problem.final_time: missing; it must be a finite number"),
    ("  kind: bagley-torvik\n", "3:3", "problem.kind: missing; it must be damped-oscillator, "),
    (", coefficient: 1.0", "6:13", "problem.damping.0.coefficient: missing"),
    ("ladder: {steps: [2, 4, 8]}\n", "1:1", "ladder: missing; it must be {steps: ["),
]


@pytest.mark.parametrize(("left_out", "place", "begins"), MISSING)
def test_what_is_missing_is_told_where_it_should_stand(left_out, place, begins):
    assert VALID.count(left_out) == 1
    found = complaints_about(VALID.replace(left_out, ""))
    assert any(line.startswith(f"f.yaml:{place}: {begins}") for line in found), found


WHOLE_TEXTS = [
    ("name: a\n»\tproblem: b\n", "not YAML", "not with tabs"),
    ("name: a»: b\n", "not YAML", "quotes"),
    ("a: [1, 2\n»", "not YAML", ""),
    ("name: a\n»---\nname: b\n", "a second document", "one file holds one"),
    ("»%YAML 1.1\n---\nname: a\n", "%YAML 1.1", "1.2"),
    ("»%TAG ! tag:x,2000:\n---\nname: a\n", "%TAG", ""),
    ("»", "nothing is written here", ""),
    ("»# only this\n", "nothing is written here", ""),
    ("»~\n", "nothing is written here", ""),
    ("»- 1\n", "a list is not allowed", "mapping"),
    ("»abc\n", "the text 'abc'", "mapping"),
    ("name: »\x00", "a character that is not allowed", ""),
    ('name: "\\U»FFFFFFFF"\n', "", "escape"),
    ("name: »*nobody\n", "*nobody", "no such anchor"),
    ("name: &me [»*me]\n", "*me", "inside"),
    ("a: " + "[" * 49 + "»" + "[" * 10, "nested more than 50 deep", ""),
    ("problem: »{}\n", "problem.kind: missing", "pendulum"),
    ("experiments: »[]\n", "experiments: 0 entries", ""),
    ("experiments: »{a: 1}\n", "experiments: a mapping", "a list"),
    ("experiments: [»1]\n", "experiments.0: 1 is not allowed", "name, problem"),
    ("experiments: [»{}]\n", "experiments.0.name: missing", ""),
    ("experiments: []\n»problem: {}\n", "problem: not known", "experiments"),
    ("name: p\nproblem: {»mass: 1, kind: pendulum, final_time: 2.0}\nladder: {steps: [4]}\n",
     "problem.mass: not known", "omega"),
    ("name: p\nproblem: {kind: pendulum, final_time: 2.0, omega: »-1}\nladder: {steps: [4]}\n",
     "problem.omega: -1", "0 or gr"),
    (PENDULUM.replace("2.0}", "2.0, initial: {position: »[1, 2]}}"),
     "problem.initial.position: is for 2 coordinates, but omega for 1", ""),
    (PENDULUM.replace("2.0}", "2.0, derivative: »riemann-liouville, initial: {position: 1}, "
     "damping: [{order: 1.5, coefficient: 1}]}"),
     "problem.derivative: riemann-liouville of order 1.5", "use caputo"),
    (DERIVATIVE.replace("{bdf: 1}", "[{bdf: 1}, »{rk: gauss}]"),
     "method.1: gauss-s3-graded: a fractional derivative is taken by bdf only", ""),
    ("»" + DERIVATIVE.replace("method: {bdf: 1}\n", ""),
     "method: gauss-s3-graded: a fractional derivative is taken by bdf only", ""),
    ("»" + "#" * 1_000_001, "the text has more than 1000000 characters", "too large"),
    (PENDULUM.replace("[4]", "[»1073741824]"),
     "ladder.steps.0: 1073741824 steps need about 60.1 GB", "has 8 GB"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "begins", "says"), WHOLE_TEXTS)
def test_a_whole_text_is_refused_with_a_place(text, begins, says, monkeypatch):
    monkeypatch.setattr("fvi_cli.config.experiment.machine_bytes", lambda: 8 * 10**9)
    assert_told(text, begins, says)


def test_too_many_entries_are_refused_soon():
    (line,) = complaints_about("a: [" + "1," * 60_000 + "]")
    assert "more than 50000 entries" in line


def test_anchors_cannot_multiply_without_limit():
    names = "abcdefgh"
    text = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
        f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n" for old, new in itertools.pairwise(names)
    )
    (line,) = complaints_about(text)
    assert line.startswith("f.yaml:4:")
    assert "counting repeated anchors" in line


PIECES = [
    # pieces of the forcing, ladder, how the complaint begins, what it says
    ("[{until: 1, value: 8}, {value: 0}]", "[»3]", "ladder.steps.0: 3", "2 and 4"),
    ("[{until: 0.5, value: 8}, {value: 0}]", "[»1]", "ladder.steps.0: 1", "fits is 4"),
    ("[{until: 0.4, value: 8}, {until: 1, value: t}, {value: 0}]", "[10, »1024]",
     "ladder.steps.1: 1024 steps put the break point t = 0.4 between two steps", "1020 and 1030"),
    ("[{until: »1, value: 8}]", "[4]", "problem.forcing.pieces.0.until: not", "last"),
    ("[»{value: 8}, {value: 0}]", "[4]", "problem.forcing.pieces.0.until: miss", ""),
    ("[{until: 1, value: 8}, {until: »0.5, value: 8}, {value: 0}]", "[4]",
     "problem.forcing.pieces.1.until: 0.5 is not after 1", "increase"),
    ("[{until: »3, value: 8}, {value: 0}]", "[4]",
     "problem.forcing.pieces.0.until: 3 is not before final_time = 2", "never act"),
    ("[{until: »0, value: 8}, {value: 0}]", "[4]", "problem.forcing.pieces.0.until: 0", ""),
    ("[{until: 1, value: »1/(1 - t)}, {value: 0}]", "[4]",
     "problem.forcing.pieces.0.value: is infinite at t = 1", ""),
    ("[{until: 1, value: 0}, {value: »(t - 1)**-1.5}]", "[4]",
     "problem.forcing.pieces.1.value: grows like (t - 1)**-1.5 behind t = 1",
     "integral is infinite"),
    ("»[]", "[4]", "problem.forcing.pieces: 0 entries", ""),
]  # fmt: skip


@pytest.mark.parametrize(("pieces", "steps", "begins", "says"), PIECES)
def test_break_points_must_lie_on_the_grid_and_in_order(pieces, steps, begins, says):
    text = PENDULUM.replace("2.0}", f"2.0, forcing: {{pieces: {pieces}}}}}").replace("[4]", steps)
    assert_told(text, begins, says)


@pytest.mark.parametrize("force", ["t**-0.9", "log(t)", "sin(t)/t", "(1 - cos(t))/t**2"])
def test_forces_that_are_infinite_or_undefined_at_their_start_may_have_an_integral(force):
    text = PENDULUM.replace("2.0}", f"2.0, forcing: {force}}}")
    (experiment,) = parse_config(text, "f.yaml").experiments
    assert experiment.problem.scene.forcing is not None


def test_a_break_point_on_the_grid_is_accepted():
    forcing = "forcing: {pieces: [{until: 0.3, value: 8}, {value: exp(-t)}]}"
    text = PENDULUM.replace("2.0}", f"2.0, {forcing}}}").replace("[4]", "[20, 40, 1000]")
    (experiment,) = parse_config(text, "f.yaml").experiments
    assert experiment.problem.scene.break_points == (0.3,)


def test_a_piece_that_begins_where_its_formula_is_infinite_is_accepted():
    forcing = "forcing: {pieces: [{until: 1, value: 0}, {value: 1/sqrt(t - 1)}]}"
    parse_config(PENDULUM.replace("2.0}", f"2.0, {forcing}}}"), "f.yaml")


def test_everything_is_told_at_once_in_the_order_of_the_text():
    text = VALID
    for old, new in [
        ("  mass: 1.0", "  mas: 1.0"),
        ("order: 1.5", "order: 2.5"),
        ("1 + t", "1 + x"),
        ("final_time: 1.0", "final_time: 0"),
        ("[1, 2]", "[1, 7]"),
        ("[2, 4, 8]", "[2, 4.5]"),
        ("norm: max", "norm: most"),
        ("bdf2: unstable", "bdf2: unstabel"),
        ("allow_unstable: false", "allow_unstable: no"),
    ]:
        assert text.count(old) == 1
        text = text.replace(old, new)
    places = [line.split(": ")[0] for line in complaints_about(text)]
    assert places == [
        f"f.yaml:{place}"
        for place in ("4:3", "6:21", "8:16", "10:15", "13:15", "14:21", "15:16", "16:16", "17:17")
    ]


def test_what_holds_between_keys_is_told_together_with_misspelt_ones():
    text = VALID.replace("norm: max", "nrom: max").replace("bdf2: unstable", "bdf3: unstable")
    assert [line.split(" ")[1] for line in complaints_about(text)] == [
        "report.nrom:",
        "expect.bdf3:",
    ]


def test_names_of_experiments_differ_also_where_case_is_ignored():
    one = (
        "  - {{name: {}, problem: {{kind: pendulum, final_time: 1}}, ladder: {{steps: 4}}, "
        "method: {{bdf: 1}}}}\n"
    )
    text = "experiments:\n" + one.format("first") + one.format("First")
    (line,) = complaints_about(text)
    assert line == "f.yaml:3:12: experiments.1.name: 'First' is the name of experiments.0 already"
    assert len(parse_config(text.replace("First", "second"), "f.yaml").experiments) == 2


def test_a_file_name_that_is_no_name_needs_a_name():
    text = PENDULUM.removeprefix("name: p\n")
    assert parse_config(text, "some/where/pendulum.yaml").name == "pendulum"
    (line,) = complaints_about_named(text, "my file.yaml")
    assert line.startswith("my file.yaml:1:1: name: missing")


def complaints_about_named(text: str, source: str) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, source)
    return caught.value.complaints


def test_at_most_a_hundred_complaints_are_printed():
    text = VALID + "".join(f"unknown{i}: 1\n" for i in range(150))
    lines = complaints_about(text)
    assert len(lines) == 101
    assert lines[-1] == "... and 50 more"


def test_text_of_strangers_stays_in_one_printable_line():
    text = 'name: "a\\e[31m\\nb"\n"k\\ne\\ny": 1\n'
    for line in complaints_about(text):
        assert line.isprintable(), line


class TestFiles:
    def test_not_utf_8(self, tmp_path):
        path = tmp_path / "f.yaml"
        path.write_bytes(b"name: a\nx: gr\xf6sse\n")
        with pytest.raises(ConfigError, match=r"f.yaml:2:6: not UTF-8 \(byte 0xf6\)"):
            load_config(path)

    def test_utf_16(self, tmp_path):
        path = tmp_path / "f.yaml"
        path.write_bytes(VALID.encode("utf-16"))
        with pytest.raises(ConfigError, match=r"f.yaml:1:1: not UTF-8"):
            load_config(path)

    def test_too_large(self, tmp_path):
        path = tmp_path / "f.yaml"
        path.write_bytes(b"#" * 1_000_001)
        with pytest.raises(ConfigError, match=r"f.yaml:1:1: more than 1000000 bytes"):
            load_config(path)

    def test_a_byte_order_mark_is_harmless(self, tmp_path):
        path = tmp_path / "f.yaml"
        path.write_bytes(b"\xef\xbb\xbf" + VALID.encode())
        assert load_config(path).text == VALID

    @pytest.mark.parametrize("name", ["missing.yaml", "."])
    def test_not_readable(self, tmp_path, name):
        with pytest.raises(ConfigError, match="cannot be read"):
            load_config(tmp_path / name)

    def test_nothing_is_written(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        Path("good.yaml").write_text(VALID)
        Path("bad.yaml").write_text(VALID.replace("1 + t", "__import__('os').mkdir('x')"))
        load_config(Path("good.yaml"))
        with pytest.raises(ConfigError):
            load_config(Path("bad.yaml"))
        assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.yaml", "good.yaml"]
