"""Texts from strangers: whatever stands in them, nothing but a complaint comes out."""

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fvi_cli.config import find_config, load_config, parse_config
from fvi_cli.errors import ConfigError

SEED = """\
name: example
problem:
  kind: bagley-torvik
  mass: 1.0
  damping: [{order: 1.5, coefficient: 1.0}]
  forcing: {pieces: [{until: 0.5, value: &f 2 + 4*sqrt(t/pi) + t**2}, {value: *f}]}
  initial: {position: &p 0.0, velocity: *p}
  final_time: 1.0
  exact: "t**2"
method:
  - {bdf: [1, 2], sampling: nodes, degree: 1, quadrature: {rule: gauss, points: 2}}
  - {rk: gauss, degree: 2}
ladder: {steps: [2, 4, 8]}
report: {norm: max}
expect: {bdf2: unstable}
"""

numbers = st.one_of(
    st.integers(-3, 10), st.integers(), st.floats(), st.sampled_from([0, 1e-300, 1e300, 10**400])
)
WORDS = (
    "pendulum bagley-torvik damped-oscillator fractional-derivative gauss nodes points series "
    "none weights auto max t t**2 sin(t) 1/t 1e-3 no true explicit-euler lobatto-iiic"
)
words = st.one_of(st.sampled_from(WORDS.split()), st.text(max_size=8))
KNOWN = (
    "name problem kind mass stiffness damping order coefficient derivative forcing pieces until "
    "value initial position velocity final_time exact omega function method bdf rk baseline "
    "sampling degree quadrature rule start weights ladder steps from to base report "
    "norm expect claims figures allow_unstable store every experiments bdf1"
)
KEYS = KNOWN.split()
trees = st.recursive(
    st.one_of(st.none(), st.booleans(), numbers, words),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.one_of(st.sampled_from(KEYS), words), inner, max_size=5),
    ),
    max_leaves=12,
)


def only_complaints(text: str, *overrides: str) -> None:
    complaints: tuple[str, ...] = ()
    experiments: tuple[object, ...] = ()
    try:
        experiments = parse_config(text, "f.yaml", overrides=overrides).experiments
    except ConfigError as error:
        complaints = error.complaints
    assert bool(experiments) != bool(complaints)
    for line in complaints:
        assert line.startswith(("f.yaml:", "--set:", "... and ")), line
        assert line.isprintable(), line


def some(examples: int):
    return settings(
        max_examples=examples, deadline=None, suppress_health_check=[HealthCheck.too_slow]
    )


@some(50)
@given(st.text(max_size=200))
def test_any_text(text):
    only_complaints(text)


def replaced(tree: object, path: list[int], value: object) -> object:
    """The tree with one of its nodes replaced, found by a list of numbers."""
    if not path or not isinstance(tree, dict | list) or not tree:
        return value
    first, *rest = path
    if isinstance(tree, list):
        index = first % len(tree)
        return [replaced(e, rest, value) if i == index else e for i, e in enumerate(tree)]
    key = sorted(tree)[first % len(tree)]
    return {k: replaced(e, rest, value) if k == key else e for k, e in tree.items()}


@some(40)
@given(st.lists(st.integers(0, 9), min_size=1, max_size=5), trees)
def test_a_valid_tree_with_one_node_replaced(path, value):
    tree = replaced(yaml.safe_load(SEED), path, value)
    only_complaints(yaml.safe_dump(tree, allow_unicode=True))


@some(50)
@given(trees)
def test_any_tree(tree):
    only_complaints(yaml.safe_dump(tree, allow_unicode=True))


@some(50)
@given(
    st.one_of(
        st.text(max_size=20),
        st.tuples(st.lists(st.sampled_from([*KEYS, "0", "1"]), min_size=1, max_size=4), words).map(
            lambda pair: ".".join(pair[0]) + "=" + pair[1]
        ),
    )
)
def test_any_change(override):
    only_complaints(SEED, override)


@pytest.mark.slow
@settings(max_examples=20_000, deadline=5000, suppress_health_check=list(HealthCheck))
@given(st.lists(st.integers(0, 9), min_size=1, max_size=5), trees)
def test_many_trees_within_five_seconds_each(path, value):
    test = replaced(yaml.safe_load(SEED), path, value)
    only_complaints(yaml.safe_dump(test, allow_unicode=True))


def test_the_seed_is_valid():
    assert parse_config(SEED, "f.yaml").experiments


def test_bytes_of_a_shipped_file_cut_anywhere(tmp_path):
    content = find_config("damped-oscillator").read_bytes()
    path = tmp_path / "f.yaml"
    for length in range(0, len(content), 97):
        path.write_bytes(content[:length])
        complaints: tuple[str, ...] = ()
        try:
            load_config(path)
        except ConfigError as error:
            complaints = error.complaints
        assert all(line.startswith(str(path)) for line in complaints)
