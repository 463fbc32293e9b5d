"""The events of a run: when the next one comes, its effect, and its record."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from lmoc.engine.book import Accounts
from lmoc.engine.event_walk import OVER, START, TOO_LOW, TOO_OFTEN, EventWalk
from lmoc.engine.instant import SETTLED
from lmoc.engine.segments import Events
from lmoc.ir.events import Events as EventsOfModel
from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import Report
from lmoc.numerics.events.chatter import too_low, too_often, where
from lmoc.numerics.events.closeness import near_to
from lmoc.numerics.events.discrete_state import DiscreteState
from lmoc.numerics.events.happened import NotAState
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.events.steps import Steps, moving_relations
from lmoc.numerics.events.tables import PlanTables
from lmoc.numerics.events.telling import Teller, told_variables
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
SHORTLY = 1e-3  # of the run, within which a function that crosses zero again may not have left it

Step = Callable[[float, np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # as `stepping.Stepping`
HandlerMemory = tuple[EventLayout, dict[str, np.ndarray], tuple[np.ndarray, np.ndarray, float, float, float]]
Starter = Callable[[np.ndarray], np.ndarray]  # (registers that do not change) -> states at the start


def held(events: EventsOfModel) -> dict[int, Signal]:
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
        has_laws: bool,
    ) -> None:
        """
        Parameters
        ----------
        has_laws : steps are passed on by laws
        """
        self.step, self.step_is_of_laws = step, has_laws
        self.layout = plan.once(EventLayout)
        self.discrete = DiscreteState(self.layout, values, base, signals, span[0])
        self.begin, self.end = span
        self.report = report
        self.records: list[Event] = []
        self._walk = EventWalk(self.layout.zero_count, *span)
        self._bind()

    def _bind(self) -> None:
        """Go on with the memory of the discrete values."""
        discrete, plan, events = self.discrete, self.layout.plan, self.layout.events
        motion = None if discrete.moves_in_c else discrete.motion
        steps = self.step_is_of_laws or bool(plan.once(Steps))
        flags = events.initial, events.terminal
        step = self._stepped if steps else None
        self._walk.bind(discrete.instant, flags, motion, self._fold, self._accounts(), step)
        self._teller = Teller(self.layout, self.report)

    def _accounts(self) -> Accounts:
        layout, plan, own = self.layout, self.layout.plan, self.layout.events.discrete
        stored = layout.flat.find("ledger.stored")
        seen = stored is not None and stored[0] in layout.seen
        told, decides = (np.searchsorted(own, which) for which in (plan.once(told_variables), layout.rounded_by))
        return Accounts(int(stored[0]) if seen else -1, *plan.accounts, told, decides, plan.once(PlanTables).stops)

    def adopt(self, plan: Plan, base: np.ndarray, t: float, x: np.ndarray) -> None:
        """Go on in other coordinates of the same model; parameters as of `HybridDynamics.adopt`."""
        self.layout = plan.once(EventLayout)
        self.discrete.adopt(self.layout, base)
        self._bind()
        self.discrete.push()
        self.discrete.look(t, x)

    def memory(self) -> HandlerMemory:
        """Return what decides about the next instant, for `recall`."""
        return self.layout, self.discrete.memory(), self._walk.memory()

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
        layout, discrete, walk = memory
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

    def after(self, outcome: Outcome, errors: np.ndarray | None = None) -> np.ndarray | None:
        """Do what happens where a segment has ended; return the states behind it, None at the end of the run.

        Parameters
        ----------
        errors : (states,) what the integrator has allowed itself in a step; None where something else happens as well

        Raises
        ------
        Stopped
        """
        t, walk, x = outcome.time, self._walk, outcome.x.copy()
        is_root = outcome.status is Status.ROOT
        if is_root:
            crossed, upwards = self._crossed(outcome.roots)
            walk.which[:] = 0.0
            walk.which[crossed] = np.where(upwards, 2.0, 1.0)
        found = self._asked(t, lambda: walk.after(t, x, is_root, outcome.step, errors))
        return None if found == OVER else x

    def _fold(self, t: float, x: np.ndarray) -> bool:
        """Take other values of relations that cross zero again at an instant, if there are any."""
        return leave_fold(self.discrete, t, x, np.flatnonzero(self._walk.folds))

    def _crossed(self, roots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the zero functions whose root functions vanish, and of rounded ones whether at their upper edge."""
        lower, upper = roots[: self.layout.zero_count], np.zeros(self.layout.zero_count, bool)
        upper[self.layout.rounded] = roots[self.layout.zero_count :]
        crossed = np.flatnonzero(lower | upper)
        return crossed, upper[crossed]

    # ------------------------------------------------------------------------- in C from event to event

    @property
    def goes_on_in_c(self) -> bool:
        """Return whether C may go from one event to the next: what happens there it knows, or asks for."""
        steps = self.layout.looks_at_time and any(
            (self.layout.flat.kind[table] == Kind.DISCRETE).any() for _, table in self.layout.rates_of_phase
        )
        return self.discrete.moves_in_c and not steps and not self._walk.book.data.step

    @property
    def in_c(self) -> Events:
        """What goes from event to event in C reads."""
        discrete, layout = self.discrete, self.layout
        shortly = SHORTLY * (self.end - self.begin)
        return Events(self._walk, layout.registers, discrete.in_c, discrete.instant.roots, shortly)

    def pass_by(self, booked: np.ndarray) -> Iterator[list[Event]]:
        """Tell of the events of instants that C has seen to, by how many numbers of the book are theirs."""
        entries = deque(self._walk.book.taken())
        self.discrete.forget()
        for end in booked.tolist():
            while entries and entries[0][0] <= end:
                self._teller.tell(entries.popleft()[1], self.records)
            yield self.records
            self.records = []

    def instant(self, t: float, near: float) -> float:
        """Return the next time event where it is as near to a time as that, else the time."""
        return self.next if abs(self.next - t) <= near else t

    def settle(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the states behind what follows from a change of the equations at an instant. Raises as `after`."""
        moved = x.copy()
        self._asked(t, lambda: self._walk.settle(t, moved))
        return moved

    def _asked(self, t: float, call: Callable[[], int]) -> int:
        """Have C carry out what happens; tell of it, and say by `Stopped` why nothing is known behind it."""
        self.discrete.stand_at(t)
        self._base = self.discrete.base.copy()
        try:
            found = call()
        except NotAState as wrong:
            raise Stopped(Status.UNSETTLED, wrong.reason(self.layout)) from None
        finally:
            self.discrete.inputs(t)
            for _, entry in self._walk.book.taken():
                self._teller.tell(entry, self.records)
        if found in (SETTLED, OVER):
            return found
        if found == TOO_OFTEN:
            raise too_often(self._walk, self.layout, t)
        raise too_low(self._walk, self.layout) if found == TOO_LOW else self._unsettled(self.discrete.unsettled(), t)

    def _stepped(self, t: float, x: np.ndarray) -> bool:
        """Do to the states what steps of discrete values do; those at the start are none."""
        discrete, walk, count = self.discrete, self._walk, self.layout.plan.count
        discrete.push()
        before, self._base = self._base, discrete.base.copy()
        if walk.data.kind == START:
            return True
        given = x.copy()  # behind the registers of the plan are zero functions, which are no part of the motion
        behind = self.step(t, given, before[:count], discrete.base[:count])
        if behind is not given:
            x[:], walk.data.jumped = behind, 1
        return True

    # --------------------------------------------------------------------- what is reported

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
