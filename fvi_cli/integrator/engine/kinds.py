"""Scenes of one kind as members: their numbers in arrays, decoupled modes as members too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import Decoupling, linear_decoupling
from fvi_cli.integrator.engine.law import General, Law, Linear, Potential
from fvi_cli.mathematics.arrays import Array


def modes_of(scenes: Sequence[Scene]) -> list[Decoupling] | None:
    """Coordinates in which linear scenes fall apart."""
    found = [linear_decoupling(one) for one in scenes]
    known = [one for one in found if one is not None]
    return known if len(known) == len(found) else None


def law_of(scenes: Sequence[Scene], modes: Sequence[Decoupling] | None) -> Law:
    """The conservative part of scenes of one kind, in these coordinates."""
    if modes is not None:
        mass, stiffness = [], []
        for mode, one in zip(modes, scenes, strict=True):
            mass.append(mode.matrices(one.inertia.mass))
            k = np.zeros((one.dimension,) * 2)
            if isinstance(one.potential, QuadraticPotential):
                k = one.potential.stiffness
            stiffness.append(mode.matrices(k))
        return Linear(mass=np.concatenate(mass), stiffness=np.concatenate(stiffness))
    first = scenes[0]
    if first.lagrangian is not None:
        lagrangians = [one.lagrangian for one in scenes if one.lagrangian is not None]
        stiffness = [one.stiffness for one in lagrangians if one.stiffness is not None]
        return General(
            lagrangian=first.lagrangian,
            parameters=_columns([one.parameters for one in lagrangians]),
            stiffness=np.array(stiffness) if stiffness else None,
        )
    potentials = [one.potential for one in scenes]
    known = [one for one in potentials if isinstance(one, ExpressionPotential)]
    if len(known) != len(potentials):
        raise ValueError("scenes: they are not of one kind")
    forms = [dense(one.stiffness) for one in known if one.stiffness is not None]
    return Potential(
        mass=np.array([one.inertia.mass for one in scenes]),
        formulas=known[0],
        parameters=_columns([one.parameters for one in known]),
        stiffness=np.array(forms) if forms else None,
    )


def _columns(parameters: Sequence[Mapping[str, float | Array]]) -> dict[str, Array]:
    """Values of every name, ``(q, 1)``."""
    return {name: np.array([[float(one[name])] for one in parameters]) for name in parameters[0]}
