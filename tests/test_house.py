"""The shape of the house: rooms, floors and sizes that no other tool holds."""

import ast
import re
import runpy
import tomllib
from collections import Counter
from pathlib import Path

import pytest
import yaml

import fvi_cli

PROJECT = Path(__file__).parents[1]
PACKAGE = PROJECT / "fvi_cli"
SETTINGS = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
FILES = {
    ".".join(path.relative_to(PROJECT).with_suffix("").parts): path
    for path in PACKAGE.rglob("*.py")
}

MOST_FILES, MOST_LINES = 14, 400
# what is larger for now: these lists may only shrink, and numbers in them only fall
CROWDED: dict[str, int] = {}
LONG: dict[str, int] = {}
IN_CIRCLES: frozenset[str] = frozenset()


def imports(name: str, path: Path, *, lazy: bool = True) -> set[str]:
    """Modules of the package that a module imports, also those for type checking alone."""
    found: set[str] = set()
    waiting: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {node.module}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        if lazy or not isinstance(node, ast.FunctionDef):
            waiting += ast.iter_child_nodes(node)
    return {module for module in found if module in FILES} - {name}


def in_circles(graph: dict[str, set[str]]) -> set[str]:
    """Modules that, over however many others, import themselves."""

    def reached(start: str) -> set[str]:
        found: set[str] = set()
        waiting = [start]
        while waiting:
            new = graph[waiting.pop()] - found
            found |= new
            waiting += new
        return found

    return {name for name in graph if name in reached(name)}


def test_circles_are_seen():
    assert in_circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == {"a", "b", "c"}
    assert in_circles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == set()


def test_no_circles_lazy_imports_and_types_included():
    graph = {name: imports(name, path) for name, path in FILES.items()}
    assert sum(map(len, graph.values())) > len(FILES)
    found = in_circles(graph)
    assert found <= IN_CIRCLES, sorted(found - IN_CIRCLES)
    assert found >= IN_CIRCLES, f"no longer: {sorted(IN_CIRCLES - found)}"


def test_every_room_has_its_floor():
    floors = next(
        contract["layers"]
        for contract in SETTINGS["tool"]["importlinter"]["contracts"]
        if contract["type"] == "layers"
    )
    named = [room.strip() for floor in floors for room in floor.split("|")]
    rooms = {
        f"fvi_cli.{path.stem}"
        for path in PACKAGE.iterdir()
        if path.name != "__init__.py" and (path.suffix == ".py" or (path / "__init__.py").exists())
    }
    assert sorted(named) == sorted(rooms)


def assert_only_known(counted: dict[str, int], most: int, known: dict[str, int]) -> None:
    large = {name: number for name, number in counted.items() if number > known.get(name, most)}
    assert not large, f"above {most}, or above what is known of them"
    mended = {name for name in known if counted.get(name, 0) <= most}
    assert not mended, "no longer large: to be taken from the list"


def test_what_grows_or_is_mended_is_told():
    assert_only_known({"a": 14, "b": 20}, 14, {"b": 20})
    for counted in ({"a": 15, "b": 20}, {"a": 14, "b": 21}, {"a": 14, "b": 14}, {"a": 14}):
        with pytest.raises(AssertionError):
            assert_only_known(counted, 14, {"b": 20})


def test_rooms_are_not_crowded():
    counted = Counter(
        str(path.parent.relative_to(PROJECT))
        for path in FILES.values()
        if path.name != "__init__.py" and path.parent.name != "cli"
    )
    assert_only_known(counted, MOST_FILES, CROWDED)


def test_files_are_not_long():
    counted = {
        str(path.relative_to(PROJECT)): len(path.read_text(encoding="utf-8").splitlines())
        for path in FILES.values()
    }
    assert_only_known(counted, MOST_LINES, LONG)


def test_the_wheel_holds_every_package_the_configurations_and_the_pages(monkeypatch):
    setuptools = pytest.importorskip("setuptools")
    built: dict[str, object] = {}
    monkeypatch.setattr(setuptools, "setup", built.update)
    monkeypatch.chdir(PROJECT)
    runpy.run_path("setup.py")
    packages = {name.removesuffix(".__init__") for name in FILES if name.endswith(".__init__")}
    beside = {"fvi_cli.shipped_configs": "configs", "fvi_cli.guide": "docs"}
    assert set(built["packages"]) == packages | set(beside)
    assert built["package_dir"] == beside
    # a folder without __init__.py would be left out
    assert {f".{path.parent.relative_to(PROJECT)}" for path in FILES.values()} == {
        f".{name.replace('.', '/')}" for name in packages
    }
    for name, folder in beside.items():
        endings = SETTINGS["tool"]["setuptools"]["package-data"][name]
        files = [path for path in (PROJECT / folder).rglob("*") if path.is_file()]
        # what makes the site is no page
        shipped = [path for path in files if path.parent.name not in ("site", "__pycache__")]
        assert {path.suffix for path in shipped} == {Path(one).suffix for one in endings}
        assert all(any(path.match(one.removeprefix("**/")) for one in endings) for path in shipped)
        assert all(
            "**/" in one or all(p.parent == PROJECT / folder for p in shipped) for one in endings
        )


def test_versions_agree():
    released = [
        line.split()[1].strip("[]")
        for line in (PROJECT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("## ")
    ]
    assert fvi_cli.__version__.removesuffix(".dev0") == released[0]
    citation = (PROJECT / "CITATION.cff").read_text(encoding="utf-8")
    authors = [f"- name: {author['name']}" for author in SETTINGS["project"]["authors"]]
    assert all(author in citation for author in authors)


def test_the_workflow_covers_what_is_claimed():
    text = (PROJECT / ".github/workflows/tests.yml").read_text(encoding="utf-8")
    jobs = yaml.safe_load(text)["jobs"]
    matrix = jobs["tests"]["strategy"]["matrix"]
    claimed = SETTINGS["project"]["classifiers"]
    python = "Programming Language :: Python :: 3."
    assert {f"{python.removesuffix('3.')}{version}" for version in matrix["python"]} == {
        name for name in claimed if name.startswith(python)
    }
    assert len(matrix["system"]) == sum(name.startswith("Operating System") for name in claimed)
    scripts = {step["run"] for job in jobs.values() for step in job["steps"] if "run" in step}
    assert {f".ci/{path.name}" for path in (PROJECT / ".ci").iterdir()} <= scripts


def test_what_is_slow_runs_on_a_schedule():
    text = (PROJECT / ".github/workflows/slow.yml").read_text(encoding="utf-8")
    # YAML reads the word on as a truth value
    assert yaml.safe_load(text)[True]["schedule"]
    (command,) = re.findall(r"python -m (pytest .*-m slow.*)", text)
    assert f"`.venv/bin/{command.replace('-n auto', '-n 2')}`" in (
        (PROJECT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    )
