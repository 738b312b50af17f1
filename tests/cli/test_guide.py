"""``fvi guide`` shows the pages of docs/."""

from pathlib import Path

from command_line import fvi

DOCS = Path(__file__).parents[2] / "docs"


def test_pages_are_listed_with_their_titles():
    listed = fvi("guide").stdout.splitlines()
    names = {line.split()[0]: line.partition(" ")[2].strip() for line in listed}
    assert set(names) == {one.stem for one in DOCS.glob("*.md")} - {"index"}
    assert names["motion"] == "What is asked of a motion"
    assert all(names.values())


def test_a_page_is_printed_as_it_stands():
    for name in ("motion", "motion.md"):
        shown = fvi("guide", name)
        assert shown.stdout.strip() == (DOCS / "motion.md").read_text(encoding="utf-8").strip()


def test_a_page_that_is_none_is_answered_with_the_nearest():
    missed = fvi("guide", "motoin", code=2)
    assert "did you mean 'motion'?" in missed.stderr
    fvi("guide", "../README", code=2)
