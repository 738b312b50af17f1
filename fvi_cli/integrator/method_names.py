"""Names of methods as people read them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeGuard

from fvi_cli.integrator.method import AnyMethod, Baseline, Method, RuleSpecification

_FORCINGS: Mapping[str, str] = {
    "galerkin": "forcing by the rule of the action",
    "exact": "forcing by exact moments",
}


@dataclass(frozen=True, kw_only=True)
class MethodName:
    """Name of a method in two parts."""

    # ``BDF2``, ``Gauss3``, ``Lobatto IIIC 4`` (Runge-Kutta families with their number of stages),
    # ``explicit Euler``
    family: str
    variant: str = ""  # what distinguishes it in its family; empty when there is no other

    @property
    def label(self) -> str:
        """Both parts."""
        return f"{self.family}, {self.variant}" if self.variant else self.family


def method_name(method: AnyMethod) -> str:
    """Its name where it stands by itself: ``BDF2 nodes, degree 1``, ``Gauss3, graded``.

    Two methods with different names in files have different names here.
    """
    if isinstance(method, Baseline):
        return method.label
    is_bdf = _is_bdf(method)
    usual = "exact" if is_bdf and method.sampling == "points" else "galerkin"
    words = [
        f"{method.label} {method.sampling}" if is_bdf else method.label,
        _degree(method),
        _rule(method) if method.rule != RuleSpecification(points=method.degree) else "",
        _start(method) if method.start != "none" else "",
        _forcing(method) if method.forcing_quadrature != usual else "",
    ]
    return ", ".join(filter(None, words))


def method_names(methods: Sequence[AnyMethod]) -> dict[str, MethodName]:
    """The shortest name of every method, by case, that no other in `methods` has."""
    distinct = {method.case: method for method in methods}
    features = [feature for feature in _FEATURES if _is_needed(feature, list(distinct.values()))]
    plain = [method for method in distinct.values() if _is_bdf(method)]
    is_mixed = len({method.sampling for method in plain}) > 1
    names = {}
    for case, method in distinct.items():
        family = method.label
        # samples at nodes are the paper's, and need no word where there are no others
        if _is_bdf(method) and (is_mixed or method.sampling == "points"):
            family = f"{family} {method.sampling}"
        variant = ", ".join(filter(None, (feature(method) for feature in features)))
        names[case] = MethodName(family=family, variant=variant)
    labels = [name.label for name in names.values()]
    return {
        case: MethodName(family=method_name(distinct[case]))
        if labels.count(name.label) > 1
        else name
        for case, name in names.items()
    }


def describe_method(method: AnyMethod) -> list[str]:
    """Phrases that describe a method."""
    if isinstance(method, Baseline):
        return ["for comparison"]
    words = [f"degree {method.degree}"]
    if method.is_runge_kutta:
        words.append(f"{method.stages} stages" if method.stages > 1 else "1 stage")
    else:
        points = "point" if method.rule.points == 1 else "points"
        words.append(f"{method.rule.points} {method.rule.rule.capitalize()} {points}")
        where = "nodes" if method.sampling == "nodes" else "quadrature points"
        words.append(f"damping sampled at the {where}")
    starts = {
        "none": "no start correction",
        "graded": "short steps behind singular points",
    }
    words.append(starts.get(method.start) or f"starting {_start(method)}")
    words.append(_FORCINGS[method.forcing_quadrature])
    return words


def _is_bdf(method: AnyMethod) -> TypeGuard[Method]:
    return isinstance(method, Method) and not method.is_runge_kutta


_Feature = Callable[[AnyMethod], str]


def _degree(method: AnyMethod) -> str:
    return f"degree {method.degree}" if _is_bdf(method) else ""


def _rule(method: AnyMethod) -> str:
    return f"{method.rule.points} {method.rule.rule.capitalize()}" if _is_bdf(method) else ""


def _start(method: AnyMethod) -> str:
    if not isinstance(method, Method):
        return ""
    if method.start != "weights":
        return "plain" if method.start == "none" else method.start
    powers = ", ".join(f"t^{exponent:g}" for exponent in method.start_exponents)
    return f"weights {powers}"


def _forcing(method: AnyMethod) -> str:
    return f"{method.forcing_quadrature} forcing" if isinstance(method, Method) else ""


_FEATURES: tuple[_Feature, ...] = (_degree, _rule, _start, _forcing)


def _is_needed(feature: _Feature, methods: Sequence[AnyMethod]) -> bool:
    """Whether two methods of one family differ in `feature`, and in no earlier one alone."""
    seen: dict[tuple[str, ...], str] = {}
    for method in methods:
        key: tuple[str, ...] = (method.label,)
        if isinstance(method, Method):
            key += (method.sampling,)
        if feature is _rule:
            # the rule follows from the degree unless it is given: compare at equal degrees only
            key += (_degree(method),)
        if seen.setdefault(key, feature(method)) != feature(method):
            return True
    return False
