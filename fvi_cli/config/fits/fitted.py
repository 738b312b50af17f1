"""A configuration with the numbers that were fitted to it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
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
    """YAML of the experiment with fitted numbers; one experiment for every motion.

    Raises
    ------
    RequestError
        If it is too large to be read again.
    """
    resolved = loaded.resolved["experiments"][number]
    name = f"{resolved['name']}-fitted"
    kept = {key: value for key, value in resolved.items() if key not in LEFT_OUT}
    made = []
    for motion, values in motions:
        problem = {**with_values(specification, values), "exact": "none"}
        label = name if len(motions) == 1 else f"{name}-{_as_name(motion)}"
        made.append({**kept, "name": label, "problem": problem})
    whole = made[0] if len(made) == 1 else {"name": name, "experiments": made}
    head = f"# {resolved['name']} with the numbers that were fitted to measurements\n"
    text = head + _as_yaml(_with_digests(whole))
    if len(text) > LARGEST_DOCUMENT:
        # files stay where they are; their sha256 is checked when they are read again
        text = head + _as_yaml(_by_reference(whole, loaded.path.parent))
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


def _with_digests(node: Any) -> Any:
    """The values with the sha256 of every content that stands in place of a file."""
    if isinstance(node, list | tuple):
        return [_with_digests(one) for one in node]
    if not isinstance(node, Mapping):
        return node
    kept = {key: _with_digests(value) for key, value in node.items()}
    if {"file", "content"} <= set(node):
        kept["content_sha256"] = hashlib.sha256(str(node["content"]).encode()).hexdigest()
    return kept


def _by_reference(node: Any, folder: Path) -> Any:
    """The values with files named by absolute paths in place of what they hold."""
    if isinstance(node, list | tuple):
        return [_by_reference(one, folder) for one in node]
    if not isinstance(node, Mapping):
        return node
    kept = {key: _by_reference(value, folder) for key, value in node.items()}
    file = (folder / str(node.get("file", ""))).resolve()
    if {"file", "sha256", "content"} <= set(node) and file.is_file():
        del kept["content"]
        kept["file"] = file.as_posix()
    return kept


def _as_name(words: str) -> str:
    """Words as they may stand in a name of files."""
    found = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in words)
    return found.lstrip("-_") or "motion"
