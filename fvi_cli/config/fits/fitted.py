"""A configuration with fitted numbers."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from fvi_cli.config.load import LoadedConfig
from fvi_cli.config.text.document import LARGEST_DOCUMENT
from fvi_cli.errors import RequestError
from fvi_cli.studies.members import with_values

LEFT_OUT = ("designs", "sweep", "claims", "expect", "exact")


def fitted_text(
    loaded: LoadedConfig,
    number: int,
    specification: Mapping[str, Any],
    motions: Sequence[tuple[str, Mapping[str, float]]],
) -> str:
    """YAML of the experiment with fitted numbers; one experiment for every motion."""
    resolved = loaded.resolved["experiments"][number]
    name = f"{resolved['name']}-fitted"
    kept = {key: value for key, value in resolved.items() if key not in LEFT_OUT}
    made = []
    for motion, values in motions:
        problem = with_values(specification, values)
        if "exact" in problem:
            problem["exact"] = "none"
        label = name if len(motions) == 1 else f"{name}-{_as_name(motion)}"
        made.append({**kept, "name": label, "problem": problem})
    whole = made[0] if len(made) == 1 else {"name": name, "experiments": made}
    head = f"# {resolved['name']} with the numbers that were fitted to measurements\n"
    text = head + _as_yaml(_with_files(whole, _add_digest))
    if len(text) > LARGEST_DOCUMENT:
        # files are referred to, not copied; reading checks their sha256
        text = head + _as_yaml(_with_files(whole, partial(_refer, folder=loaded.path.parent)))
    if len(text) > LARGEST_DOCUMENT:
        raise RequestError(
            f"{name}: the configuration with the fitted numbers takes {len(text)} characters, and "
            f"one with more than {LARGEST_DOCUMENT} is not read; write matrices of the problem as "
            "files, such as stiffness: {file: K.mtx}"
        )
    return text


def _as_yaml(whole: Mapping[str, Any]) -> str:
    text: str = yaml.safe_dump(whole, sort_keys=False, default_flow_style=None, width=100)
    return text


def _with_files(node: Any, change: Callable[[dict[str, Any]], None]) -> Any:
    """The values after `change` of every mapping that holds the content of a file."""
    if isinstance(node, list | tuple):
        return [_with_files(one, change) for one in node]
    if not isinstance(node, Mapping):
        return node
    kept = {key: _with_files(value, change) for key, value in node.items()}
    if {"file", "content"} <= set(node):
        change(kept)
    return kept


def _add_digest(found: dict[str, Any]) -> None:
    found["content_sha256"] = hashlib.sha256(str(found["content"]).encode()).hexdigest()


def _refer(found: dict[str, Any], folder: Path) -> None:
    """Replace the content of a file by its absolute path."""
    file = (folder / str(found["file"])).resolve()
    if "sha256" in found and file.is_file():
        del found["content"]
        found["file"] = file.as_posix()


def _as_name(words: str) -> str:
    """Words in characters that names of files may have."""
    found = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in words)
    return found.lstrip("-_") or "motion"
