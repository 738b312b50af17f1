"""Operators at hand: made for a step size, and made anew where second derivatives change."""

from __future__ import annotations

import copy
from collections import OrderedDict

import numpy as np

from fvi_cli.integrator.damping.damping import Damping
from fvi_cli.integrator.engine.frame import Frame, sampling_of, unit_tables
from fvi_cli.integrator.engine.law import StepLaw
from fvi_cli.integrator.engine.operator import Operator
from fvi_cli.integrator.engine.state import State
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.mathematics.arrays import Array, Places

KEPT_TABLES = 128
"""Step sizes whose tables are kept."""


class Operators:
    """Frames and operators of the members of an engine.

    Parameters
    ----------
    law, damping, method, components
        Of the engine.
    """

    def __init__(
        self, law: StepLaw, damping: Damping | None, method: Method, components: int
    ) -> None:
        self.law, self.damping, self._method, self._e = law, damping, method, components
        self._tables, self._sampling = step_tables(method), sampling_of(method)
        self._frames: OrderedDict[tuple[float, int], Frame] = OrderedDict()
        self._linear: OrderedDict[tuple[float, int], Operator] = OrderedDict()
        self._of_block: Operator | None = None
        self._whole: tuple[Operators, Places] | None = None

    def frame(self, h: float, count: int) -> Frame:
        """Tables of `count` steps of length h."""
        key = (h, count)
        if key not in self._frames:
            unit = unit_tables(self._method, count, self._e, self.law.has_rates)
            self._frames[key] = Frame(self._sampling, unit, self.damping, h, count)
            if len(self._frames) > KEPT_TABLES:
                self._frames.popitem(last=False)
        return self._frames[key]

    def frame_of_at_least(self, h: float, count: int, most: int) -> Frame:
        """Tables of so many steps or, where they are at hand, of a longest block."""
        whole = self._frames.get((h, most))
        return self.frame(h, count) if whole is None or most < count else whole

    def at(self, state: State, h: float, count: int, guess: Array | None) -> Operator:
        """The operator of `count` steps from a state, which learns what it is linearised by.

        Blocks take the second derivatives of the state, single steps those at the guess.
        """
        key = (h, count)
        if self.law.is_linear:
            if key not in self._linear:
                at = self.law.linearise(state.x[:, None], None, 0.0)
                self._linear[key] = Operator(self.frame(h, count), at, self.damping, is_linear=True)
                if len(self._linear) > KEPT_TABLES:
                    self._linear.popitem(last=False)
            return self._linear[key]
        if guess is None:
            return self._block(state, key)
        frame = self.frame(h, 1)
        points = frame.points_of(guess[:, None]).reshape(len(guess), self._tables.points.size, -1)
        v = points[..., self._e :] if self.law.has_rates else None
        x, t = state.x[:, None] + points[..., : self._e], state.t + h * self._tables.points
        return Operator(
            frame,
            self.law.linearise(x, v, t, per_point=True),
            self.damping,
            is_linear=False,
        )

    def _block(self, state: State, key: tuple[float, int]) -> Operator:
        if state.block is None or state.stale.any():
            x, v = state.x[:, None], None
            if self.law.has_rates:
                v = self.law.velocity(state.x, state.p, state.t)[:, None]
            fresh = self.law.linearise(x, v, state.t).copy()
            if state.block is not None:
                kept = np.flatnonzero(~state.stale)
                fresh.put(kept, state.block.of(kept))
            state.block, state.stale = fresh, np.zeros_like(state.stale)
        known = self._of_block
        if known is None and self._whole is not None:
            whole, places = self._whole
            known = None if whole._of_block is None else whole._of_block.of(places)
            self._of_block = known
        if known is None or (known.frame.h, known.frame.count) != key:
            known = Operator(self.frame(*key), state.block.copy(), self.damping, is_linear=False)
            self._of_block = known
        elif (places := known.at.differing(state.block)).size == len(state.longest):
            known = Operator(known.frame, state.block.copy(), self.damping, is_linear=False)
            self._of_block = known
        elif places.size:
            fresh, frame = state.block.of(places), known.frame.of(places)
            damping = None if self.damping is None else self.damping.of(places)
            known.put(places, Operator(frame, fresh, damping, is_linear=False))
        return known

    def of(self, places: Places) -> Operators:
        """Those of some members; tables of step sizes are shared where members have the same."""
        part = copy.copy(self)
        part.law = self.law.of(places)
        if self.damping is not None:
            part.damping = self.damping.of(places)
            if not self.damping.is_shared:
                part._frames = OrderedDict()
        part._linear = OrderedDict()
        part._of_block, part._whole = None, (self, places)
        return part
