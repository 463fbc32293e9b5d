"""A scene that is stepped from a loop: for controllers, games and hardware.

A smooth scene whose equations are explicit keeps one integrator at work, which advances exactly to each requested time;
what it costs beside the integration is a few microseconds. Functions of time in it are looked at some steps ahead, for
short pulses and kinks. Any other scene (switching laws, events, closed loops whose
coordinates may have to change) is run from one time to the next as `simulate` does, from where the last run ended.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.names import UnknownNameError, hint_for
from lmoc.ir.program import Solve
from lmoc.messages.budgeted import budgeted
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report, SimulationError, nearest
from lmoc.numerics.events.steps import Steps
from lmoc.numerics.laws.select import make_system
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.one_state import moved, why_not
from lmoc.numerics.observe.trajectory import End
from lmoc.numerics.plan import kinks
from lmoc.numerics.plan.activity import lookout, pulsing
from lmoc.numerics.plan.plan import Plan, build_plan
from lmoc.numerics.plan.steps import stepping_inputs
from lmoc.numerics.problem.base import Problem
from lmoc.numerics.problem.status import Status
from lmoc.numerics.signals.signals import Constant, Signal, bind_signals, break_times
from lmoc.numerics.steps import automatic, choice, onward
from lmoc.numerics.task.sizes import assumed_sizes
from lmoc.support import budget

if TYPE_CHECKING:
    from lmoc.run import Run


_AHEAD = 16  # steps for which functions of time are looked at together
_AT_ONCE = 64  # steps between two looks at the budget


class Scene(Protocol):
    """The scene that is stepped: a `DAE`."""

    def simulate(self, **options) -> Run: ...


class Live:
    """A scene at one time, and the way to a later one. Made by `DAE.live`.

    Attributes
    ----------
    time : s
    inputs : the numbers at the top-level inputs, {name: value}; those that follow another signal are absent until they
        are set. A new value holds from the present time on
    events : records of switching and impacts since the beginning
    """

    def __init__(self, scene: Scene, run: Run, inputs: Mapping[str, object], options: Mapping[str, object]):
        self._scene, self._options, self._given = scene, dict(options), dict(inputs)
        self._stepping: dict[str, float] = {}  # the values before of inputs that have yet to step
        self.inputs = Inputs(self)
        self.events: list = list(run.events)
        self._stand(run)

    def _stand(self, run: Run, end: End | None = None) -> None:
        """Stand where a run has ended, or at another state of it."""
        self._run = run
        self._end = run.trajectory.end if end is None else end
        self.time = float(self._end.time)
        self._smooth = _Smooth(run, self._end, self._given) if _is_smooth(run, self._given) else None

    def advance(self, dt: float) -> float:
        """Go on by dt seconds; returns the time there, which is an earlier one where the model says `terminate`.

        Raises
        ------
        ModelError
            E0541: dt is not positive.
        SimulationError
            The integration failed; `.time` is the time reached. Where it has no explicit equations, the scene stays
            where it was before the call.
        """
        if not (type(dt) is float or isinstance(dt, Real)) or not 0 < dt < math.inf:  # the former is quicker
            raise ModelError([Diagnostic("E0541", f"a step of {dt!r} s is not possible", expected="seconds, above 0")])
        target = self.time + dt
        if not self._stepping and self._smooth is not None and self._smooth.goes_at_once(target):
            self.time = target
            return target
        return self._advance(target)

    @budgeted("the step")
    def _advance(self, target: float) -> float:
        if self._stepping:
            self._stand(self._stepped(target))
            target = self.time
        elif self._smooth is None:
            run = self._simulated(self._end, target)
            self._run, self._end = run, run.trajectory.end
            target = float(self._end.time)  # earlier where the model has ended the run
        elif not self._smooth.go(target):
            self._stand(self._simulated(self._here(self._smooth.run.t), target))
        self.time = target
        return target

    def _stepped(self, target: float) -> Run:
        """Return a run up to a time that begins with the steps of inputs that have been set."""
        pairs = {name: (old, self._given[name]) for name, old in self._stepping.items()}
        steps = {n: f"if time < ({self.time!r}) then ({old!r}) else ({new!r})" for n, (old, new) in pairs.items()}
        run = self._simulated(replace(self._here(), stepping=True), target, self._given | steps)
        self._stepping.clear()
        return run

    def _simulated(self, end: End, target: float, inputs: Mapping[str, object] | None = None) -> Run:
        """Return a run from a state up to a time."""
        given = self._given if inputs is None else inputs
        options = {"initial": end, "start": end.time, "stop": target, "points": 2, "inputs": given}
        run = self._scene.simulate(**options, **self._options)
        self.events += run.events
        return run

    def __getitem__(self, name: str) -> float:
        """Return the value of a variable now.

        Raises
        ------
        UnknownNameError
            A KeyError: there is no such variable, or it is an array.
        """
        if self._smooth is not None:
            return self._smooth.value(name)
        return self._observed(name, self._end.x)

    @property
    def _observer(self) -> Observer:
        return self._smooth.observer if self._smooth is not None else self._run.trajectory.segments[-1].observer

    def _observed(self, name: str, x: np.ndarray) -> float:
        return float(self._observer(_variable(self._run.flat, name), np.array([self.time]), x[None])[0, 0])

    def set(self, name: str, value: float) -> None:
        """Change a state now, or what one state alone determines.

        Raises
        ------
        ModelError
            E0621: it follows from several states, or from none; no value of its state leads there; the value is not a
            finite number.
        """
        value = _finite(name, value)
        x = np.array(self._smooth.run.x if self._smooth is not None else self._end.x, float)
        names = self._end.states
        if name in names:
            x[names.index(name)] = value
        else:
            x = self._moved(x, name, value)
        if self._smooth is not None:
            self._smooth.run.jump(x)
        else:
            self._end = replace(self._end, x=x, mode=None)  # the laws are judged again there

    def values(self, names: Sequence[str]) -> np.ndarray:
        """Return the values of several variables now.

        Raises
        ------
        UnknownNameError
            A KeyError, as of a single one.
        """
        places = None if self._smooth is None else self._smooth.places(names)
        return np.array([self[n] for n in names]) if places is None else self._smooth.run.x[places]

    def _moved(self, x: np.ndarray, name: str, value: float) -> np.ndarray:
        """Return the states after a change of the one that a variable follows from."""
        found = moved(lambda states: self._observed(name, states), x, value)
        if found.x is not None:
            return found.x
        plan = self._observer.plan
        why = why_not(found.followed, [plan.reduced.register_name(int(s)) for s in plan.states])
        raise ModelError([Diagnostic("E0621", f"'{name}' cannot be set: {why}", hint="set states instead")])

    def copy(self) -> Live:
        """Return another scene in the same state, independent of this one."""
        other = Live.__new__(Live)
        other._scene, other._options, other._given = self._scene, dict(self._options), dict(self._given)
        other.inputs, other.events, other._stepping = Inputs(other), list(self.events), dict(self._stepping)
        other._stand(self._run, self._here())
        return other

    def _here(self, time: float | None = None) -> End:
        """Return the state now, or at a time between that the integrator has come to."""
        if self._smooth is None:
            return self._end
        return replace(self._end, time=self.time if time is None else time, x=np.array(self._smooth.run.x))

    def _give(self, name: str, variables: np.ndarray, value: float) -> None:
        """A new number for an input; where the motion depends on its derivative, it steps when the scene goes on."""
        if self._observer.plan.once(Steps).is_moved_by(variables):
            before = self._stepping.get(name, self[name])
            self._stepping.pop(name, None)
            if before != value:
                self._stepping[name] = before
        self._given[name] = value
        if self._smooth is not None and not self._smooth.give(variables, value):
            self._stand(self._run, self._here())

    def __repr__(self) -> str:
        return f"<Live {self._run.flat.name} at {self.time:g} s>"


class Inputs(MutableMapping):
    """The numbers at the inputs of a live scene."""

    def __init__(self, live: Live):
        self._live = live
        self._variables: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> float:
        value = self._live._given[name]
        if not isinstance(value, (int, float)):
            raise KeyError(name)
        return float(value)

    def __setitem__(self, name: str, value: float) -> None:
        found = self._variables.get(name)
        if found is None:
            found = self._variables[name] = self._find(name)
        self._live._give(name, found, _finite(name, value))

    def _find(self, name: str) -> np.ndarray:
        flat = self._live._run.flat
        found = flat.find(name)
        if found is None or flat.kind[found[0]] != Kind.INPUT:
            names = [b.pattern for b in flat.blocks if b.kind == Kind.INPUT]
            hint = nearest(name, names) or (f"the inputs are {', '.join(names)}" if names else "the model has none")
            raise ModelError([Diagnostic("E0622", f"'{name}' is not an input of '{flat.name}'", hint=hint)])
        return found

    def __delitem__(self, name: str) -> None:
        raise TypeError("an input keeps a value: set another one")

    def __iter__(self) -> Iterator[str]:
        return (name for name, value in self._live._given.items() if isinstance(value, (int, float)))

    def __len__(self) -> int:
        return sum(1 for _ in self)


class _Smooth:
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
        self.states, self.seen = {name: i for i, name in enumerate(end.states)}, {}
        self.known: dict[tuple[str, ...], np.ndarray | None] = {}  # places of names asked for together
        rtol, none = float(run.stats["rtol"]), np.zeros(0)
        atol = rtol * 1e-3 * assumed_sizes(self.plan, self.values, end.x, {})
        start, patience = float(end.time), automatic.patience(self.system)
        self.problem = Problem(
            self.system, start, end.x, math.inf, none, rtol, atol, lambda first, states: None, patience=patience
        )
        self.run = onward.begin(self.problem)
        self.timed = _depends_on_time(self.plan, self.signals)
        self.seen_until = start

    def goes_at_once(self, target: float) -> bool:
        """Integrate up to a time where that takes a few steps; return whether it has come there."""
        return not self.timed and self.run.reach(target, _AT_ONCE) is Status.OK and self.run.t >= target

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
            status = run.reach(target, _AT_ONCE)
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
        x = self.run.x
        place = self.states.get(name)
        if place is not None:
            return float(x[place])
        seen = self.seen.get(name)
        if seen is None:
            seen = self.seen[name] = self.observer.prepare(_variable(self.observer.flat, name))
        return float(seen(np.array([self.run.t]), x[None])[0, 0])

    def places(self, names: Sequence[str]) -> np.ndarray | None:
        """Return where variables stand among the states; None where one of them is none."""
        key = tuple(names)
        if key not in self.known:
            found = [self.states.get(name) for name in key]
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


def _finite(name: str, value: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        message = f"'{name}' cannot be set to this value"
        raise ModelError([Diagnostic("E0621", message, expected="a finite number", found=f"{value!r:.60}")])
    return number


def _variable(flat: FlatDAE, name: str) -> np.ndarray:
    found = flat.find(name)
    if found is None or len(found) != 1:
        if name.startswith("der("):
            raise UnknownNameError(name, "derivatives are not available here; read a variable of the model")
        raise UnknownNameError(name, hint_for(flat, name))
    return found


def _depends_on_time(plan: Plan, signals: Mapping[int, Signal]) -> bool:
    """Return whether an integrator could step over something that happens at a time."""
    steady = all(isinstance(signal, Constant) for signal in signals.values())
    return not steady or bool(plan.once(pulsing)) or bool(plan.once(kinks.switches))


def _is_smooth(run: Run, given: Mapping[str, object]) -> bool:
    """Return whether nothing switches, no input steps with an impulse, and no coordinates have to be watched."""
    flat, reduced, observer = run.flat, run.reduced, run.trajectory.segments[-1].observer
    if stepping_inputs(observer.plan, bind_signals(flat, given, Report(), reduced.inputs[1:])):
        return False
    nonlinear = any(isinstance(step, Solve) and not step.linear for step in reduced.rhs)
    return reduced.switched is None and flat.events is None and not nonlinear and len(reduced.states) > 0
