"""The discrete side of a run: values of discrete variables, and the iteration at an event.

At an event the values ``pre(v)`` are fixed and all equations are solved: the continuous ones for given discrete values,
the discrete ones in their order for given continuous values, in turn until nothing changes. Then ``pre(v) := v``, and
again, until no event follows (Modelica specification 3.6, 8.6 and appendix B).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.engine.instant import Instant
from lmoc.engine.kernel import Kernel
from lmoc.engine.step_functions import Watched
from lmoc.expression.dag import Expr
from lmoc.expression.evaluate import evaluate
from lmoc.ir.flat import Kind
from lmoc.numerics.evaluate.function import watched
from lmoc.numerics.events.happened import NotAState
from lmoc.numerics.events.layout import EventLayout, initial_values
from lmoc.numerics.events.stiff_states import at_once, going_back
from lmoc.numerics.events.tables import PlanTables
from lmoc.numerics.events.trials import Trial, prefer_regular, surely_off
from lmoc.numerics.limits import ULP
from lmoc.numerics.observe.one_state import moved as moved_to
from lmoc.numerics.observe.one_state import places_under
from lmoc.numerics.signals.signals import Signal

_FORGIVEN = 1e-10  # of the largest state: what states may be off by without being asked whether they forget it
_ASKED = 64  # states that are asked at once
_OF_BOUNDS = ("bound", "way", "known", "bound_time", "bound_size", "bound_known")
_REMEMBERED = ("v", "zero", "margin", "largest", "high", "crossed", "early")


class DiscreteState:
    """Values of the discrete variables, and how they change: in C (``engine/c/instant.h``), on the memory here.

    Attributes
    ----------
    instant : what C works on
    v : (flat.count,) values of all variables as last looked at
    base : (layout.count,) registers that do not change between events
    zero : (zeros,) values of the zero functions as last looked at
    margin : (zeros,) by which a function that has just crossed zero, or is zero but for rounding, may miss it
    """

    instant: Instant
    v: np.ndarray
    zero: np.ndarray
    margin: np.ndarray

    def __init__(
        self, layout: EventLayout, values: np.ndarray, base: np.ndarray, signals: Mapping[int, Signal], time: float
    ) -> None:
        self.signals, self._begun = signals, time
        self._recalled: Mapping[str, np.ndarray] | None = None
        self._parameters: np.ndarray | None = None  # where they stand, once asked for
        self._bounds: list[tuple[np.ndarray, np.ndarray]] = []  # that have been asked for at what is recalled
        self._asked = 0
        self.trial: Trial | None = None  # that is being made
        self._bind(layout, base, initial_values(layout.flat, values))
        self.time, self.literal = time, True
        self.remember()

    def _bind(self, layout: EventLayout, base: np.ndarray, values: np.ndarray) -> None:
        """Take the memory for a plan, with the values (flat.count,) of all variables."""
        self.layout, own = layout, layout.plan.once(PlanTables)
        self.base = np.concatenate([base, np.full(layout.count - len(base), np.nan)])
        self._own, plan = own, layout.plan
        self.instant = e = Instant(own.tables.columns, len(plan.states), (own.assign, own.lines))
        e.fill(values)
        self.v, self.zero, self.margin = e.v[: len(values)], e.zero, e.margin
        self._pushed: bytes | None = None
        self._moving: bytes | None = None  # what `motion` has been made ready for
        self._bind_zeros = layout.zeros.binder()
        self._view: Kernel | None = None
        self._along: Kernel | None = None
        if layout.view is None:
            self._bind_values = layout.values.binder()
            e.ask("look", self._look)
        else:
            zeros, seen = plan.count + np.arange(layout.zero_count), plan.reduced.register_of[layout.seen]
            registers = plan.states, layout.registers, zeros, plan.derivatives
            own = e.view(layout.view, registers, np.stack([seen, layout.seen]), layout.moving)
            self._view, self._along = own[0], None if layout.moving is None else own[1]
        e.ask("bounds", self._find_bounds)
        if layout.switching:
            e.ask("regular", lambda t, x: prefer_regular(self, t, x))
        e.ask_to_move(self._move)

    def adopt(self, layout: EventLayout, base: np.ndarray) -> None:
        """Look at the same variables through another plan."""
        before, time = self.instant, self.time
        literal, values = self.literal, self.v.copy()
        self._bind(layout, base, values)
        for name in ("zero", "margin", "largest"):
            getattr(self.instant, name)[:] = getattr(before, name)
        self.time, self.literal = time, literal

    def memory(self) -> dict[str, np.ndarray]:
        """Return what decides about the next instant, for `recall`."""
        return {name: getattr(self.instant, name).copy() for name in _REMEMBERED}

    @property
    def in_c(self) -> list[tuple[int, int]]:
        """Return what decides about the next instant, for who goes on in C: addresses, and how many numbers."""
        return self.instant.memory(*_REMEMBERED, *_OF_BOUNDS, "time")

    def forget(self) -> None:
        """C has gone through events without this: what it knows stands elsewhere, and what has failed is repeated."""
        self._pushed = self._moving = None
        self.instant.forgive()

    def recall(self, memory: Mapping[str, np.ndarray], values: np.ndarray, change: np.ndarray) -> None:
        """Be as it was before an instant, with other values.

        Parameters
        ----------
        values : (flat.count,) of parameters
        change : (discrete,) what is added to the discrete values
        """
        e, flat, discrete = self.instant, self.layout.flat, self.layout.events.discrete
        if memory is not self._recalled:
            self._recalled, self._bounds = memory, []
        self._asked = 0
        for name, value in memory.items():
            getattr(e, name)[:] = value
        if self._parameters is None:
            self._parameters = np.flatnonzero(flat.kind[: len(values)] < Kind.INPUT)
        e.give(self._parameters, values[self._parameters])
        self.v[discrete] += change
        e.data.bound_known = 0
        self._pushed = None

    @property
    def time(self) -> float:
        """s, for which the discrete equations are solved."""
        return float(self.instant.data.time)

    @time.setter
    def time(self, value: float) -> None:
        self.instant.data.time = value

    @property
    def literal(self) -> bool:
        """Whether relations of time are taken as they are written, not as what they are right behind."""
        return bool(self.instant.data.literal)

    @literal.setter
    def literal(self, value: bool) -> None:
        self.instant.data.literal = int(value)

    def take_early(self, rows: np.ndarray) -> None:
        """Have relations of time be what they were right before, as long as others are taken as they are written."""
        self.instant.early[rows] = 1.0

    # ----------------------------------------------------------------------- looking

    def push(self) -> None:
        """Pass the discrete values on to the continuous equations."""
        layout = self.layout
        self.base[layout.registers] = self.v[layout.events.discrete]
        now = self.base[layout.given].tobytes()
        if now == self._pushed and self._view is not None:  # slices are shared: what was bound last counts
            return
        self._pushed = now
        self._zeros = self._bind_zeros(self.base, self.signals)
        if self._view is None:
            self._values = self._bind_values(self.base, self.signals)
            return
        self._view.w[: len(self.base)] = self.base
        self._view.forget()

    def look(self, t: float, x: np.ndarray) -> None:
        """Take the continuous values at a place."""
        self.inputs(t)
        self.instant.call("lmoc_take", t, x)

    def inputs(self, t: float) -> None:
        """Take the inputs at a time, where blocks are linear."""
        if self._view is not None:
            plan = self.layout.plan
            for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
                self._view.w[register] = self.signals[variable].value(t, order)

    def _look(self, t: float, x: np.ndarray) -> bool:
        """Look where blocks are nonlinear, and their solutions are followed."""
        self.push()
        times, states = np.array([t]), x[None]
        self.v[self.layout.seen], self.zero[:] = self._values(times, states)[0], self._zeros(times, states)[0]
        return True

    def seen(self, t: float, x: np.ndarray, variable: int) -> float:
        """Return a variable that the discrete equations read, at a place; nothing else is taken from there."""
        self.push()
        if self._view is None:
            k = int(np.searchsorted(self.layout.seen, variable))
            return float(self._values(np.array([t]), x[None])[0][k])
        view, plan = self._view, self.layout.plan
        self.inputs(t)
        view.w[plan.states] = x
        view(t)
        return float(view.w[plan.reduced.register_of[variable]])

    @property
    def zeros_in_c(self) -> object:
        """The same as a function of a tape, if it is one."""
        return self._zeros

    def zeros(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return (times, zeros) the zero functions at other places, for the values that have been pushed."""
        return self._zeros(times, states)

    def rounding(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return bounds for the rounding of the zero functions, (zeros,); kept as long as they hold."""
        self.instant.call("lmoc_rounding", t, x)
        return self.instant.bound

    def _find_bounds(self, t: float, x: np.ndarray) -> bool:
        """Bound the rounding of the zero functions.

        A state is off by a digit of itself or of its way, whatever number it has come to, and by what the rounding of
        its rate has added up to. Where an instant is repeated with other values they are those of the first time.
        """
        e, known = self.instant, self._recalled is not None and self._asked < len(self._bounds)
        if known:
            e.bound[:], e.way[:] = self._bounds[self._asked]
        elif self.trial is None or not surely_off(self, self.trial):
            self._find_new_bounds(t, x)
        if self._recalled is not None:
            self._asked += 1
            self._bounds += [] if known else [(e.bound.copy(), e.way.copy())]
        return True

    def _find_new_bounds(self, t: float, x: np.ndarray) -> None:
        w, plan = self.registers(t, x), self.layout.plan
        count, passed = self.layout.zero_count, t - self._begun
        rates = _finite(self.layout.rounding(w, t))[count:]
        way = _finite(np.fmax(np.abs(x), passed * np.abs(w[plan.derivatives]))) if passed > 0 else np.zeros(len(x))
        off = self._remembered(w, t, rates, ULP * way + 2.0 * passed * rates)
        self.instant.bound[:] = _finite(self.layout.rounding(w, t, (plan.states, off)))[:count]
        self.instant.way[:] = way

    def _remembered(self, w: np.ndarray, t: float, rates: np.ndarray, off: np.ndarray) -> np.ndarray:
        """Return by how much states are off that may be off by so much, without what they have forgotten.

        Where a state that is off goes back by itself (a stiff damper), its error is what its rate is off by in the
        time that this takes: not what has been added up since the start. Few are asked, where it is worth a look.
        """
        states = self.layout.plan.states
        some = np.flatnonzero(off > _FORGIVEN * np.abs(w[states]).max(initial=0.0))
        some = some[np.argsort(-off[some], kind="stable")[: min(_ASKED, at_once(self.layout))]]
        if not len(some):
            return off
        back = going_back(self.layout, self.layout.rounding.beside(w, t, states[some], off[some]), some, off[some])
        found = off.copy()
        with np.errstate(all="ignore"):
            kept = 2.0 * rates[some] / back + ULP * np.abs(w[states[some]])
            found[some] = np.where(back > 0, np.fmin(off[some], kept), off[some])
        return found

    def registers(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return (layout.count,) registers with all that is given at a place."""
        self.base[self.layout.registers] = self.v[self.layout.events.discrete]
        w, plan = self.base.copy(), self.layout.plan
        w[plan.states] = x
        for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
            w[register] = self.signals[variable].value(t, order)
        return w

    def quiet(self, t: float, x: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Return which root functions are zero but for rounding where they are no higher than so much, (roots,)."""
        mask, count = np.zeros(len(height), bool), self.layout.zero_count
        quiet = np.zeros(count, np.uint8)
        self.instant.call("lmoc_quiet", t, x, height[:count] - self.margin, quiet)
        mask[:count] = quiet
        return mask

    def remember(self) -> None:
        """``pre(v) := v``."""
        self.instant.call("lmoc_remember")

    # ----------------------------------------------------------------- discrete equations

    def assign(self) -> None:
        """Carry out the discrete equations in their order."""
        self.instant.call("lmoc_assign")

    def assigned(self, values: np.ndarray) -> np.ndarray:
        """Return what the discrete equations make of values (flat.count,) that have been and are, (discrete,).

        Relations are among the values.
        """
        known = np.isfinite(values)
        self.v[known] = values[known]
        self.remember()
        self.supposing(np.concatenate([np.zeros(0, int), *(r.target for r in self.layout.events.relations)]))
        self.assign()
        self.supposing(None)
        return self.v[self.layout.events.discrete].copy()

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
        self.supposing(targets)
        self.assign()
        self.supposing(None)

    def supposing(self, targets: np.ndarray | None) -> None:
        """Leave relations, by their discrete variables, as they are; None: they have the values of their functions."""
        self.instant.data.supposing = targets is not None
        if targets is not None:
            self.instant.supposed[:] = np.isin(self._own.tables.columns["target"], targets)

    def values(self, shape: Expr, table: np.ndarray) -> np.ndarray:
        """Return an expression for all rows of a table of variables."""
        result = evaluate(shape, lambda k, _: self.v[table[:, k]], self.time)
        return np.broadcast_to(np.asarray(result, float), (len(table),))

    # --------------------------------------------------------------------------- events

    def stand_at(self, t: float) -> None:
        """Be ready for an instant."""
        self.push()
        self.inputs(t)
        self._moving = None  # slices are shared
        if self._along is not None:
            self._along.w[: len(self.base)] = self.base
            self._along.forget()

    def unsettled(self) -> np.ndarray:
        """Return variables that keep changing, where no values satisfy all equations."""
        events, changed = self.layout.events, self.instant.changed > 0
        now, before = events.before
        keeps = np.isin(now, events.discrete) & (self.v[now] != self.v[before])
        targets = [events.discrete[changed], now[keeps], *(r.target for r in events.reinits)]
        return next(one for one in targets if len(one))

    def _move(self, x: np.ndarray, reinit: int, wanted: float, moved: np.ndarray) -> bool:
        """Change the state that a variable of a `reinit` follows from."""
        t, variable = self.time, int(self._own.reinit_targets[reinit])
        if variable not in self.layout.seen:
            raise NotAState(variable, np.zeros(0, int))
        places = places_under(self.layout.plan.reduced)
        found = moved_to(lambda states: self.seen(t, states, variable), x, wanted, places)
        if found.x is None:
            raise NotAState(variable, found.followed)
        own = found.followed[0]
        moved[own] = found.x[own]
        return True

    def next_time(self, t: float, include: bool = False) -> float:
        """Return the first time event behind a time, s; infinity where there is none.

        Parameters
        ----------
        include : one at the time itself counts
        """
        return float(self.instant.call("lmoc_next_time", t, include))

    # ---------------------------------------------------------------------------- roots

    @property
    def moves_in_c(self) -> bool:
        """Return whether C looks at `motion` by itself."""
        return self._along is not None

    def motion(self, t: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rates of the states and the zero functions, with the present discrete values."""
        layout = self.layout
        self.push()
        if self._moving is not self._pushed:
            layout.rates.prepare(self.base, self.signals)
            layout.zeros.prepare(self.base, self.signals)
            self._moving = self._pushed
        return layout.rates(t, x).copy(), layout.zeros(t, x)

    @property
    def crossing(self) -> np.ndarray:
        """(2, zeros) the margins of functions that have just crossed zero, and their largest magnitudes since."""
        return np.stack([self.margin, self.instant.largest])

    @crossing.setter
    def crossing(self, value: np.ndarray) -> None:
        if value.shape == (2, len(self.margin)):  # else the functions are others
            self.margin[:], self.instant.largest[:] = value

    def signs(self) -> np.ndarray:
        """Return the sides on which the root functions stand, ±1."""
        self.push()
        sides = np.empty(self.instant.roots)
        self.instant.call("lmoc_root_sides", sides)
        return sides

    def watched(self) -> tuple[Watched, ...] | None:
        """Return `roots` for C, with the values that have been pushed; None where only Python knows them."""
        return watched(self._zeros, self.instant.roots, events=self.instant)

    def heights(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the functions of `roots` without what keeps them from being noticed twice, unlooked at.

        For the values that have been pushed.
        """
        rounded = np.flatnonzero(self.layout.rounded)
        zero, now = self._zeros(times, states), self.v[self.layout.zero_target[rounded]]
        found = np.concatenate([zero, now + 1 - zero[:, rounded]], axis=1)
        found[:, rounded] -= now
        return found

    def roots(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the functions whose change of sign is an event: the zero functions; of a rounded one both edges."""
        zero = np.ascontiguousarray(self._zeros(times, states))
        found = np.empty((len(times), self.instant.roots))
        self.instant.call("lmoc_follow", len(times), zero, found)
        return found


def differ(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return where two arrays differ; what is no number is like itself."""
    return (a != b) & ~(np.isnan(a) & np.isnan(b))


def _finite(value: np.ndarray) -> np.ndarray:
    """Return an array with zeros for what is no finite number."""
    return np.nan_to_num(value, nan=0.0, posinf=0.0)
