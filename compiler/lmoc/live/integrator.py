"""One integrator that stays at work: for scenes without events whose equations are explicit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.names import UnknownNameError, hint_for
from lmoc.ir.program import Solve
from lmoc.messages.diagnostics import Report, SimulationError
from lmoc.numerics.laws.select import make_system
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.trajectory import End
from lmoc.numerics.plan import kinks
from lmoc.numerics.plan.activity import lookout, pulsing
from lmoc.numerics.plan.plan import Plan, build_plan
from lmoc.numerics.plan.steps import stepping_inputs
from lmoc.numerics.problem.base import Problem
from lmoc.numerics.problem.status import Status
from lmoc.numerics.signals.signals import Constant, Signal, bind_signals, break_times
from lmoc.numerics.start.initialization import states_of
from lmoc.numerics.steps import automatic, choice, onward
from lmoc.numerics.task.sizes import assumed_sizes
from lmoc.support import budget

if TYPE_CHECKING:
    from lmoc.run import Run

_AHEAD = 16  # steps for which functions of time are looked at together
AT_ONCE = 64  # steps between two looks at the budget


class Integrator:
    """One integrator that stays at work.

    Attributes
    ----------
    run : the integrator, whose `x` are the states and quadratures
    observer : computes all other variables
    """

    def __init__(self, run: Run, end: End, given: Mapping[str, object]):
        report = Report()
        self.values = run.trajectory.segments[-1].observer.values
        self.signals = bind_signals(run.flat, given, report, run.reduced.inputs[1:])
        self.plan: Plan = build_plan(run.reduced, self.signals, False, report)
        report.check()
        self.system = make_system(self.plan)
        self.base = self.plan.base(self.values, self.signals)
        self.system.prepare(self.base, self.signals)
        self.observer = Observer(self.plan, self.values, self.base, self.signals)
        self.registers = {variable: register for register, variable in self.plan.constants}
        self.states = {name: i for i, name in enumerate(end.states)}
        self.seen: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {}  # by names of what is no state
        self.known: dict[tuple[str, ...], np.ndarray | None] = {}  # places of names asked for together
        rtol, none = float(run.stats["rtol"]), np.zeros(0)
        atol = rtol * 1e-3 * assumed_sizes(self.plan, self.values, end.x, {})
        start, patience = float(end.time), automatic.patience(self.system)
        self.problem = Problem(
            self.system, start, end.x, math.inf, none, rtol, atol, lambda first, states: None, patience=patience
        )
        self.run = onward.begin(self.problem)
        self.held: dict[tuple[str, ...], Held | None] = {}  # by names of inputs
        self.timed = _depends_on_time(self.plan, self.signals)
        self.seen_until = start

    def goes_at_once(self, target: float) -> bool:
        """Integrate up to a time where that takes a few steps; return whether it has come there."""
        return not self.timed and self.run.reach(target, AT_ONCE) is Status.OK and self.run.t >= target

    def go(self, target: float) -> bool:
        """Integrate up to a time; False where a stiff method has to go on from the time reached.

        Raises
        ------
        SimulationError
        """
        run = self.run
        if not self.timed:
            return self._reach(target)
        if target > self.seen_until:
            self._look_ahead(target)
        for edge in choice.edges(replace(self.problem, t=run.t, end=target)):
            if edge < run.t - choice.near(edge):
                continue
            before, behind = min(target, edge - choice.near(edge) / 2), edge + choice.near(edge) / 2
            run.max_step = self.problem.lookout.longest(run.t, before)
            if not self._reach(before):
                return False
            if behind > target:
                break
            run.t = max(run.t, behind)
            run.jump(run.x)
        return True

    def _reach(self, target: float) -> bool:
        try:
            status = self._step_to(target)
        except KeyboardInterrupt:  # wherever it strikes, within a step or between two
            if not budget.interrupted():
                raise
            status = Status.SPENT
        if status not in (Status.OK, Status.STIFF):
            raise SimulationError(f"the run stopped at t = {self.run.t:.6g} s: {status.value}", self.run.t)
        return status is Status.OK

    def _step_to(self, target: float) -> Status:
        run, begin = self.run, self.run.t
        while run.t < target:
            status = run.reach(target, AT_ONCE)
            if status is not Status.OK:
                return status
            budget.reached((run.t - begin) / (target - begin))
        return Status.OK

    def _look_ahead(self, target: float) -> None:
        """Look at what depends on time alone, as far as some steps like the present one reach."""
        start = self.run.t
        stop = self.seen_until = start + _AHEAD * (target - start)
        own = kinks.break_times(self.plan, self.base, start, stop)
        given = break_times(self.signals, start, stop, kinks.MOST)
        seen = lookout(self.plan, self.base, self.signals, (start, stop))
        self.problem = replace(self.problem, lookout=seen, breaks=np.union1d(own, given))

    def value(self, name: str) -> float:
        """The value of a variable at the current time."""
        place = self._place(name)
        if place is not None:
            return float(self.run.x[place])
        seen = self.seen.get(name)
        if seen is None:
            seen = self.seen[name] = self.observer.prepare(variable_of(self.observer.flat, name))
        return float(seen(np.array([self.run.t]), self.run.x[None])[0, 0])

    def _place(self, name: str) -> int | None:
        """Return where a variable stands among the states, under whatever name; None where it is none."""
        place = self.states.get(name)
        if place is None and name not in self.seen:
            register = self.plan.reduced.register_of[variable_of(self.observer.flat, name)]
            found = int(states_of(self.plan, register)[0])
            if found >= 0:
                place = self.states[name] = found
        return place

    def places(self, names: Sequence[str]) -> np.ndarray | None:
        """Return where variables stand among the states; None where one of them is none."""
        key = tuple(names)
        if key not in self.known:
            found = [self._place(name) for name in key]
            self.known[key] = None if None in found else np.array(found, int)
        return self.known[key]

    def give(self, variables: np.ndarray, value: float) -> bool:
        """Put a number at an input; False where the system has it as a signal of another kind."""
        given = variables.tolist()
        if not all(isinstance(self.signals.get(v), Constant) for v in given):
            return False
        for v in given:
            self.signals[v] = Constant(value)
            if v in self.registers:
                self.system.put(self.registers[v], value)
        self.seen.clear()
        self.run.restart()
        return True

    def hold(self, variables: np.ndarray, value: float) -> None:
        """Note a number that the method at work has been given already."""
        for v in variables.tolist():
            self.signals[v] = Constant(value)
            if v in self.registers:
                self.system.given[0][self.registers[v]] = value

    def rewind(self, end: End, given: Iterable[tuple[np.ndarray, float]]) -> bool:
        """Go back to the beginning, with inputs of then; False where the method at work cannot."""
        if not isinstance(self.run, onward.Onward):
            return False
        for variables, value in given:
            self.hold(variables, value)
        self.system.prepare(*self.system.given)
        self.run.rewind()
        self.seen.clear()
        self.seen_until = float(end.time)
        return True

    def holding(self, inputs: Sequence[np.ndarray]) -> Held | None:
        """Return what puts numbers at inputs and goes on; None where Python takes part in a step."""
        numbers = all(isinstance(self.signals.get(v), Constant) for own in inputs for v in own.tolist())
        if self.timed or not numbers or not isinstance(self.run, onward.Onward):
            return None
        return Held(self, self.run, inputs)


class Held:
    """Numbers at some inputs, which hold while an integrator goes on: set and integrated in one call of C.

    Attributes
    ----------
    run : the method at work
    places, registers : which registers hold which of the numbers
    """

    def __init__(self, integrator: Integrator, run: onward.Onward, inputs: Sequence[np.ndarray]) -> None:
        self._integrator, self.run = integrator, run
        self._variables = [(k, v) for k, own in enumerate(inputs) for v in own.tolist()]
        pairs = [(k, integrator.registers[v]) for k, v in self._variables if v in integrator.registers]
        self.places, self.registers = [k for k, _ in pairs], [register for _, register in pairs]
        self._abreast, self._pairs = onward.Abreast([run], self.registers, AT_ONCE), list(enumerate(pairs))

    def note(self, values: Sequence[float]) -> None:
        """Note numbers that the method at work has been given."""
        signals, base = self._integrator.signals, self._integrator.system.given[0]
        for k, variable in self._variables:
            signals[variable] = Constant(values[k])
        for _, (k, register) in self._pairs:
            base[register] = values[k]
        self._integrator.seen.clear()

    def goes_at_once(self, values: Sequence[float], target: float) -> bool:
        """Put numbers at the inputs, and integrate up to a time where that takes a few steps; return whether it did."""
        own = self._abreast
        for i, (k, _) in self._pairs:
            own.values[0, i] = values[k]
        own.ends[0] = target
        self.note(values)
        return own.go() is None


def _depends_on_time(plan: Plan, signals: Mapping[int, Signal]) -> bool:
    """Return whether an integrator could step over something that happens at a time."""
    steady = all(isinstance(signal, Constant) for signal in signals.values())
    return not steady or bool(plan.once(pulsing)) or bool(plan.once(kinks.switches))


def is_smooth(run: Run, given: Mapping[str, object]) -> bool:
    """Return whether nothing switches, no input steps with an impulse, and no coordinates have to be watched."""
    flat, reduced, observer = run.flat, run.reduced, run.trajectory.segments[-1].observer
    if stepping_inputs(observer.plan, bind_signals(flat, given, Report(), reduced.inputs[1:])):
        return False
    nonlinear = any(isinstance(step, Solve) and not step.linear for step in reduced.rhs)
    return reduced.switched is None and flat.events is None and not nonlinear and len(reduced.states) > 0


def variable_of(flat: FlatDAE, name: str) -> np.ndarray:
    found = flat.find(name)
    if found is None or len(found) != 1:
        if name.startswith("der("):
            raise UnknownNameError(name, "derivatives are not available here; read a variable of the model")
        raise UnknownNameError(name, hint_for(flat, name))
    return found
