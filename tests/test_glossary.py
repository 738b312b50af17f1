"""Plain words: names, messages, help and pages have none that readers must translate."""

import ast
import functools
import io
import re
import tokenize
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted((ROOT / "fvi_cli").rglob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

NAMES = {
    "told": "reported, logged, described",
    "tell": "report_, log_, print_",
    "asked": "request",
    "said": "attributes, reason, text",
    "settled": "is_resolved, simplify_",
    "joined": "join",
    "watched": "on_progress",
    "advanced": "report_progress",
    "taken_off": "caputo_offset",
    "side_by_side": "batch, stack",
    "way": "displacement, direction",
    "ways": "displacements",
    "pull": "force",
    "pulls": "forces",
    "driving": "memory input",
    "vain": "rejected",
    "beside": "what it is beside",
    "alone": "single, individually",
    "apart": "distance, separate",
    "left_over": "residual, remainder",
    "known_forces": "loads",
    "nothing": "zero, empty",
    "nobody": "no user",
    "whoever": "caller",
    "finest_of_first": "finest_runs",
    "left_to_round_off": "below_floor",
    "row_of": "column getter",
    "is_part": "is_partial",
    "refuse_what_has_no_price": "check_measurable",
}
"""Parts of names, with what to write."""
ANY_NAME = re.compile(f"_(?:{'|'.join(NAMES)})_")

OF_LIBRARIES = {("storage/stream.py", "tell"), ("scenes/structures/archives.py", "tell")}
"""Names that a protocol of Python gives."""

PHRASES = (
    r"\btold\b",
    r"\btells? (?!from\b)",
    r"left over",
    r"what is left",
    r"side by side",
    r"in vain",
    r"comes? to nothing",
    r"done alone",
    r"known forces",
    r"\bquadrated\b",
    r"\b[Nn]obody\b",
    r"\b[Ww]hoever\b",
    r"(?:^|[.;:,] )[Nn]othing (?!else|relies)",
    r"\b(?:is|are) said\b",
    r"\basked of\b",
    r"so often; the same command goes on",
    r"did not expect it",
    r"is no kind\b",
)
"""What no message, help, page, docstring or comment says."""
ANY_PHRASE = re.compile("|".join(PHRASES))


Nodes = Sequence[ast.AST]


@functools.cache
def parts(name: str) -> str:
    """The words of a name, each between underscores."""
    return f"_{re.sub(r'(?<=[a-z])(?=[A-Z])', '_', name).lower().strip('_')}_"


def nodes_of(source: str) -> Nodes:
    return list(ast.walk(ast.parse(source)))


def names(nodes: Nodes) -> Iterator[tuple[int, str]]:
    """Names that are given in a module: of functions, classes, arguments, values and attributes."""
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr


def docstrings(nodes: Nodes) -> list[ast.Constant]:
    return [
        node.value
        for node in nodes
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    ]


def texts(nodes: Nodes) -> Iterator[tuple[int, str]]:
    """Texts of a module that are no docstrings."""
    own = {id(one) for one in docstrings(nodes)}
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in own:
            yield node.lineno, node.value


def comments(source: str, nodes: Nodes) -> Iterator[tuple[int, str]]:
    """Docstrings and comments of a module, each in one line; comments over several lines joined."""
    for one in docstrings(nodes):
        yield one.lineno, " ".join(str(one.value).split())
    joined: list[tuple[int, str]] = []
    last = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            line, text = token.start[0], token.string.lstrip("# ")
            if line == last + 1:
                joined[-1] = (joined[-1][0], f"{joined[-1][1]} {text}")
            else:
                joined.append((line, text))
            last = line
    yield from joined


def wrong_names(nodes: Nodes, place: str) -> list[str]:
    return [
        f"{place}:{line}: {name}: write {NAMES[word]}"
        for line, name in dict.fromkeys(names(nodes))
        if ANY_NAME.search(parts(name)) and (place, name) not in OF_LIBRARIES
        for word in NAMES
        if f"_{word}_" in parts(name)
    ]


def wrong_phrases(lines: Iterator[tuple[int, str]], place: str) -> list[str]:
    return [
        f"{place}:{line}: {found[0]!r} in {text.strip()[:80]!r}"
        for line, text in lines
        if ANY_PHRASE.search(text)
        for phrase in PHRASES
        if (found := re.search(phrase, text))
    ]


FRONT_DOORS = {
    "compare", "hard_cases", "integrate", "run", "show", "write",
}  # fmt: skip
"""Public functions of the package that check what users give, and call one of the same name."""


def test_names_messages_and_comments_are_plain_and_no_two_things_have_one_name():
    found: list[str] = []
    homes: dict[str, list[str]] = {}
    for path in SOURCES:
        place = path.relative_to(ROOT / "fvi_cli").as_posix()
        source = path.read_text(encoding="utf-8")
        tree, *inner = nodes = nodes_of(source)
        found += wrong_names(nodes, place)
        found += wrong_phrases(texts(nodes), place)
        found += wrong_phrases(comments(source, nodes), place)
        # commands are called like the functions that they call
        named = [n for n in tree.body if isinstance(n, ast.FunctionDef) and place[:4] != "cli/"]
        for node in [*named, *(n for n in inner if isinstance(n, ast.ClassDef))]:
            if not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(f"{place}:{node.lineno}")
    assert found == []
    several = {name: places for name, places in homes.items() if len(places) > 1}
    assert {name: places for name, places in several.items() if name not in FRONT_DOORS} == {}
    assert set(several) >= FRONT_DOORS


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_pages_are_plain(path):
    text = path.read_text(encoding="utf-8")
    # tables that are made from stored results have their own words
    text = re.sub(r"<!-- begin results.*?<!-- end results", "", text, flags=re.DOTALL)
    paragraphs = ((k, " ".join(one.split())) for k, one in enumerate(text.split("\n\n")))
    assert wrong_phrases(paragraphs, path.name) == []


def test_the_lists_find_what_they_are_for():
    source = "def was_told(beside, theWay):\n    self.asked = 'nobody can tell it'\n"
    nodes = nodes_of(source)
    assert [one.split(": ")[1] for one in wrong_names(nodes, "m.py")] == [
        "was_told", "beside", "theWay", "asked"
    ]  # fmt: skip
    assert len(wrong_phrases(texts(nodes), "m.py")) == 2
    source = '"""What is\n    told."""\n# in\n# vain\n'
    lines = list(comments(source, nodes_of(source)))
    assert [line for line, _ in lines] == [1, 3]
    assert len(wrong_phrases(iter(lines), "m.py")) == 2
    assert wrong_names(nodes_of("def always(anyway, tellurium): ..."), "m.py") == []
