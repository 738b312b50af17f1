"""Writing starter configurations, and the schema for editors."""

from __future__ import annotations

import logging
from pathlib import Path

from fvi_cli.config import SCHEMA_FILE, SCHEMA_TITLE, schema_text, starter_config
from fvi_cli.config.keys.experiment import NAME
from fvi_cli.errors import RequestError
from fvi_cli.storage.atomic import replace_file

_logger = logging.getLogger(__name__)


def write_starter(name: str, kind: str) -> Path:
    """Write a commented configuration into the current folder; the file must not exist yet.

    The JSON schema for editors is written next to it, or updated; another file of that name is not
    touched.

    Raises
    ------
    RequestError
        For an unknown kind, a name that is not allowed, or a file that exists.
    """
    if not NAME.allows(name):
        raise RequestError(f"{name!r} is not allowed as a name; use letters, digits, - and _")
    path = Path(f"{name}.yaml")
    text = starter_config(kind, name=name)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise RequestError(f"{path}: exists already; it is left as it is") from None
    except OSError as error:
        raise RequestError(f"{path}: cannot be written: {error.strerror}") from None
    _write_schema(Path(SCHEMA_FILE))
    return path


def _write_schema(path: Path) -> None:
    """Write the schema unless it exists already, or another file has its name."""
    fresh = schema_text()
    try:
        stored = path.read_text(encoding="utf-8") if path.exists() else ""
        if stored == fresh or (stored and f'"{SCHEMA_TITLE}"' not in stored):
            return
        replace_file(path, fresh.encode())
    except (OSError, UnicodeDecodeError) as error:
        _logger.warning("%s: not written: %s", path, error)
    else:
        _logger.info("%s: for editors", path)
