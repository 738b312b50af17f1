"""The keys of a force: pieces, or samples from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from fvi_cli.config.complaints import Complaints, KeyPath, excerpt
from fvi_cli.config.csv_samples import CsvMistakesError, read_csv_samples
from fvi_cli.config.document import MappingNode, Node
from fvi_cli.config.records import Key, Record
from fvi_cli.config.shapes import INVALID, OPTIONAL, Choice, Number, Schema, Text, is_complete
from fvi_cli.scenes.samples import LARGEST_TEXT, samples_as_text

_KEYS: Final = Record(
    keys=(
        Key(
            name="file",
            shape=Text(what="the path of a CSV file, from the configuration's folder"),
            meaning="CSV file with names of columns in its first line; a relative path begins at "
            "the configuration.",
        ),
        Key(
            name="column",
            shape=Text(what="the name of a column"),
            meaning="Column of the values (the force's unit over scale).",
        ),
        Key(
            name="time",
            shape=Text(what="the name of a column"),
            meaning="Column of the times, which increase from 0 or before to final_time or later.",
            default="t",
        ),
        Key(
            name="interpolation",
            shape=Choice(words=("linear", "cubic")),
            meaning="Between the samples: straight lines (order 2 at most) or a cubic spline (4).",
            default="linear",
        ),
        Key(
            name="scale",
            shape=Number(),
            meaning="Factor of the values, for example 9.81 for a record in g.",
            default=1.0,
        ),
        Key(
            name="sha256",
            shape=Text(what="64 hexadecimal digits"),
            meaning="Of the file; filled in, and checked where it is given.",
            default=OPTIONAL,
        ),
        Key(
            name="content",
            shape=Text(what="samples as fvi writes them"),
            meaning="Times and values in short; filled in, and used in place of the file.",
            default=OPTIONAL,
        ),
    )
)


@dataclass(frozen=True, kw_only=True)
class Samples:
    """Samples from a CSV file, read together with the configuration."""

    @property
    def expected(self) -> str:
        """What is allowed."""
        return "samples such as {file: quake.csv, column: a, time: t, interpolation: linear}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """The keys with `sha256` and `content` filled in."""
        values = _KEYS.read(node, path, complaints)
        if not isinstance(values, dict) or not is_complete(values) or "content" in values:
            return values
        if any(key not in values for key in ("file", "column", "time")):
            return values
        place, name = node.place, excerpt(values["file"], 200)
        if isinstance(node, MappingNode) and "file" in node.entries:
            place = node.entries["file"].node.place
        folder = complaints.folder
        file = Path(values["file"]) if folder is None else folder / values["file"]
        try:
            found = read_csv_samples(file, name, values["time"], values["column"])
        except CsvMistakesError as error:
            for message in error.messages:
                complaints.add(place, (*path, "file"), message)
            return INVALID
        text = samples_as_text(found.time, found.values)
        if len(text) > LARGEST_TEXT:
            complaints.add(
                place,
                (*path, "file"),
                f"{name}: its {found.time.size} samples take {len(text)} characters in every "
                f"result file, more than {LARGEST_TEXT}; thin them out",
            )
            return INVALID
        given = values.get("sha256")
        if given is not None and given.lower() != found.sha256:
            complaints.add(
                place, (*path, "sha256"), f"{name} has changed: its sha256 is {found.sha256}"
            )
            return INVALID
        return {**values, "sha256": found.sha256, "content": text}

    def is_meant(self, node: MappingNode) -> bool:
        """Whether a mapping has any key of samples."""
        return _KEYS.is_meant(node)

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return _KEYS.schema()


@dataclass(frozen=True, kw_only=True)
class PiecesOrSamples:
    """A mapping with the key ``pieces``, or one with the keys of samples."""

    pieces: Record

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"{self.pieces.expected}; or {Samples().expected}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """What the form that is meant reads."""
        if isinstance(node, MappingNode) and not self.pieces.is_meant(node):
            samples = Samples()
            if samples.is_meant(node):
                return samples.read(node, path, complaints)
        return self.pieces.read(node, path, complaints)

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"anyOf": [self.pieces.schema(), Samples().schema()]}

    def is_meant(self, node: MappingNode) -> bool:
        """Whether a mapping has any key of either form."""
        return self.pieces.is_meant(node) or Samples().is_meant(node)
