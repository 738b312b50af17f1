r"""Newton's iteration on a block of steps, for all members at once.

With second derivatives that are fixed, the points of a block are
``begin + fold . remainder(points)``. Single steps have second derivatives at every point, which
are computed again where the iteration is slow; where it diverges, shorter steps of Newton lead to
the root, or the step fails. Blocks have one linearisation for all points; where their iteration
does not contract, they are solved in shorter pieces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.engine.law import StepLaw
from fvi_cli.integrator.engine.operator import Operator
from fvi_cli.integrator.engine.state import State
from fvi_cli.integrator.engine.tables import apply, largest
from fvi_cli.integrator.memory.damping import Damping
from fvi_cli.mathematics.arrays import Array, Integers, Mask, Places
from fvi_cli.mathematics.convergence import (
    ITERATIONS,
    NEGLIGIBLE,
    NOISE,
    SLOW,
    SMALLEST,
    UNIT,
    find_roots,
)

HALF_THE_DIGITS = UNIT**0.5  # relative changes above this are no round-off


@dataclass(eq=False, kw_only=True)
class Solution:
    """Unknowns ``(q, B s e)``, points and remainders ``(q, B r, w)``, and how they were found."""

    unknowns: Array
    points: Array
    rest: Array
    iterations: Integers
    failed: Mask
    change: Array  # largest change in the last iteration of every member, (q,)


class Newton:
    """The iteration for one block of steps, or for a single one.

    Known loads, with the sign of the left side, are ``(q, B, s + 1, e)``.
    """

    def __init__(
        self, law: StepLaw, damping: Damping | None, op: Operator, state: State, known: Array
    ) -> None:
        self.law, self.damping, self.op, self.state, self.known = law, damping, op, state, known
        self.is_step = op.frame.count == 1
        self.q, self.count, _, self.e = known.shape
        points = op.frame.tables.points
        self.n = self.count * points.size
        self.width = 2 * self.e if law.has_rates else self.e
        self.times = points
        if law.has_rates:
            # other laws do not depend on the time
            steps = np.arange(self.count)[:, None]
            self.times = state.t + op.frame.h * (steps + points).ravel()
        self._begin()

    def _begin(self) -> None:
        """Compute the unknowns and points without remainders."""
        self.fixed = self.op.solve(self.state, self.known)
        self.fold = self.op.fold
        if self.count < self.op.frame.count:
            k = self.n * self.width
            self.fold = self.fold[:, :k, :k]
        s = self.op.frame.tables.degree
        self.begin = self.op.frame.points_of(self.fixed.reshape(self.q, -1, s, self.e))

    def _largest(self, values: Array) -> Array:
        """Largest absolute values of every component over all points, ``(q, w)``."""
        return largest(np.abs(values).reshape(self.q, self.n, self.width))

    def _has_ended(self, change: Array, before: Array, limit: Array) -> bool | None:
        """True: the iteration has ended for all members. False: for none. None: check each member.

        The next change would be ``change^2 / before``.
        """
        if change.size == 1:
            now, last, end = change.item(), before.item(), limit.item()
            return True if now * now <= end * last else False if now <= SLOW * last else None
        if self.q == 1:
            rows = list(zip(change[0].tolist(), before[0].tolist(), limit[0].tolist(), strict=True))
            if all(now * now <= end * last for now, last, end in rows):
                return True
            return False if all(now <= SLOW * last for now, last, _ in rows) else None
        good = change * change <= limit * before
        if good.all():
            return True
        if (change <= SLOW * before).all() and not good.all(axis=1).any():
            return False
        return None

    def _shrunk(self, points: Array, limit: Array) -> Mask:
        """Components whose first scale, from points far away, is too large at the points now."""
        return np.asarray(2.0 * NEGLIGIBLE * self._largest(points) < limit)

    def _rescale(self, limit: Array, size: Array, points: Array, places: Mask) -> None:
        """Set the negligible change and the size of some components by their present points."""
        now = self._largest(points)
        limit[places] = NEGLIGIBLE * now[places]
        now[:, : self.e] = np.maximum(now[:, : self.e], np.abs(self.state.x))
        size[places] = now[places]

    def _falls(self, change: Array, before: Array, size: Array, least: float) -> Mask:
        """Members whose largest relative change is at least `least`, and less than before."""
        share = 1.0 / np.maximum(size, SMALLEST)
        now, last = ((share * one).max(axis=1) for one in (change, before))
        return np.asarray((now < last) & (now >= least))

    def run(self, points: Array | None, fresh: Array | None) -> Solution:
        """Iterate until every component of every member has converged.

        Steps begin from points ``(q, n, w)`` and their remainders `fresh`, blocks from the last
        remainder. Changes must be negligible relative to displacements, since positions are
        compensated sums; where round-off prevents that, relative to positions.
        """
        state, q, shape = self.state, self.q, (self.q, self.n, self.width)
        rest = np.zeros(shape)
        if points is not None:
            points = points.reshape(q, -1)
        else:
            if state.rest is not None:
                rest += state.rest[:, None]
            points = self.begin + apply(self.fold, rest.reshape(q, -1))
        live, done, failed = state.live, ~state.live, np.zeros(q, dtype=bool)
        everyone, iterations = bool(live.all()), np.zeros(q, dtype=np.int64)
        renewed: Places | None = None
        damped = np.zeros(q, dtype=bool)
        limit = before = size = change = np.zeros((q, self.width))
        for iteration in range(ITERATIONS):
            if iteration or fresh is None:
                at, x = self.op.at, state.x
                fresh = self.law.remainder(at, x, points.reshape(shape), self.times, rest)
            moved = self.begin + apply(self.fold, fresh.reshape(q, -1))
            change = self._largest(moved - points)
            if everyone:
                rest, points = fresh, moved
            else:
                rest = np.where(live[:, None, None], fresh, rest)
                points = np.where(live[:, None], moved, points)
                iterations += live
            if iteration == 0:
                size, before = self._largest(moved), change
                limit = NEGLIGIBLE * size
                size[:, : self.e] = np.maximum(size[:, : self.e], np.abs(state.x))
                continue
            if renewed is None and everyone:
                has_ended = self._has_ended(change, before, limit)
                if has_ended and (far := self._shrunk(moved, limit)).any():
                    self._rescale(limit, size, moved, far)
                    has_ended = self._has_ended(change, before, limit)
                if has_ended:
                    return self._solution(points, rest, iterations + iteration + 1, failed, change)
                # blocks may be iterated slowly, as long as large changes fall
                if has_ended is not None or (
                    not self.is_step and self._falls(change, before, size, HALF_THE_DIGITS).all()
                ):
                    before = change
                    continue
                # from here on members end one by one
                everyone = False
                iterations += iteration + 1
            good = change * change <= limit * before
            slow = ~(change <= SLOW * before)
            ending = np.asarray((good | (slow & (change <= UNIT * size))).all(axis=1))
            if ending.any():
                self._rescale(limit, size, moved, self._shrunk(moved, limit) & ending[:, None])
                good = change * change <= limit * before
            if renewed is not None:
                good[renewed], slow[renewed] = False, ~np.isfinite(change[renewed])
                renewed = None
            good |= slow & (change <= UNIT * size)
            slow &= ~good
            done = np.asarray(good.all(axis=1))
            stuck = live & slow.any(axis=1)
            if stuck.any():
                # large changes that fall are no round-off
                noisy = stuck & ~self._falls(change, before, size, HALF_THE_DIGITS)
                if noisy.any():
                    floor = NOISE * UNIT * self._largest(points)
                    if not (good | (change <= floor))[noisy].all():
                        # terms of the equations, points among them
                        floor = NOISE * self._floor(rest, points)
                    done |= noisy & (good | (change <= floor)).all(axis=1)
                stuck &= ~done
                hopeless = stuck & ~self._falls(change, before, size, 0.0)
                # equations of a block contract the better the longer they are iterated
                if self.is_step:
                    for place in np.flatnonzero(hopeless & ~damped).tolist():
                        hopeless[place] = not self._damp(place, points)
                        damped[place] = True
                    renewed = np.flatnonzero(stuck & ~hopeless)
                    self._renew(renewed, points)
                failed |= hopeless
                live = live & ~hopeless
            live = live & ~done
            if not live.any():
                break
            before = change
        if everyone:
            iterations += iteration + 1
        return self._solution(points, rest, iterations, failed | (live & ~done), change)

    def _solution(
        self,
        points: Array,
        rest: Array,
        iterations: Integers,
        failed: Mask,
        change: Array,
    ) -> Solution:
        return Solution(
            unknowns=self.fixed + self.op.respond(rest, self.count),
            points=points.reshape(self.q, self.n, self.width),
            rest=rest,
            iterations=iterations,
            failed=failed,
            change=change.max(axis=1),
        )

    def _floor(self, rest: Array, points: Array) -> Array:
        """Bound on the round-off of every component: rounded terms, times absolute matrices.

        Components that are not coupled have no effect on each other: their entries are exact zeros.
        """
        op, size = self.op, self.fixed.shape[1]
        known = np.abs(self.known).reshape(self.q, -1)
        begin = np.concatenate([self.state.x, self.state.p], axis=1)
        terms = apply(np.abs(op.by_load[:, :size, : known.shape[1]]), known)
        terms += apply(np.abs(op.start[:, :size]), np.abs(begin))
        to_points = op.frame.points[:, : self.n * self.width, :size]
        total = apply(np.abs(to_points), terms)
        at = points.reshape(self.q, self.n, self.width)
        rounded = np.abs(rest) + op.at.terms_of(self.state.x, at)
        total += apply(np.abs(self.fold), rounded.reshape(self.q, -1))
        return UNIT * self._largest(total + np.abs(points))

    def _damp(self, place: int, points: Array) -> bool:
        """Move a member's points to the root that shorter steps find from uniform motion on.

        The corrections must fall, each by derivatives of its own: a step that only goes downhill
        may lead over an infinite motion, to a solution behind it.
        """
        one = np.array([place])
        law, state, known = self.law.of(one), self.state.of(one), self.known[one]
        damping = None if self.damping is None else self.damping.of(one)
        frame, identity = self.op.frame.of(one), np.eye(self.fixed.shape[1])[None]

        def points_of(u: Array) -> Array:
            return frame.points_of(u.reshape(1, 1, -1, self.e))

        def evaluate(u: Array) -> tuple[Array, Array, Array]:
            at, rest = law.expand(state.x, points_of(u).reshape(1, self.n, -1), self.times)
            op = Operator(frame, at, damping, is_linear=False)
            return u - op.solve(state, known) - op.respond(rest, 1), identity, np.abs(u)

        velocity = law.velocity(state.x, state.p, state.t)
        guess = frame.tables.control_points[1:, None] * velocity
        found, is_found, _ = find_roots(evaluate, guess.reshape(1, -1))
        if is_found[0]:
            points[one] = points_of(found)
        return bool(is_found[0])

    def _renew(self, places: Places, points: Array) -> None:
        """Compute the second derivatives of some members again, at their present points."""
        if not places.size:
            return
        op = self.op
        at = points.reshape(self.q, self.n, self.width)
        fresh, _ = self.law.expand(self.state.x, at, self.times)
        damping = None if self.damping is None else self.damping.of(places)
        own = Operator(op.frame.of(places), fresh.of(places), damping, is_linear=False)
        op.put(places, own)
        self._begin()
