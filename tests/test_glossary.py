"""Plain words: names, messages, help and pages have none that readers must translate."""

import ast
import re
from collections.abc import Iterator
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
"""What no message, help or page says."""


def parts(name: str) -> str:
    """The words of a name, each between underscores."""
    return f"_{re.sub(r'(?<=[a-z])(?=[A-Z])', '_', name).lower().strip('_')}_"


def names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Names that are given in a module: of functions, classes, arguments, values and attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr


def texts(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Texts of a module that readers see: all but docstrings of what is no command."""
    docstrings = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if is_text and id(node) not in docstrings:
            yield node.lineno, node.value


def wrong_names(source: str, place: str) -> list[str]:
    return [
        f"{place}:{line}: {name}: write {instead}"
        for line, name in names(ast.parse(source))
        for word, instead in NAMES.items()
        if f"_{word}_" in parts(name) and (place, name) not in OF_LIBRARIES
    ]


def wrong_phrases(lines: Iterator[tuple[int, str]], place: str) -> list[str]:
    return [
        f"{place}:{line}: {found[0]!r} in {text.strip()[:80]!r}"
        for line, text in lines
        for phrase in PHRASES
        if (found := re.search(phrase, text))
    ]


def test_names_are_plain():
    found = []
    for path in SOURCES:
        place = path.relative_to(ROOT / "fvi_cli").as_posix()
        found += wrong_names(path.read_text(encoding="utf-8"), place)
    assert found == []


def test_messages_and_help_are_plain():
    found = []
    for path in SOURCES:
        place = path.relative_to(ROOT / "fvi_cli").as_posix()
        tree = ast.parse(path.read_text(encoding="utf-8"))
        found += wrong_phrases(texts(tree), place)
        if place.startswith("cli/"):
            helps = ((n.lineno, ast.get_docstring(n) or "") for n in ast.walk(tree)
                     if isinstance(n, ast.FunctionDef) and n.decorator_list)  # fmt: skip
            found += wrong_phrases(helps, place)
    assert found == []


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_pages_are_plain(path):
    text = path.read_text(encoding="utf-8")
    # tables that are made from stored results have their own words
    text = re.sub(r"<!-- begin results.*?<!-- end results", "", text, flags=re.DOTALL)
    paragraphs = ((k, " ".join(one.split())) for k, one in enumerate(text.split("\n\n")))
    assert wrong_phrases(paragraphs, path.name) == []


def test_the_lists_find_what_they_are_for():
    source = "def was_told(beside, theWay):\n    self.asked = 'nobody can tell it'\n"
    assert [one.split(": ")[1] for one in wrong_names(source, "m.py")] == [
        "was_told", "beside", "theWay", "asked"
    ]  # fmt: skip
    assert len(wrong_phrases(texts(ast.parse(source)), "m.py")) == 2
    assert wrong_names("def always(anyway, tellurium): ...", "m.py") == []


def test_no_class_has_the_name_of_another():
    homes: dict[str, list[str]] = {}
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert {name: places for name, places in homes.items() if len(places) > 1} == {}
