r"""Outputs of steady responses: linear expressions in the variables of a motion, at a frequency.

With :math:`q = \hat q e^{st}` a velocity is :math:`s \hat q`, an acceleration
:math:`s^2 \hat q`, and the force of a damper its complex modulus times its deformation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from fvi_cli.effects.directions import linear_form
from fvi_cli.effects.matrices import times
from fvi_cli.integrator.observe.dampers import damper_values, dampers_of, deformation_rows
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.mathematics.algebra.builder import bound
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.problem import Problem

QUALITIES: Final = {"": "displacement", "v": "velocity", "a": "acceleration"}
"""Quality of an output that is a sum of coordinates, by the prefix of their names."""
Term = tuple[Callable[[complex], complex], Array]
"""A function of s and the linear form of the amplitudes that it multiplies, shape ``(d,)``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicOutputs:
    """Linear forms of the amplitudes of coordinates; the forms depend on the frequency."""

    qualities: tuple[str, ...]  # of each output: displacement, velocity, acceleration, or empty
    terms: tuple[Sequence[Term], ...]  # those of every output
    ground: Array  # factor of the acceleration of the ground, shape ``(k,)``

    def rows(self, s: complex) -> ComplexArray:
        """The forms at s, shape ``(k, d)``."""
        found = [sum(symbol(s) * row for symbol, row in terms) for terms in self.terms]
        return np.array(found, dtype=complex)


def harmonic_outputs(
    texts: Sequence[str],
    names: tuple[str, ...],
    problem: Problem,
    quantities: Mapping[str, Expression],
) -> HarmonicOutputs:
    """Linear forms of expressions in coordinates `names` and `quantities`, at a frequency.

    Raises
    ------
    ValueError
        For expressions that are not linear in the motion, hold the time, or have a constant.
    """
    size = problem.scene.dimension
    qualities, every, ground = [], [], np.zeros(len(texts))
    for number, text in enumerate(texts):
        formula = quantities.get(text) or Expression.parse(text, variables=names)
        system = bound(formula.expand(problem.ready).system, problem.numbers)
        constant, *factors = linear_form(system, system.names)
        if constant or not any(factors):
            raise ValueError(f"{text!r}: it holds {constant:g}, which does not move; write none")
        terms: list[Term] = [(lambda s: 0.0, np.zeros(size))]
        kinds = set()
        for name, factor in zip(system.names, factors, strict=True):
            if name in problem.inputs:
                ground[number] = factor
                kinds.add("a")
                continue
            try:
                kind, found = _terms_of(name, problem)
            except KeyError:
                raise ValueError(
                    f"{text!r}: {name} has no amplitude in a steady response"
                ) from None
            terms += [(symbol, factor * row) for symbol, row in found]
            kinds.add(kind)
        qualities.append(QUALITIES.get(kinds.pop(), "") if len(kinds) == 1 else "")
        every.append(terms)
    return HarmonicOutputs(qualities=tuple(qualities), terms=tuple(every), ground=ground)


def _terms_of(name: str, problem: Problem) -> tuple[str, list[Term]]:
    """Prefix (or name) of a variable of a motion, and its terms; KeyError: it has no amplitude."""
    scene = problem.scene
    derived = Observations(coordinates=problem.coordinates, parameters=problem.numbers).derived
    if name in derived:
        prefix, index = derived[name]
        unit = np.eye(1, scene.dimension, index)[0]
        if prefix == "d":
            # relaxed moduli belong to the potential
            return name, [(one.symbol, -times(unit, one.form)) for one in scene.active_forces]
        power = ("", "v", "a").index(prefix)
        return prefix, [(lambda s: s**power, unit)]
    value = damper_values(scene)[name]
    if value.kind == "work":
        raise KeyError(name)
    rows = deformation_rows(scene, value.place)
    if value.kind == "deformation":
        return "", [(lambda s: 1.0, rows[value.component])]
    terms: list[Term] = []
    for one in dampers_of(scene)[value.place]:
        row = times(np.eye(len(rows))[value.component], one.inner) @ rows
        terms += [(one.symbol, row), (lambda s: 1.0, getattr(one, "spring", 0.0) * row)]
    return name, terms
