"""``fvi guide`` shows the pages of docs/, in the groups of their folders."""

from pathlib import Path

from command_line import fvi

DOCS = Path(__file__).parents[2] / "docs"


def test_pages_are_listed_with_their_group_and_title():
    rows = [line.split(maxsplit=2) for line in fvi("guide").stdout.splitlines()[1:]]
    pages = [one for one in DOCS.rglob("*.md") if one != DOCS / "index.md"]
    groups = {one.stem: one.parent.name for one in pages} | {"tutorial": "tutorial"}
    assert {name: group for group, name, _ in rows} == groups
    assert len(rows) == len(pages)


def test_a_page_is_printed_as_it_stands():
    for name in ("motions", "motions.md"):
        shown = fvi("guide", name)
        page = DOCS / "how-to" / "motions.md"
        assert shown.stdout.strip() == page.read_text(encoding="utf-8").strip()


def test_an_unknown_page_is_answered_with_the_nearest():
    missed = fvi("guide", "motoins", code=2)
    assert "did you mean 'motions'?" in missed.stderr
    fvi("guide", "../README", code=2)


def test_the_page_of_pages_and_shipped_configurations_are_printed():
    assert fvi("guide", "index").stdout.strip() == (DOCS / "index.md").read_text().strip()
    shown = fvi("show", "three-designs", "--config").stdout
    assert "copy" not in fvi("show", "duffing", "--config").stderr
    told = fvi("show", "five-storeys", "--config").stderr.split()
    assert [Path(one).name for one in told[-2:]] == ["five-storeys.csv", "ground-motion.csv"]
    assert all(Path(one).is_file() for one in told[-2:])
    assert shown == (DOCS.parent / "configs" / "three-designs.yaml").read_text(encoding="utf-8")
