"""``fvi guide`` shows the pages of docs/, in the groups of their folders."""

from pathlib import Path

from command_line import fvi

DOCS = Path(__file__).parents[2] / "docs"
GROUPS = ("tutorial", "how-to", "reference", "explanation")


def test_pages_are_listed_in_groups_with_their_titles():
    groups = {
        title.rstrip(":"): rest.splitlines()
        for title, _, rest in (one.partition("\n") for one in fvi("guide").stdout.split("\n\n"))
        if rest
    }
    assert tuple(groups) == GROUPS
    for group, lines in groups.items():
        names = {line.split()[0]: line.strip().partition(" ")[2].strip() for line in lines}
        folder = DOCS / group
        expected = {one.stem for one in folder.glob("*.md")} if folder.is_dir() else {"tutorial"}
        assert set(names) == expected
        assert all(names.values())
    assert "building " in "".join(groups["how-to"])


def test_every_page_stands_in_a_group_and_its_name_is_its_own():
    pages = [one for one in DOCS.rglob("*.md") if one != DOCS / "index.md"]
    assert {one.parent.name for one in pages} == {"docs", *GROUPS[1:]}
    assert len({one.stem for one in pages}) == len(pages)


def test_a_page_is_printed_as_it_stands():
    for name in ("motions", "motions.md"):
        shown = fvi("guide", name)
        page = DOCS / "how-to" / "motions.md"
        assert shown.stdout.strip() == page.read_text(encoding="utf-8").strip()
    assert "The notebook: " in fvi("guide", "notebook").stdout


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
