"""A configuration with the numbers that were fitted to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from fvi_cli.config.load import LoadedConfig
from fvi_cli.studies.members import with_values

LEFT_OUT = ("sweep", "claims", "expect", "exact")


def fitted_text(
    loaded: LoadedConfig,
    number: int,
    specification: Mapping[str, Any],
    motions: Sequence[tuple[str, Mapping[str, float]]],
) -> str:
    """YAML of the experiment with fitted numbers; one experiment for every motion.

    Parameters
    ----------
    loaded
        The configuration that was fitted.
    number
        Which of its experiments.
    specification
        The ``problem`` mapping of the model.
    motions
        Name and values by key path of every motion.
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
    text: str = yaml.safe_dump(whole, sort_keys=False, default_flow_style=None, width=100)
    return head + text


def _as_name(words: str) -> str:
    """Words as they may stand in a name of files."""
    found = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in words)
    return found.lstrip("-_") or "motion"
