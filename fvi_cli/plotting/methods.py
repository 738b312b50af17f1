"""One name, colour, marker and line style for every method."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypedDict

from fvi_cli.integrator.method import BDF_NAMES, AnyMethod, Baseline, Method
from fvi_cli.plotting.style import COLOURS, LINE_STYLES, MARKERS, LineStyle, fraction


@dataclass(frozen=True, kw_only=True)
class SeriesStyle:
    """Name, colour, marker and line style of one method in one figure."""

    label: str
    colour: str
    marker: str
    line_style: LineStyle
    is_filled: bool = True

    def line_properties(self) -> LineProperties:
        """Keyword arguments of a line of this style, its label apart."""
        return {
            "color": self.colour,
            "linestyle": self.line_style,
            "marker": self.marker,
            "markerfacecolor": self.colour if self.is_filled else "white",
            # a white edge keeps filled marks apart that lie upon each other
            "markeredgecolor": "white" if self.is_filled else self.colour,
            "markeredgewidth": 0.5 if self.is_filled else 0.9,
        }


class LineProperties(TypedDict):
    """Properties of a matplotlib line."""

    color: str
    linestyle: LineStyle
    marker: str
    markerfacecolor: str
    markeredgecolor: str
    markeredgewidth: float


def series_styles(methods: Sequence[AnyMethod]) -> dict[str, SeriesStyle]:
    """Style of every method by its case, told apart in colour as well as in grey.

    BDF of order p has the p-th colour and marker in every figure. Methods that share the
    convolution quadrature share its colour and marker; the second is hollow and dashed. If all
    share one, every method has a colour of its own.
    """
    distinct = {method.case: method for method in methods}
    labels = method_labels(list(distinct.values()))
    families: dict[str, list[str]] = {}
    for case, method in distinct.items():
        families.setdefault(_family(method), []).append(case)
    colours = _choose(distinct, COLOURS)
    markers = _choose(distinct, MARKERS)
    if len(families) == 1:
        first = COLOURS.index(next(iter(colours.values())))
        return {
            case: SeriesStyle(
                label=labels[case],
                colour=COLOURS[(first + k) % len(COLOURS)],
                marker=MARKERS[(first + k) % len(MARKERS)],
                line_style=LINE_STYLES[k % len(LINE_STYLES)],
            )
            for k, case in enumerate(distinct)
        }
    spare = [marker for marker in MARKERS if marker not in markers.values()] or list(MARKERS)
    is_shared = len(families) < len(distinct)
    styles: dict[str, SeriesStyle] = {}
    for position, (family, cases) in enumerate(families.items()):
        colour = colours[family]
        # beyond the number of colours the line style has to tell methods apart
        offset = position // len(COLOURS) + (0 if is_shared else COLOURS.index(colour))
        for k, case in enumerate(cases):
            styles[case] = SeriesStyle(
                label=labels[case],
                colour=colour,
                marker=markers[family] if k < 2 else spare[(k // 2 - 1) % len(spare)],
                line_style=LINE_STYLES[(k + offset) % len(LINE_STYLES)],
                is_filled=k % 2 == 0,
            )
    return {case: styles[case] for case in distinct}


def _family(method: AnyMethod) -> str:
    if isinstance(method, Baseline):
        return method.name
    return f"{method.cq}-{method.degree}" if method.is_runge_kutta else method.cq


def _choose(methods: Mapping[str, AnyMethod], values: Sequence[str]) -> dict[str, str]:
    """One value for every family: BDF p takes the p-th, others what is left, then round again."""
    names = dict.fromkeys(_family(method) for method in methods.values())
    chosen = {name: values[int(name[3:]) - 1] for name in names if name in BDF_NAMES}
    for name in names:
        if name not in chosen:
            free = [value for value in values if value not in chosen.values()]
            chosen[name] = free[0] if free else values[len(chosen) % len(values)]
    return chosen


_FAMILY_NAMES = {"gauss": "Gauss", "radau-iia": "Radau IIA", "lobatto-iiic": "Lobatto IIIC"}


def method_labels(methods: Sequence[AnyMethod]) -> dict[str, str]:
    """Shortest label of every method, by case, that tells it from the others.

    Beside other people's methods ours say that they are variational integrators, as in
    ``FVI-BDF1CQ``.
    """
    beside_others = any(isinstance(method, Baseline) for method in methods)
    galerkin = [method for method in methods if isinstance(method, Method)]
    plain = [method for method in galerkin if not method.is_runge_kutta]
    told: list[_Feature] = [
        feature for feature in _ACTION if len({feature(method) for method in plain}) > 1
    ]
    for feature in _REST:
        if len(_names(galerkin, [*told, feature])) > len(_names(galerkin, told)):
            told.append(feature)
    labels = {}
    for method in methods:
        if isinstance(method, Baseline):
            labels[method.case] = method.label
            continue
        base = _base_label(method)
        if beside_others:
            base = f"FVI-{base.replace(' ', '')}CQ"
        labels[method.case] = ", ".join([base, *_told(method, told)])
    doubled = [label for label in labels.values() if list(labels.values()).count(label) > 1]
    return {case: case if label in doubled else label for case, label in labels.items()}


_Feature = Callable[[Method], str]


def _sampling(method: Method) -> str:
    return method.sampling


def _degree(method: Method) -> str:
    return f"$s={method.degree}$"


def _rule(method: Method) -> str:
    return f"{method.rule.points} {method.rule.rule.capitalize()}"


def _start(method: Method) -> str:
    if method.start != "weights":
        return "series start" if method.start == "series" else "plain start"
    if not method.start_exponents:
        return "starting weights"
    powers = ", ".join(f"$t^{{{fraction(e)}}}$" for e in method.start_exponents)
    return f"starting weights for {powers}"


def _forcing(method: Method) -> str:
    return f"{method.forcing_quadrature} forcing"


_ACTION: tuple[_Feature, ...] = (_sampling, _degree)
_REST: tuple[_Feature, ...] = (_rule, _start, _forcing)


def _told(method: Method, features: Sequence[_Feature]) -> list[str]:
    """What a label says of its method; a Runge-Kutta method brings degree and points along."""
    return [
        feature(method)
        for feature in (*_ACTION, *_REST)
        if (feature in features and not (method.is_runge_kutta and feature not in _REST[1:]))
        or (feature is _start and method.start == "weights")
    ]


def _names(methods: Sequence[Method], features: Sequence[_Feature]) -> set[tuple[str, ...]]:
    return {(_base_label(method), *_told(method, features)) for method in methods}


def common_features(methods: Sequence[AnyMethod]) -> str:
    """What all BDF methods of a figure have in common: degree, quadrature points, sampling."""
    plain = [m for m in methods if isinstance(m, Method) and not m.is_runge_kutta]
    if len({(m.degree, m.rule.label, m.sampling) for m in plain}) != 1:
        return ""
    method = plain[0]
    points = "point" if method.rule.points == 1 else "points"
    where = "nodes" if method.sampling == "nodes" else "quadrature points"
    return f"degree $s={method.degree}$, {_rule(method)} {points}, damping sampled at the {where}"


def _base_label(method: Method) -> str:
    if method.is_runge_kutta:
        return f"{_FAMILY_NAMES[method.cq]} {method.stages}"
    return f"BDF{method.bdf_order}"
