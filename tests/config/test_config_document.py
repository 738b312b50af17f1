"""Numbers and words of YAML 1.2, and the places of nodes."""

import json
import math

import numpy as np
import pytest
import yaml

from fvi_cli.config.text.document import read_document
from fvi_cli.keys.complaints import Complaints, SourcePosition
from fvi_cli.keys.nodes import ListNode, MappingNode, ScalarNode, read_scalar

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


def test_not_a_number_is_read():
    assert math.isnan(read_scalar(".nan"))


@pytest.mark.parametrize("text", ["9" * 100_000, "0x" + "f" * 100_000, "0o" + "7" * 100_000])
def test_endless_numbers_are_infinite_at_once(text):
    assert read_scalar(text) == math.inf
    assert read_scalar("-" + "9" * 100_000) == -math.inf


def tree(text: str) -> MappingNode:
    complaints = Complaints()
    node = read_document(text, SourcePosition(source="f", line=1, column=1), complaints)
    complaints.raise_if_any()
    return node


def test_quoted_words_are_texts():
    node = tree("a: '1'\nb: \"true\"\nc: |\n  12\n")
    values = [entry.node.value for entry in node.entries.values()]
    assert values == ["1", "true", "12\n"]


def test_places_of_keys_and_values():
    node = tree("a:\n  b: [1,\n      two]\n  'c':   3\r\n  d: ü\n  e: x\n")
    inner = node.entries["a"].node
    assert str(inner.place) == "f:2:3"
    listed = inner.entries["b"].node
    assert [str(item.place) for item in listed.items] == ["f:2:7", "f:3:7"]
    assert str(inner.entries["c"].key_place) == "f:4:3"
    assert str(inner.entries["c"].node.place) == "f:4:10"
    assert str(inner.entries["e"].node.place) == "f:6:6"


def test_the_first_character_of_a_text_is_known_where_it_stands_as_it_is():
    node = tree("a: x + y\nb: 'x + y'\nc: \"x + \\x79\"\nd: |\n  x + y\n")
    places = [entry.node.text_place for entry in node.entries.values()]
    assert [str(place) for place in places[:2]] == ["f:1:4", "f:2:5"]
    assert places[2:] == [None, None]


def test_an_alias_is_what_it_names():
    node = tree("a: &x {b: 1}\nc: *x\n")
    assert node.entries["c"].node is node.entries["a"].node


def test_no_object_is_ever_made():
    complaints = Complaints()
    text = "a: !!python/object/apply:os.system ['true']\n"
    node = read_document(text, SourcePosition(source="f", line=1, column=1), complaints)
    assert len(complaints) == 1
    assert isinstance(node.entries["a"].node, ListNode)
    (item,) = node.entries["a"].node.items
    assert isinstance(item, ScalarNode)
    assert item.value == "true"


def drawn_json(random: np.random.Generator, depth: int = 0) -> object:
    """Values as Python gives them, with texts that are hard to write."""
    kind = random.integers(7 if depth < 4 else 5)
    if kind == 5:
        return [drawn_json(random, depth + 1) for _ in range(random.integers(5))]
    if kind == 6:
        keys = ("a", "b: c", "#", "é", "\\", "<<", "", "\n- 1", "🙂", "1e3")
        return {
            keys[random.integers(len(keys))]: drawn_json(random, depth + 1)
            for _ in range(random.integers(5))
        }
    if kind == 4:
        words = ("no", "1e-3", "\x00", "\ud800", "\U0001f642", "'\"", "\t x ", "\u2028", "&a", "* ")
        return words[random.integers(len(words))]
    number = float(10 ** random.uniform(-300, 300))
    return (number, -math.inf, int(random.integers(-(10**9), 10**9)), bool(kind))[kind]


@pytest.mark.parametrize("seed", range(60))
def test_json_is_read_alike_by_both_parsers(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Trees, places and complaints; without the parser in C as well."""
    random = np.random.default_rng([41, seed])
    text = json.dumps({"values": [drawn_json(random) for _ in range(6)]}, indent=1)
    found = []
    for is_json, has_library in ((False, True), (True, True), (True, False)):
        with monkeypatch.context() as patch:
            if not has_library:
                patch.delattr(yaml, "CSafeLoader", raising=False)
            complaints = Complaints()
            start = SourcePosition(source="one", line=1, column=1)
            tree = read_document(text, start, complaints, is_json=is_json)
            said = str(complaints.error()) if len(complaints) else ""
            found.append((repr(tree), said))
    assert found[0] == found[1] == found[2]
