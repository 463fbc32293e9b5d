"""The variables with start values, and the initial equations, as functions of the states."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lmoc.ir.program import Program, Solve, needed_steps
from lmoc.ir.reduced import StartGuess
from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Span
from lmoc.numerics.failures.diagnosis import sentence
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.numerics.solve.rounding import Rounding
from lmoc.numerics.start.initial_equations import InitialEquations
from lmoc.numerics.start.targets import Targets

_ROUNDOFF = 1e-14  # a gradient below this share of the value wanted, and of the terms, is none
_EPSILON = 2e-16  # relative rounding of a number


def without_gradient(size: np.ndarray, value: np.ndarray, sizes: Callable[[], np.ndarray]) -> np.ndarray:
    """Return (m,) whether nothing but rounding is in gradients: cos(pi/2) is not zero in floating point.

    Parameters
    ----------
    size, value : (m,) lengths of gradients, and values wanted
    sizes : returns the sizes of terms (`term_sizes`): a gradient may be as small as they are, as of 1e-20 J
    """
    none = size <= _ROUNDOFF * (1.0 + np.abs(value))
    small = none & (size > 0.0)
    if small.any():
        none[small] = (size <= _ROUNDOFF * (sizes() + np.abs(value)))[small]
    return none


def term_sizes(rounding: Rounding, w: np.ndarray, time: float, states: np.ndarray) -> np.ndarray:
    """Return the sizes of the terms that registers come from, (m,); 1 where they are not known or larger."""
    found = rounding(w, time, (states, _EPSILON * np.abs(w[states]))) / _EPSILON
    return np.where(found < 1.0, found, 1.0)


def _parts(
    plan: Plan, equations: InitialEquations, outputs: np.ndarray
) -> tuple[Program, Interpreter, Jacobian, Rounding]:
    """Return the evaluator of the outputs, with derivatives and rounding.

    Without initial equations it depends on the outputs alone, and is cached.
    """
    kept = plan.once(_kept_parts) if not len(equations.out) else {}
    key = outputs.tobytes()
    if key not in kept:
        program = needed_steps(equations.program, outputs, equations.count)
        made = Interpreter(program, equations.count), Jacobian(program, plan.states, outputs, equations.count)
        kept[key] = program, *made, Rounding(program, outputs, equations.count)
    return kept[key]


def _kept_parts(plan: Plan) -> dict[bytes, tuple[Program, Interpreter, Jacobian, Rounding]]:
    return {}


def _reachable(targets: Targets, closed: StartGuess | None) -> np.ndarray:
    """What is wanted, but for guesses in loops: their values where the loops close nearest to all of them.

    Least squares by Gauss–Newton steps would go on from there, overshoot where it is far from the guesses, and come to
    another way to close the loops.
    """
    value = targets.value.copy()
    if closed is not None:
        order = np.argsort(closed.tied)
        at = np.searchsorted(closed.tied, targets.variable, sorter=order)
        at = order[np.minimum(at, len(order) - 1)] if len(order) else at
        own = np.isin(targets.variable, closed.tied) & ~targets.hard
        nearest = closed.nearest[at[own]]
        value[own] = np.where(np.isnan(nearest), value[own], nearest)
    return value


class StartSystem:
    """Residuals ``variable - value`` and of the initial equations, and their Jacobian by states and quadratures.

    Attributes
    ----------
    wished : (m,) values wanted; 0 for equations
    value : (m,) those that are looked for: guesses in loops that close elsewhere give way to where these do
    hard : (m,) whether a residual must vanish
    rest : (n,) where states are to be that nothing decides: at zero, in loops where these are closed
    level : (m,) which residuals count first: 0 for those that must vanish, above it by the ranks of start values
    """

    def __init__(
        self,
        plan: Plan,
        base: np.ndarray,
        signals: Mapping,
        values: np.ndarray,
        time: float,
        targets: Targets,
        report: Report,
        closed: StartGuess | None = None,
        rest: np.ndarray | None = None,
    ) -> None:
        self.plan, self.time, self.targets, self.signals = plan, time, targets, signals
        self.flat = plan.reduced.flat
        self.rest = np.zeros(len(plan.states)) if rest is None else rest
        equations = InitialEquations(plan, signals, report)
        self.place = equations.place
        outputs = np.concatenate([plan.reduced.register_of[targets.variable], equations.out]).astype(int)
        self.program, self.interpreter, self.jacobian, self._rounding = _parts(plan, equations, outputs)
        self.interpreter.reset()
        self.outputs = outputs
        self.w = np.concatenate([base, np.full(equations.count - plan.count, np.nan)])
        equations.fill(self.w, values, time)
        for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
            self.w[register] = signals[variable].value(time, order)
        self._seeds = self.w.copy()
        none = np.zeros(len(equations.out))
        self.wished = np.concatenate([targets.value, none])
        self.value = np.concatenate([_reachable(targets, closed), none])
        self._last: tuple[np.ndarray, tuple] | None = None
        self.hard = np.concatenate([targets.hard, np.ones(len(equations.out), bool)])
        rank = np.concatenate([self.flat.start_rank[targets.variable], np.zeros(len(equations.out), int)])
        self.level = np.where(self.hard, 0, 1 + rank)

    def restart(self) -> None:
        """Let blocks begin at their first guesses again, not at their last solutions."""
        self.w[:] = self._seeds
        self.interpreter = Interpreter(self.program, len(self.w))

    def evaluate(self, x: np.ndarray):
        """Residuals (m,) and their Jacobian as (rows, columns, values)."""
        if self._last is None or not np.array_equal(self._last[0], x):  # often evaluated twice at the same place
            self._last = x.copy(), self._evaluate(x)
        return self._last[1]

    def unknowns(self, x: np.ndarray, registers: np.ndarray) -> np.ndarray:
        """The values of unknowns of blocks at x, on the branch that has been followed."""
        self._last = x.copy(), self._evaluate(x)
        return self.w[registers]

    def _evaluate(self, x: np.ndarray):
        self.w[self.plan.states] = x
        self.interpreter.run(self.w, self.time)
        residual = self.w[self.outputs] - self.value
        rows, columns, values = self.jacobian.rows, self.jacobian.columns, self.jacobian.values(self.w, self.time)
        # what only roundoff moves does not follow from the states
        size = np.sqrt(np.bincount(rows, values**2, len(residual)))
        none = without_gradient(size, self.value, lambda: self.sizes(x))
        return residual, (rows, columns, np.where(none[rows], 0.0, values))

    def rounding(self, x: np.ndarray, off: np.ndarray) -> np.ndarray:
        """By how much the residuals may be off, (m,), where the states at least are off by so much."""
        found = self._rounding(self._at(x), self.time, (self.plan.states, off))
        return np.where(np.isfinite(found), found, 0.0)

    def sizes(self, x: np.ndarray) -> np.ndarray:
        """The sizes of the terms that the residuals come from, (m,); 1 where they are not known or larger."""
        return term_sizes(self._rounding, self._at(x), self.time, self.plan.states)

    def _at(self, x: np.ndarray) -> np.ndarray:
        w = self.w.copy()
        w[self.plan.states] = x
        return w

    # ---------------------------------------------------------------- names for messages

    def name(self, k: int) -> str:
        if k < len(self.targets):
            return self.flat.variable_name(int(self.targets.variable[k]))
        group, row = self.place(k - len(self.targets))
        return f"the initial equation `{self.flat.row_text(group, row)}`"

    def text(self, k: int) -> str:
        return f"{self.name(k)} = {self.wished[k]:g}" if k < len(self.targets) else self.name(k)

    def reached(self, k: int, residual: float) -> str:
        """Describe what resulted instead: a value, or the residual of an equation."""
        if k < len(self.targets):
            return f"{self.name(k)} = {self.value[k] + residual:.6g}"
        return f"a difference of {residual:.6g} between the sides of {self.name(k)}"

    def given(self, k: int) -> bool:
        """Return whether the caller wants it, and not the model."""
        return k < len(self.targets) and bool(self.targets.given[k])

    def of_class(self, k: int) -> bool:
        """Return whether it is but a guess: a package gives it, as 288.15 K to a temperature, or the start finds it."""
        if k >= len(self.targets) or self.targets.given[k]:
            return False
        variable = self.targets.variable[k]
        return any(a.of_class for a in self.flat.starts if (a.target == variable).any())

    def span_of(self, group: np.ndarray) -> Span | None:
        """The place of the first of several that stands in the model; None where the caller has given all of them."""
        return next((self.span(k) for k in group.tolist() if not self.given(k)), None)

    def span(self, k: int) -> Span | None:
        if k < len(self.targets):
            variable = self.targets.variable[k]
            for a in self.flat.starts:
                if a.span is not None and (a.target == variable).any():
                    return a.span
            return self.flat.block_at(int(variable)).span
        return self.place(k - len(self.targets))[0].span

    def lost(self, k: int) -> tuple[str, Span | None]:
        """Return which value became NaN first in the last evaluation, where residual k is not finite, and its place."""
        for step in self.program:
            nonlinear = isinstance(step, Solve) and not step.linear
            filled = step.unknowns.ravel() if isinstance(step, Solve) else step.out
            bad = filled[~np.isfinite(self.w[filled])]
            if len(bad) and bad[0] < self.plan.reduced.registers.count:
                return sentence(self.plan.reduced, bad, self.w, nonlinear, self.signals)
        return f"{self.name(k)} has no finite value", self.span(k)
