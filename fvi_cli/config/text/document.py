"""YAML text to a tree of nodes that know their places.

Words and numbers are read by the core schema of YAML 1.2: ``1e-3`` is a number, ``no`` and ``on``
are text, ``0o17`` is 15 and ``017`` is 17. The tree is built from the parser's events without
recursion, and with limits, because the text may come from strangers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import yaml

from fvi_cli.keys.complaints import Complaints, KeyPath, SourcePosition, excerpt
from fvi_cli.keys.nodes import ListNode, MappingNode, Node, NodeEntry, ScalarNode, read_scalar

LARGEST_DOCUMENT = 1_000_000
DEEPEST_NESTING = 50
MOST_NODES = 50_000


def read_document(
    text: str, origin: SourcePosition, complaints: Complaints, path: KeyPath = ()
) -> Node | None:
    """The tree of the single document in `text`; None, with a complaint, when there is none.

    The text begins at `origin`, line 1 and column 1 of a file; a place without a line is the place
    of everything in it. Complaints are of syntax, tags, repeated keys, several documents, and texts
    that are too large, too deep or grow too large by their anchors.
    """
    builder = _Builder(text=text, origin=origin, complaints=complaints, prefix=path)
    if len(text) > LARGEST_DOCUMENT:
        complaints.add(
            origin, path, f"the text has more than {LARGEST_DOCUMENT} characters: too large"
        )
        return None
    try:
        return builder.build()
    except _GivenUpError:
        return None


class _GivenUpError(Exception):
    """Reading cannot go on; the complaint is noted."""


@dataclass(kw_only=True, eq=False)
class _Open:
    """A list or mapping whose end has not been read; `key` waits for its value."""

    place: SourcePosition
    anchor: str | None
    is_mapping: bool
    items: list[Node] = field(default_factory=list)
    entries: dict[str, NodeEntry] = field(default_factory=dict)
    key: ScalarNode | None = None
    size: int = 1


@dataclass(kw_only=True, eq=False)
class _Builder:
    text: str
    origin: SourcePosition
    complaints: Complaints
    prefix: KeyPath
    stack: list[_Open] = field(default_factory=list)
    anchors: dict[str, tuple[Node, int]] = field(default_factory=dict)
    root: Node | None = None
    size: int = 0

    def build(self) -> Node | None:
        documents = 0
        for event in self.events():
            place = self.place(event.start_mark)
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    self.give_up(place, "a second document begins here; one file holds one")
                self.check_directives(event, place)
            elif isinstance(event, yaml.AliasEvent):
                self.alias(event, place)
            elif isinstance(event, yaml.NodeEvent):
                self.check_tag(event, place)
                if isinstance(event, yaml.ScalarEvent):
                    self.attach(self.scalar(event, place), event.anchor, 1)
                else:
                    self.open(event, place)
            elif isinstance(event, yaml.CollectionEndEvent):
                self.close()
        if self.root is None or (isinstance(self.root, ScalarNode) and not self.root.text):
            self.give_up(self.origin, "the text is empty")
        return self.root

    def events(self) -> Iterator[yaml.Event]:
        loader: yaml.SafeLoader | None = None
        try:
            loader = yaml.SafeLoader(self.text)
            while loader.check_event():
                yield loader.get_event()  # type: ignore[no-untyped-call]
        except yaml.reader.ReaderError as error:
            self.give_up(self.place_of(error.position), "a character that is not allowed in YAML")
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            context = f" {error.context}" if error.context else ""
            self.give_up(
                self.place(mark) if mark else self.origin,
                f"not YAML{context}: {excerpt(error.problem or 'unknown reason', 200)}"
                + _advice(error.problem or ""),
            )
        except (ValueError, OverflowError, IndexError, yaml.YAMLError):
            # the parser has no message of its own for escapes such as "\UFFFFFFFF"
            mark = loader.get_mark() if loader is not None else None
            self.give_up(self.place(mark) if mark else self.origin, "not YAML: a wrong escape")
        finally:
            if loader is not None:
                loader.dispose()

    def check_directives(self, event: yaml.DocumentStartEvent, place: SourcePosition) -> None:
        if event.version not in (None, (1, 2)):
            version = ".".join(str(part) for part in event.version)
            self.complain(place, f"%YAML {version} is not allowed; it must be 1.2, or left out")
        if event.tags:
            self.complain(place, "%TAG is not allowed; tags are not understood")

    def check_tag(self, event: yaml.NodeEvent, place: SourcePosition) -> None:
        tag = getattr(event, "tag", None)
        if tag is not None:
            self.complain(place, f"the tag {excerpt(tag)!r} is not allowed; write the plain value")

    def alias(self, event: yaml.AliasEvent, place: SourcePosition) -> None:
        name = str(event.anchor)
        if name not in self.anchors:
            inside = any(frame.anchor == name for frame in self.stack)
            reason = "it stands inside of what it names" if inside else "no such anchor before it"
            self.give_up(place, f"*{excerpt(name)}: {reason}")
        node, size = self.anchors[name]
        self.attach(node, None, size)

    def open(self, event: yaml.NodeEvent, place: SourcePosition) -> None:
        if len(self.stack) >= DEEPEST_NESTING:
            self.give_up(place, f"nested more than {DEEPEST_NESTING} deep")
        is_mapping = isinstance(event, yaml.MappingStartEvent)
        self.stack.append(_Open(place=place, anchor=event.anchor, is_mapping=is_mapping))

    def close(self) -> None:
        frame = self.stack.pop()
        node: Node = (
            MappingNode(place=frame.place, entries=frame.entries)
            if frame.is_mapping
            else ListNode(place=frame.place, items=tuple(frame.items))
        )
        self.attach(node, frame.anchor, frame.size)

    def scalar(self, event: yaml.ScalarEvent, place: SourcePosition) -> ScalarNode:
        written = event.value
        quoted = event.style in ("'", '"')
        mark: Any = event.start_mark
        start = mark.index + (1 if quoted else 0)
        literally = event.style not in ("|", ">") and self.text.startswith(written, start)
        if any(0xD800 <= ord(character) <= 0xDFFF for character in written):
            self.complain(place, "half of a character pair is not text")
            written = ""
        plain = event.style is None or event.style == ""
        return ScalarNode(
            place=place,
            value=read_scalar(written) if plain else written,
            text=written,
            text_place=place.shifted(1 if quoted else 0) if literally else None,
        )

    def attach(self, node: Node, anchor: str | None, size: int) -> None:
        """Give a finished node to whatever is open."""
        self.size += size
        if self.size > MOST_NODES:
            self.give_up(node.place, f"more than {MOST_NODES} entries, counting repeated anchors")
        if anchor is not None:
            self.anchors[anchor] = (node, size)
        if not self.stack:
            self.root = node
            return
        frame = self.stack[-1]
        frame.size += size
        if not frame.is_mapping:
            frame.items.append(node)
        elif frame.key is None:
            frame.key = self.key(node)
        else:
            key, frame.key = frame.key, None
            self.enter(frame, key, node)

    def key(self, node: Node) -> ScalarNode:
        if not isinstance(node, ScalarNode):
            self.complain(node.place, "a list or mapping is not allowed as a key; use a word")
            return ScalarNode(place=node.place, value=None, text="")
        if not node.text:
            self.complain(node.place, "a key is missing before ':'")
        return node

    def enter(self, frame: _Open, key: ScalarNode, node: Node) -> None:
        if not key.text:
            return
        if key.text == "<<" and key.value == "<<":
            self.complain(key.place, "merging with << is not part of YAML 1.2; repeat the keys")
        elif key.text in frame.entries:
            first = frame.entries[key.text].key_place
            self.complaints.add(
                key.place,
                (*self.path(), key.text),
                f"given twice, first in line {first.line}" if first.line else "given twice",
            )
        else:
            frame.entries[key.text] = NodeEntry(key_place=key.place, node=node)

    def path(self) -> KeyPath:
        """Keys that lead to the innermost open list or mapping."""
        outer = list(self.prefix)
        for frame in self.stack[:-1]:
            if frame.is_mapping:
                outer.append(frame.key.text if frame.key is not None else "?")
            else:
                outer.append(len(frame.items))
        return tuple(outer)

    def complain(self, place: SourcePosition, message: str) -> None:
        inner: KeyPath = ()
        if self.stack:
            frame = self.stack[-1]
            if not frame.is_mapping:
                inner = (len(frame.items),)
            elif frame.key is not None:
                inner = (frame.key.text,)
        self.complaints.add(place, (*self.path(), *inner), message)

    def give_up(self, place: SourcePosition, message: str) -> None:
        self.complaints.add(place, self.prefix, message)
        raise _GivenUpError

    def place(self, mark: Any) -> SourcePosition:
        return self.at(mark.line, mark.column)

    def place_of(self, index: int) -> SourcePosition:
        before = self.text[:index]
        line_start = before.rfind("\n") + 1
        return self.at(before.count("\n"), index - line_start)

    def at(self, line: int, column: int) -> SourcePosition:
        if not self.origin.line:
            return self.origin
        return SourcePosition(source=self.origin.source, line=line + 1, column=column + 1)


def _advice(problem: str) -> str:
    if "'\\t'" in problem:
        return "; indent with blanks, not with tabs"
    if "mapping values are not allowed" in problem:
        return "; is the indentation right, or does a text with ':' need quotes?"
    return ""
