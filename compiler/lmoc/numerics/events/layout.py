"""The data of a plan for events: root functions, time events, and the variables that the discrete equations read."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import TIME, Expr, depends_on_time, postorder, slots
from lmoc.ir.events import Events, Relations
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.program import Apply, Program, Solve, needed_steps, unfilled, walk
from lmoc.ir.reduced import DiscreteStep
from lmoc.lower.blocks import values_tape
from lmoc.lower.tape import Tape
from lmoc.numerics.events.switching_blocks import SwitchingBlocks
from lmoc.numerics.observe.readout import Readout
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.solve.rounding import Rounding
from lmoc.structure.laws.degree import dependent
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Timed:
    """Relations of time alone, ``slope·time + offset``, over discrete variables and parameters."""

    relation: int
    slope: Expr
    offset: Expr


@dataclass(frozen=True, eq=False)
class Started:
    """Initial equations of discrete variables.

    Attributes
    ----------
    step : what they have been before the start
    past, same : (k,) what has the same values: where they are, and where they go to
    waits : whether continuous variables are read
    """

    step: DiscreteStep
    past: np.ndarray
    same: np.ndarray
    waits: bool


class EventLayout:
    """The tables, made once for a plan.

    Attributes
    ----------
    events, flat, plan : whose they are
    first : (relations + 1,) where the rows of each relation begin among all
    zero_row : (rows,) position among the zero functions, -1 of a relation of time alone
    timed : the relations of time alone
    seen : (k,) continuous variables that the discrete equations read
    registers : (discrete,) where the continuous equations read the discrete variables
    zeros, values : readouts of the zero functions and of `seen`
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.flat: FlatDAE = plan.reduced.flat
        self.events: Events = self.flat.events
        relations = self.events.relations
        self.first = np.cumsum([0, *(r.rows for r in relations)])
        self.timed = tuple(t for k, r in enumerate(relations) if (t := self._timed(k, r)) is not None)
        register = plan.reduced.register_of
        of_time = {t.relation for t in self.timed}
        self.zero_row = np.full(int(self.first[-1]), -1)
        steps, at = [], 0
        for k, r in enumerate(relations):
            if k not in of_time:
                rows = at + np.arange(r.rows)
                self.zero_row[self.first[k] : self.first[k + 1]] = rows
                steps.append(Apply(r.zero, register[r.slots], plan.count + rows))
                at += r.rows
        self.zero_count = at
        self.count = plan.count + at
        program = (*plan.full_program, *steps)
        self._program = program
        self.zeros = Readout(plan, program, self.count, plan.count + np.arange(at))
        self.seen = self._seen(of_time)
        self.values = Readout(plan, program, self.count, register[self.seen])
        self.registers = register[self.events.discrete]

    @cached_property
    def _looked(self) -> Program:
        """What fills the zero functions and what is seen."""
        return needed_steps(self._program, self._wanted, self.count)

    @property
    def _wanted(self) -> np.ndarray:
        return np.concatenate([self.plan.count + np.arange(self.zero_count), self.plan.reduced.register_of[self.seen]])

    @cached_property
    def view(self) -> Tape | None:
        """The zero functions and what is seen; None where nonlinear blocks are followed."""
        return None if _is_nonlinear(self._looked) else values_tape(self._looked, self.count)

    @cached_property
    def moving(self) -> Tape | None:
        """The rates of the states and the zero functions; None where nonlinear blocks are followed, or inputs."""
        if len(self.plan.sampled):
            return None
        wanted = np.concatenate([self.plan.derivatives, self.plan.count + np.arange(self.zero_count)])
        program = needed_steps(self._program, wanted, self.count)
        return None if _is_nonlinear(program) else values_tape(program, self.count)

    @cached_property
    def given(self) -> np.ndarray:
        """The registers from which these begin; all of them where a nonlinear block starts from a guess."""
        return np.arange(self.count) if self.view is None else unfilled(self._looked, self._wanted, self.count)

    @cached_property
    def rounded_by(self) -> np.ndarray:
        """The discrete variables on which `rounding` depends."""
        wanted = np.concatenate([self.plan.count + np.arange(self.zero_count), self.plan.derivatives])
        read = unfilled(needed_steps(self._program, wanted, self.count), wanted, self.count)
        found: np.ndarray = self.events.discrete[np.isin(self.registers, read)]
        return found

    def _timed(self, k: int, r: Relations) -> Timed | None:
        """The relation as one of time alone."""
        if not depends_on_time(r.zero) or not r.rows:
            return None
        columns = sorted({leaf.value[0] for leaf in slots(r.zero)})
        if any(self.flat.kind[v] in (Kind.UNKNOWN, Kind.INPUT) for v in r.slots[0, columns]):
            return None
        parts = linear_parts(r.zero, (TIME,))
        return None if parts is None or TIME not in parts[0] else Timed(k, parts[0][TIME], parts[1])

    def _seen(self, of_time: set[int]) -> np.ndarray:
        events, flat = self.events, self.flat
        read = [events.before[0], events.clocks(), *(r.target for r in events.reinits)]
        tables = [(s.value, s.slots) for s in self.plan.reduced.discrete if s.relation < 0 or s.relation in of_time]
        tables += [(s.value, s.slots) for s in self.plan.reduced.started]
        tables += [(r.value, r.slots) for r in events.reinits]
        tables += [(t.guard, t.slots) for t in events.terminations]
        tables += [(c.condition, c.slots) for c in flat.checks if c.at_events]
        for shape, table in tables:
            columns = sorted({leaf.value[0] for leaf in slots(shape)})
            read.append(table[:, columns].ravel())
        stored = flat.find("ledger.stored") if events.reinits else None
        read += [] if stored is None else [stored]
        found = np.unique(np.concatenate(read)).astype(int)
        continuous = (flat.kind[found] == Kind.UNKNOWN) | (flat.kind[found] == Kind.INPUT)
        return found[continuous & (self.plan.reduced.register_of[found] >= 0)]

    @cached_property
    def started(self) -> tuple[Started, ...]:
        """The initial equations of discrete variables."""
        now, before = self.events.before.copy()
        for k in reversed(range(len(now))):  # what pre(pre(v)) remembers is v, too
            now[now == before[k]] = now[k]
        found = []
        for step in self.plan.reduced.started:
            pairs = []
            for one in step.target.tolist():
                own = int(now[before == one][0])
                pairs += [(one, other) for other in (own, *before[now == own].tolist()) if other != one]
            past, same = np.array(pairs, int).reshape(-1, 2).T
            found.append(Started(step, past, same, bool(np.isin(step.slots, self.seen).any())))
        return tuple(found)

    @cached_property
    def rounding(self) -> Rounding:
        """The rounding of the zero functions, and behind them of the rates of the states."""
        registers = np.concatenate([self.plan.count + np.arange(self.zero_count), self.plan.derivatives])
        return Rounding(self._program, registers, self.count)

    @cached_property
    def switching(self) -> SwitchingBlocks:
        """The implicit blocks whose matrices depend on discrete values."""
        registers = np.concatenate([self.plan.count + np.arange(self.zero_count), self.plan.derivatives])
        return SwitchingBlocks(needed_steps(self._program, registers, self.count), self.registers, self.count)

    @cached_property
    def rates(self) -> Readout:
        """The derivatives of the states."""
        return Readout(self.plan, self.plan.full_program, self.count, self.plan.derivatives)

    @cached_property
    def looks_at_time(self) -> bool:
        """Return whether relations depend on time other than linearly, or on inputs."""
        timed = {t.relation for t in self.timed}
        for k, r in enumerate(self.events.relations):
            kinds = {int(self.flat.kind[v]) for v in r.slots[0]} if r.rows else set()
            if k not in timed and (Kind.INPUT in kinds or depends_on_time(r.zero)):
                return True
        return False

    @cached_property
    def rates_of_phase(self) -> tuple[tuple[Expr, np.ndarray], ...]:
        """Return how fast the arguments of sines and the like of time grow: (rate, table of its variables)."""
        found, timed = [], {t.relation for t in self.timed}
        for k, r in enumerate(self.events.relations):
            waves = [n for n in postorder(r.zero) if n.op in ("sin", "cos", "tan")] if k not in timed else []
            for parts in (linear_parts(n.args[0], (TIME,)) for n in waves):
                rate = None if parts is None else parts[0].get(TIME)
                columns = [] if rate is None else [leaf.value[0] for leaf in slots(rate)]
                if (
                    rate is not None
                    and not np.isin(self.flat.kind[r.slots[:, columns]], (Kind.UNKNOWN, Kind.INPUT)).any()
                ):
                    found.append((rate, r.slots))
        return tuple(found)

    @cached_property
    def relation_of_zero(self) -> np.ndarray:
        """(zeros,) row among all relations of each zero function."""
        rows = np.flatnonzero(self.zero_row >= 0)
        return rows[np.argsort(self.zero_row[rows])]

    @cached_property
    def rounded(self) -> np.ndarray:
        """(zeros,) whether the function is rounded down, not compared with zero."""
        ops = np.repeat([r.op == "floor" for r in self.events.relations], np.diff(self.first))
        return ops[self.relation_of_zero].astype(bool) if self.zero_count else np.zeros(0, bool)

    @cached_property
    def zero_target(self) -> np.ndarray:
        """(zeros,) the discrete variable that each zero function decides about."""
        targets = [r.target for r in self.events.relations]
        return np.concatenate(targets)[self.relation_of_zero] if self.zero_count else np.zeros(0, int)

    def solved_with(self, zeros: np.ndarray) -> np.ndarray:
        """Return the zero functions whose relations are solved together with those of some, these first."""
        register = self.plan.reduced.register_of

        def felt(some: np.ndarray) -> np.ndarray:
            found = dependent(self._program, register[self.zero_target[some]], self.count)
            return np.flatnonzero(found[self.plan.count :] & ~self.rounded)

        others = np.setdiff1d(felt(zeros), zeros)
        return np.concatenate([zeros, *([k] for k in others.tolist() if np.isin(zeros, felt(np.array([k]))).any())])

    def relation_at(self, zero: int) -> Relations:
        """The relation that a zero function belongs to."""
        row = int(self.relation_of_zero[zero])
        return self.events.relations[int(np.searchsorted(self.first, row, "right")) - 1]


def _is_nonlinear(program: Program) -> bool:
    return any(not step.linear for step in walk(program) if isinstance(step, Solve))


def initial_values(flat: FlatDAE, values: np.ndarray) -> np.ndarray:
    """Return the values (flat.count,) of parameters with those that discrete variables begin with."""
    found, discrete = values.copy(), flat.events.discrete
    found[discrete] = 0.0
    for a in flat.starts:
        own = np.isin(a.target, discrete)
        if own.any():
            found[a.target[own]] = a.values(values)[own]
    return found
