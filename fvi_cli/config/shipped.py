"""Configurations and pages that come with the program."""

from __future__ import annotations

import contextlib
import itertools
from pathlib import Path

from fvi_cli.errors import RequestError, excerpt, listed, suggestion

PAGE_GROUPS = ("tutorial", "how-to", "reference", "explanation")
"""Groups of pages: the first is a page next to the folders, each other group is a folder."""


def shipped_configs() -> tuple[str, ...]:
    """Names of the shipped configurations, sorted."""
    return tuple(sorted(path.stem for path in _folder().glob("*.yaml")))


def shipped_titles() -> dict[str, str]:
    """Titles of the shipped configurations: the first sentence of the comment at their top."""
    return {name: _title(_folder() / f"{name}.yaml") for name in shipped_configs()}


def _title(path: Path) -> str:
    lines = path.read_text(encoding="utf-8").splitlines()
    comment = itertools.takewhile(lambda line: line.startswith("# "), lines)
    words = " ".join(line.removeprefix("# ") for line in comment)
    return words.partition(". ")[0].removesuffix(".")


def find_config(name: str) -> Path:
    """The file of a given name: a path if it exists, otherwise a shipped configuration."""
    with contextlib.suppress(OSError, ValueError):
        if Path(name).is_file():
            return Path(name)
    plain, known = name.removesuffix(".yaml"), shipped_configs()
    if plain in known:
        return _folder() / f"{plain}.yaml"
    words = f"{excerpt(name, 200)}: no such file, and no shipped configuration has this name"
    raise RequestError(f"{words}{suggestion(plain, known)}; `fvi list` lists them")


def guide_pages() -> dict[str, dict[str, str]]:
    """Names of the pages of the guide with their titles, by group."""
    found: dict[str, dict[str, str]] = {}
    for name, path in _page_files().items():
        title = path.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
        group = path.parent.name if path.parent.name in PAGE_GROUPS else PAGE_GROUPS[0]
        found.setdefault(group, {})[name] = title
    return found


def guide_page(name: str) -> str:
    """The text of a page of the guide."""
    # the page that lists the others is not in their list
    index = {"index": _shipped("guide", "docs") / "index.md"}
    plain, known = name.removesuffix(".md"), {**_page_files(), **index}
    if plain not in known:
        raise RequestError(
            f"{excerpt(name, 200)}: no such page{suggestion(plain, tuple(known))} "
            f"(pages: {listed(tuple(known))})"
        )
    return known[plain].read_text(encoding="utf-8").rstrip()


def _folder() -> Path:
    return _shipped("shipped_configs", "configs")


def _page_files() -> dict[str, Path]:
    """The pages by name, group by group."""
    folder = _shipped("guide", "docs")
    places = (folder, *(folder / group for group in PAGE_GROUPS))
    return {
        path.stem: path
        for place in places
        for path in sorted(place.glob("*.md"))
        if path != folder / "index.md"
    }


def _shipped(inside: str, outside: str) -> Path:
    """A folder within the installed package; in a checkout next to the package."""
    package = Path(__file__).resolve().parents[1]
    folder = package / inside
    return folder if folder.is_dir() else package.parent / outside
