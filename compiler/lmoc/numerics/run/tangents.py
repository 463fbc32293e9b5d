"""States and tangents, integrated together in one segment of a motion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from lmoc.numerics.evaluate.tangent_system import TangentSystem, tangent_system
from lmoc.numerics.limits import FINEST_SMOOTH
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.plan import kinks
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import Problem
from lmoc.numerics.problem.status import Status
from lmoc.numerics.run.sensitivities import STEP, Direction, Tangent, refused
from lmoc.numerics.signals.signals import break_times
from lmoc.numerics.steps import choice
from lmoc.support.distinct import distinct

_SHARE = 0.5  # of the run's tolerance
_ABSOLUTE = 1e-2  # of the relative tolerance times the size
_ASIDE = 1e-9  # of the time, by which an instant may be beside another and is still the same
_GOLDEN = (5**0.5 - 1) / 2  # ratio of the shares by which quantities are changed at once
_PLACES = 0.382, 0.7, 1.0  # of a segment, at which slopes are looked at until they are good …
_CHANGES, _BENT = (1e-5, 1e-7), 1e-2  # … by such shares of the tangents; share of a slope by which it may bend
# steps after which a segment is given up, and those in which the ledger is followed closely: more hold up the motion
_STEPS, _CLOSELY = 5_000_000, 100_000
_APART = 1e4  # tolerances by which the states may differ from those of the run


class Tangents:
    """States and tangents, integrated together in one segment."""

    def __init__(
        self, observer: Observer, directions: Sequence[Direction], base: np.ndarray, sizes: np.ndarray, rtol: float,
        methods: Sequence[str],
    ) -> None:  # fmt: skip
        """
        Parameters
        ----------
        base : (m, registers) derivatives of what does not change in the segment
        sizes : (n,) of the states
        rtol : relative tolerance of the run
        methods : those by which tangents are integrated, the one where the other fails
        """
        self.observer, self.directions, self.methods = observer, directions, methods
        self.plan, self.n, self.m = observer.plan, len(observer.plan.states), len(directions)
        self.rtol, self.sizes = max(_SHARE * rtol, FINEST_SMOOTH), sizes
        self.scale, self._by = np.array([d.size for d in directions]), base
        own = np.sort(self.plan.parameters)
        registers = own[(base[:, own] != 0).any(axis=0)]
        moves = base[:, registers].T * self.scale
        self._registers, self.system = registers, tangent_system(self.plan, registers, moves)
        self.system.prepare(observer.base, observer.signals)

    def rates(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the rates (n,) of the states at a place."""
        out = np.empty(self.system.n)
        self.system.rhs(t, np.concatenate([x, np.zeros(self.n * self.m)]), out)
        return out[: self.n]

    def others(self, at: Tangent, registers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return other registers of the plan (k,) at a place to which this has come, and their derivatives (m, k)."""
        x = np.concatenate([at.x, (at.by * self.scale[:, None]).ravel()])
        self.system.rhs(at.time, x, np.empty(self.system.n))
        system = TangentSystem(self.plan, self._registers, self.system.directions, registers)
        system.prepare(self.observer.base, self.observer.signals)
        found = system.values(at.time, x, self.system)
        return found[0], found[1:] / self.scale[:, None]

    def check_slopes(self, times: np.ndarray, states: np.ndarray, tangents: np.ndarray) -> None:
        """Refuse a motion that stays where its equations have a kink, as ``x' = |x|`` at x = 0.

        Parameters
        ----------
        times, states, tangents : (k,), (k, n), (m, k, n) along the segment

        Raises
        ------
        ModelError
            E0575: rates bend at all of some places, however little the states are moved along the tangents.
        """
        if not self.n or not len(times):
            return
        shares, least = (-_GOLDEN) ** np.arange(self.m), 1.0 / max(float(times[-1] - times[0]), 1e-300)
        for place in sorted({int(share * (len(times) - 1)) for share in _PLACES}):
            t, by = float(times[place]), tangents[:, place] * self.scale[:, None]
            x = np.concatenate([states[place], by.ravel()])
            own = self.system.aside(t, x, np.zeros(self.m)).reshape(1 + self.m, self.n)
            slope, size = shares @ own[1:], np.abs(own[0])
            if least < np.inf:
                size = np.maximum(size, self.sizes * least)
            for change in _CHANGES:
                high, low = (self.system.aside(t, x, sign * change * shares)[: self.n] for sign in (1.0, -1.0))
                bent = np.abs(high + low - 2 * own[0]) / change  # where there is no kink it shrinks with the change
                if not (bent > _BENT * np.maximum(np.abs(slope), size))[~self.plan.ledger].any():
                    return
        raise refused("the motion stays where its equations have a kink")

    def _kinks(self, begin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return where the equations have kinks in time (k,), and the derivatives (m, k) of these instants.

        Raises
        ------
        ModelError
            E0575: something else happens at such an instant.
        """
        own = kinks.break_times(self.plan, self.observer.base, begin, end)
        moves = np.zeros((self.m, len(own)))
        if not len(own):
            return own, moves
        wide = begin - (end - begin), end + (end - begin)  # at the ends some come in and others leave
        for k, direction in enumerate(self.directions):
            step = STEP * direction.size
            # discrete variables stay what they are in the segment: `if mod(time, T) > T/2` jumps later in each period
            bases = (self.observer.base + s * step * self._by[k] for s in (-1, 1))
            sides = [kinks.break_times(self.plan, base, *wide) for base in bases]
            if not all(map(len, sides)):
                raise refused(f"only with this value of '{direction.name}' the equations jump at some instant")
            low, high = (side[np.abs(side[:, None] - own).argmin(axis=0)] for side in sides)
            moves[k] = (high - low) / (2 * step)
        margin = _ASIDE * max(abs(begin), abs(end))
        moves[np.abs(moves) * self.scale[:, None] <= margin] = 0.0
        beside = (np.abs(own - begin) <= margin) | (np.abs(own - end) <= margin)
        if (moves[:, beside] != 0).any():
            name = self.directions[int(np.flatnonzero(moves[:, beside].any(axis=1))[0])].name
            raise refused(f"'{name}' moves an instant at which the equations jump where something else happens")
        return own, moves

    def go(self, at: Tangent, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, Tangent]]]:
        """Return the states (times, n) and tangents (m, times, n) at times behind a place.

        Also which quantities (m,) move kinks in time, and the places behind these.

        Raises
        ------
        ModelError
            E0575: the integration failed.
        """
        y = np.concatenate([at.x, (at.by * self.scale[:, None]).ravel()])
        found, atol = np.tile(y, (len(times), 1)), _ABSOLUTE * self.rtol * np.tile(self.sizes, 1 + self.m)
        end, bent = float(times[-1]) if len(times) else at.time, []
        if end - at.time > choice.near(end):
            own, moves = self._kinks(at.time, end)
            moving = moves.any(axis=0) & (own > at.time) & (own < end)
            fixed = distinct(np.concatenate([own, break_times(self.observer.signals, at.time, end, kinks.MOST)]))
            begin = at.time
            for instant, by in (*zip(own[moving].tolist(), moves.T[moving], strict=True), (end, None)):
                inside = (times > begin) & (times <= instant)
                asked = np.append(times[inside], instant)
                part = self._forward(begin, y, asked, atol, fixed[(fixed >= begin) & (fixed <= instant)])
                found[inside], y, begin = part[:-1], part[-1].copy(), instant
                if by is not None:
                    jump = self._jump(instant, y[: self.n])
                    y[self.n :] += np.outer(by * self.scale, jump).ravel()
                    behind = y[self.n :].reshape(self.m, self.n) / self.scale[:, None]
                    bent.append((by != 0, Tangent(instant, y[: self.n].copy(), behind, at.base)))
        tangents = found[:, self.n :].reshape(len(times), self.m, self.n)
        return found[:, : self.n], np.moveaxis(tangents, 1, 0) / self.scale[:, None, None], bent

    def _jump(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return by what the rates before an instant are larger than those behind it."""
        aside = 2 * kinks.NEAR * max(abs(t), 1e-300)
        return self.rates(t - aside, x) - self.rates(t + aside, x)

    def _forward(
        self, begin: float, y: np.ndarray, times: np.ndarray, atol: np.ndarray, breaks: np.ndarray
    ) -> np.ndarray:
        """Return states and tangents (times, n·(1 + m)) at times behind a place, by an integrator of runs.

        Where rounding is all that flows, as heat in an elastic string, the ledger is not followed so closely that
        it holds up the motion, on which it does not act.
        """
        found, end = np.empty((len(times), len(y))), float(times[-1])
        if not len(y):  # all motion is given
            return found

        def sink(first: int, states: np.ndarray) -> None:
            found[first : first + len(states)] = states

        ledger = np.tile(self.plan.ledger, 1 + self.m)
        loose = np.where(ledger, np.max(atol), atol)
        methods = [m for m in self.methods if m != "taylor" or self.system.suits_series]
        ways = ((atol, _CLOSELY), (loose, _STEPS)) if ledger.any() else ((atol, _STEPS),)
        for method, (tolerances, most) in product(methods, ways):
            problem = Problem(
                self.system, begin, y, end, times, self.rtol, tolerances, sink, breaks=breaks, max_steps=most
            )  # fmt: skip
            outcome, _ = choice.run(problem, method)
            if outcome.status in (Status.OK, Status.INTERRUPTED, Status.SPENT):
                break
        if outcome.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        if outcome.status is not Status.OK or not np.isfinite(found).all():
            raise refused(f"their integration failed at t = {outcome.time:g} s: {outcome.status.value}")
        return found


def agree(plan: Plan, states: np.ndarray, table: np.ndarray, sizes: np.ndarray, rtol: float) -> None:
    """Refuse tangents along another motion (times, n) than that of the run; work and heat are no part of it."""
    apart = (np.abs(states - table) / sizes)[:, ~plan.ledger]
    if not np.max(apart, initial=0.0) <= _APART * max(rtol, 1e-12):
        raise refused("the motion depends on its values so much that it cannot be repeated within its tolerance")
