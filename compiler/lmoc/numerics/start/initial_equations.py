"""The initial equations of a model as steps of its program, with every derivative they ask for."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from itertools import accumulate

import numpy as np

from lmoc.expression.dag import postorder
from lmoc.expression.dag import slots as slots_of
from lmoc.ir.flat import Group, Kind
from lmoc.ir.program import Apply, Program, needed_steps, read, written
from lmoc.messages.diagnostics import Report
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal, gives
from lmoc.structure.blocks.tangent import Tangent
from lmoc.structure.linear.explicit import as_formula
from lmoc.support.distinct import distinct

NOWHERE = -1


class InitialEquations:
    """Residuals of the initial equations.

    Derivatives of states stand in the program; all others, such as ``der(tip.q)`` of a point geared to a state, are
    made by differentiating it (`structure.tangent`).

    Attributes
    ----------
    program : Program
        The plan's whole program, the derivatives, and the residuals.
    out : (m,) registers of the residuals
    count : number of registers
    """

    def __init__(self, plan: Plan, signals: Mapping[int, Signal], report: Report) -> None:
        self.plan, self.signals = plan, signals
        self.count = plan.count
        groups = plan.reduced.flat.initial_groups
        self._register, self._added = self._lookup(groups)
        # what is constant has the first one for its derivative, what no signal gives the other: never filled, NaN
        self._zero, self._unknown = self._take(2)
        self._sampled: list[tuple[int, int, int]] = []  # register, input, order: further derivatives of signals
        highest = max((leaf.value[1] for g in groups for leaf in slots_of(g.residual)), default=0)
        tangent = Tangent(plan.full_program, self._rates(highest))
        tables = [(g, self._table(g, tangent)) for g in groups if self._determined(g, report)]
        self.count = len(tangent.rate)
        steps = [Apply(as_formula(g.residual)[0], table, self._take(g.rows)) for g, table in tables]
        self.out = np.concatenate([np.zeros(0, int), *(step.out for step in steps)])
        self._groups = [g for g, _ in tables]
        self._first = [0, *accumulate(g.rows for g in self._groups)]
        self.program: Program = (*plan.full_program, *tangent.program, *steps)
        given = any(node.op == "given" for g in plan.reduced.flat.groups for node in postorder(g.residual))
        for (g, _), step in zip(tables, steps, strict=True):
            self._check_signals(g, step, report)
            if given:
                self._check_given(g, step, tangent, report)

    def fill(self, w: np.ndarray, values: np.ndarray, time: float) -> None:
        """Put in what the program reads and does not compute.

        Parameters
        ----------
        w : (count,) registers
        values : parameter values of the flat model
        """
        w[self._zero] = 0.0
        w[self._register[self._added]] = values[self._added]
        for register, variable, order in self._sampled:
            w[register] = self.signals[variable].value(time, order)

    def place(self, k: int) -> tuple[Group, int]:
        """The group of a residual, and its row there."""
        at = bisect_right(self._first, k) - 1
        return self._groups[at], k - self._first[at]

    def _take(self, number: int) -> np.ndarray:
        self.count += number
        return np.arange(self.count - number, self.count)

    def _lookup(self, groups: tuple[Group, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Register of each flat variable, and the parameters that only initial equations read."""
        flat, plan = self.plan.reduced.flat, self.plan
        register = np.where(flat.kind > Kind.PARAMETER, plan.reduced.register_of, NOWHERE)
        register[plan.known[1]] = plan.known[0]
        used = distinct(np.concatenate([np.zeros(0, int), *(g.slots.ravel() for g in groups)]))
        added = used[(flat.kind[used] <= Kind.PARAMETER) & (register[used] < 0)]
        register[added] = self._take(len(added))
        return register, added

    def _rates(self, highest: int) -> np.ndarray:
        """For `Tangent`: derivatives of states, and those of sampled inputs up to an order."""
        plan = self.plan
        sampled = dict(zip(plan.samplers, plan.sampled.tolist(), strict=True))
        for variable, order in plan.samplers:
            for n in range(order + 1, order + highest + 1):
                if (variable, n) not in sampled and gives(self.signals[variable], n):
                    sampled[variable, n] = int(self._take(1)[0])
                    self._sampled.append((sampled[variable, n], variable, n))
        rate = np.full(self.count, NOWHERE)
        rate[plan.states] = plan.derivatives
        for (variable, order), register in sampled.items():
            rate[register] = sampled.get((variable, order + 1), self._unknown)
        rate[plan.absent] = rate[self._unknown] = self._unknown
        return rate

    # -------------------------------------------------------------------------- equations

    def _table(self, group: Group, tangent: Tangent) -> np.ndarray:
        """(rows, jets) registers that appear in the equations."""
        columns = []
        for column, order in (leaf.value for leaf in slots_of(group.residual)):
            register = self._register[group.slots[:, column]]
            for n in range(order):
                if tangent.depth <= n and (tangent.rate[register] < 0).any():
                    tangent.advance()
                rate = tangent.rate[register]
                register = np.where(rate < 0, self._zero, rate)
            columns.append(register)
        return np.stack(columns, axis=1) if columns else np.zeros((group.rows, 0), int)

    def _determined(self, group: Group, report: Report) -> bool:
        """Everything in the equations has a value, unlike a force in a loop of rods."""
        flat = self.plan.reduced.flat
        lost = np.argwhere(self._register[group.slots] < 0)
        if len(lost):
            name = flat.variable_name(int(group.slots[tuple(lost[0])]))
            message = f"an initial equation cannot contain {name}: the model leaves it undetermined"
            hint = "it is a force in a loop of rigid parts, which can share their load in more than one way"
            report.error("E0536", message, group.span, hint=hint)
        return not len(lost)

    def _check_signals(self, group: Group, step: Apply, report: Report) -> None:
        """No derivative of a signal is needed that is not available."""
        unknown = np.append(self.plan.absent, self._unknown)
        if any(np.isin(read(s), unknown).any() for s in needed_steps(self.program, step.out, self.count)):
            message = "an initial equation needs a derivative of an input that its signal does not give"
            hint = "a formula in time has all derivatives, a table two, a callable those of its method derivative(n)"
            report.error("E0536", message, group.span, found=self.plan.reduced.flat.row_text(group, 0), hint=hint)

    def _check_given(self, group: Group, step: Apply, tangent: Tangent, report: Report) -> None:
        """No rate is made by the chain rule where functions give rates of their own: the program is without these."""
        made = np.concatenate([[self._zero], *(written(s) for s in tangent.program)])
        if any(np.isin(read(s), made).any() for s in needed_steps(self.program, step.out, self.count)):
            message = "an initial equation needs a derivative, where a function with `noDerivative` gives its own"
            hint = "give it a name in an equation, as v = der(x), and write that"
            report.error("E0536", message, group.span, found=self.plan.reduced.flat.row_text(group, 0), hint=hint)
