"""The keys as a JSON schema for editors, as a reference page, and as commented starter files."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from fvi_cli.config.keys.experiment import EXPERIMENT, SEVERAL, SINGLE
from fvi_cli.config.keys.ladder import ACCURACY_EXAMPLE
from fvi_cli.config.load import parse_config
from fvi_cli.errors import RequestError
from fvi_cli.integrator.observe.request import names_of
from fvi_cli.keys.complaints import listed, suggestion
from fvi_cli.keys.cursor import Missing
from fvi_cli.keys.scalars import Schema
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.material import Material
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import KINDS

_HEADER: Final = ("key", "may be", "default", "meaning")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One key: its path, allowed values, default and meaning, as Markdown.

    `is_word`: the allowed values are words, which other forms of the mapping may extend; `of`: the
    word of the form to which the key belongs.
    """

    key: str
    allowed: str
    default: str
    meaning: str
    is_word: bool = False
    of: str = ""


def configuration_reference() -> str:
    """Every key of a configuration as a Markdown page.

    It has the contents of :func:`fvi_cli.config.json_schema`, for people. Keys that several kinds
    of problem share with the same meaning and default are in one table, the others in the table of
    their kind.
    """
    schema = json_schema()
    top = _inlined(schema["else"], schema["$defs"])
    properties = top["properties"]
    lines = [
        "# Configuration, key by key",
        "",
        "Made by `python docs/site/reference.py` from what checks configurations; for editors",
        "there is the same as [JSON schema](../how-to/editors.md). `a.b` is the key `b` of the",
        "mapping under `a`, `a[].b` that of every entry of the list under `a`. A key that is",
        "required is so wherever the mapping that it belongs to is given in that form.",
        "",
        "## An experiment",
        "",
        "A file is one experiment, or has a `name` and a list `experiments` of them.",
        "",
    ]
    rows: list[Row] = []
    for name, described in properties.items():
        rows += _rows(
            name,
            described,
            is_required=name in top["required"],
            nested=name not in _OWN_SECTIONS,
        )
    lines += _table(rows)
    lines += [
        "",
        "## method",
        "",
        "One mapping or a list of them; lists in a mapping are combined.",
    ]
    lines += ["", *_table(_members(properties["method"], ""))]
    lines += ["", "## problem", ""]
    lines += _problems(properties["problem"]["oneOf"])
    return "\n".join(lines) + "\n"


def _inlined(schema: Any, definitions: Schema) -> Any:
    """A schema with the definitions in place of references to them."""
    if isinstance(schema, list):
        return [_inlined(one, definitions) for one in schema]
    if not isinstance(schema, dict):
        return schema
    name = schema.get("$ref", "").removeprefix("#/$defs/")
    target = _inlined(definitions[name], definitions) if name else {}
    return {**target, **{k: _inlined(v, definitions) for k, v in schema.items() if k != "$ref"}}


REQUIRED: Final = "required"
_OWN_SECTIONS: Final = ("problem", "method")
"""Keys with a section of their own."""


def _problems(variants: Sequence[Schema]) -> Iterator[str]:
    """The kinds of problems: their common keys, then each kind."""
    kinds = {variant["properties"]["kind"]["const"]: variant for variant in variants}
    users: dict[tuple[Row, ...], list[str]] = {}
    for kind, variant in kinds.items():
        needed = variant["required"]
        for name, described in variant["properties"].items():
            if name != "kind":
                rows = tuple(_rows(name, described, is_required=name in needed))
                users.setdefault(rows, []).append(kind)
    shared = {rows: names for rows, names in users.items() if len(names) > 1}
    yield "`kind` names the equation; the kinds are below. Keys that several kinds share:"
    yield ""
    shown: list[Row] = []
    for rows, names in shared.items():
        first = rows[0]
        has_others = sum(other[0].key == first.key for other in users) > 1
        of = f" Here for {', '.join(names)}." if has_others else ""
        shown += [replace(first, meaning=first.meaning + of), *rows[1:]]
    yield from _table(shown)
    for kind in kinds:
        yield ""
        yield f"### {kind}"
        yield ""
        yield f"    {KINDS[kind].equation}"
        yield ""
        own = [row for rows, names in users.items() if names == [kind] for row in rows]
        common = [rows[0].key for rows, names in shared.items() if kind in names]
        if own:
            yield from _table(own)
            yield ""
        yield f"Shared keys: {', '.join(common)}."


def _rows(
    name: str, schema: Schema, *, is_required: bool = False, nested: bool = True
) -> Iterator[Row]:
    """The key itself, then the keys below it."""
    default = REQUIRED if is_required else ""
    if "default" in schema:
        text = yaml_line(schema["default"])
        default = f"`{text}`" if text else ""
    yield Row(
        key=f"`{name}`",
        allowed=_allowed(schema),
        default=default or "-",
        meaning=_cell(schema.get("description", "")),
        is_word=bool(schema.keys() & {"const", "enum"}),
    )
    if nested:
        yield from _members(schema, name)


def _members(schema: Schema, path: str) -> Iterator[Row]:
    """Keys of the mappings that `schema` allows; each path occurs once."""
    seen: dict[str, Row] = {}
    forms: dict[str, list[str]] = {}
    for row in _inner(schema, path):
        name = row.key.replace("[]", "")
        known = seen.setdefault(name, row)
        if row.allowed != known.allowed and row.is_word:
            words = dict.fromkeys(f"{known.allowed}, {row.allowed}".split(", "))
            seen[name] = replace(known, allowed=", ".join(words))
        if row.default == REQUIRED and row.of:
            forms.setdefault(name, []).append(row.of)
    for name, row in seen.items():
        if needed := ", ".join(dict.fromkeys(forms.get(name, ()))):
            others = f"{row.default}; " if row.default not in (REQUIRED, "-") else ""
            row = replace(row, default=f"{others}{REQUIRED} by {needed}")
        yield row


def _inner(schema: Schema, path: str, of: str = "") -> Iterator[Row]:
    variants: Sequence[Schema] = schema.get("anyOf") or schema.get("oneOf") or ()
    # a mapping before a list of such mappings
    for variant in sorted(variants, key=lambda variant: "items" in variant):
        # forms under oneOf differ by the word that their first key has
        first: Schema = next(iter(variant.get("properties", {}).values()), {})
        words = first.get("enum", [first.get("const", "")]) if "oneOf" in schema else [""]
        yield from _inner(variant, path, of=str(words[0]))
    if "items" in schema:
        yield from _inner(schema["items"], f"{path}[]" if path else "")
    under = schema.get("additionalProperties")
    if isinstance(under, dict):
        # names are the user's choice
        yield from _inner(under, f"{path}.NAME")
    for name, described in schema.get("properties", {}).items():
        needed = name in schema.get("required", ())
        own, *inner = _rows(f"{path}.{name}" if path else name, described, is_required=needed)
        yield replace(own, of=of)
        yield from inner


def _allowed(schema: Schema) -> str:
    """The allowed values, in words."""
    if "title" in schema:
        return str(schema["title"])
    variants = schema.get("anyOf", schema.get("oneOf"))
    if variants is not None:
        words = list(dict.fromkeys(_allowed(variant) for variant in variants))
        if len(words) == 2 and words[1] == _list_of(words[0]):
            return f"{words[0]}; or a list"
        return " or ".join(words)
    if "enum" in schema:
        return ", ".join(f"`{word}`" for word in schema["enum"])
    if "const" in schema:
        return f"`{schema['const']}`"
    kind = schema.get("type")
    if kind == "array":
        return _list_of(_allowed(schema["items"])) if "items" in schema else "list"
    if kind == "object":
        under = schema.get("additionalProperties")
        return f"mapping to {_allowed(under)}" if isinstance(under, dict) else "mapping"
    if kind in ("number", "integer"):
        return f"{kind}{_range(schema)}"
    if kind == "boolean":
        return "`true`, `false`"
    return "text" if kind == "string" else "number or text"


def _list_of(words: str) -> str:
    """Words for a list whose entries are described by `words`."""
    if words == "list of number":
        return "list of rows of numbers"
    return f"list of ({words})" if " or " in words or ", " in words else f"list of {words}"


def _range(schema: Schema) -> str:
    """Limits of a number in words; round limits as powers of ten."""
    if "minimum" in schema and "maximum" in schema:
        return f", {_number(schema['minimum'])} to {_number(schema['maximum'])}"
    words = {
        "exclusiveMinimum": "above",
        "minimum": "at least",
        "exclusiveMaximum": "below",
        "maximum": "at most",
    }
    found = [f"{word} {_number(schema[key])}" for key, word in words.items() if key in schema]
    return f" {' and '.join(found)}" if found else ""


def _number(value: float) -> str:
    exponent = int(value).bit_length() - 1
    if value == 2**exponent and exponent > 16:
        return f"2^{exponent}"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _cell(text: Any) -> str:
    return str(text).replace("|", "\\|").replace("*", "\\*").replace("<", "&lt;")


def _table(rows: Iterator[Row] | Sequence[Row]) -> Iterator[str]:
    yield f"| {' | '.join(_HEADER)} |"
    yield f"|{'---|' * len(_HEADER)}"
    for row in rows:
        yield f"| {row.key} | {row.allowed} | {row.default} | {row.meaning} |"


SCHEMA_TITLE: Final = "Configuration of fvi"


def json_schema() -> Schema:
    """JSON schema (draft 2020-12) of a configuration, for editors.

    Every key has a description, which names its unit, and its default. Only
    :func:`fvi_cli.config.parse_config` checks combinations of keys.
    """
    defs: Schema = {}
    single, several = SINGLE.whole(defs), SEVERAL.whole(defs)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": SCHEMA_TITLE,
        "if": {"required": ["experiments"]},
        "then": several,
        "else": single,
        "$defs": defs,
    }


def schema_text() -> str:
    """The JSON schema as the text of a file."""
    return json.dumps(json_schema(), indent=2) + "\n"


WIDTH: Final = 98
SCHEMA_FILE: Final = "fvi.schema.json"
"""Name of the schema file, beside a starter file."""
MODELINE: Final = f"# yaml-language-server: $schema={SCHEMA_FILE}"
"""The line at the top of a configuration by which editors find the schema."""
OF_MATERIAL: Final = {
    "ladder": "ladder: {steps: [500]}",
    "figures": "figures: [hysteresis]",
    "output": "# output: {step: 0.01}",
    "quantities": "# quantities: {force: force_1, deformation: deformation_1}",
    "fit": "# fit:\n"
    "#   data: {file: measured.csv, time: t, columns: {force: force}}\n"
    "#   parameters: {problem.law.order: {}}",
}
"""Lines of a starter file for a damper on the bench, whose motion is given."""


def starter_config(kind: str, *, name: str | None = None) -> str:
    """A commented, valid configuration of a kind of problem, to begin with.

    The default name is ``my-<kind>``.
    """
    if kind not in KINDS:
        raise RequestError(
            f"{kind!r}: unknown kind of problem{suggestion(kind, KINDS)} (known: {listed(KINDS)})"
        )
    described = KINDS[kind]
    lines = [
        *_comment(described.equation, ""),
        f"name: {name or f'my-{kind}'}",
        "",
        "problem:",
        f"  kind: {kind}",
    ]
    for key in described.keys.values():
        default = "{}" if isinstance(key.default, Missing) else yaml_line(key.default)
        value = described.example.get(key.name) or default
        lines += _comment(key.description, "  ")
        other = described.alternatives.get(key.name)
        lines.append(
            f"  # {key.name}: {value}   # or {other}" if other else f"  {key.name}: {value}"
        )
    shown = {
        "method": f"method: {described.methods}",
        "ladder": "ladder: {steps: [16, 32, 64, 128, 256]}",
        "sweep": f"# sweep: {{{described.sweep}}}",
        "figures": "figures: [convergence]",
    }
    if issubclass(described, SceneKind):
        core = "\n".join([*lines, shown["ladder"]])
        problem = parse_config(core, "starter").experiments[0].problem
        shown |= _switched_off(described, problem) if isinstance(problem, Problem) else {}
    elif described is Material:
        shown |= OF_MATERIAL
    for key in EXPERIMENT.keys.values():
        if key.name in shown:
            lines += ["", *_comment(key.description, ""), shown[key.name]]
    return "\n".join(lines) + "\n"


def _switched_off(kind: type[SceneKind], problem: Problem) -> dict[str, str]:
    """Lines for optional or alternative keys, which a starter file has as comments."""
    name = (problem.coordinates or names_of(problem.scene))[0]
    fitted = kind.sweep.partition(":")[0]
    # of numbered quantities the first
    names = [one for one in problem.ready if not one[-1].isdecimal() or one.endswith("_1")]
    ready = f"[{', '.join(names)}]" if names else ""
    return {
        "accuracy": f"# {ACCURACY_EXAMPLE}",
        "output": "# output: {step: 0.01}",
        "quantities": f"# quantities: {ready or f'{{speed: v{name}, acceleration: a{name}}}'}",
        "events": f"# events: {{turn: {{when: v{name}, direction: falling}}}}",
        "fit": "# fit:\n"
        f"#   data: {{file: measured.csv, time: t, columns: {{{name}: displacement}}}}\n"
        f"#   parameters: {{{fitted}: {{}}}}",
    }


def _comment(text: str, indent: str) -> list[str]:
    prefix = f"{indent}# "
    return textwrap.wrap(text, WIDTH, initial_indent=prefix, subsequent_indent=prefix)


def yaml_line(value: Any) -> str:
    """A default in one line of YAML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {yaml_line(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(yaml_line(entry) for entry in value) + "]"
    return str(value).lower() if isinstance(value, bool) else str(value)
