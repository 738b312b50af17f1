"""Completion of arguments in a shell."""

from __future__ import annotations


def shipped_names(incomplete: str) -> list[str]:
    """Names of shipped configurations; if none fits, the shell completes names of files."""
    from fvi_cli.config import shipped_configs

    return [name for name in shipped_configs() if name.startswith(incomplete)]


def names_of_pages(incomplete: str) -> list[str]:
    """Names of the pages of the guide."""
    from fvi_cli.config import guide_pages

    names = (name for pages in guide_pages().values() for name in pages)
    return [name for name in names if name.startswith(incomplete)]


def kinds_of_problems(incomplete: str) -> list[str]:
    """Kinds of problems."""
    from fvi_cli.scenes.registry import KINDS

    return [kind for kind in KINDS if kind.startswith(incomplete)]
