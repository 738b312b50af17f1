"""YAML text to a tree of nodes that know their places.

Words and numbers are read by the core schema of YAML 1.2: ``1e-3`` is a number, ``no`` and ``on``
are text, ``0o17`` is 15 and ``017`` is 17. The tree is built from the parser's events with limits
on its size, because the text may be hostile.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from typing import Any, NoReturn

import yaml

from fvi_cli.keys.complaints import Complaints, KeyPath, SourcePosition, excerpt
from fvi_cli.keys.nodes import ListNode, MappingNode, Node, NodeEntry, ScalarNode, read_scalar

LARGEST_DOCUMENT = 1_000_000
DEEPEST_NESTING = 50
MOST_NODES = 50_000


def read_document(
    text: str,
    origin: SourcePosition,
    complaints: Complaints,
    path: KeyPath = (),
    *,
    is_json: bool = False,
) -> Node | None:
    """The tree of the single document in `text`; None, with a complaint, when there is none.

    The text begins at `origin`, line 1 and column 1 of a file. If `origin` has no line, all nodes
    get `origin` as their place. Complaints concern syntax, tags, repeated keys, several documents,
    and texts that are too large, too deeply nested or become too large by their anchors.
    """
    try:
        return _Reader(text, origin, complaints, path, is_json=is_json).document()
    except _GivenUpError:
        return None


class _GivenUpError(Exception):
    """Reading cannot go on; the complaint has been added."""


class _Reader:
    """Reads a document; `prefix` is its key path in a configuration."""

    def __init__(
        self,
        text: str,
        origin: SourcePosition,
        complaints: Complaints,
        prefix: KeyPath,
        *,
        is_json: bool,
    ) -> None:
        self.text, self.origin, self.is_json = text, origin, is_json
        self.complaints, self.prefix = complaints, prefix
        self.events = self.parsed()
        # by anchor the node and its size in nodes; None: the end of the node has not been read
        self.anchors: dict[str, tuple[Node, int] | None] = {}
        self.size = 0

    def document(self) -> Node:
        if len(self.text) > LARGEST_DOCUMENT:
            message = f"the text has more than {LARGEST_DOCUMENT} characters: too large"
            self.give_up(self.origin, message)
        root: Node | None = None
        for event in self.events:
            if isinstance(event, yaml.DocumentStartEvent):
                place = self.place(event.start_mark)
                if root is not None:
                    self.give_up(place, "a second document begins here; one file holds one")
                self.check_directives(event, place)
                root = self.node(next(self.events), self.prefix, 0)
        if root is None or (isinstance(root, ScalarNode) and not root.text):
            self.give_up(self.origin, "the text is empty")
        return root

    def parsed(self) -> Iterator[Any]:
        if self.is_json:
            # the parser in C is fast, but its error messages are different
            events = yaml.parse(self.text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
            with contextlib.suppress(yaml.YAMLError):
                # a node has at most two events
                yield from list(itertools.islice(events, 3 * MOST_NODES))
                return
        loader: yaml.SafeLoader | None = None
        try:
            loader = yaml.SafeLoader(self.text)
            while loader.check_event():
                yield loader.get_event()  # type: ignore[no-untyped-call]
        except yaml.reader.ReaderError as error:
            before = self.text[: error.position]
            place = self.at(before.count("\n"), error.position - (before.rfind("\n") + 1))
            self.give_up(place, "a character that is not allowed in YAML")
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
            message = f"%YAML {version} is not allowed; it must be 1.2, or left out"
            self.complaints.add(place, self.prefix, message)
        if event.tags:
            message = "%TAG is not allowed; tags are not understood"
            self.complaints.add(place, self.prefix, message)

    def node(self, event: Any, path: KeyPath, depth: int) -> Node:
        """The node that begins with an event, at a path, at a depth of nesting."""
        place = self.place(event.start_mark)
        if isinstance(event, yaml.AliasEvent):
            return self.alias(str(event.anchor), place)
        if event.tag is not None:
            message = f"the tag {excerpt(event.tag)!r} is not allowed; write the plain value"
            self.complaints.add(place, path, message)
        before = self.size
        node: Node
        if isinstance(event, yaml.ScalarEvent):
            node = self.scalar(event, place, path)
        elif depth >= DEEPEST_NESTING:
            self.give_up(place, f"nested more than {DEEPEST_NESTING} deep")
        else:
            if event.anchor is not None:
                self.anchors[event.anchor] = None
            is_mapping = isinstance(event, yaml.MappingStartEvent)
            inside = self.rest_of_mapping if is_mapping else self.rest_of_list
            node = inside(place, path, depth + 1)
        self.count(node, 1)
        if event.anchor is not None:
            self.anchors[event.anchor] = node, self.size - before
        return node

    def count(self, node: Node, size: int) -> None:
        self.size += size
        if self.size > MOST_NODES:
            self.give_up(node.place, f"more than {MOST_NODES} entries, counting repeated anchors")

    def alias(self, name: str, place: SourcePosition) -> Node:
        known = self.anchors.get(name)
        if known is None:
            is_open = name in self.anchors
            reason = "it stands inside of what it names" if is_open else "no such anchor before it"
            self.give_up(place, f"*{excerpt(name)}: {reason}")
        self.count(*known)
        return known[0]

    def rest_of_list(self, place: SourcePosition, path: KeyPath, depth: int) -> ListNode:
        items: list[Node] = []
        while not isinstance(event := next(self.events), yaml.CollectionEndEvent):
            items.append(self.node(event, (*path, len(items)), depth))
        return ListNode(place=place, items=tuple(items))

    def rest_of_mapping(self, place: SourcePosition, path: KeyPath, depth: int) -> MappingNode:
        entries: dict[str, NodeEntry] = {}
        while not isinstance(event := next(self.events), yaml.CollectionEndEvent):
            is_word = isinstance(event, yaml.ScalarEvent)
            key = self.node(event, path if is_word else (*path, "?"), depth)
            word = key.text if isinstance(key, ScalarNode) else ""
            if not isinstance(key, ScalarNode):
                message = "a list or mapping is not allowed as a key; use a word"
                self.complaints.add(key.place, path, message)
            elif not word:
                self.complaints.add(key.place, path, "a key is missing before ':'")
            node = self.node(next(self.events), (*path, word), depth)
            if word == "<<":
                message = "merging with << is not part of YAML 1.2; repeat the keys"
                self.complaints.add(key.place, path, message)
            elif word in entries:
                line = entries[word].key_place.line
                message = f"given twice, first in line {line}" if line else "given twice"
                self.complaints.add(key.place, (*path, word), message)
            elif word:
                entries[word] = NodeEntry(key_place=key.place, node=node)
        return MappingNode(place=place, entries=entries)

    def scalar(self, event: Any, place: SourcePosition, path: KeyPath) -> ScalarNode:
        written, mark = event.value, event.start_mark
        quoted = event.style in ("'", '"')
        start = mark.index + (1 if quoted else 0)
        literally = event.style not in ("|", ">") and self.text.startswith(written, start)
        if any(0xD800 <= ord(character) <= 0xDFFF for character in written):
            self.complaints.add(place, path, "half of a character pair is not text")
            written = ""
        return ScalarNode(
            place=place,
            value=written if event.style else read_scalar(written),
            text=written,
            text_place=place.shifted(1 if quoted else 0) if literally else None,
        )

    def give_up(self, place: SourcePosition, message: str) -> NoReturn:
        self.complaints.add(place, self.prefix, message)
        raise _GivenUpError

    def place(self, mark: Any) -> SourcePosition:
        return self.at(mark.line, mark.column)

    def at(self, line: int, column: int) -> SourcePosition:
        if not self.origin.line:
            return self.origin
        return SourcePosition(source=self.origin.source, line=line + 1, column=column + 1)


def _advice(problem: str) -> str:
    if "'\\t'" in problem:
        return "; indent with blanks, not with tabs"
    if "mapping values are not allowed" in problem:
        return "; is the indentation right, or does a text with ':' need quotes?"
    if "expected <block end>" in problem:
        return "; begin it in the column of those before it, or is the key above it missing?"
    if "but got '<stream end>'" in problem:
        return "; a bracket is not closed"
    if "could not find expected ':'" in problem:
        return "; write a blank behind the colon, as in `mass: 1.0`"
    return ""
