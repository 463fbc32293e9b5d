"""The discrete side of a run: values of discrete variables, and the iteration at an event.

At an event the values ``pre(v)`` are fixed and all equations are solved: the continuous ones for given discrete values,
the discrete ones in their order for given continuous values, in turn until nothing changes. Then ``pre(v) := v``, and
again, until no event follows (Modelica specification 3.6, 8.6 and appendix B).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.expression.evaluate import evaluate
from lmoc.ir.flat import FlatDAE
from lmoc.ir.reduced import DiscreteStep
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.events.trials import NOISES, prefer_regular, try_relations
from lmoc.numerics.limits import ULP
from lmoc.numerics.observe.one_state import moved as moved_to
from lmoc.numerics.observe.one_state import why_not
from lmoc.numerics.signals.signals import Signal
from lmoc.support.records import dataclass

ROUNDING = 1e-14  # of a function's magnitude; the dense output of a step is no more exact
_ZERO = 1e-10  # of the largest values: what is smaller may be a zero with rounding
_ROUNDS = 100  # of solving at one instant, and of events that follow each other at it


class Unsettled(Exception):
    """No values of the discrete variables satisfy all equations, or events follow each other without end.

    Attributes
    ----------
    variables : those that keep changing
    """

    def __init__(self, variables: np.ndarray) -> None:
        super().__init__()
        self.variables = variables


class NotAState(Exception):
    """A `reinit` of a variable that does not follow from one state alone, or not so far.

    Attributes
    ----------
    variable : which
    followed : (k,) indices of the states that it follows from
    """

    def __init__(self, variable: int, followed: np.ndarray) -> None:
        super().__init__()
        self.variable, self.followed = variable, followed

    def reason(self, layout: EventLayout) -> str:
        """Return why the `reinit` has failed, with its line."""
        name = layout.flat.variable_name(self.variable)
        span = next(r.span for r in layout.events.reinits if self.variable in r.target)
        why = why_not(self.followed, layout.plan.reduced.state_names)
        return f"'{name}' cannot be given a new value by reinit ({span.source.name}, line {span.line}): {why}"


@dataclass(frozen=True, eq=False)
class Happened:
    """The effect of an event.

    Attributes
    ----------
    x : states behind it
    whens : (when-clause, row) of each branch that was carried out, in order
    terminations : those whose guard was true
    broken : (check of the flat model, row) of those that belong to events and did not hold
    """

    x: np.ndarray
    whens: tuple[tuple[int, int], ...]
    terminations: tuple[int, ...]
    broken: tuple[tuple[int, int], ...]


class DiscreteState:
    """Values of the discrete variables, and how they change.

    Attributes
    ----------
    v : (flat.count,) values of all variables as last looked at
    base : (layout.count,) registers that do not change between events
    zero : (zeros,) values of the zero functions as last looked at
    """

    def __init__(
        self, layout: EventLayout, values: np.ndarray, base: np.ndarray, signals: Mapping[int, Signal], time: float
    ) -> None:
        self.layout, self.signals, self.time = layout, signals, time
        self.v = initial_values(layout.flat, values)
        self.base = np.concatenate([base, np.full(layout.count - len(base), np.nan)])
        self.zero = np.zeros(layout.zero_count)
        # what a function that has just crossed zero may come back by rounding, and its largest magnitude since
        self.margin, self.largest = np.zeros(layout.zero_count), np.zeros(layout.zero_count)
        # (t, x, ways of the states, discrete values, rounding)
        self._known: tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None
        self._begun = time
        self._token = object()  # stands for this run
        self._looked: tuple[tuple[float, bytes], np.ndarray, np.ndarray] | None = None  # place, and what is seen there
        self.literal = True  # relations of time are taken as they are written, not as what they are right behind
        self.supposed: np.ndarray | None = None  # mask of relations whose values are being tried
        self.early: frozenset[int] = frozenset()  # relations that are then taken as what they were right before
        self.remember()

    def adopt(self, layout: EventLayout, base: np.ndarray) -> None:
        """Look at the same variables through another plan."""
        self.layout, self._known, self._looked = layout, None, None
        self.base = np.concatenate([base, np.full(layout.count - len(base), np.nan)])

    # ----------------------------------------------------------------------- looking

    def push(self) -> None:
        """Pass the discrete values on to the continuous equations."""
        layout = self.layout
        self.base[layout.registers] = self.v[layout.events.discrete]
        now = self._token, self.base[layout.given].tobytes()
        if now == layout.prepared:
            return
        layout.prepared, self._looked = now, None
        layout.zeros.prepare(self.base, self.signals)
        layout.values.prepare(self.base, self.signals)

    def look(self, t: float, x: np.ndarray) -> None:
        """Take the continuous values at a place."""
        self.time = t
        place, layout = (t, x.tobytes()), self.layout
        if self._looked is None or self._looked[0] != place:
            self._looked = place, layout.values(t, x).copy(), layout.zeros(t, x).copy()
        _, self.v[layout.seen], self.zero = self._looked
        self._widen(t, x)

    def _widen(self, t: float, x: np.ndarray) -> None:
        """Set the margins of functions that are zero but for rounding: a relation does not react to that.

        The acceleration of a wheel at rest behind open clutches is a sum that cancels, 1e-15 or −2e-15, as it comes.
        What is zero without a sum has no rounding, and no margin: the force between two teeth in their play.
        """
        height = np.abs(self.zero)
        near = self._may_be_rounding(t, x, height) & ((height > 0) | (self.margin > 0))
        if not near.any():
            return
        rounding = self.rounding(t, x)
        margin = np.where((height == 0) & (rounding == 0), 0.0, np.fmax(self.margin, NOISES * rounding))
        near &= height <= margin
        self.margin[near] = margin[near]

    def _may_be_rounding(self, t: float, x: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Return which functions are so small that their rounding is worth a look, (zeros,)."""
        size = max(1.0, float(np.abs(x).max(initial=0.0)), float(np.abs(self.zero).max(initial=0.0)))
        terms = np.zeros(len(height)) if self._known is None else self._known[4] / ULP
        return (height <= _ZERO * np.fmax(terms, size)) & ~self.layout.rounded

    def rounding(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return bounds for the rounding of the zero functions, (zeros,).

        A state is off by a digit of itself or of its way, whatever number it has come to, and by what the rounding of
        its rate has added up to. Bounds found last are kept as long as the discrete values that they depend on are the
        same, the time and the largest state have not doubled or halved, and no state is twice as far as it has gone.
        """
        discrete = self.v[self.layout.rounded_by]
        if self._known is not None:
            known_t, known_x, known_way, known_discrete, found = self._known
            grown = abs(t) > 2.0 * abs(known_t) or bool((np.abs(x) > 2.0 * known_way).any())
            shrunk = 2.0 * abs(t) < abs(known_t) or 2.0 * np.abs(x).max(initial=0.0) < np.abs(known_x).max(initial=0.0)
            if not (grown or shrunk) and np.array_equal(discrete, known_discrete, equal_nan=True):
                return found
        w, plan = self.registers(t, x), self.layout.plan
        count, passed = self.layout.zero_count, t - self._begun
        rates = _finite(self.layout.rounding(w, t))[count:]
        way = _finite(np.fmax(np.abs(x), passed * np.abs(w[plan.derivatives]))) if passed > 0 else np.zeros(len(x))
        found = _finite(self.layout.rounding(w, t, (plan.states, ULP * way + 2.0 * passed * rates)))[:count]
        self._known = t, x.copy(), np.fmax(np.abs(x), way), discrete, found
        return found

    def registers(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return (layout.count,) registers with all that is given at a place."""
        w, plan = self.base.copy(), self.layout.plan
        w[plan.states] = x
        for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
            w[register] = self.signals[variable].value(t, order)
        return w

    def quiet(self, t: float, x: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Return which root functions are zero but for rounding where they are no higher than so much, (roots,)."""
        mask = np.zeros(len(height), bool)
        mask[: self.layout.zero_count] = ~self.tells(t, x, height[: self.layout.zero_count], self.margin)
        return mask

    def tells(self, t: float, x: np.ndarray, height: np.ndarray, off: np.ndarray) -> np.ndarray:
        """Return which zero functions of so much are not zero but for rounding, and what else they may be off."""
        height = height - off
        near = self._may_be_rounding(t, x, height)
        return (height > NOISES * self.rounding(t, x)) | ~near if near.any() else ~near

    def remember(self) -> None:
        """``pre(v) := v``."""
        now, before = self.layout.events.before
        self.v[before] = self.v[now]

    # ----------------------------------------------------------------- discrete equations

    def assign(self) -> None:
        """Carry out the discrete equations in their order."""
        for step in self.layout.plan.reduced.discrete:
            if step.relation < 0:
                self.v[step.target] = self.values(step.value, step.slots)
            else:
                found = self._relation(step)
                self.v[step.target] = found if self.supposed is None else self._unless_supposed(step, found)

    def suppose(self, register_of: np.ndarray, w: np.ndarray) -> None:
        """Take the relations as they are elsewhere, and what follows from them.

        Parameters
        ----------
        register_of, w : the registers there, and which holds which variable
        """
        targets = np.concatenate([np.zeros(0, int), *(r.target for r in self.layout.events.relations)])
        values = w[register_of[targets]]
        known = (register_of[targets] >= 0) & np.isfinite(values)
        self.v[targets[known]] = values[known]
        self.supposed = np.zeros(len(self.v), bool)
        self.supposed[targets] = True
        self.assign()
        self.supposed = None

    def _unless_supposed(self, step: DiscreteStep, found: np.ndarray) -> np.ndarray:
        return np.where(self.supposed[step.target], self.v[step.target], found)

    def values(self, shape: Expr, table: np.ndarray) -> np.ndarray:
        """Return an expression for all rows of a table of variables."""
        result = evaluate(shape, lambda k, _: self.v[table[:, k]], self.time)
        return np.broadcast_to(np.asarray(result, float), (len(table),))

    def _relation(self, step: DiscreteStep) -> np.ndarray:
        rows = self.layout.zero_row[self.layout.first[step.relation] + step.rows]
        if len(rows) and rows[0] >= 0:
            return self._decided(step.op, rows, self.v[step.target])
        if not self.literal:
            return self._timed(step, 1.0)
        if step.relation in self.early:
            return self._timed(step, -1.0)
        return decide(step.op, self.values(step.value, step.slots))

    def _decided(self, op: str, zeros: np.ndarray, now: np.ndarray) -> np.ndarray:
        """Return relations from their zero functions; those within the margin of a crossing stay as they are now."""
        zero, margin = self.zero[zeros], self.margin[zeros]
        beside = np.maximum(now - zero, zero - now - 1.0) if op == "floor" else np.abs(zero)
        return np.where(beside < margin, now, decide(op, zero))

    def differs(self, zeros: np.ndarray) -> np.ndarray:
        """Return which zero functions, as last looked at, ask for another value than their relations have."""
        ops = [self.layout.relation_at(k).op for k in zeros.tolist()]
        now = self.v[self.layout.zero_target[zeros]]
        asked = [self._decided(op, zeros[i : i + 1], now[i : i + 1])[0] for i, op in enumerate(ops)]
        return np.array(asked, float) != now

    def _timed(self, step: DiscreteStep, side: float) -> np.ndarray:
        """Return a relation of time as it is right behind the present time, side = 1, or right before it, −1."""
        slope, offset = self.line(step.relation, step.slots)
        with np.errstate(all="ignore"):
            zero, near = slope * self.time + offset, np.abs(slope) * near_to(self.time)
        nearest = np.round(zero) if step.op == "floor" else np.zeros(len(zero))
        behind = nearest + side * np.sign(slope) * 0.5  # any value on the side to which it goes
        return decide(step.op, np.where((np.abs(zero - nearest) <= near) & (slope != 0), behind, zero))

    def line(self, relation: int, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return slope and offset of a relation of time."""
        timed = next(t for t in self.layout.timed if t.relation == relation)
        return self.values(timed.slope, table), self.values(timed.offset, table)

    # --------------------------------------------------------------------------- events

    def solve(self, t: float, x: np.ndarray) -> None:
        """Find discrete values that agree with the continuous ones.

        Solved in turn, as long as that leads somewhere. Where the values repeat each other (a friction that would start
        forward if it were stuck, and backward if it slid), those of the relations that flip are tried.

        Raises
        ------
        Unsettled
        """
        discrete = self.layout.events.discrete
        begun, seen = self.v.copy(), set()
        flipped = np.zeros(len(self.v), bool)
        while len(seen) < _ROUNDS:
            changed = self.turn_once(t, x)
            if not changed.any():
                return prefer_regular(self, t, x, begun)
            flipped[discrete[changed]] = True
            key = self.v[discrete].tobytes()
            if key in seen:
                break
            seen.add(key)
        if not try_relations(self, t, x, begun, flipped):
            raise Unsettled(discrete[changed])

    def turn_once(self, t: float, x: np.ndarray) -> np.ndarray:
        """Solve once for the continuous values, then for the discrete ones; (discrete,) which have changed."""
        discrete = self.layout.events.discrete
        self.push()
        self.look(t, x)
        before = self.v[discrete].copy()
        self.assign()
        return differ(before, self.v[discrete])

    def event(self, t: float, x: np.ndarray, begin: Callable[[], object]) -> Happened:
        """Carry out everything that happens at an instant.

        Parameters
        ----------
        begin : called when the values before the event have been kept, to set what the event itself changes

        Raises
        ------
        Unsettled, NotAState
        """
        events = self.layout.events
        whens: list[tuple[int, int]] = []
        ended: list[int] = []
        broken: list[tuple[int, int]] = []
        now, before = events.before
        held = np.isin(now, events.discrete)
        self.push()
        self.look(t, x)
        for k in range(_ROUNDS):
            self.remember()
            if k == 0:
                begin()
            self.solve(t, x)
            for number, when in enumerate(events.whens):
                whens += [(number, row) for row in np.flatnonzero(self.v[when.active]).tolist()]
            ended += [k for k, e in enumerate(events.terminations) if self.values(e.guard, e.slots).any()]
            for number, check in enumerate(self.layout.flat.checks):
                if check.at_events:
                    fails = self.values(check.condition, check.slots) == 0
                    broken += [(number, row) for row in np.flatnonzero(fails)[:1].tolist()]
            moved = self._reinit(t, x)
            for samples in events.samples:
                self.v[samples.target] = 0.0
            changed = held & differ(self.v[now], self.v[before])
            if moved is None and not changed.any():
                return Happened(x, tuple(dict.fromkeys(whens)), tuple(ended), tuple(dict.fromkeys(broken)))
            x = x if moved is None else moved
            self.push()
            self.look(t, x)
        raise Unsettled(now[changed] if changed.any() else np.concatenate([r.target for r in events.reinits]))

    def _reinit(self, t: float, x: np.ndarray) -> np.ndarray | None:
        """Return the states with the values that `reinit` gives them; None where it gives none."""
        moved = None
        for r in self.layout.events.reinits:
            active = np.flatnonzero(self.v[r.guard])
            if not len(active):
                continue
            moved = x.copy() if moved is None else moved
            value = self.values(r.value, r.slots[active])
            for variable, wanted in zip(r.target[active].tolist(), value.tolist(), strict=True):
                self._set(t, x, moved, variable, wanted)
        return moved

    def _set(self, t: float, x: np.ndarray, moved: np.ndarray, variable: int, wanted: float) -> None:
        """Change the state that a variable is, or the one that it follows from."""
        plan = self.layout.plan
        at = np.flatnonzero(plan.states == plan.reduced.register_of[variable])
        if len(at):
            moved[at[0]] = wanted
            return
        k = int(np.searchsorted(self.layout.seen, variable))
        if k == len(self.layout.seen) or self.layout.seen[k] != variable:
            raise NotAState(variable, np.zeros(0, int))
        found = moved_to(lambda states: float(self.layout.values(t, states)[k]), x, wanted)
        if found.x is None:
            raise NotAState(variable, found.followed)
        own = found.followed[0]
        moved[own] = found.x[own]

    # ---------------------------------------------------------------------------- roots

    def turn(self, zeros: np.ndarray, upwards: np.ndarray) -> None:
        """Let relations change whose functions are about to cross zero, or the next whole number.

        Parameters
        ----------
        upwards : of rounded ones, whether to the number above
        """
        targets = self.layout.zero_target[zeros]
        now = self.v[targets]
        self.v[targets] = np.where(self.layout.rounded[zeros], now + np.where(upwards, 1.0, -1.0), 1.0 - now)
        height = np.maximum(2.0 * self._height(self.zero), ROUNDING * self.largest)[zeros]
        self.margin[zeros] = np.maximum(self.margin[zeros], height)

    def crossed(self, zeros: np.ndarray) -> None:
        """Take note that functions have crossed zero: until they have left it, rounding does not bring them back."""
        height = self._height(self.zero)
        self.margin[height > self.margin] = 0.0
        self.margin[zeros] = np.maximum(ROUNDING * self.largest, self.margin)[zeros]
        self.largest[zeros] = 0.0

    def _height(self, zero: np.ndarray) -> np.ndarray:
        """Return the distances of functions from zero, of rounded ones from the nearest whole number."""
        return np.abs(np.where(self.layout.rounded, zero - np.round(zero), zero))

    @property
    def crossing(self) -> np.ndarray:
        """(2, zeros) the margins of functions that have just crossed zero, and their largest magnitudes since."""
        return np.stack([self.margin, self.largest])

    @crossing.setter
    def crossing(self, value: np.ndarray) -> None:
        if value.shape == (2, len(self.margin)):  # else the functions are others
            self.margin, self.largest = value[0].copy(), value[1].copy()

    def signs(self) -> np.ndarray:
        """Return the sides on which the root functions stand, ±1."""
        layout = self.layout
        value = self.v[layout.zero_target]
        sign = self._side = np.where(value > 0, 1.0, -1.0)
        return np.concatenate([np.where(layout.rounded, 1.0, sign), np.ones(int(layout.rounded.sum()))])

    def roots(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the functions whose change of sign is an event: the zero functions; of a rounded one both edges."""
        layout = self.layout
        zero = np.array([layout.zeros(float(t), x).copy() for t, x in zip(times, states, strict=True)])
        margin = self.margin.copy()
        self.margin[self._height(zero).max(axis=0) > 100 * margin] = 0.0  # it has left zero, whatever comes
        self.largest = np.fmax(self.largest, np.abs(zero).max(axis=0))
        if not layout.rounded.any():
            return zero + self._side * margin
        step = np.where(layout.rounded, self.v[layout.zero_target], 0.0)
        lower = zero - step + np.where(layout.rounded, 1.0, self._side) * margin
        return np.concatenate([lower, (step + 1.0 - zero + margin)[:, layout.rounded]], axis=1)


def initial_values(flat: FlatDAE, values: np.ndarray) -> np.ndarray:
    """Return the values (flat.count,) of parameters with those that discrete variables begin with."""
    found, discrete = values.copy(), flat.events.discrete
    found[discrete] = 0.0
    for a in flat.starts:
        own = np.isin(a.target, discrete)
        if own.any():
            found[a.target[own]] = a.values(values)[own]
    return found


def differ(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return where two arrays differ; what is no number is like itself."""
    return (a != b) & ~(np.isnan(a) & np.isnan(b))


def _finite(value: np.ndarray) -> np.ndarray:
    """Return an array with zeros for what is no finite number."""
    return np.nan_to_num(value, nan=0.0, posinf=0.0)


def decide(op: str, zero: np.ndarray) -> np.ndarray:
    """Return the value of a relation from that of its function."""
    if op == "floor":
        return np.floor(zero)
    return (zero > 0 if op == "gt" else zero >= 0).astype(float)


def near_to(t: float) -> float:
    """Return a distance in time that does not count: some units of the last digit."""
    return 4e-15 * max(abs(t), 1e-300)


def located(t: float, start: float) -> float:
    """Return by what the place of a root may be wrong: some units of the time's last digit, and of a sum of steps."""
    return 1e-14 * max(abs(t), abs(start)) + 1e-12 * (t - start)
