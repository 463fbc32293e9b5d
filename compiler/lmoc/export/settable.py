"""Which parameters can be set in an FMU: those on which neither the equations' form nor the start nor kinks depend.

Each is tried out: a little more, a little less. What follows smoothly from parameters, and does not change with them
there, never does. Where a relation of parameters decides (``if k > 100 then …``), it may elsewhere: those that do are
found by the equations.
"""

from __future__ import annotations

from collections import deque
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from lmoc.expression.dag import Expr, depends_on_time, postorder, slots
from lmoc.expression.functions import FUNCTIONS
from lmoc.expression.functions import Kind as Treatment
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.program import Apply, Program, Total, unfilled, written
from lmoc.messages.diagnostics import ModelError
from lmoc.numerics.events.layout import initial_values
from lmoc.numerics.plan import kinks
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal

if TYPE_CHECKING:
    from lmoc.dae import CompiledDAE
    from lmoc.run import Run

MOST_TRIED = 300  # groups of parameters whose influence on structure and start is tried out; others stay as they are
MOST_VALUES = 200_000  # of variables in all trials: a start of a thousand strings takes 0.2 s
_KINKED = frozenset(f.name for f in FUNCTIONS.values() if f.kind in (Treatment.KINKED, Treatment.LOGICAL))
_ASIDE = 2.0**-10
_GOLDEN = 0.618033988749895  # its multiples lie apart from each other modulo 1


def begun(run: Run, count: int) -> np.ndarray:
    """Return the states with which a run starts, before what events do there."""
    begun = run.trajectory.begun
    return (run.trajectory.segments[0].table[0] if begun is None else begun[0])[:count]


class Tried:
    """Which parameters can be set: those on which neither the equations' form nor the start nor kinks depend."""

    def __init__(
        self,
        dae: CompiledDAE,
        plan: Plan,
        signals: dict[int, Signal],
        inputs: dict[str, float],
        span: tuple[float, float],
        start: np.ndarray,
        program: Program,
    ) -> None:
        self.program = program
        self.dae, self.plan, self.signals, self.inputs, self.span, self.start = dae, plan, signals, inputs, span, start
        self._breaks = self._break_times(dae.values)

    def settable(self) -> tuple[np.ndarray, tuple[str, ...]]:
        """Return the flat variables that can be set, and the names of those that cannot."""
        flat = self.dae.flat
        bound = np.zeros(flat.count, bool)
        for a in flat._parameter_bindings[1]:
            bound[a.target] = True
        candidates = [
            v
            for b in flat.blocks
            if b.kind == Kind.PARAMETER and b.quantity == "Real" and not (b.structural or b.final or b.protected)
            for v in range(b.offset, b.offset + b.size)
            if not bound[v] and np.isfinite(self.dae.values[v])
        ]
        deciding = deciders(self.dae.flat, self.plan, self.program)
        free = self._free_ones([v for v in candidates if not deciding[v]])
        return np.array(sorted(free), int), tuple(flat.variable_name(v) for v in candidates if v not in free)

    def _free_ones(self, candidates: list[int]) -> set[int]:
        """Return which of them may change: tried together, and by halves where something depends on one of them.

        Adaptive group testing (Hwang, "A method for detecting all defective members in a population by group testing",
        1972): a few trials where few parameters matter. Their number is bounded, by the size of the scene, too.
        """
        free: set[int] = set()
        groups = deque([candidates] if candidates else [])
        trials = min(MOST_TRIED, 1 + MOST_VALUES // self.dae.flat.count)
        while groups and trials > 0:
            group, trials = groups.popleft(), trials - 1
            if self._are_free(group):
                free.update(group)
            elif len(group) > 1:
                groups.extend((group[: len(group) // 2], group[len(group) // 2 :]))
        return free

    def _are_free(self, variables: list[int]) -> bool:
        """Whether changes of these parameters, up and down, change nothing but numbers in the equations.

        Each changes by a part of its own: quotients and differences of several change, and their order.
        """
        own = {v: _ASIDE * (1.0 + v * _GOLDEN % 1.0) for v in variables}
        values = {v: float(self.dae.values[v]) for v in variables}
        same = {
            self._same_with({v: values[v] * (1.0 + sign * own[v]) if values[v] else sign * own[v] for v in variables})
            for sign in (1.0, -1.0)
        }
        return same == {True} or (len(variables) == 1 and same == {True, None})

    def _same_with(self, changed: dict[int, float]) -> bool | None:
        """Whether structure, kinks and start are the same with other values of parameters; None: impossible ones."""
        flat = self.dae.flat
        values = flat.parameter_values({**_overrides(flat), **changed})
        if any(r.broken_guard(values) is not None for r in (self.dae.reduced, self.plan.reduced)):
            return False
        if not np.array_equal(self._break_times(values), self._breaks):
            return False
        try:
            only = [self.span[0]]
            named = {flat.variable_name(variable): value for variable, value in changed.items()}
            run = self.dae.simulate(times=only, parameters=named, inputs=self.inputs, energy=False)
        except ModelError:
            return None  # such as a string that is too short for where its ends begin
        if not np.array_equal(self._discrete(values), self._discrete(self.dae.values)):
            return False
        found = begun(run, len(self.start))
        return len(found) == len(self.start) and np.array_equal(found, self.start)

    def _discrete(self, values: np.ndarray) -> np.ndarray:
        """Return what discrete variables begin with."""
        flat = self.dae.flat
        return np.zeros(0) if flat.events is None else initial_values(flat, values)[flat.events.discrete]

    def _break_times(self, values: np.ndarray) -> np.ndarray:
        base = self.plan.base(self.plan.reduced.flat.extended(values), self.signals)
        return kinks.break_times(self.plan, base, *self.span)


# ------------------------------------------------------------------ what decides


def deciders(flat: FlatDAE, plan: Plan, program: Program) -> np.ndarray:
    """Return (flat.count,) the parameters whose relations with each other decide anything, or from which kinks follow.

    Parameters
    ----------
    program : fills what follows from parameters, which stand behind the registers of the plan
    """
    count, own = plan.count, flat.kind <= Kind.PARAMETER
    found = np.zeros(count + plan.reduced.flat.count, bool)
    shapes = [(g.residual, g.slots) for g in (*flat.groups, *flat.initial_groups)]
    shapes += [(a.shape, a.slots) for a in (*flat.bindings, *flat.starts, *flat.fixed) if a.numbers is None]
    for shape, table in shapes:
        for columns in _compared(shape):
            used = table[:, columns]
            found[used[own[used].all(axis=1)] + count] = True
    for expression, registers in kinks.switches(plan):
        found[registers[:, _columns(expression)]] = True
    for step in reversed(program):
        if isinstance(step, Apply):
            found[step.slots[found[step.out]]] = True
        elif isinstance(step, Total):
            found[step.index[np.repeat(found[step.out], np.diff(step.start))]] = True
        else:
            found[unfilled((step,), written(step), len(found))] |= found[written(step)].any()
    return found[count : count + flat.count]


def _columns(shape: Expr) -> list[int]:
    return sorted({leaf.value[0] for leaf in slots(shape)})


@cache
def _compared(shape: Expr) -> tuple[list[int], ...]:
    """Return the columns of each part of a shape that has a kink or a jump, but not by the time."""
    kinked = [n for n in postorder(shape) if n.op in _KINKED and not depends_on_time(n)]
    return tuple(filter(None, map(_columns, kinked)))


def _overrides(flat: FlatDAE) -> dict[int, float]:
    from lmoc.parameters import indexed

    return indexed(flat, flat.overrides)
