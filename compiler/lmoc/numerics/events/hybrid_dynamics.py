"""The events and laws of a run, combined.

Both change values that the continuous equations take as given between two events: discrete variables, and the modes of
laws. At an instant the laws go first, then the discrete equations, and the laws again where those have changed
something that they depend on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Span as SourceSpan
from lmoc.numerics.coordinates.change import all_unknowns
from lmoc.numerics.events.closeness import located, near_to
from lmoc.numerics.events.event_handler import EventHandler, Starter
from lmoc.numerics.events.memory import Begun, Memory
from lmoc.numerics.events.stepping import Stepping
from lmoc.numerics.laws.switching import LawSwitching
from lmoc.numerics.observe.event import Event
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.trajectory import End
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import Outcome
from lmoc.numerics.problem.mode import Mode
from lmoc.numerics.problem.roots import Roots, joined
from lmoc.numerics.problem.status import Status
from lmoc.numerics.signals.signals import Constant, Signal

if TYPE_CHECKING:
    from lmoc.engine.segments import Past
    from lmoc.numerics.coordinates.change import RunState
    from lmoc.numerics.laws.time_stepping import TimeStepping
    from lmoc.numerics.problem.system import System

_MOMENT = 1e-10  # share of the run within which laws that change without end are chattering


class HybridDynamics:
    """The events and laws of one run.

    Parameters
    ----------
    base, signals : of the run, with all laws open
    span : s, start and end of the run

    Attributes
    ----------
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
    ) -> None:
        self.plan, self.values, self.open, self.given = plan, values, base.copy(), signals
        self.span, self.report = span, report
        reduced = plan.reduced
        self.laws = None if reduced.switched is None else self._switching(self.open)
        self.stepping = Stepping(plan, base, signals, span, report)
        self.handler = None
        if reduced.flat.events is not None:
            self.handler = EventHandler(
                plan, values, base, signals, span, report, self._step, self.laws is not None
            )
        self.records: list[Event] = []
        self._reached = span[0]  # s, of the latest instant
        self._law_roots = 0
        self._roots: Roots | None = None  # of the present segment …
        self._signs: np.ndarray | None = None  # … and their signs where it has begun
        self._signals: WeakKeyDictionary[Mode, Mapping[int, Signal]] = WeakKeyDictionary()  # with those of a mode

    def memory(self) -> Memory:
        """Return what decides about the next instant, for `recall`."""
        laws, handler = self.laws, self.handler
        return Memory(
            self.plan, self.values, self.open.copy(), self._reached, self._law_roots,
            np.zeros(0) if laws is None else laws.mode.push, np.inf if handler is None else handler.next,
            laws, None if laws is None else laws.memory(),
            None if handler is None else handler.memory(), self.stepping.memory(),
        )  # fmt: skip

    def recall(
        self, memory: Memory, values: np.ndarray, base: np.ndarray, push: np.ndarray, change: np.ndarray, since: float
    ) -> None:
        """Be as before an instant, with other values; parameters as of the laws and the events."""
        self.plan, self.values, self.open = memory.plan, values, base
        self._reached, self._law_roots, self.laws = memory.reached, memory.law_roots, memory.laws
        self.stepping.recall(memory.stepping)
        self.records = []
        if self.handler is not None:
            self.handler.recall(memory.of_handler, values, base, change, since)
        if self.laws is not None:
            self.laws.recall(memory.of_laws, push, values, self._with_discrete(base))

    def heights(self) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        """Return the present functions whose change of sign is an event: (times, states) -> (times, roots).

        What it has returned last counts, no other.
        """
        base, laws, handler = self.base(), self.laws, self.handler
        watched = laws is not None and self._law_roots > 0  # before the laws have taken their modes nothing is
        read = laws.reader(base, self.signals) if watched else None
        if handler is not None:
            handler.discrete.base[: len(base)] = base
            handler.discrete.push()

        def values(times: np.ndarray, states: np.ndarray) -> np.ndarray:
            found = []
            if read is not None:
                found.append(laws.run.values(read(times, states), self._law_roots))
            if handler is not None:
                found.append(handler.discrete.heights(times, states))
            return np.concatenate(found, axis=1) if found else np.zeros((len(times), 0))

        return values

    def stand_at(self, unknowns: np.ndarray, solutions: np.ndarray) -> None:
        """Take the solutions of the nonlinear blocks where the run stands, to stay on their branch."""
        if not len(unknowns):
            return
        self.open[unknowns] = solutions
        if self.laws is not None:
            self.laws.kinematics.stand_at(unknowns, solutions)
        if self.handler is not None:
            self.handler.discrete.base[unknowns] = solutions

    def adopt(self, plan: Plan, base: np.ndarray, t: float, x: np.ndarray) -> None:
        """Go on in other coordinates of the same model, in the same mode and with the same discrete values.

        Parameters
        ----------
        base : registers of the other plan that do not change during a run, with all laws open
        t, x : where the run stands
        """
        self.plan, self.open, self._signals = plan, base.copy(), WeakKeyDictionary()
        if self.handler is not None:
            self.handler.adopt(plan, base, t, x)
        if self.laws is not None:
            before = self.laws
            self.laws = self._switching(self._with_discrete(self.open))
            self.laws.go_on(before, t, x)

    def _switching(self, base: np.ndarray) -> LawSwitching:
        return LawSwitching(self.plan, self.values, base, self.given, _MOMENT * (self.span[1] - self.span[0]))

    # --------------------------------------------------------- what holds between events

    @property
    def signals(self) -> Mapping[int, Signal]:
        """The inputs, with the values of the laws' modes."""
        if self.laws is None:
            return self.given
        mode = self.laws.mode
        found = self._signals.get(mode)
        if found is None:  # forces that steps of equal length fill stay what they are
            held = {v: s for v, s in self.laws.signals().items() if isinstance(self.given[v], Constant)}
            found = self._signals[mode] = {**self.given, **held}
        return found

    def base(self) -> np.ndarray:
        """Return the registers that do not change until the next event."""
        base = self._with_discrete(self.open)
        if self.laws is not None:
            self.laws.put(base)
        return base

    @property
    def mode(self) -> Mode | None:
        """The mode of the laws."""
        return None if self.laws is None else self.laws.mode

    @property
    def crossing(self) -> np.ndarray | None:
        """Return what keeps relations that have just changed from changing back by rounding."""
        return None if self.handler is None else self.handler.discrete.crossing

    @property
    def places(self) -> dict[str, SourceSpan | None]:
        """Return where the conditions and discrete variables stand by whose text events are recorded."""
        if self.handler is None:
            return {}
        events, flat = self.handler.layout.events, self.plan.reduced.flat
        own = (b for b in flat.blocks if b.kind == Kind.DISCRETE and not b.protected and b.size)
        declared = {flat.variable_name(b.offset): b.span for b in own}
        return declared | {r.text: r.span for r in events.relations} | {w.text: w.span for w in events.whens}

    def _with_discrete(self, base: np.ndarray) -> np.ndarray:
        base = base.copy()
        if self.handler is not None:
            layout = self.handler.layout
            base[layout.registers] = self.handler.discrete.v[layout.events.discrete]
        return base

    @property
    def rounding(self) -> np.ndarray | None:
        """(n,) what of the states' rates the forces of closed laws leave by rounding; None without laws."""
        return None if self.laws is None else self.laws.rounding

    @property
    def until(self) -> float:
        """s, where the present segment ends at the latest."""
        end = self.span[1] if self.handler is None else self.handler.until
        return min(end, self.stepping.next)

    @property
    def is_over(self) -> bool:
        """Return whether what the model does at the end of the run has been done."""
        handler = self.handler
        return handler is not None and handler.is_over

    def instant(self, outcome: Outcome) -> float:
        """Return when what has ended a segment happens: integrators stop a few digits before a kink of an input."""
        t, end = outcome.time, self.span[1]
        exact = self.stepping.instant(t)
        if exact is not None:
            return exact
        if self.until == end and abs(end - t) <= near_to(t):
            return end
        is_root = self.handler is not None and outcome.status is Status.ROOT
        return self.handler.instant(t, located(t, self.span[0])) if is_root else t

    def together(self, outcome: Outcome, system: System) -> Outcome:
        """Return what has ended a segment with all that follows it more closely than the places of roots are known.

        Whether a state reaches a level an ulp before the tick of a clock, or behind it, is rounding: both are one
        instant. So are two levels that are reached an ulp apart.
        """
        t, x, roots = outcome.time, outcome.x, self._roots
        if roots is None or outcome.status.failed or not len(x) or not t > self._reached:
            return outcome
        own = np.zeros(len(self._signs), bool) if outcome.roots is None else outcome.roots
        if self.handler is None and own.all():
            return outcome
        rates, ahead = np.empty(len(x)), located(t, self.span[0])
        system.rhs(t, x, rates)
        values = roots.values(np.array([t, t + ahead]), np.stack([x, x + ahead * rates])) * self._signs
        with np.errstate(invalid="ignore"):
            soon = ~own & (values[1] < 0.0) & (values[1] < values[0])
        return replace(outcome, status=Status.ROOT, roots=own | soon) if soon.any() else outcome

    @property
    def longest_step(self) -> float:
        """s, so that nothing that depends on time is stepped over."""
        return np.inf if self.handler is None else self.handler.longest_step

    @property
    def ended(self) -> None:
        """What ends the run here is raised: `Stopped`."""

    def watch(self, observer: Observer, t: float, x: np.ndarray) -> Roots | None:
        """Return what ends the segment that begins at a place, or goes on there: on the observer's branch."""
        unknowns = self.plan.once(all_unknowns)
        self.stand_at(unknowns, observer.base[unknowns])
        return self.roots(t, x)

    def roots(self, t: float, x: np.ndarray) -> Roots | None:
        """Return what ends the segment that begins at a place."""
        found = []
        if self.laws is not None:
            found.append(self.laws.roots(t, x, self.base(), self.signals))
            self._law_roots = len(found[0].signs)
        if self.handler is not None and self.handler.layout.zero_count:
            found.append(self.handler.roots)
        self._roots = joined(found) if found else None
        self._signs = None if self._roots is None else self._roots.signs.copy()
        return self._roots

    def _note_undecided(self, t: float, names: list[str]) -> None:
        """Say, once a run, that the law of impacts has decided between several answers."""
        who = _listed(list(dict.fromkeys(names)))
        text = (
            f"{who} are hit at once at t = {t:.6g} s, and what follows depends on the law of impacts: one after the "
            "other they would leave with other velocities"
        )
        self.report.note_once("N0558", text, hint="a gap that takes longer than 1e-10 s to close gives an order")

    @property
    def kept(self) -> Callable[..., np.ndarray] | None:
        """Return what moves states onto what is closed (`LawSwitching.kept`); None where it stays closed by itself."""
        return None if self.laws is None or not self.laws.drifts else self.laws.kept

    def steps(self) -> TimeStepping:
        """Return what goes through the laws in steps of equal length, from the present states on."""
        from lmoc.numerics.laws.time_stepping import TimeStepping

        laws = self.laws
        forces = [self.given[int(v)].call for v in laws.kinematics.form.push]
        return TimeStepping(laws.kinematics, forces, laws.laws, laws.ledger)

    # ------------------------------------------------------------------- what happens

    def pass_by(self, past: Past) -> Iterator[tuple[Mode, np.ndarray] | None]:
        """Take note of instants that C has seen to, one by one; yield the mode behind each, and the rounding there."""
        if self.laws is None:
            events = self.handler.pass_by(past.booked)
            yield from (self._taken(float(t), own, None) for t, own in zip(past.ended, events, strict=True))
            return
        for t, (mode, rounding, told) in zip(past.ended, self.laws.run.kept(past.kept[1:]), strict=True):
            yield self._taken(float(t), self.laws.pass_by(told, mode), (mode, rounding))
        self.laws.run.forget_after(self._reached)

    def _taken(self, t: float, records: list[Event], mode: tuple[Mode, np.ndarray] | None):
        self._reached = t
        self.records += records
        return mode

    @property
    def passed(self) -> float:
        """s, when something has happened last, or where the run has begun."""
        return self._reached

    def start(
        self, states: Starter, initial: object, near: RunState | None = None, kept: list[Begun] | None = None
    ) -> np.ndarray:
        """Return the states at the start, behind what happens there; `near` as of `Task`.

        Parameters
        ----------
        kept : takes what is known before the laws take their modes, where somebody asks for it

        Raises
        ------
        Stopped
        """
        if self.handler is None:
            x = states(self.open)
        else:
            x = self.handler.start(lambda base: states(base[: self.plan.count]), initial, near)
            self._collect()
        goes_on = isinstance(initial, End) and not initial.stepping
        if goes_on:
            self.stepping.pass_by(self.span[0])
        if isinstance(initial, End) and initial.mode is not None and not self.report.errors:
            return self._resume(initial.mode, x)
        if not self.report.errors and not goes_on:
            x = self._input_steps(self.span[0], x)
            self._collect()
        self.stepping.pass_by(self.span[0])
        if self.laws is not None and not self.report.errors:
            self._renew_laws()
        if kept is not None:
            kept.append((self.memory(), x))
        if self.laws is None or self.report.errors:
            return x
        x, events = self.laws.start(self.span[0], x)
        self.records += events
        self._collect()
        return x if self.handler is None else self._settle(self.span[0], x, x)

    def _resume(self, mode: Mode, x: np.ndarray) -> np.ndarray:
        """Return the states with which a run goes on in a mode, behind what steps there; `Stopped` as of `start`."""
        t = self.span[0]
        self._renew_laws()
        self.laws.mode = mode
        x, events = self.laws.resume(t, x, self.base(), self.signals)
        self.records += events
        if self.stepping.instant(t) is None:
            return x
        behind = self._input_steps(t, x)
        self.stepping.pass_by(t)
        behind, events = self.laws.happen(t, behind, jumped=True)
        self.records += events
        self._collect()
        return behind if self.handler is None else self._settle(t, x, behind)

    def after(
        self, outcome: Outcome, unresolved: np.ndarray | float = 0.0, errors: np.ndarray | float = 0.0
    ) -> np.ndarray | None:
        """Return the states behind what has ended a segment; None at the end of the run.

        Parameters
        ----------
        unresolved : (states,) as of ``lmoc_kinematics``
        errors : (states,) what the integrator has allowed itself in a step

        Raises
        ------
        Stopped
        """
        t, x, root = outcome.time, outcome.x, outcome.status is Status.ROOT
        stepped = self.stepping.instant(t) is not None
        x = self._input_steps(t, x)
        self._collect()
        self.stepping.pass_by(t)
        self._reached = t
        of_laws = outcome.roots[: self._law_roots] if root else np.zeros(self._law_roots, bool)
        if self.laws is not None:
            self.laws.allow(unresolved, errors)
        alone = not (of_laws.any() or stepped)
        if self.laws is not None and not alone:
            x, events = self.laws.happen(t, x, of_laws, jumped=stepped)
            self.records += events
        if self.handler is None:
            self._collect()
            return x if root or stepped else None
        self._renew_discrete()
        crossed = outcome.roots[self._law_roots :] if root else None
        early = stepped and not root and t < self.handler.until - near_to(t)  # it is not the end of the run
        own = replace(outcome, x=x, roots=crossed)
        known = errors if alone and isinstance(errors, np.ndarray) else None
        behind = None if early else self.handler.after(own, known)
        if behind is None and stepped:
            behind = self.handler.settle(t, x)
        self._collect()
        return behind if behind is None or self.laws is None else self._settle(t, x, behind)

    def _settle(self, t: float, before: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Let laws and discrete equations answer each other until nothing changes.

        Parameters
        ----------
        before, x : the states as the laws have left them, and as they are now
        """

        def settle(x: np.ndarray) -> np.ndarray:
            self._renew_discrete()
            moved = self.handler.settle(t, x)
            self._collect()
            return moved

        renewed = partial(self._with_discrete, self.open)
        return self.laws.settle(t, before, x, renewed, self.records.extend, settle)

    def _renew_laws(self) -> None:
        """The laws are judged with the present discrete values."""
        if self.handler is not None:
            self.laws.renew(self._with_discrete(self.open))

    def _renew_discrete(self) -> None:
        """The discrete equations are judged with the present modes of the laws."""
        base = self.base()
        self.handler.discrete.base[: len(base)] = base

    def _input_steps(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the states after what inputs do at an instant; `Stopped` as of `Stepping`."""
        if self.stepping.instant(t) is None:
            return x
        base = self._with_discrete(self.open)
        return self._step(t, x, base, base)

    def _step(self, t: float, x: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Return the states after a step, with what the laws that are closed pass on; `Stopped` as of `Stepping`."""
        moved = self.stepping(t, x, before, after)
        return moved if self.laws is None else self.laws.strike(t, x, moved)

    def _collect(self) -> None:
        if self.laws is not None and self.laws.undecided:
            self._note_undecided(*self.laws.undecided[0])
            self.laws.undecided.clear()
        self.records += self.stepping.records
        self.stepping.records = []
        if self.handler is not None:
            self.records += self.handler.records
            self.handler.records = []


def _listed(names: list[str]) -> str:
    shown = names[:4]
    return ", ".join(f"'{name}'" for name in shown) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
