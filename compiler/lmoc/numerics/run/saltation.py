"""Derivatives of a motion with events: between them tangents are integrated, over them leads the saltation.

An event at t, where g(t, x, p) = 0, with the states x- before it and x+ = R(t, x-, p) behind it, comes later by
``t' = -(g_p + g_x S-) / (g_t + g_x f-)`` with a quantity that moves the states by S-. Behind it they are moved by
``S+ = d/dp R(t + t', x- + S- + f- t', p) - f+ t'`` (Hiskens and Pai, IEEE Transactions on Circuits and Systems I 47,
2000; Galan, Feehery and Barton, Applied Numerical Mathematics 31, 1999). The instant is repeated a little to both
sides, along the surface g = 0: what R is follows from laws and discrete equations that answer each other, and its
difference is its derivative where the same happens on both sides. Else the motion grazes, or a mode is on its edge, and
there is none; nor where a function of an event comes as near to zero as a millionth of a quantity moves it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.messages.diagnostics import ModelError
from lmoc.numerics.events.closeness import near_to
from lmoc.numerics.events.occasion import Behind, behind
from lmoc.numerics.problem.status import Status, Stopped
from lmoc.numerics.run.sensitivities import Tangent, refused
from lmoc.numerics.run.surroundings import LITTLE, OVER_EVENTS, Surroundings
from lmoc.numerics.run.tangents import Tangents
from lmoc.support.records import replace

_SHRINK, _TRIES = 8.0, 4  # of that step, where it is too coarse
_BENT = 1e-2  # share by which differences to both sides may differ: the error of the one to both is its square
_NOISE = 1e-12  # of the sizes, what does not count in that
_SHORT = 1e-4  # of the time since the last instant, over which slopes of functions are taken
_TOGETHER = 1e-5  # share by which functions that vanish at one instant may move apart
ROUNDING = 1e-9  # of the time, what does not count in that

Heights = Callable[[np.ndarray, np.ndarray], np.ndarray]  # as of `HybridDynamics.heights`


class Saltation:
    """What an instant does to the tangents.

    Attributes
    ----------
    behind : the place behind it; its states are moved at an instant that moves along, so that the rates there times
        `delays` are to be subtracted
    delays : (m,) the derivatives of the instant
    since : s, when the instant before was that is no part of this one
    """

    def __init__(self, around: Surroundings, sweep: Tangents, at: Tangent, along: np.ndarray | None = None) -> None:
        """
        Parameters
        ----------
        at : where it happens
        along : (m,) the derivatives of the instant, where it is the one before it but for rounding: then `at` is moved
            along with it, as `behind`
        """
        self._around, self._at, self._occasion, self._along = around, at, around.occasion, along
        self.since = around.since
        t, x, roots = at.time, at.x, around.occasion.outcome.roots
        self._f = sweep.rates(t, x)
        short = _SHORT * around.room or _SHORT * max(abs(t), 1.0)
        self._bend = (self._f - sweep.rates(t - short, x - short * self._f)) / short
        self._roots = np.zeros(0, int) if around.occasion.outcome.status is not Status.ROOT else np.flatnonzero(roots)
        self._slope = self._curve = self._zero = np.zeros(0)
        if len(self._roots):
            around.recall()
            before = -short * np.array([2.0, 1.0, 0.0])
            values = around.dynamics.heights()(t + before, self._on(before, x))[:, self._roots]
            self._zero, self._slope = values[2], (values[0] - 4 * values[1] + 3 * values[2]) / (2 * short)
            self._curve = (values[0] - 2 * values[1] + values[2]) / short**2
        found, n, base = self._derivatives(), len(self._reached.x), at.base.copy()
        self.delays, base[:, around.changing] = found[:, 0], found[:, 1 + n :]
        self.behind = Tangent(t, self._reached.x, found[:, 1 : 1 + n], base)

    @property
    def _reached(self) -> Behind:
        assert self._occasion.behind is not None
        return self._occasion.behind

    def _on(self, later: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the states (k, n) on the motion before the instant, so much later than at x."""
        return x + later[:, None] * self._f + later[:, None] ** 2 / 2 * self._bend

    @property
    def said(self) -> str:
        """What happens, in words."""
        return ", ".join(dict.fromkeys(f"{name} {kind}" for name, kind in self._reached.told))

    def near(self, times: np.ndarray, rtol: float) -> np.ndarray:
        """Return which times, s, are at the instant, within what is known of it; rtol : of the run."""
        return np.flatnonzero(np.abs(times - self._at.time) <= max(rtol, ROUNDING) * self._span)

    @property
    def moving(self) -> np.ndarray:
        """(m,) which quantities move the instant."""
        sizes = np.array([d.size for d in self._around.directions])
        return np.abs(self.delays) * sizes > ROUNDING * self._span

    @property
    def _span(self) -> float:
        return max(abs(self._at.time), self._around.room)

    def _error(self, which: int) -> ModelError:
        return self._around.grazes(which, self._at.time, self.said)

    # ------------------------------------------------------------------ differences

    def _derivatives(self) -> np.ndarray:
        """Return the derivatives (m, 1 + n + changing) of the instant, of the states behind it, and of the base.

        Differences to both sides, of smaller steps where these are too coarse.
        """
        around, at, m = self._around, self._at, len(self._around.directions)
        size, n, sizes = np.array([d.size for d in around.directions]), len(self._reached.x), around.sizes
        middle = np.concatenate([[at.time], self._reached.x, self._reached.base[around.changing]])
        known = np.isfinite(middle)
        middle[~known] = 0.0
        moved = np.maximum(size * np.max(np.abs(at.by) / sizes, axis=1, initial=0.0), 1.0)
        # the same at most instants, so that what follows from parameters is known again
        steps = OVER_EVENTS * size / _SHRINK ** np.ceil(np.log2(moved) / np.log2(_SHRINK))
        # what is held from then on: a wave sampled late bends within a step, |x| has two slopes where it is zero
        worth = np.abs(middle[1 + n :])
        found, left = np.empty((m, len(middle))), list(range(m))
        for _ in range(_TRIES):
            sides = {k: self._both_sides(k, steps[k]) for k in left}
            here = [k for k in left if sides[k] is not None]
            if here:
                step = steps[here, None]
                ahead, back = np.moveaxis(np.where(known, np.stack([sides[k] for k in here]), 0.0) - middle, 1, 0)
                slope, bent = (ahead - back) / (2 * step), np.abs(ahead + back) / step
                own = np.max(np.abs(slope[:, 1 : 1 + n]) / sizes, axis=1, initial=0.0)[:, None] * sizes
                good = (bent[:, 1 : 1 + n] <= _BENT * own + _NOISE * sizes / step).all(axis=1)
                held = np.maximum(np.abs(slope[:, 1 + n :]), worth / size[here, None])
                good &= (bent[:, 1 + n :] <= _BENT * held + _NOISE * worth / step).all(axis=1)
                found[here] = slope
                left = [k for k in left if k not in here or not good[here.index(k)]]
            if not left:
                return found
            steps[left] /= _SHRINK
        raise self._error(left[0])

    def _both_sides(self, which: int, step: float) -> np.ndarray | None:
        """Return (2, 1 + n + changing) as `_repeated` with a quantity larger and smaller; None where one is none."""
        ahead = self._repeated(which, step)
        back = None if ahead is None else self._repeated(which, -step)
        return None if ahead is None or back is None else np.stack([ahead, back])

    def _repeated(self, which: int, change: float) -> np.ndarray | None:
        """Return (1 + n + changing,) when it happens with a quantity changed, and what follows.

        None where something else happens.
        """
        around, at, dynamics = self._around, self._at, self._around.dynamics
        around.recall(around.change(which, change), at.base)
        x = at.x + change * at.by[which]
        later = self._delay(which, change, x)
        if later is None:
            return None
        place = self._moved(later, x)
        outcome = replace(self._occasion.outcome, time=at.time + later, x=place)
        try:
            found = dynamics.after(outcome, self._occasion.unresolved, self._occasion.errors)
        except (Stopped, ModelError):
            return None
        if found is None:
            return None
        reached = behind(dynamics, found, 0)
        if not reached.is_like(self._reached):
            return None
        return np.concatenate([[at.time + later], reached.x, reached.base[around.changing]])

    # ------------------------------------------------------------------ the instant

    def _delay(self, which: int, change: float, x: np.ndarray) -> float | None:
        """Return how much later it happens, s, from the states where it was; None where other things happen."""
        at, dynamics = self._at, self._around.dynamics
        known, clock = None, self._occasion.memory.next
        if self._along is not None:
            return self._along_with(which, change)
        if dynamics.stepping.instant(at.time) is not None:
            known = 0.0
        elif dynamics.handler is not None and abs(clock - at.time) <= near_to(at.time):
            known = dynamics.handler.next - at.time
        later = self._of_roots(which, change, x, known) if len(self._roots) else known or 0.0
        return later if later is not None and np.isfinite(later) else None

    def _of_roots(self, which: int, change: float, x: np.ndarray, known: float | None) -> float | None:
        """Return how much later functions vanish; `known`: how much later something else happens at the instant."""
        at, later = self._at, 0.0 if known is None else known
        values, little = self._around.dynamics.heights(), LITTLE * self._around.directions[which].size
        missing = self._missing(values, x, later)
        with np.errstate(all="ignore"):
            # where it comes down by as little as a millionth moves it, a little more or less leads elsewhere
            if (self._slope**2 / np.abs(2 * self._curve) < np.abs(missing / change) * little).any():
                raise self._error(which)
            for last in (False, True) if known is None else ():
                later -= float(missing[0] / self._slope[0]) if missing[0] else 0.0
                if last and len(missing) == 1:
                    return later
                missing = self._missing(values, x, later)
            apart = np.abs(missing) > _TOGETHER * np.abs(self._slope) * max(abs(later), ROUNDING * abs(at.time))
        if apart.any():
            raise self._coincides(which)
        return later

    def _along_with(self, which: int, change: float) -> float:
        """Return how much later the instant before happens, where functions still vanish together with it.

        They miss that by squares of the change, as the places are linear in it: what has its sign is looked at.
        """
        at, later, sides = self._at, change * float(self._along[which]), []
        for sign in (-1.0, 1.0):
            self._around.recall(self._around.change(which, sign * change), at.base)
            x = at.x + sign * change * at.by[which]
            sides.append(self._missing(self._around.dynamics.heights(), x, sign * later))
        most = _TOGETHER * np.abs(self._slope) * max(abs(later), ROUNDING * abs(at.time))
        if (np.abs(sides[1] - sides[0]) / 2 > most).any():
            raise self._coincides(which)
        return later

    def _coincides(self, which: int) -> ModelError:
        name, time = self._around.directions[which].name, self._at.time
        return refused(
            f"what happens at t = {time:.6g} s ({self.said}) happens at one instant only for this value of '{name}'"
        )

    def _missing(self, values: Heights, x: np.ndarray, later: float) -> np.ndarray:
        """Return by how much functions miss what they were at the instant, so much later."""
        return values(np.array([self._at.time + later]), self._moved(later, x)[None])[0, self._roots] - self._zero

    def _moved(self, later: float, x: np.ndarray) -> np.ndarray:
        """Return the states (n,) so much later; those that are moved along with the instant are there."""
        return x + later * self._f + later**2 / 2 * self._bend if self._along is None else x
