"""What is around an instant at which something happens: it is repeated with other values, and near misses are found.

Where a function of an event comes near zero between two instants without crossing it, a little more of a quantity may
make it cross: the motion grazes, and has no derivative there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.messages.diagnostics import ModelError
from lmoc.numerics.events.occasion import Occasion
from lmoc.numerics.problem.status import Status
from lmoc.numerics.run.sensitivities import Direction, Tangent, at_output, refused
from lmoc.numerics.run.tangents import Tangents

OVER_EVENTS = 1e-5  # of a quantity's size, of differences over an event: their error is some 1e-10
LITTLE = 1e-6  # of a quantity's size: within the way of a function by that the motion grazes
_LOW = 1e-3  # of its largest value, below which a function is looked at closely
_AT_ENDS = 1e-4  # of a segment, where what has just happened does not count
_AT_END = 1e-9  # share of the time within which it is not known whether something happens at the end
_CLOSER = np.linspace(-1.0, 1.0, 9)  # of the distance of places around one, where it is looked at closely


class Surroundings:
    """What is around the instant at which a segment ends: the same events and laws with other values.

    Attributes
    ----------
    occasion, directions : as given
    sizes : (n,) of the states
    since, room : s, the instant before, and the time since then
    rates : (m, flat.count) derivatives of the parameter values
    changing : registers that an instant may change: discrete variables, and modes of laws
    """

    def __init__(self, occasion: Occasion, directions: Sequence[Direction], sizes: np.ndarray, since: float) -> None:
        self.occasion, self.directions, self.sizes = occasion, directions, sizes
        self.dynamics, memory, reduced = occasion.dynamics, occasion.memory, occasion.memory.plan.reduced
        self.time = occasion.outcome.time
        self.since, self._between = since, (since + self.time) / 2
        self.room = self.time - since
        self.rates = np.stack([d.rates if d.is_parameter else np.zeros(len(memory.values)) for d in directions])
        self._discrete, self._push, self._held = (np.zeros(0, int) for _ in range(3))
        if reduced.flat.events is not None:
            self._discrete = reduced.register_of[reduced.flat.events.discrete]
        if memory.laws is not None:
            form = reduced.switched
            self._push = reduced.register_of[form.push]
            held = form.modes
            self._held = reduced.register_of[held]
        changing = np.concatenate([self._discrete, self._held])
        self.changing = changing[changing >= 0]

    def change(self, which: int, by: float) -> np.ndarray:
        """Return the changes (m,) in which one quantity is another."""
        found = np.zeros(len(self.directions))
        found[which] = by
        return found

    def recall(self, change: np.ndarray | None = None, base: np.ndarray | None = None) -> None:
        """Have events and laws be as they were before the instant, with some quantities changed.

        Parameters
        ----------
        change : (m,) by how much; None for nothing
        base : (m, registers) the derivatives of what does not change between events
        """
        memory, discrete = self.occasion.memory, np.zeros(len(self._discrete))
        values, held = memory.values, memory.open
        push = np.zeros(0) if memory.laws is None else memory.push
        if change is not None and base is not None:
            own = change @ base
            push, discrete = push + own[self._push], own[self._discrete]
            own[self._held] = 0.0
            held, values = held + own, values + change @ self.rates
        self.dynamics.recall(memory, values, held, push, discrete, self._between)

    # ------------------------------------------------------------------ what comes near

    def check(
        self,
        begin: float,
        times: np.ndarray,
        states: np.ndarray,
        tangents: np.ndarray,
        base: np.ndarray,
        sweep: Tangents,
    ) -> None:
        """See that no function of an event comes near zero on the way without crossing it.

        Parameters
        ----------
        begin : s, of the segment
        times, states, tangents : (k,), (k, n), (m, k, n) along it, to its end

        Raises
        ------
        ModelError
            E0575: one does.
        """
        inside = np.abs(times - (begin + times[-1]) / 2) < (0.5 - _AT_ENDS) * (times[-1] - begin)
        if inside.sum() < 3:  # noqa: PLR2004  (a lowest one between two others)
            return
        self.recall()
        times, states, tangents = times[inside], states[inside], tangents[:, inside]
        heights = np.abs(self.dynamics.heights()(times, states))
        middle, most = heights[1:-1], heights.max(axis=0)
        bend = heights[2:] - 2 * middle + heights[:-2]
        with np.errstate(all="ignore"):
            lowest = middle - np.where(bend > 0, (heights[2:] - heights[:-2]) ** 2 / (8 * bend), 0.0)
        low = (middle <= heights[2:]) & (middle <= heights[:-2]) & (lowest <= _LOW * most)
        for place, root in zip(*np.nonzero(low), strict=True):
            near = slice(place, place + 3)
            self._check_near(root, times[near], states[near], tangents[:, place + 1], base, sweep)

    def _check_near(
        self, root: int, times: np.ndarray, states: np.ndarray, by: np.ndarray, base: np.ndarray, sweep: Tangents
    ) -> None:
        """Look closely at where a function is low, among three places."""
        t, x = float(times[1]), states[1]
        f, aside = sweep.rates(t, x), (times[2] - times[0]) / 2
        bend = (sweep.rates(times[2], states[2]) - sweep.rates(times[0], states[0])) / (times[2] - times[0])
        self.recall()
        values = self.dynamics.heights()
        for _ in range(6):
            later = aside * _CLOSER
            around = x + later[:, None] * f + later[:, None] ** 2 / 2 * bend
            heights = np.abs(values(t + later, around)[:, root])
            own = int(heights.argmin())
            t, x, f, aside = t + later[own], around[own], f + later[own] * bend, aside / 4
        for k, direction in enumerate(self.directions):
            moved = []
            step = OVER_EVENTS * direction.size
            for sign in (-1, 1):
                self.recall(self.change(k, sign * step), base)
                moved.append(self.dynamics.heights()(np.array([t]), (x + sign * step * by[k])[None])[0, root])
            if heights[own] < LITTLE * direction.size * abs(moved[1] - moved[0]) / (2 * step):
                raise self.grazes(k, t, "")

    def check_end(self, at: Tangent, sweep: Tangents, rtol: float) -> None:
        """Refuse an end of the run at which a function of an event vanishes, as it would a little earlier or later.

        Parameters
        ----------
        at : where the run ends
        rtol : relative tolerance of the run, within which that is known
        """
        if self.occasion.outcome.status is Status.ROOT:  # the model has ended the run there
            return
        self.recall()
        t, x, f = at.time, at.x, sweep.rates(at.time, at.x)
        short = _AT_ENDS * self.room or _AT_ENDS * max(abs(t), 1.0)
        before, now = np.abs(self.dynamics.heights()(np.array([t - short, t]), np.stack([x - short * f, x])))
        near = now <= max(rtol, _AT_END) * max(abs(t), self.room) * np.abs(before - now) / short
        for k, direction in enumerate(self.directions if near.any() else ()):
            step, sides = OVER_EVENTS * direction.size, []
            for sign in (-1, 1):
                self.recall(self.change(k, sign * step), at.base)
                sides.append(self.dynamics.heights()(np.array([t]), (x + sign * step * at.by[k])[None])[0])
            if (np.abs(sides[1] - sides[0])[near] > _AT_END * np.abs(before - now)[near]).any():
                raise at_output(direction.name, t, "")

    def grazes(self, which: int, time: float, what: str) -> ModelError:
        """Return the error that says that there is no derivative."""
        told = f" ({what})" if what else ""
        return refused(
            f"at t = {time:.6g} s{told} the motion has no derivative by '{self.directions[which].name}': it grazes, "
            "or a mode is on its edge",
            "a value a little larger or smaller leads to another sequence of events",
        )

