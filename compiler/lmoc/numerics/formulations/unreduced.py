"""All equations of a flat model in IDA, without reduction: what reduction is compared with."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lmoc.messages.diagnostics import Report
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.laws.select import make_system
from lmoc.numerics.plan.plan import Plan, build_plan
from lmoc.numerics.problem.base import Outcome, Problem
from lmoc.numerics.signals.signals import Signal
from lmoc.numerics.steps import ida, loop
from lmoc.structure.unreduced import Unreduced

_STEPS = 20_000
_ROUNDS = 8  # of Gauss and Newton's method, for the start


class OpenEquations:
    """``x' = f(y), 0 = r(t, y)`` for y = (x, z), as `IndexOne`, whatever its index."""

    algebraic_size = 1.0

    def __init__(self, unreduced: Unreduced, signals: Mapping[int, Signal], values: np.ndarray, report: Report) -> None:
        self.plan: Plan = build_plan(unreduced.reduced, signals, False, report)
        plan = self.plan
        opened = replace(
            plan,
            states=np.concatenate([plan.states, unreduced.unknown]),
            derivatives=np.concatenate([plan.derivatives, unreduced.residual]),
            _made={},
        )
        self.system = make_system(opened)
        self.system.prepare(plan.base(values, signals), signals)
        self.n, self.states = self.system.n, len(plan.states)
        self.description = self.system.description
        self.differential = np.arange(self.n) < self.states
        table = plan.reduced.registers
        self.variable, self.order = table.variable[opened.states], table.order[opened.states]

    def start(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return x, which is complete."""
        return x

    def rhs(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        self.system.rhs(t, x, out)

    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        return self.system.pattern()

    def jacobian_values(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        self.system.jacobian_values(t, x, out)

    def consistent(self, t: float, values: np.ndarray) -> np.ndarray:
        """Return y at the start, its derivatives found from the equations by Gauss and Newton's method.

        Parameters
        ----------
        values : (flat.count,) the variables there
        """
        y = np.where(self.order == 0, values[self.variable], np.nan)
        free = ~np.isfinite(y)
        y[free] = 0.0
        residual = np.empty(self.n)
        for _ in range(_ROUNDS if free.any() else 0):
            self.rhs(t, y, residual)
            matrix = self.system.jacobian(t, y)[self.states :][:, free]
            move = np.linalg.lstsq(matrix, residual[self.states :], rcond=None)[0]
            y[free] -= move
            if np.abs(move).max() <= 1e-10 * max(1.0, float(np.abs(y[free]).max())):
                break
        return y


def integrate(
    equations: OpenEquations, start: float, y: np.ndarray, times: np.ndarray, rtol: float, seconds: float
) -> tuple[Outcome, np.ndarray]:
    """Integrate open equations by IDA; returns the outcome, and y at the output times reached.

    Parameters
    ----------
    y : (n,) at the start
    times : (k,) s
    seconds : of the processor in this thread, after which it is given up
    """
    table = np.full((len(times), equations.n), np.nan)
    outline = EngineSystem(equations.plan)
    outline.n = equations.n

    def sink(first: int, states: np.ndarray) -> None:
        table[first : first + len(states)] = states

    atol = rtol * 1e-3 * np.fmax(1.0, np.abs(y))
    deadline = clock.thread_time() + seconds
    problem = Problem(
        outline, start, y, float(times[-1]), times, rtol, atol, sink, max_steps=_STEPS, deadline=deadline,
        index_one=equations,
    )  # fmt: skip
    outcome = loop.integrate(problem, ida.begin(problem))
    return outcome, table[: outcome.reached]
