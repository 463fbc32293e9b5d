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

from lmoc.ir.flat import Kind
from lmoc.live.integrator import Held, Integrator, is_smooth, variable_of
from lmoc.messages.budgeted import budgeted
from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest
from lmoc.numerics.events.steps import Steps
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.one_state import moved, places_under, why_not
from lmoc.numerics.observe.trajectory import End
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.run import Run


class Scene(Protocol):
    """The scene that is stepped: a `DAE`."""

    def simulate(self, **options) -> Run: ...


@dataclass(frozen=True)
class _Home:
    """Where a scene was made or copied."""

    run: Run
    end: End
    given: Mapping[str, object]
    events: int
    smooth: Integrator | None


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
        self._settle_in()

    def _stand(self, run: Run, end: End | None = None) -> None:
        """Stand where a run has ended, or at another state of it."""
        self._run = run
        self._end = run.trajectory.end if end is None else end
        self.time = float(self._end.time)
        self._smooth = Integrator(run, self._end, self._given) if is_smooth(run, self._given) else None

    def advance(self, dt: float, inputs: Mapping[str, float] | None = None) -> float:
        """Go on by dt seconds; returns the time there, which is an earlier one where the model says `terminate`.

        Parameters
        ----------
        inputs : numbers that stand at inputs from now on, as if set before; here it is quicker

        Raises
        ------
        ModelError
            E0541: dt is not positive. E0621, E0622: a value is no finite number, or there is no such input.
        SimulationError
            The integration failed; `.time` is the time reached. Where it has no explicit equations, the scene stays
            where it was before the call.
        """
        if not (type(dt) is float or isinstance(dt, Real)) or not 0 < dt < math.inf:  # the former is quicker
            raise ModelError([Diagnostic("E0541", f"a step of {dt!r} s is not possible", expected="seconds, above 0")])
        target = self.time + dt
        if inputs:
            held = self.held(tuple(inputs))
            values = [_finite(*pair) for pair in inputs.items()]
            if held is not None:
                self._given.update(zip(inputs, values, strict=True))
                return self._come_to(target) if held.goes_at_once(values, target) else self._advance(target)
            for name, value in zip(inputs, values, strict=True):
                self.inputs[name] = value
        return self.reach(target)

    def reach(self, target: float) -> float:
        """Go on to a time ahead, s; returns the time there.

        Raises
        ------
        SimulationError
            As of `advance`.
        """
        if not self._stepping and self._smooth is not None and self._smooth.goes_at_once(target):
            return self._come_to(target)
        return self._advance(target)

    def _come_to(self, time: float) -> float:
        self.time = time
        return time

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
        return float(self._observer(variable_of(self._run.flat, name), np.array([self.time]), x[None])[0, 0])

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
        smooth = self._smooth
        places = None if smooth is None else smooth.places(names)
        return np.array([self[n] for n in names]) if smooth is None or places is None else smooth.run.x[places]

    def places(self, names: Sequence[str]) -> np.ndarray | None:
        """Return where variables stand among the states of the integrator; None where one is none, or there is none."""
        return None if self._smooth is None else self._smooth.places(names)

    def _moved(self, x: np.ndarray, name: str, value: float) -> np.ndarray:
        """Return the states after a change of the one that a variable follows from."""
        plan = self._observer.plan
        found = moved(lambda states: self._observed(name, states), x, value, places_under(plan.reduced))
        if found.x is not None:
            return found.x
        why = why_not(found.followed, [plan.reduced.register_name(int(s)) for s in plan.states])
        raise ModelError([Diagnostic("E0621", f"'{name}' cannot be set: {why}", hint="set states instead")])

    def copy(self) -> Live:
        """Return another scene in the same state, independent of this one."""
        other = Live.__new__(Live)
        other._scene, other._options, other._given = self._scene, dict(self._options), dict(self._given)
        other.inputs, other.events, other._stepping = Inputs(other), list(self.events), dict(self._stepping)
        other._stand(self._run, self._here())
        other._settle_in()
        return other

    def rewind(self) -> None:
        """Go back to the time and the state in which the scene was made or copied, with the inputs of then."""
        home = self._home
        self._given, self._stepping = dict(home.given), {}
        del self.events[home.events :]
        if home.smooth is None or not home.smooth.rewind(home.end, self._numbers()):
            self._stand(home.run, home.end)
        else:
            self._run, self._smooth, self._end, self.time = home.run, home.smooth, home.end, float(home.end.time)

    def _settle_in(self) -> None:
        self._home = _Home(self._run, self._here(), dict(self._given), len(self.events), self._smooth)

    def _numbers(self) -> list[tuple[np.ndarray, float]]:
        """Return the variables of inputs that are numbers, and these."""
        return [(self.inputs.variables(name), value) for name, value in self.inputs.items()]

    def held(self, names: tuple[str, ...]) -> Held | None:
        """Return what puts numbers at inputs and goes on, in C; None where Python takes part in a step."""
        if self._smooth is None or self._stepping:
            return None
        found = self._smooth.held
        if names not in found:
            variables = [self.inputs.variables(name) for name in names]
            moved = any(map(self._steps_motion, variables))
            found[names] = None if moved else self._smooth.holding(variables)
        return found[names]

    def stand_at(self, time: float, inputs: Mapping[str, float]) -> None:
        """Stand where somebody has brought the method at work, with the inputs that it was given (`held`)."""
        held = self.held(tuple(inputs))
        assert held is not None
        held.note(list(inputs.values()))
        self._given.update(inputs)
        self._come_to(time)

    def _steps_motion(self, variables: np.ndarray) -> bool:
        """Return whether the motion depends on derivatives of an input, which steps where another number is given."""
        return self._observer.plan.once(Steps).is_moved_by(variables)

    def _here(self, time: float | None = None) -> End:
        """Return the state now, or at a time between that the integrator has come to."""
        if self._smooth is None:
            return self._end
        return replace(self._end, time=self.time if time is None else time, x=np.array(self._smooth.run.x))

    def _give(self, name: str, variables: np.ndarray, value: float) -> None:
        """A new number for an input; where the motion depends on its derivative, it steps when the scene goes on."""
        if self._steps_motion(variables):
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
        self._live._give(name, self.variables(name), _finite(name, value))

    def variables(self, name: str) -> np.ndarray:
        """Return the variables of an input.

        Raises
        ------
        ModelError
            E0622: there is no such input.
        """
        found = self._variables.get(name)
        if found is None:
            found = self._variables[name] = self._find(name)
        return found

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


def _finite(name: str, value: float) -> float:
    if type(value) is float and -math.inf < value < math.inf:  # quicker than what follows
        return value
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        message = f"'{name}' cannot be set to this value"
        raise ModelError([Diagnostic("E0621", message, expected="a finite number", found=f"{value!r:.60}")])
    return number
