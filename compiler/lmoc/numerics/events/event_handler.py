"""The events of a run: when the next one comes, its effect, and its record."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from lmoc.engine.event_walk import OVER, START, TERMINAL, TIME, TOO_LOW, TOO_OFTEN, WHEN, EventWalk
from lmoc.engine.instant import SETTLED
from lmoc.expression.dag import slots
from lmoc.ir.events import Events
from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import Report, Subject
from lmoc.numerics.events.chatter import too_low, too_often, where
from lmoc.numerics.events.closeness import located, near_to
from lmoc.numerics.events.discrete_state import DiscreteState
from lmoc.numerics.events.happened import Happened, NotAState
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.events.steps import moving_relations
from lmoc.numerics.events.stiff_states import noise
from lmoc.numerics.events.trials import leave_fold
from lmoc.numerics.observe.event import Event
from lmoc.numerics.observe.trajectory import End
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import Outcome
from lmoc.numerics.problem.roots import Roots
from lmoc.numerics.problem.status import Status, Stopped
from lmoc.numerics.signals.signals import Constant, Signal

if TYPE_CHECKING:
    from lmoc.numerics.coordinates.change import RunState

_PHASE = 200.0  # rad, that a sine in a condition goes on in a step at most
_LOOKS = 120  # steps at least in a run with relations of time that are not linear in it
_SHORTLY = 1e-3  # of the run, within which a function that crosses zero again may not have left it
_KINDS = {WHEN: "when", START: "when", TIME: "time", TERMINAL: "terminal"}

Step = Callable[[float, np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # as `stepping.Stepping`
HandlerMemory = tuple[EventLayout, dict[str, np.ndarray], tuple[np.ndarray, np.ndarray, float, float], float]
Starter = Callable[[np.ndarray], np.ndarray]  # (registers that do not change) -> states at the start


def held(events: Events) -> dict[int, Signal]:
    """Return the discrete variables as inputs that stay as they are between events."""
    return {int(v): Constant(0.0) for v in events.discrete}


class _NoStart(Exception):
    """The report says why there are no states."""


class EventHandler:
    """The events of one run.

    Attributes
    ----------
    discrete : the discrete values
    records : what has happened so far
    """

    def __init__(
        self,
        plan: Plan,
        values: np.ndarray,
        base: np.ndarray,
        signals: Mapping[int, Signal],
        span: tuple[float, float],
        report: Report,
        step: Step,
    ) -> None:
        self.step = step
        self.layout = plan.once(EventLayout)
        self.discrete = DiscreteState(self.layout, values, base, signals, span[0])
        self.begin, self.end = span
        self.report = report
        self.records: list[Event] = []
        self._walk = EventWalk(self.layout.zero_count, *span)
        self._turned = span[0]  # s, of the latest event that has changed the motion
        self._bind()

    def _bind(self) -> None:
        """Go on with the memory of the discrete values."""
        flags = self.layout.events.initial, self.layout.events.terminal
        self._walk.bind(self.discrete.instant, flags, self.discrete.motion, self._happened, self._fold)

    def adopt(self, plan: Plan, base: np.ndarray, t: float, x: np.ndarray) -> None:
        """Go on in other coordinates of the same model; parameters as of `HybridDynamics.adopt`."""
        self.layout = plan.once(EventLayout)
        self.discrete.adopt(self.layout, base)
        self._bind()
        self.discrete.push()
        self.discrete.look(t, x)

    def memory(self) -> HandlerMemory:
        """Return what decides about the next instant, for `recall`."""
        return self.layout, self.discrete.memory(), self._walk.memory(), self._turned

    def recall(
        self, memory: HandlerMemory, values: np.ndarray, base: np.ndarray, change: np.ndarray, since: float
    ) -> None:
        """Be as the events were before an instant, with other values.

        Parameters
        ----------
        values : (flat.count,) of parameters
        base : registers that do not change during a run
        change : (discrete,) what is added to the discrete values
        since : s, a time between this instant and the one before it
        """
        layout, discrete, walk, self._turned = memory
        if layout is not self.layout:
            self.layout = layout
            self.discrete.adopt(layout, base)
            self._bind()
        self.discrete.base[: len(base)] = base
        self.discrete.recall(discrete, values, change)
        self._walk.recall(walk)
        self.records = []
        if np.isfinite(self.next):
            self._walk.next = self.discrete.next_time(since)

    # ------------------------------------------------------------------------ the start

    def start(self, states: Starter, initial: Mapping[str, float], near: RunState | None = None) -> np.ndarray:
        """Find states and discrete values that agree, and do what happens at the start; `near` as of `Task`.

        Raises
        ------
        Stopped
        """
        discrete, events = self.discrete, self.layout.events
        if isinstance(initial, End):
            discrete.v[events.discrete] = initial.values[events.discrete]
            self._flag(events.terminal, 0.0)
            if initial.crossing is not None:
                discrete.crossing = initial.crossing
            discrete.push()
            return self._go_on(states(discrete.base), initial)
        for name, value in initial.items():
            variables = self.layout.flat.find(name)
            if self.layout.flat.kind[variables[0]] == Kind.DISCRETE:
                discrete.v[variables] = value
        discrete.remember()
        if near is not None:
            discrete.suppose(near.observer.plan.reduced.register_of, near.w)
        discrete.take_early(moving_relations(self.layout.plan))
        return self._first(states)

    def _go_on(self, x: np.ndarray, end: End) -> np.ndarray:
        """Return the states where a run goes on at the end of another one, which has done what happens there."""
        discrete, begin, walk = self.discrete, self.begin, self._walk
        discrete.literal = False
        discrete.remember()
        walk.next = discrete.next_time(begin, include=abs(end.time - begin) > near_to(begin))
        return self.settle(begin, x) if walk.next <= begin + near_to(begin) else x

    def _first(self, states: Starter) -> np.ndarray:
        """Return the states behind the start, which C finds with the discrete values (``engine/c/happen.c``)."""
        x, discrete = np.zeros(len(self.layout.plan.states)), self.discrete

        def found() -> np.ndarray:
            discrete.push()
            x = states(discrete.base)
            if self.report.errors:
                raise _NoStart
            discrete.inputs(self.begin)
            return x

        try:
            self._asked(self.begin, lambda: self._walk.start(self.begin, x, found, self._initial_equations))
        except _NoStart:
            pass
        return x

    def _initial_equations(self, first: bool) -> None:
        """Discrete variables with an equation at the start have had that value, and have it where no `when` gives more.

        Those that read continuous variables wait until there are some.
        """
        discrete = self.discrete
        for one in self.layout.started:
            if first and one.waits:
                continue
            discrete.v[one.step.target] = discrete.values(one.step.value, one.step.slots)
            if first:
                discrete.v[one.same] = discrete.v[one.past]

    def _flag(self, variable: int, value: float) -> None:
        if variable >= 0:
            self.discrete.v[variable] = value

    # ------------------------------------------------------------------------- the way

    @property
    def next(self) -> float:
        """s, of the next time event."""
        return self._walk.next

    @property
    def until(self) -> float:
        """s, where the present segment ends at the latest."""
        return min(self.next, self.end)

    @property
    def roots(self) -> Roots | None:
        """Return what ends the present segment earlier."""
        if not self.layout.zero_count:
            return None
        discrete = self.discrete
        signs, in_c = discrete.signs(), discrete.watched()
        return Roots(discrete.roots, signs, quiet=discrete.quiet, soon=self._walk.soon, in_c=in_c)

    @property
    def is_over(self) -> bool:
        """Return whether ``terminal()`` has been true."""
        terminal = self.layout.events.terminal
        return terminal >= 0 and self.discrete.v[terminal] != 0

    @property
    def longest_step(self) -> float:
        """s, so that relations of time that are not linear in it are looked at often enough."""
        return longest_step(self.discrete, self.end - self.begin)

    def after(self, outcome: Outcome, errors: np.ndarray | float = 0.0) -> np.ndarray | None:
        """Do what happens where a segment has ended; return the states behind it, None at the end of the run.

        Parameters
        ----------
        errors : (states,) what the integrator has allowed itself in a step; 0 where something else happens as well

        Raises
        ------
        Stopped
        """
        t, walk, x, folds = outcome.time, self._walk, outcome.x.copy(), False
        is_root = outcome.status is Status.ROOT
        if is_root:
            crossed, upwards = self._crossed(outcome.roots)
            if np.ndim(errors) and self._comes_again(t, crossed):
                real = self._left_zero(t, x, crossed, errors)
                crossed, upwards, is_root = crossed[real], upwards[real], bool(real.any())
            if not is_root and t < self.until - near_to(t):
                return x
        if is_root:
            walk.which[:] = 0.0
            walk.which[crossed] = np.where(upwards, 2.0, 1.0)
            self._returning = crossed[t - walk.times[crossed, -1] <= located(t, self.begin)]
            folds = bool(len(self._returning))
        found = self._asked(t, lambda: walk.after(t, x, is_root, outcome.step, folds))
        return None if found == OVER else x

    def _comes_again(self, t: float, crossed: np.ndarray) -> bool:
        """Return whether one of these functions has crossed zero just before, and the motion is the same since."""
        times, since = self._walk.times, max(self._turned, t - _SHORTLY * (self.end - self.begin))
        return any(times[k, -1] > since for k in crossed.tolist())

    def _left_zero(self, t: float, x: np.ndarray, crossed: np.ndarray, errors: np.ndarray) -> np.ndarray:
        """Return which of the functions that cross zero have been further away from it than steps leave open.

        What has not is where it was, until it is so far on the other side. Where an event has changed the motion, that
        may well have sent a function back.
        """
        instant, w, rate = self.discrete.instant, self.discrete.registers(t, x), self.discrete.motion(t, x)[0]
        left_open = noise(self.layout, w, t, rate, errors, self.end - self.begin)[crossed]
        back = np.array([self._comes_again(t, crossed[k : k + 1]) for k in range(len(crossed))])
        back &= (instant.largest[crossed] <= left_open) & ~self.layout.rounded[crossed]
        own = crossed[back]
        instant.margin[own] = np.fmax(instant.margin[own], left_open[back])
        return ~back

    def _fold(self, t: float, x: np.ndarray) -> bool:
        """Take other values of relations that cross zero again at an instant, if there are any."""
        return leave_fold(self.discrete, t, x, self._returning)

    def _crossed(self, roots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the zero functions whose root functions vanish, and of rounded ones whether at their upper edge."""
        lower, upper = roots[: self.layout.zero_count], np.zeros(self.layout.zero_count, bool)
        upper[self.layout.rounded] = roots[self.layout.zero_count :]
        crossed = np.flatnonzero(lower | upper)
        return crossed, upper[crossed]

    def instant(self, t: float, near: float) -> float:
        """Return the next time event where it is as near to a time as that, else the time."""
        return self.next if abs(self.next - t) <= near else t

    def settle(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the states behind what follows from a change of the equations at an instant. Raises as `after`."""
        moved = x.copy()
        self._asked(t, lambda: self._walk.settle(t, moved))
        return moved

    def _asked(self, t: float, call: Callable[[], int]) -> int:
        """Have C carry out what happens; say by `Stopped` why nothing is known behind it."""
        self.discrete.stand_at(t)
        self._base = self.discrete.base.copy()
        try:
            found = call()
        except NotAState as wrong:
            raise Stopped(Status.UNSETTLED, wrong.reason(self.layout)) from None
        if found in (SETTLED, OVER):
            return found
        if found == TOO_OFTEN:
            raise too_often(self._walk, self.layout, t)
        raise too_low(self._walk, self.layout) if found == TOO_LOW else self._unsettled(self.discrete.unsettled(), t)

    def _happened(self, t: float, x: np.ndarray) -> bool:
        """Book an event that C has carried out, and tell of it."""
        discrete, walk, told = self.discrete, self._walk, self._told
        discrete.push()
        before, self._base, held, lost = self._base, discrete.base.copy(), discrete.v[told].copy(), 0.0
        if walk.data.kind != START:
            held = walk.held[np.searchsorted(self.layout.events.discrete, told)]
            lost = self._energy(t, x) if walk.data.jumped else 0.0
            count = self.layout.plan.count  # behind them are zero functions, which are no part of the motion
            given = x.copy()
            behind = self.step(t, given, before[:count], discrete.base[:count])
            if behind is not given:
                x[:], walk.data.jumped = behind, 1
        if walk.data.jumped or self._turns_the_motion():
            self._turned = t
        discrete.inputs(t)
        self._warn_of_lost(t)
        self._report(t, _KINDS[walk.data.kind], discrete.happened(), held, lost)
        return True

    def _turns_the_motion(self) -> bool:
        """Return whether an event has changed what the equations of the motion read."""
        layout = self.layout
        return bool((self._walk.held[layout.rounded_places] != self.discrete.v[layout.rounded_by]).any())

    def _energy(self, t: float, x: np.ndarray) -> float:
        """Book what energy a jump to states has cost as heat, what it has brought as work; return the loss."""
        layout, discrete = self.layout, self.discrete
        work, heat = layout.plan.accounts
        if work < 0:
            return 0.0
        stored = layout.flat.find("ledger.stored")[0]
        if stored not in layout.seen:
            return 0.0
        before, after = (discrete.seen(t, one, stored) for one in (self._walk.begun, x))
        lost = before - after
        if np.isfinite(lost):
            x[heat if lost > 0 else work] += abs(lost)
            lost = max(lost, 0.0)
        return lost

    # --------------------------------------------------------------------- what is reported

    def _report(self, t: float, kind: str, happened: Happened, held: np.ndarray, lost: float) -> None:
        """Record what has happened, warn of assertions, and stop where that is an end; `held` as of `_tell`."""
        self._tell(t, kind, happened, held, lost)
        self._judge(t, happened)
        for k in happened.terminations:
            raise Stopped(Status.OK, self.layout.events.terminations[k].message)

    @property
    def _told(self) -> np.ndarray:
        """Discrete variables whose changes are recorded.

        Relations that decide about continuous equations, and the model's own that are counted or true; these where no
        `when` tells of the event.
        """
        return self.layout.plan.once(told_variables)

    def _tell(self, t: float, kind: str, happened: Happened, held: np.ndarray, lost: float) -> None:
        flat, events = self.layout.flat, self.layout.events
        for k, row in happened.whens:
            when = events.whens[k]
            name = flat.parts[when.part].pattern or flat.name
            text = when.text if len(when.active) == 1 else f"{when.text} [{row + 1}]"
            self.records.append(Event(t, name, "when" if kind == "terminal" else kind, "", text, 0.0, lost))
            lost = 0.0
        now = self.discrete.v[self._told]
        for k in np.flatnonzero(held != now).tolist():
            variable, before, after = int(self._told[k]), held[k], now[k]
            block = flat.block_at(variable)
            if block.protected or not happened.whens:
                values = (_shown(block.quantity, value) for value in (before, after))
                kind = "relation" if block.protected else "change"
                self.records.append(Event(t, flat.variable_name(variable), kind, *values))

    def _judge(self, t: float, happened: Happened) -> None:
        """Assertions that belong to events."""
        for k, row in happened.broken:
            check = self.layout.flat.checks[k]
            message = self.layout.flat.message_of(check, row)
            if check.error:
                raise Stopped(Status.ASSERTION, f"an assertion does not hold: {where(message, check.span)}")
            self.report.warning("W0551", f"{message} (t = {t:.6g} s)", check.span)

    def _warn_of_lost(self, t: float) -> None:
        """Warn of a discrete variable that has no finite value, once in a run."""
        discrete = self.layout.events.discrete
        lost = discrete[~np.isfinite(self.discrete.v[discrete])]
        if not len(lost) or self.report.says(Subject.NOT_FINITE):
            return
        first, flat = int(lost[0]), self.layout.flat
        message = f"{flat.variable_name(first)} has no finite value ({self.discrete.v[first]:g}) at t = {t:g} s"
        self.report.warning("W0537", message, flat.block_at(first).span, subject=Subject.NOT_FINITE)

    def _unsettled(self, variables: np.ndarray, t: float) -> Stopped:
        flat = self.layout.flat
        names = [flat.variable_name(int(v)) for v in variables[:3]]
        spans = [flat.block_at(int(v)).span for v in variables[:3]]
        places = " and ".join(dict.fromkeys(where(n, s) for n, s in zip(names, spans, strict=True)))
        do = "changes" if len(names) == 1 else "change"
        reason = f"no values satisfy all equations at t = {t:g} s: {places} {do} again and again"
        return Stopped(Status.UNSETTLED, reason)


def longest_step(discrete: DiscreteState, span: float) -> float:
    """Return the longest step, in s, of a run over `span`, with which relations of time are looked at often enough."""
    layout = discrete.layout
    if not layout.looks_at_time:
        return np.inf
    rates = [np.abs(discrete.values(*one)).max(initial=0.0) for one in layout.rates_of_phase]
    return min([span / _LOOKS, *(_PHASE / rate for rate in rates if rate > 0)])


def told_variables(plan: Plan) -> np.ndarray:
    flat = plan.reduced.flat
    own = [b for b in flat.blocks if b.kind == Kind.DISCRETE and not b.protected and b.quantity != "Real"]
    targets = [r.target for r in flat.events.relations]
    used = np.zeros(flat.count, bool)
    for group in flat.groups:
        columns = sorted({leaf.value[0] for side in (group.left, group.right) for leaf in slots(side)})
        used[group.slots[:, columns]] = True
    every = np.concatenate([*targets, np.zeros(0, int)])
    found = np.concatenate([every[used[every]], *(b.offset + np.arange(b.size) for b in own)]).astype(int)
    return found[np.isin(found, flat.events.discrete)]


def _shown(quantity: str, value: float) -> str:
    if quantity == "Boolean":
        return "true" if value else "false"
    return f"{value + 0.0:g}"  # no negative zero
