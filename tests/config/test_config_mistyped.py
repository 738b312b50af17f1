"""Configurations as people mistype them: each is told its place and what to write instead."""

import pytest

from fvi_cli.config import parse_config
from fvi_cli.errors import ConfigError

TEXT = """\
name: w
problem:
  kind: pendulum
  damping: [{order: 0.5, coefficient: 0.2}]
  forcing: sin(t)
  initial: {position: 1.0}
  final_time: 5.0
ladder: {steps: [8, 16]}
"""


def told(text: str) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "w.yaml")
    return caught.value.complaints


def test_the_text_itself_is_valid():
    assert parse_config(TEXT, "w.yaml").name == "w"


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("sin(t)", "sin(2t)", "5:17: problem.forcing: '*' is missing: write 2*t"),
        ("sin(t)", "t^2", "'^' is not allowed; a power is written **, as in x**2"),
        ("sin(t)", "t²", "5:13: problem.forcing: '²' is not allowed; a power is written **"),
        ("sin(t)", "1 if t < 1 else 0", "'<' is not allowed; what jumps is given in pieces"),
        ("sin(t)", "damping", "unknown name 'damping' (known: e, pi, t)"),
        ("sin(t)", "sin(w*t)", "5:16: problem.forcing: unknown name 'w'"),
        ("sin(t)", "sin(w*t)", "a number of your own: problem.parameters: {w: 1.0}"),
        ("sin(t)", "np.sin(t)", "5:12: problem.forcing: write sin(...) without 'np.'"),
        ("sin(t)", "2*numpy.maximum(t, 1)", "write max(...) without 'numpy.'"),
        ("sin(t)", "sin(math.pi*t)", "5:16: problem.forcing: write pi without 'math.'"),
        ("sin(t)", "cosine(t)", "unknown function 'cosine'; did you mean 'cos'?"),
        ("sin(t)", "os.system(t)", "only numbers, names, + - * / **, parentheses"),
        ("sin(t)", "x'", "the velocity of x is vx, its acceleration ax"),
        ("0.5,", "0,5,", "numbers have a decimal point, no comma: write 0.5"),
        ("0.5,", "1/2,", "4:21: problem.damping.0.order: the text '1/2' is not allowed"),
        ("0.5,", "1/2,", "; write 0.5"),
        ("0.5,", "50%,", "; write 0.5"),
        ("1.0}", "60°}", "angles are in radians: write 1.0471975511966"),
        ("5.0", "5 s", "7:15: problem.final_time: the text '5 s' is not allowed"),
        ("5.0", "5 s", "numbers have no unit: write 5"),
        ("{position: 1.0}", "1.0", "6:12: problem.initial: 1.0 is not allowed"),
        ("{position: 1.0}", "1.0", "; write {position: 1.0}"),
        ("initial: {position:", "initial_position: {x:", "write initial: {position: ...}"),
        ("final_time", "T", "7:3: problem.T: not a key: write final_time"),
        ("final_time", "end_time", "problem.end_time: not a key: write final_time"),
        ("forcing", "force", "problem.force: not a key: write forcing"),
        ("kind:", "type:", "3:3: problem.type: not a key: write kind"),
        ("ladder: {steps: [8, 16]}", "accuracy: 1e-8", "; write {tolerance: 1e-8}"),
        ("ladder: {steps: [8, 16]}", "tolerance: 1e-8", "write accuracy: {tolerance: 1e-8}"),
        ("ladder: {steps: [8, 16]}", "steps: [8]", "write ladder: {steps: [16, 32, 64]}"),
    ],
)
def test_what_is_mistyped_in_a_problem(old, new, complaint):
    assert any(complaint in one for one in told(TEXT.replace(old, new, 1)))


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("method: {rk: gauss, order: 6}", "Gauss of degree m has order 2 m"),
        ("method: {euler: 1}", "write baseline: explicit-euler or implicit-euler"),
        ("method: {baseline: euler}", "did you mean 'explicit-euler'?"),
        ("method: {gauss: 3}", "write rk: gauss, degree: 3"),
        ("output: 0.1", "9:9: output: 0.1 is not allowed"),
        ("output: 0.1", "; write {step: 0.1}"),
        ("output: {dt: 0.1}", "9:10: output.dt: not a key: write step"),
        ("events: {zero: x}", "; write {when: x}"),
        ("events: {zero: x = 0}", "; write {when: x}"),
        ("events: {zero: x = 1 + t}", "; write {when: x - (1 + t)}"),
        ("events: {zero: {when: x = 1}}", "give the difference of both sides: x - 1"),
        ("events: {zero: {when: w*x}}", "problem.parameters: {w: 1.0}"),
        ("events: {zero: {when: x = 0}}", "give the difference of both sides"),
        ("events: {zero: {when: x, terminal: true}}", "not a key: write stop"),
        ("impacts: {floor: {when: x, e: 0.5}}", "not a key: write restitution"),
        ("figures: energy", "; write [energy]"),
        ("plot: [energy]", "9:1: plot: not a key: write figures"),
        ("parameters: {a: 1}", "not a key here: write it under problem"),
        ("quantities: {speed: v}", "unknown name 'v'; did you mean 'vx'?"),
        ("units: mm", "such as {length: mm, time: s}"),
    ],
)
def test_what_is_mistyped_beside_it(line, complaint):
    assert any(complaint in one for one in told(f"{TEXT}{line}\n"))


@pytest.mark.parametrize("name", ["events", "impacts"])
def test_what_is_missing_is_told_once(name):
    (one,) = told(f"{TEXT}{name}: {{floor: {{}}}}\n")
    assert f"9:{len(name) + 11}: {name}.floor.when: missing" in one
