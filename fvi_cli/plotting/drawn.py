"""Figures as files: PDF, SVG and PNG, and their data as JSON, to find stale figures."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from fvi_cli.plotting.slopes import GUIDE
from fvi_cli.plotting.style import journal_style, own_style
from fvi_cli.storage.atomic import replace_file
from fvi_cli.studies.order import NEAR_FLOOR

JsonValue = None | bool | int | float | str | Sequence["JsonValue"] | Mapping[str, "JsonValue"]

SIGNIFICANT_DIGITS = 3
MOST_POINTS = 257
"""Longer lines are thinned evenly, first and last point kept."""

_FLOOR = re.compile(r"floor (\S+)")
_SHARE = re.compile(r"(\d+) %")
# below this many times the floor digits differ between machines, and so may the side of the limit
# on which an error lies
_ABOVE_FLOOR = 2 * NEAR_FLOOR


def drawn_data(figure: Figure) -> dict[str, JsonValue]:
    """Titles, axis labels, texts and lines of a figure, numbers rounded to 3 significant digits.

    On a linear axis the digits are counted from the largest number of a line. Reference slopes
    are given by their slope only, since their place is a matter of layout. JSON values: ``texts``,
    ``legend`` and ``panels``, each panel with ``title``, ``remark`` if there is one, ``x``, ``y``
    (label and scale), ``texts`` and ``lines`` (``label``, ``look`` if it is no plain line, and
    ``x``, ``y``, and ``noise`` where rounding decides below a level; or ``slope``).
    """
    panels: list[JsonValue] = [
        _panel(axes) for axes in figure.axes if axes.axison and axes.get_gid() != "decoration"
    ]
    texts: list[JsonValue] = [text.get_text() for text in figure.texts if text.get_text()]
    legends = [*figure.legends, *(a.legend_ for a in figure.axes if a.legend_ is not None)]
    names: list[JsonValue] = [text.get_text() for one in legends for text in one.get_texts()]
    return {"texts": texts, "legend": names, "panels": panels}


def _panel(axes: Axes) -> dict[str, JsonValue]:
    lines: list[JsonValue] = [
        _line(axes, line) for line in axes.lines if line.get_gid() != "decoration"
    ]
    # numbers in it are round-off at times, and those of peaks are drawn
    remark = re.sub(r"\$[^$]*\$", "$", axes.get_title(loc="right"))
    return {
        "title": axes.get_title(),
        **({"remark": remark} if remark else {}),
        "x": {"label": axes.get_xlabel(), "scale": axes.get_xscale()},
        "y": {"label": axes.get_ylabel(), "scale": axes.get_yscale()},
        "texts": [text.get_text() for text in axes.texts],
        "lines": lines,
    }


def _line(axes: Axes, line: Line2D) -> dict[str, JsonValue]:
    label = str(line.get_label()).removeprefix("_")
    x = np.asarray(line.get_xdata(orig=True), dtype=float)
    y = np.asarray(line.get_ydata(orig=True), dtype=float)
    gid = line.get_gid() or ""
    if gid == GUIDE:
        slope = np.diff(np.log(y))[0] / np.diff(np.log(x))[0]
        return {"label": label, "slope": rounded([slope], logarithmic=True)[0]}
    if x.size > MOST_POINTS:
        kept = np.unique(np.linspace(0, x.size - 1, MOST_POINTS).round().astype(int))
        x, y = x[kept], y[kept]
    look = _look(line)
    values: dict[str, JsonValue] = {
        "label": label,
        **({"look": look} if look else {}),
        "x": rounded(x, logarithmic=axes.get_xscale() == "log"),
    }
    if gid == "failure":
        return values
    values["y"] = rounded(y, logarithmic=axes.get_yscale() == "log")
    floor = _FLOOR.fullmatch(gid)
    if floor is not None:
        values["noise"] = float(f"{_ABOVE_FLOOR * float(floor[1]):.2g}")
    return values


def _look(line: Line2D) -> str:
    """Mark and dashes of a line: ``hollow o, dashes 5 1.5``; empty for a plain line."""
    mark, (_, dashes) = str(line.get_marker()), line._unscaled_dash_pattern  # type: ignore[attr-defined]
    style = f"dashes {' '.join(f'{one:g}' for one in dashes)}" if dashes else ""
    if mark in ("", "None"):
        return style
    is_hollow = line.get_markerfacecolor() in ("white", "none")
    style = "no line" if line.get_linestyle() == "None" else style
    return ", ".join(filter(None, (f"{'hollow ' * is_hollow}{mark}", style)))


def rounded(values: ArrayLike, *, logarithmic: bool) -> list[float | None]:
    """Numbers to 3 significant digits (linear: of the largest number); None if not finite."""
    numbers = np.asarray(values, dtype=float)
    largest = float(np.abs(numbers[np.isfinite(numbers)]).max(initial=0.0))

    def one(value: float) -> float | None:
        if not math.isfinite(value):
            return None
        scale = abs(value) if logarithmic else largest
        digits = SIGNIFICANT_DIGITS - 1 - math.floor(math.log10(scale)) if scale else 0
        # adding zero removes the sign of a negative zero
        return round(value, digits) + 0.0

    return [one(value) for value in numbers.tolist()]


def compare_drawn(committed: JsonValue, fresh: JsonValue) -> list[str]:
    """One line for every difference of two results of :func:`drawn_data`.

    ``panels.0.lines.1.y.3: 0.5 is now 0.7``. One unit in the last kept digit is no difference, nor
    is one in a percentage, nor is anything between two values below a line's ``noise``.
    """
    return list(_differences(committed, fresh, "", _LINEAR))


_Scales = Mapping[str, bool]
_LINEAR: _Scales = {"x": False, "y": False}  # whether the axis is logarithmic


def _differences(old: JsonValue, new: JsonValue, place: str, scales: _Scales) -> Iterator[str]:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        found = {axis: old.get(axis) for axis in ("x", "y")}
        scales = {
            axis: value.get("scale") == "log" if isinstance(value, Mapping) else scales[axis]
            for axis, value in found.items()
        }
        level = max(_number(old.get("noise")), _number(new.get("noise")))
        for key in dict.fromkeys((*old, *new)):
            here = f"{place}.{key}" if place else key
            if key not in old or key not in new:
                yield f"{here}: {'no longer there' if key in old else 'not there before'}"
            elif key in scales and isinstance(old[key], list):
                allowed = level if key == "y" else 0.0
                yield from _numbers(old[key], new[key], here, allowed, logarithmic=scales[key])
            elif key != "noise":
                yield from _differences(old[key], new[key], here, scales)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield f"{place}: {len(old)} entries, now {len(new)}"
            return
        for position, pair in enumerate(zip(old, new, strict=True)):
            yield from _differences(*pair, f"{place}.{position}", scales)
    elif isinstance(old, float) and isinstance(new, float):
        yield from _numbers([old], [new], place, 0.0, logarithmic=True)
    elif old != new and not _is_near_share(old, new):
        yield f"{place}: {old!r} is now {new!r}"


def _is_near_share(old: JsonValue, new: JsonValue) -> bool:
    """Whether both are percentages that differ by no more than rounding."""
    found = [_SHARE.fullmatch(str(text)) for text in (old, new)]
    shares = [int(match[1]) for match in found if match is not None]
    return len(shares) == 2 and abs(shares[0] - shares[1]) <= 1


def _number(value: JsonValue) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def _numbers(
    old: JsonValue, new: JsonValue, place: str, noise: float, *, logarithmic: bool
) -> Iterator[str]:
    if not isinstance(old, list) or not isinstance(new, list) or len(old) != len(new):
        yield f"{place}: another number of points"
        return
    largest = max((abs(_number(value)) for value in (*old, *new)), default=0.0)
    for position, (a, b) in enumerate(zip(old, new, strict=True)):
        if a == b:
            continue
        if a is not None and b is not None:
            size = max(abs(_number(a)), abs(_number(b)))
            scale = size if logarithmic else largest
            unit = 10.0 ** (math.floor(math.log10(scale)) - SIGNIFICANT_DIGITS + 1)
            if size <= noise or abs(_number(a) - _number(b)) < 1.5 * unit:
                continue
        yield f"{place}.{position}: {a!r} is now {b!r}"


FORMATS = ("pdf", "png", "svg")
"""Kinds of pictures."""

USUAL_FORMS = ("pdf", "png", "json")
"""Formats in which a figure is written by default."""

_NO_METADATA: Mapping[str, Mapping[str, str | None]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
}
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


def save_figure(
    figure: Figure, directory: Path, name: str, forms: Sequence[str] = USUAL_FORMS
) -> list[Path]:
    """Write pictures and ``<name>.json`` (the drawn data) into `directory`, which is created.

    The files contain no date and no version, so that equal figures give equal bytes. Every file is
    complete or does not appear: all are rendered before the first one is moved to its place.

    Raises
    ------
    ValueError
        For a name with other characters than letters, digits, ``-`` and ``_``, or an unknown form.
    """
    if not _NAME.fullmatch(name):
        raise ValueError(f"name: {name!r} is not allowed; use letters, digits, - and _")
    for form in forms:
        if form not in (*FORMATS, "json"):
            raise ValueError(f"format: {form!r} is not one of {', '.join(FORMATS)}")
    contents = {directory / f"{name}.{form}": _rendered(figure, form) for form in forms}
    directory.mkdir(parents=True, exist_ok=True)
    for path, content in contents.items():
        replace_file(path, content)
    return list(contents)


def drawn_text(figure: Figure) -> str:
    """Return :func:`drawn_data` as the text of the JSON file, one line for every curve's axis."""
    content = dict(drawn_data(figure))
    if style := own_style():
        content["style"] = style
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    return re.sub(r"\[[^][{}\"]*\]", _on_one_line, text) + "\n"


def _on_one_line(numbers: re.Match[str]) -> str:
    return re.sub(r"\s+", " ", numbers[0]).replace("[ ", "[").replace(" ]", "]")


def _rendered(figure: Figure, kind: str) -> bytes:
    if kind == "json":
        return drawn_text(figure).encode()
    buffer = io.BytesIO()
    with journal_style():
        figure.savefig(buffer, format=kind, metadata=dict(_NO_METADATA[kind]))
    return buffer.getvalue()
