"""Start series of many linear scenes at a time: one expansion, and one table of their windows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.expansion import Expansion, solution_expansion
from fvi_cli.integrator.known_part import (
    KnownPart,
    KnownTable,
    SeriesPlan,
    method_order,
    plan_series,
    window_rule,
)
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.moments import galerkin_moments
from fvi_cli.integrator.start import near_start, window_force
from fvi_cli.integrator.step_tables import StepTables, step_tables
from fvi_cli.mathematics.power_series import SeriesError
from fvi_cli.mathematics.windowed_series import WindowedSeries

Array = NDArray[np.float64]

MOST_COMPONENTS = 64
"""Components of a joined scene: its square matrices must cost less than what sharing saves."""

MOST_VALUES = 2**21
"""Values of one table, so that a few of them take little memory beside the members' own."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Planned:
    """A member whose window begins at 0 and is the only one."""

    place: int
    known: KnownPart
    window: WindowedSeries


def plan_members(
    scenes: Sequence[Scene], method: Method, n_steps: int
) -> list[tuple[SeriesPlan, KnownTable | None]]:
    """What `plan_series` decides about every scene, and the values of the known parts.

    Parameters
    ----------
    scenes
        Linear scenes of one dimension, final time, kind of derivative, and set of orders of
        damping.
    method
        With ``start: series``.
    n_steps
        N.

    Returns
    -------
    list
        The decision for every scene in its place; the table is None where there is no known part,
        or one that is not a single window from the start.
    """
    tables = step_tables(method)
    values = n_steps * max(tables.points.size, 1) * scenes[0].dimension
    count = max(1, min(MOST_COMPONENTS // scenes[0].dimension, MOST_VALUES // values))
    found: list[tuple[SeriesPlan, KnownTable | None]] = []
    for first in range(0, len(scenes), count):
        found += _plan_together(scenes[first : first + count], method, tables, n_steps)
    return found


def _plan_together(
    scenes: Sequence[Scene], method: Method, tables: StepTables, n_steps: int
) -> list[tuple[SeriesPlan, KnownTable | None]]:
    expansions = _expansions(scenes, method)
    plans = [
        plan_series(scene, method, n_steps, expansion)
        for scene, expansion in zip(scenes, expansions, strict=True)
    ]
    members = [
        _Planned(place=place, known=plan.known, window=plan.known.start.window)
        for place, plan in enumerate(plans)
        if plan.known is not None and plan.known.start.window is not None and not plan.known.jumps
    ]
    found: list[KnownTable | None] = [None] * len(scenes)
    if members:
        chosen = [scenes[member.place] for member in members]
        for member, table in zip(members, _tables(members, chosen, tables, n_steps), strict=True):
            found[member.place] = table
    return list(zip(plans, found, strict=True))


def _expansions(scenes: Sequence[Scene], method: Method) -> list[Expansion | None]:
    """Expansions of all scenes as those of one; None where they have to be made one by one."""
    nothing: list[Expansion | None] = [None] * len(scenes)
    rule = window_rule(method)
    if rule is None or len(scenes) == 1 or any(scene.break_points for scene in scenes):
        return nothing
    try:
        whole = solution_expansion(joined(scenes), method_order(method) + rule.powers)
    except SeriesError:
        # it says of which scene only where that scene is alone
        return nothing
    parts = np.split(whole.coefficients, len(scenes), axis=1)
    found: list[Expansion | None] = []
    for part in parts:
        present = part.any(axis=1)
        found.append(
            Expansion(
                exponents=whole.exponents[present],
                coefficients=part[present],
                cutoff=whole.cutoff,
            )
        )
    return found


def _tables(
    members: Sequence[_Planned], scenes: Sequence[Scene], tables: StepTables, n_steps: int
) -> list[KnownTable]:
    """Values of all windows on the grid and at the points of the steps."""
    scene = joined([_without_forcing(one) for one in scenes])
    window = WindowedSeries.side_by_side([member.window for member in members])
    h = scene.final_time / n_steps
    left = h * np.arange(n_steps, dtype=float)
    grid = h * np.arange(n_steps + 1, dtype=float)
    driving = window_force(scene, window)
    d = scenes[0].dimension

    def residual(start: Array, step_size: float, offsets: Array) -> Array:
        total = -driving(start, step_size, offsets)
        for index, (member, one) in enumerate(zip(members, scenes, strict=True)):
            own = total[..., index * d : (index + 1) * d]
            if one.forcing is not None:
                own += one.forcing.on_steps(start, step_size, offsets)
            near_start(member.known.scene, member.known.start, start, step_size, offsets, own)
        return total

    moments = galerkin_moments(residual, tables, h, n_steps)
    shift = window.position(left[:, None] + h * tables.points)
    position, velocity = window.position(grid), window.velocity(grid)
    parts = [slice(index * d, (index + 1) * d) for index in range(len(members))]
    return [
        KnownTable(
            moments=moments[..., part].copy(),
            position=shift[..., part].copy(),
            on_grid=(position[:, part].copy(), velocity[:, part].copy()),
        )
        for part in parts
    ]


def _without_forcing(scene: Scene) -> Scene:
    return Scene(
        inertia=scene.inertia,
        initial_position=scene.initial_position,
        initial_velocity=scene.initial_velocity,
        final_time=scene.final_time,
        potential=scene.potential,
        damping=scene.damping,
        derivative=scene.derivative,
    )


def joined(scenes: Sequence[Scene]) -> Scene:
    """Scenes side by side that do not know of each other, as one.

    Parameters
    ----------
    scenes
        Linear scenes of one final time and kind of derivative, without break points.
    """
    first = scenes[0]
    orders = sorted({term.order for scene in scenes for term in scene.active_damping})
    damping = []
    for order in orders:
        blocks = [
            sum(
                (term.coefficient for term in scene.active_damping if term.order == order),
                start=np.zeros_like(scene.inertia.mass),
            )
            for scene in scenes
        ]
        damping.append(FractionalDamping(order=order, coefficient=_side_by_side(blocks)))
    stiffness = [
        scene.potential.stiffness
        if isinstance(scene.potential, QuadraticPotential)
        else np.zeros_like(scene.inertia.mass)
        for scene in scenes
    ]
    forcing = None
    if any(scene.forcing is not None for scene in scenes):
        components = [
            component
            for scene in scenes
            for component in (scene.forcing or _no_force(scene.dimension)).pieces[0].components
        ]
        forcing = Forcing(pieces=(ForcingPiece(components=tuple(components), until=math.inf),))
    return Scene(
        inertia=Inertia(mass=_side_by_side([scene.inertia.mass for scene in scenes])),
        initial_position=np.concatenate([scene.initial_position for scene in scenes]),
        initial_velocity=np.concatenate([scene.initial_velocity for scene in scenes]),
        final_time=first.final_time,
        potential=QuadraticPotential(stiffness=_side_by_side(stiffness)),
        damping=tuple(damping),
        forcing=forcing,
        derivative=first.derivative,
    )


def _no_force(dimension: int) -> Forcing:
    return Forcing.from_text(*["0"] * dimension)


def _side_by_side(blocks: Sequence[Array]) -> Array:
    """The blocks on the diagonal of a matrix of zeros."""
    d = blocks[0].shape[0]
    whole = np.zeros((len(blocks) * d, len(blocks) * d))
    for index, block in enumerate(blocks):
        part = slice(index * d, (index + 1) * d)
        whole[part, part] = block
    return whole
