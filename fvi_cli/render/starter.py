"""Writing starter configurations, and the schema for editors."""

from __future__ import annotations

from pathlib import Path

from fvi_cli.config import MODELINE, SCHEMA_FILE, schema_text, starter_config
from fvi_cli.config.load import is_name
from fvi_cli.errors import RequestError
from fvi_cli.storage.files import replace_file


def write_starter(name: str, kind: str, *, schema: bool = False) -> list[Path]:
    """Write a commented configuration into the current folder; the file must not exist yet.

    With `schema` also the JSON schema for editors, to which its first line refers them.

    Raises
    ------
    RequestError
        For an unknown kind, a name that is not allowed, or a file that exists.
    """
    if not is_name(name):
        raise RequestError(f"{name!r} is not allowed as a name; use letters, digits, - and _")
    path = Path(f"{name}.yaml")
    text = starter_config(kind, name=name)
    if schema:
        text = f"{MODELINE}\n{text}"
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise RequestError(f"{path}: exists already; it is left as it is") from None
    if not schema:
        return [path]
    replace_file(Path(SCHEMA_FILE), schema_text().encode())
    return [path, Path(SCHEMA_FILE)]
