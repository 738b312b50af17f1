"""Numbers and words of YAML 1.2, and the places of nodes."""

import json
import math

import numpy as np
import pytest

from fvi_cli.config.text.tree import MistakesError, read_document, read_scalar

# From the tables of the core schema in the YAML 1.2.2 specification, section 10.3, and what
# YAML 1.1 reads differently.
CORE_SCHEMA = [
    ("1e-3", 0.001),
    ("1E3", 1000.0),
    ("-.5", -0.5),
    ("0.", 0.0),
    ("+12e03", 12000.0),
    ("-2E+05", -200000.0),
    ("12", 12),
    ("+12", 12),
    ("-19", -19),
    ("017", 17),
    ("0o17", 15),
    ("0x3A", 58),
    (".inf", math.inf),
    ("-.Inf", -math.inf),
    ("+.INF", math.inf),
    ("true", True),
    ("FALSE", False),
    ("null", None),
    ("~", None),
    ("", None),
    # texts
    ("yes", "yes"),
    ("no", "no"),
    ("on", "on"),
    ("Off", "Off"),
    ("y", "y"),
    ("1_000", "1_000"),
    ("1:30", "1:30"),
    ("2001-01-01", "2001-01-01"),
    ("0b11", "0b11"),
    ("1e", "1e"),
    (".", "."),
    ("inf", "inf"),
    ("nan", "nan"),
    ("t**2", "t**2"),
    ("15/4*sqrt(t)", "15/4*sqrt(t)"),
    ("٣", "٣"),  # a digit, but not one of YAML's
]


@pytest.mark.parametrize(("text", "value"), CORE_SCHEMA)
def test_plain_words_are_read_by_the_core_schema(text, value):
    found = read_scalar(text)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize("text", ["9" * 100_000, "0x" + "f" * 100_000, "0o" + "7" * 100_000])
def test_endless_numbers_are_infinite_at_once(text):
    assert read_scalar(text) == math.inf
    assert read_scalar("-" + "9" * 100_000) == -math.inf


def test_places_of_keys_and_values():
    document = read_document("a:\n  b: [1,\n      two]\n  'c':   3\r\n  d: ü\n  e: x + y\n", "f")
    assert [str(document.place(("a", "b", n))) for n in (0, 1)] == ["f:2:7", "f:3:7"]
    assert str(document.place(("a", "c"), of_key=True)) == "f:4:3"
    assert str(document.place(("a", "c"))) == "f:4:10"
    assert str(document.place(("a", "e"), column=5)) == "f:6:10"
    # what is missing, at what should hold it
    assert str(document.place(("a", "b", 7, "x"))) == "f:2:6"


def test_columns_are_those_of_texts_that_stand_as_they_are():
    document = read_document("a: 'x + y'\nb: x + y\n", "f")
    assert [str(document.place((key,), column=5)) for key in "ab"] == ["f:1:4", "f:2:8"]


def test_an_alias_is_what_it_names_and_stands_where_that_stands():
    document = read_document("a: &x {b: 1}\nc: *x\n", "f")
    assert document.value["c"] == {"b": 1}
    assert str(document.place(("c", "b"))) == "f:1:11"


def test_no_object_is_ever_made():
    with pytest.raises(MistakesError) as caught:
        read_document("a: !!python/object/apply:os.system ['true']\n", "f")
    assert "python/object" in str(caught.value.mistakes[0])


def drawn_json(random: np.random.Generator, depth: int = 0) -> object:
    """Values as Python gives them, with texts that are hard to write."""
    kind = random.integers(7 if depth < 4 else 5)
    if kind == 5:
        return [drawn_json(random, depth + 1) for _ in range(random.integers(5))]
    if kind == 6:
        keys = ("a", "b: c", "#", "é", "\\", "<<", "", "\n- 1", "1e3")
        return {
            keys[random.integers(len(keys))]: drawn_json(random, depth + 1)
            for _ in range(random.integers(5))
        }
    if kind == 4:
        words = ("no", "1e-3", "\x00", "'\"", "\t x ", "\u2028", "&a", "* ")
        return words[random.integers(len(words))]
    number = float(10 ** random.uniform(-300, 300))
    return (number, -math.inf, int(random.integers(-(10**9), 10**9)), bool(kind))[kind]


@pytest.mark.parametrize("seed", range(60))
def test_json_is_read_as_it_is(seed):
    random = np.random.default_rng([41, seed])
    values = {"values": [drawn_json(random) for _ in range(6)]}
    text = json.dumps(values, indent=1).replace("-Infinity", "-.inf")
    assert read_document(text, "f").value == values
