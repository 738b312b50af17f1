r"""Outputs of steady responses: linear expressions in the variables of a motion, at a frequency.

With :math:`q = \hat q e^{st}` a velocity is :math:`s \hat q`, an acceleration
:math:`s^2 \hat q`, and the force of a damper its complex modulus times its deformation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from fvi_cli.effects.directions import linear_form
from fvi_cli.effects.matrices import times
from fvi_cli.integrator.observe.dampers import (
    DamperForce,
    damper_values,
    dampers_of,
    deformation_rows,
)
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.mathematics.algebra.builder import bound
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.problem import Problem

QUALITIES: Final = {"": "displacement", "v": "velocity", "a": "acceleration"}
"""Quality of an output that is a sum of coordinates, by the prefix of their names."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicOutputs:
    """Linear forms of the amplitudes of coordinates; the forms depend on the frequency."""

    names: tuple[str, ...]
    qualities: tuple[str, ...]  # of each output: displacement, velocity, acceleration, or empty
    powers: Array  # factors of q, s q and s^2 q, shape ``(3, k, d)``
    # pairs (complex modulus of a damper as a function of s, rows that it multiplies, ``(k, d)``)
    dampers: tuple[tuple[Callable[[complex], complex], Array], ...]
    ground: Array  # factor of the acceleration of the ground, shape ``(k,)``

    @property
    def forms(self) -> Array | Callable[[complex], Array | ComplexArray]:
        """The forms, shape ``(k, d)``, or where they depend on s the function :meth:`rows`."""
        return self.rows if self.powers[1:].any() or self.dampers else self.powers[0]

    def rows(self, s: complex) -> Array | ComplexArray:
        """The forms at s, shape ``(k, d)``."""
        found: Array | ComplexArray = self.powers[0]
        for power in (1, 2):
            if self.powers[power].any():
                found = found + s**power * self.powers[power]
        for modulus, rows in self.dampers:
            found = found + modulus(s) * rows
        return found


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
    size, count = problem.scene.dimension, len(texts)
    powers, ground = np.zeros((3, count, size)), np.zeros(count)
    dampers: list[tuple[Callable[[complex], complex], Array]] = []
    qualities = []
    derived = Observations(coordinates=problem.coordinates, parameters=problem.numbers).derived
    values = damper_values(problem.scene)
    terms: tuple[DamperForce, ...] = (*problem.scene.damping, *problem.scene.laws)
    for number, text in enumerate(texts):
        formula = quantities.get(text) or Expression.parse(text, variables=names)
        system = bound(formula.expand(problem.ready).system, problem.numbers)
        used = system.names
        constant, *factors = linear_form(system, used)
        if constant or not any(factors):
            raise ValueError(f"{text!r}: it holds {constant:g}, which does not move; write none")
        add = partial(_at_row, number, (count, size))
        kinds = set()
        for name, factor in zip(used, factors, strict=True):
            prefix, index = derived.get(name, ("", -1))
            unit = np.eye(1, size, max(index, 0))[0]
            if name in problem.inputs:
                ground[number] = factor
                kinds.add("a")
            elif index >= 0 and prefix != "d":
                powers["va".find(prefix) + 1 if prefix else 0, number, index] += factor
                kinds.add(prefix)
            elif index >= 0:
                # relaxed moduli belong to the potential
                pulled = [(one.symbol, np.asarray(times(unit, one.form))) for one in terms]
                dampers += [(symbol, add(-factor * row)) for symbol, row in pulled]
            elif name in values and values[name].kind != "work":
                value = values[name]
                rows = deformation_rows(problem.scene, value.place)
                if value.kind == "deformation":
                    powers[0, number] += factor * rows[value.component]
                    kinds.add("")
                    continue
                for one in dampers_of(problem.scene)[value.place]:
                    inner = np.asarray(times(np.eye(len(rows)), one.inner))
                    whole = add(factor * inner[value.component] @ rows)
                    dampers.append((one.symbol, whole))
                    powers[0] += getattr(one, "spring", 0.0) * whole
                kinds.add(name)
            else:
                raise ValueError(f"{text!r}: {name} has no amplitude in a steady response")
        qualities.append(QUALITIES.get(kinds.pop(), "") if len(kinds) == 1 else "")
    return HarmonicOutputs(
        names=tuple(texts),
        qualities=tuple(qualities),
        powers=powers,
        dampers=tuple(dampers),
        ground=ground,
    )


def _at_row(number: int, shape: tuple[int, int], row: Array) -> Array:
    found = np.zeros(shape)
    found[number] = row
    return found
