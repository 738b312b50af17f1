"""A configuration with fitted numbers."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from fvi_cli.config.load import LoadedConfig
from fvi_cli.scenes.records.inputs import is_file
from fvi_cli.studies.members import with_values

LEFT_OUT = ("designs", "sweep", "claims", "expect", "figures")


def fitted_text(
    loaded: LoadedConfig,
    number: int,
    specification: Mapping[str, Any],
    motions: Sequence[tuple[str, Mapping[str, float]]],
    folder: Path,
) -> str:
    """YAML of the experiment with fitted numbers, for `folder`; one experiment for every motion."""
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
    referring = _referring(whole, loaded.path.parent, folder)
    written = yaml.safe_dump(referring, sort_keys=False, default_flow_style=None, width=100)
    return head + str(written)


def _referring(node: Any, base: Path, folder: Path) -> Any:
    """The values with paths of files as seen from a folder in place of the base."""
    if isinstance(node, list | tuple):
        return [_referring(one, base, folder) for one in node]
    if not isinstance(node, Mapping):
        return node
    found = {key: _referring(value, base, folder) for key, value in node.items()}
    if is_file(node):
        path = (base / str(node["file"])).resolve()
        try:
            found["file"] = Path(os.path.relpath(path, folder.resolve())).as_posix()
        except ValueError:
            # on another drive of Windows
            found["file"] = path.as_posix()
    return found


def _as_name(words: str) -> str:
    """Words in characters that names of files may have."""
    found = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in words)
    return found.lstrip("-_") or "motion"
