"""Commands whose processes, and those that they begin, are changed before they load anything."""

import os
from pathlib import Path

import pytest

import fvi_cli


def change_every_process(folder: Path, monkeypatch: pytest.MonkeyPatch, statements: str) -> None:
    """Let Python carry out `statements` at the beginning of every process from now on."""
    own = folder / "changed"
    own.mkdir()
    (own / "sitecustomize.py").write_text(statements)
    package = str(Path(fvi_cli.__file__).parents[1])
    search = filter(None, [str(own), package, os.environ.get("PYTHONPATH")])
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(search))
