"""Which scenes C can run by the thousand, and the start of many runs: what single runs start with, number by number."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.expression.evaluate import evaluate
from lmoc.ir.flat import Kind
from lmoc.ir.program import Solve, walk
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.evaluate.taylor_system import plan_series
from lmoc.numerics.failures.chatter import jumps
from lmoc.numerics.observe.observer import Observer, find, sources
from lmoc.numerics.observe.slices import signal_values, slice_of
from lmoc.numerics.options.options import RunOptions
from lmoc.numerics.plan.activity import pulsing
from lmoc.numerics.plan.kinks import switches
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import System
from lmoc.numerics.signals.signals import Signal
from lmoc.numerics.start.bases import signals_of
from lmoc.numerics.start.first_states import first_states
from lmoc.numerics.start.initialization import is_given, states_of
from lmoc.numerics.start.targets import own_starts
from lmoc.numerics.task.tolerances import absolute_tolerances
from lmoc.support.records import dataclass

SOLVERS = ("auto", "dop853", "taylor")


class NotInLanes(Exception):
    """Why runs are made one by one in Python."""


@dataclass(frozen=True, eq=False)
class Runs:
    """The values of many runs of one plan.

    Attributes
    ----------
    signals : of all runs; that of an input which is a number of its own in each stands for any
    numbers : {input: (runs,)} these numbers
    values : (variables, runs) parameters
    base : (runs, registers) what does not change during a run
    """

    plan: Plan
    signals: Mapping[int, Signal]
    numbers: Mapping[int, np.ndarray]
    values: np.ndarray
    base: np.ndarray

    @property
    def count(self) -> int:
        return len(self.base)

    def observer(self, run: int) -> Observer:
        """Return the observer of one run."""
        signals = signals_of(self.signals, self.numbers, run)
        return Observer(self.plan, np.ascontiguousarray(self.values[:, run]), self.base[run].copy(), signals)

    def of(self, variables: np.ndarray, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return variables of the flat model, (runs, times, variables), of the states (runs, times, n)."""
        plan = self.plan
        constant, inputs, computed = sources(plan, variables)
        part = slice_of(plan, plan.reduced.register_of[variables[computed]])
        if not part.suits_runs or len(times) < 2:
            return np.stack([self.observer(k)(variables, times, states[k]) for k in range(self.count)])
        if len(computed) == len(variables):
            return part.across(self.base, times, states)
        found = np.full((self.count, len(times), len(variables)), np.nan)
        found[:, :, constant] = self.values[variables[constant]].T[:, None]
        for k in inputs.tolist():
            variable = int(variables[k])
            if variable in self.numbers:
                found[:, :, k] = self.numbers[variable][:, None]
            elif variable in self.signals:
                signal = self.signals[variable]
                found[:, :, k] = [signal_values(signal, times, self.values[:, j]) for j in range(self.count)]
        if len(computed):
            found[:, :, computed] = part.across(self.base, times, states)
        return found


def refuse(plan: Plan, system: System, options: RunOptions) -> None:
    """Raise what keeps a scene from being run in C from beginning to end.

    Raises
    ------
    NotInLanes
    """
    reduced, flat = plan.reduced, plan.reduced.flat
    reasons = {
        "laws": bool(flat.laws) or reduced.switched is not None,
        "events": flat.events is not None,
        "homotopy": flat.simplified is not None,
        "closed loops": reduced.constraints is not None or reduced.invariants is not None,
        "nonlinear equations": any(isinstance(s, Solve) and not s.linear for s in walk(plan.full_program)),
        "assertions on the motion": any(c not in flat.constant_checks for c in flat.checks),
        "no states": not len(plan.states),
        "inputs that Python gives": len(plan.sampled) > 0,
        "formulas of time with kinks, jumps or short pulses": bool(plan.once(switches) or plan.once(pulsing)),
        "jumps of its equations": bool(plan.once(jumps)),
        "another evaluation": not isinstance(system, EngineSystem),
        "this solver": options.solver not in SOLVERS,
        "options of their own": options.formulation not in ("auto", "reduced") or options.keep is not None
        or options.step is not None or options.max_seconds is not None or options.max_steps < 10_000,
    }  # fmt: skip
    if options.solver == "taylor":
        reasons["no series"] = isinstance(plan.once(plan_series), str)
    found = next((reason for reason, holds in reasons.items() if holds), "")
    if found:
        raise NotInLanes(found)


def starts(runs: Runs, begin: float, initial: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the states (runs, n) at the start, and which runs (runs,) have one.

    Parameters
    ----------
    initial : {name: (runs,) or, for arrays of the model, (runs, m)}
    """
    found = _direct(runs, initial)
    if found is None and runs.plan.reduced.guess is not None:
        raise NotInLanes("a start that has to be looked for")
    if found is not None:
        return found, np.isfinite(found).all(axis=1)
    states, good = np.full((runs.count, len(runs.plan.states)), np.nan), np.zeros(runs.count, bool)
    for k in range(runs.count):
        observer, report = runs.observer(k), Report()
        own = {name: value[k] for name, value in initial.items()}
        impacts: list = []
        try:
            x = first_states(observer, begin, observer.base, own, report, impacts)(observer.base)
        except ModelError:
            continue
        if not report.errors and not impacts:
            states[k], good[k] = x, np.isfinite(x).all()
    return states, good


def _direct(runs: Runs, initial: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the states (runs, n) where all start values sit on states (`start.initialization`); else None."""
    plan, flat, values = runs.plan, runs.plan.reduced.flat, runs.values
    if flat.initial_groups:
        return None
    start, _ = own_starts(flat, values)
    for name, own in initial.items():
        variables = flat.find(name)
        if variables is None or flat.kind[variables[0]] != Kind.UNKNOWN:
            return None
        start[variables] = own.T
    known = np.isfinite(start) & (flat.kind == Kind.UNKNOWN)[:, None]
    if (known != known[:, :1]).any():
        return None
    chosen = np.flatnonzero(known[:, 0])
    at = states_of(plan, plan.reduced.register_of[chosen])
    if (at < 0).any() or (np.bincount(at, minlength=1) > 1).any():
        return None
    if plan.reduced.guess is not None and not is_given(plan, chosen):
        return None
    x = np.zeros((runs.count, len(plan.states)))
    x[:, at] = start[chosen].T
    return x


def tolerances(runs: Runs, begin: float, x: np.ndarray, rtol: float, atol: float | None) -> np.ndarray:
    """Return the absolute tolerances (runs, n) of runs from states x (runs, n)."""
    plan = runs.plan

    def stored() -> np.ndarray:
        variable, begins = find(plan.reduced.flat, "ledger.stored"), np.array([begin])
        part = slice_of(plan, plan.reduced.register_of[variable])
        if part.suits_runs:
            return part.across(runs.base, begins, x[:, None])[:, 0, 0]
        return np.array([runs.observer(k)(variable, begins, x[k, None])[0, 0] for k in range(runs.count)])

    return absolute_tolerances(plan, runs.values, x, rtol, atol, stored, {})


def sound(runs: Runs) -> np.ndarray:
    """Return which runs (runs,) have values for everything that they read, and keep all assertions on parameters."""
    plan, flat, values = runs.plan, runs.plan.reduced.flat, runs.values
    registers = np.concatenate([plan.read_parameters[0], plan.parameters])
    good = ~np.isnan(runs.base[:, registers]).any(axis=1) & ~np.isnan(values[flat.read_beside]).any(axis=0)
    for check in flat.checks:
        held = evaluate(check.condition, lambda k, _, own=check.slots: values[own[:, k]])
        good &= np.broadcast_to(np.not_equal(held, 0), (len(check.slots), runs.count)).all(axis=0)
    return good
