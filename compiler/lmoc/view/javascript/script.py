"""A run as data: what a page needs to simulate the scene again with other parameter values.

The programs are those of the plan of the run, which the engine runs in the page; the registers are those of the plan,
behind them the parameters of the flat model that something is computed from.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator

import numpy as np

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import ONE, TIME, ZERO, if_, slot
from lmoc.ir.flat import Assignments, FlatDAE, Kind
from lmoc.ir.program import Apply, Program, Step, read, written
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.trajectory import Trajectory
from lmoc.numerics.options.options import MOREAU
from lmoc.numerics.plan import kinks
from lmoc.numerics.plan.activity import lookout
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.plan.steps import stepping_inputs
from lmoc.numerics.problem.base import REQUESTED
from lmoc.numerics.signals.curves import Curve
from lmoc.numerics.signals.signals import Function, break_times
from lmoc.numerics.signals.tables import Table
from lmoc.support.records import dataclass
from lmoc.view.javascript.accuracy import absolute_tolerances, refinement, seeds
from lmoc.view.javascript.coordinates import coordinates, pairs, passage, write_constraints
from lmoc.view.javascript.events import write_events
from lmoc.view.javascript.jumps import JumpTables, write_jumps
from lmoc.view.javascript.laws import LawTables, write_laws
from lmoc.view.javascript.programs import InstantTables, Programs, packed_programs
from lmoc.view.javascript.start import start_program

FINER = 0.1  # factor on the tolerance where the run has used a method that the page does not have
MOST_ROWS = 10_000  # of all steps: more makes a large page, and a run that takes seconds


EngineTables = tuple[InstantTables | None, LawTables | None, JumpTables | None]


class NotWritten(Exception):
    """The run cannot be repeated in a page; the text says why."""


@dataclass(frozen=True, eq=False)
class Script:
    """The data from which a page simulates.

    Attributes
    ----------
    data : what `simulate.js` reads, in plain lists, numbers and texts; None stands for NaN. `code` are the programs as
        bytes in base64, `programs` the numbers that they have there
    slots : (flat.count,) where the value of each parameter stands, -1 where nothing is computed from it
    registers : (flat.count,) where the value of each variable stands after ``observe``, -1: nowhere
    """

    data: dict
    slots: np.ndarray
    registers: np.ndarray


def write_script(trajectory: Trajectory, stop: float | None = None) -> Script:
    """Return a run as data of a page.

    Parameters
    ----------
    stop : s, where it ends; by default where the run was to end, or has failed

    Raises
    ------
    NotWritten
        For what the page cannot do: inputs that are Python functions, coordinates that change, …
    """
    _check(trajectory)
    observer, segment = trajectory.observer, trajectory.segments[0]
    times, states = segment.samples
    if not len(times) or times[0] != segment.begin:
        raise NotWritten("the start of the run is not among its output times")
    stop = trajectory.planned if stop is None else stop
    places = [(observer, times[0], states[0]), *_other_choices(trajectory)]
    scenes = [_Scene(o, segment.begin, stop, t, x, trajectory) for o, t, x in places]
    return _with_choices(*scenes) if len(scenes) > 1 else scenes[0].script()


def _other_choices(trajectory: Trajectory) -> Iterator[tuple[Observer, float, np.ndarray]]:
    """Yield an observer, a time and the state there for each choice of coordinates that the run has changed to."""
    known = [sorted(trajectory.segments[0].coordinates)]
    for segment in trajectory.segments:
        path, own = segment.observer.path, sorted(segment.coordinates)
        times, states = segment.samples if path is None else (path.times, path.states)
        if own not in known and len(times) and not segment.reduced.in_all_coordinates:
            known.append(own)
            yield segment.observer, float(times[0]), states[0]


def _with_choices(*scenes: _Scene) -> Script:
    """Return the script of a run that changes its coordinates."""
    main, *rest = (scene.script() for scene in scenes)
    data = [
        script.data | {"slots": pairs(main.slots, script.slots), "observed": pairs(main.registers, script.registers)}
        for script in rest
    ]
    passages = [[passage(a.observer, b.plan) for b in scenes] for a in scenes]
    choices = {"choices": data, "passages": passages}
    return Script(main.data | choices, main.slots, main.registers)


def _check(trajectory: Trajectory) -> None:
    observer = trajectory.observer
    reduced, flat = observer.plan.reduced, observer.flat
    happens = reduced.switched is not None or flat.events is not None
    if (happens or stepping_inputs(observer.plan, observer.signals)) and trajectory.begun is None:
        raise NotWritten("the run goes on where another one has ended, whose events the page does not know")
    if flat.events is not None and (flat.kind[flat.events.clocks()] == Kind.UNKNOWN).any():
        raise NotWritten("the equations of the start determine when it samples, which the page does not compute")
    if trajectory.stats.get("solver") == MOREAU:
        raise NotWritten("the run takes steps of equal length with impulses, which the page does not compute")
    for variable, _ in observer.plan.samplers:
        if isinstance(observer.signals[variable], Function):
            name = flat.variable_name(variable)
            raise NotWritten(f"the input '{name}' is a function of Python, which the page does not have")
    if observer.plan.row_count > MOST_ROWS:
        rows = f"{observer.plan.row_count:,}".replace(",", " ")
        raise NotWritten(f"the scene is too large to be simulated in a page ({rows} rows of equations)")


class _Scene:
    """One run on its way to a script."""

    def __init__(
        self,
        observer: Observer,
        begin: float,
        stop: float,
        time: float,
        x: np.ndarray,
        trajectory: Trajectory,
    ) -> None:
        stats = trajectory.stats
        self.plan: Plan = observer.plan
        self.observer, self.begin, self.stop, self.time, self.x = observer, begin, stop, time, x
        self.flat: FlatDAE = observer.flat
        self.rtol = float(stats.get("rtol", 1e-6)) * (1.0 if stats.get("solver") == "dop853" else FINER)
        self.automatic = stats.get("reason") != REQUESTED
        own = trajectory.begun if observer is trajectory.observer else None  # other coordinates begin on the way
        self.first = own or (x, observer.base)
        self.count = self.plan.count
        self.slots = np.full(self.flat.count, -1)
        self.base = list(observer.base)
        self.undetermined = np.isin(np.arange(self.flat.count), self.plan.reduced.undetermined)

    def add(self, count: int, values: np.ndarray | None = None) -> np.ndarray:
        """Return new registers."""
        self.count += count
        self.base += [np.nan] * count if values is None else list(values)
        return np.arange(self.count - count, self.count)

    def of_parameters(self, variables: np.ndarray) -> np.ndarray:
        """Return the registers of parameters of the flat model, made where there are none yet."""
        new = np.unique(variables[self.slots[variables] < 0])
        self.slots[new] = self.add(len(new), self.observer.values[new])
        return self.slots[variables]

    def of_variables(self, variables: np.ndarray) -> np.ndarray:
        """Return the registers of variables of the flat model, -1 where there are none."""
        variables = np.asarray(variables, int)
        known = (variables >= 0) & (self.flat.kind[variables] <= Kind.PARAMETER)
        found = np.where(variables >= 0, self.plan.reduced.register_of[variables], -1)
        if known.any():
            found[known] = self.of_parameters(variables[known])
        return found

    def script(self) -> Script:
        plan = self.plan
        used = plan.read_parameters
        copied = Apply(slot(0), self.of_parameters(used[1])[:, None], used[0])
        x, base = self.first
        before = Observer(plan, self.observer.values, base, self.observer.signals)
        start = start_program(before, self.time, x, self)
        breaks, lines, switches = self._breaks()
        judged, checks = self._checks()
        happening, told, engine = self._happening()
        constraints, watch, judged_by = write_constraints(self.observer, self)
        steps = (copied, *plan.reduced.parameter_program)
        reading = (*steps, *start.wanted, *breaks, *judged, *(s for p in _flat(happening) for s in p))
        steps = (*self._bindings(reading, _read_by_hand(*engine[:2])), *steps, *start.wanted, *judged)
        base = np.array(self.base)
        base[np.concatenate([np.zeros(0, int), *map(written, steps)])] = np.nan
        programs: Programs = {
            "parameters": steps,
            "start": start.program,
            "observe": plan.full_program,
            "breaks": breaks,
            "rhs": plan.program,
            "constraints": constraints,
        }
        code, numbers = packed_programs(plan, programs | happening, self.count, self._curves(), *engine, judged_by)
        data = {
            "code": b64encode(code).decode(),
            "programs": numbers,
            "base": _registers(base),
            "seeds": seeds(self.observer, self.time, self.x),
            "states": plan.states.tolist(),
            "names": [plan.reduced.register_name(int(r)) for r in plan.states],
            "x": _numbers(x),
            "held": start.held,
            "met": start.met,
            "begin": self.begin,
            "end": self.stop,
            "rtol": self.rtol,
            "atol": absolute_tolerances(self.observer, self.time, self.x, self.rtol).tolist(),
            "refine": refinement(self.observer, self.time, self.x) if self.automatic else None,
            "breakTimes": break_times(self.observer.signals, self.begin, self.stop, kinks.MOST // 10).tolist(),
            "checks": checks,
            "watch": watch,
            "coordinates": coordinates(plan),
            **told,
            "lines": lines,
            "switches": switches,
            "bounds": self._bounds(),
        }
        registers = plan.reduced.register_of.copy()
        registers[self.undetermined] = -1
        return Script(data, self.slots, registers)

    def _happening(self) -> tuple[Programs, dict[str, dict | None], EngineTables]:
        """Return the programs of laws, events and steps, the data of each, and what the engine reads of them."""
        programs: Programs = {}
        laws = events = instants = tables = None
        if self.plan.reduced.switched is not None:
            own, laws, tables = write_laws(self.plan, self.observer.values, self.observer.signals, self)
            programs |= own
        if self.flat.events is not None:
            others, events, instants = write_events(self.observer, self)
            programs |= others
        own_steps, jumps, steps = write_jumps(self.plan, self.observer.signals, self)
        return programs | own_steps, {"laws": laws, "events": events, "jumps": jumps}, (instants, tables, steps)

    # ------------------------------------------------------------------ parameters

    def _bindings(self, program: Program, more: list[int]) -> Program:
        """Return the steps that compute parameters bound to others, as far as a program needs them, or `more` names."""
        steps: list[Step] = []
        wanted = np.unique(np.concatenate([np.array(more, int), *map(read, program)]))
        kind = self.flat.kind
        dependent = [a for a in self.flat.bindings if a.slots.shape[1] and kind[a.target[0]] <= Kind.PARAMETER]
        for a in reversed(dependent):
            own = self.slots[a.target]
            rows = np.flatnonzero((own >= 0) & np.isin(own, wanted) & ~self._overridden(a))
            if len(rows):
                slots = self.of_parameters(a.slots[rows].ravel()).reshape(len(rows), -1)
                steps.append(Apply(a.shape, slots, own[rows]))
                wanted = np.union1d(wanted, slots.ravel())
        return tuple(reversed(steps))

    def _overridden(self, a: Assignments) -> np.ndarray:
        """Return which rows of a binding do not hold, because a value has been given instead."""
        values = self.observer.values
        return ~((a.values(values) == values[a.target]) | (np.isnan(a.values(values)) & np.isnan(values[a.target])))

    def _checks(self) -> tuple[Program, list[list]]:
        """Return what judges the values of parameters, and [message, registers] of the judgements."""
        steps: list[Step] = []
        checks: dict[str, list[int]] = {}
        for check in self.flat.checks:
            if check.error and len(check.slots) and (self.flat.kind[check.slots] <= Kind.PARAMETER).all():
                slots = self.of_parameters(check.slots.ravel()).reshape(check.slots.shape)
                out = self.add(len(slots))
                steps.append(Apply(if_(check.condition, ONE, ZERO), slots, out))
                checks.setdefault(check.message, []).extend(out.tolist())
        return tuple(steps), [list(own) for own in checks.items()]

    # ------------------------------------------------------------------ time

    def _breaks(self) -> tuple[Program, list[list[int]], list[list[int]]]:
        """Return what computes the places of kinks in formulas of time.

        Returns
        -------
        the program; (registers of slope and offset) of what is linear in time; (register, 1 where its jumps count and
        not its signs) of the rest
        """
        steps: list[Step] = []
        lines, switches = [], []
        for expression, registers in kinks.switches(self.plan):
            linear = linear_parts(expression, [TIME])
            if linear is None:
                out = self.add(len(registers))
                steps.append(Apply(expression, registers, out))
                switches += [[r, int(expression.op in ("floor", "ceil"))] for r in out.tolist()]
            else:
                slope, offset = self.add(len(registers)), self.add(len(registers))
                steps += [Apply(linear[0][TIME], registers, slope), Apply(linear[1], registers, offset)]
                lines += np.stack([slope, offset], axis=1).tolist()
        return tuple(steps), lines, switches

    def _curves(self) -> list[tuple[int, int, Curve]]:
        """Return which derivative of which table stands in which register."""
        found = []
        for register, (variable, order) in zip(self.plan.sampled.tolist(), self.plan.samplers, strict=True):
            signal = self.observer.signals[variable]
            assert isinstance(signal, Table)
            found.append((register, order, signal.curve))
        return found

    def _bounds(self) -> list[list[float]]:
        """Return from when on steps are bounded, and by how much; infinity is left out as None."""
        seen = lookout(self.plan, self.observer.base, self.observer.signals, (self.begin, self.stop))
        edges = [self.begin, *seen.edges(self.begin, self.stop), self.stop]
        bounds = [(a, seen.longest(a, b)) for a, b in zip(edges, edges[1:]) if b > a]
        return [[a, longest if np.isfinite(longest) else None] for a, longest in bounds]


def _read_by_hand(instants: InstantTables | None, laws: LawTables | None) -> list[int]:
    """Return the registers of parameters that no program reads: those of laws, and of the clocks."""
    found = [] if laws is None else np.concatenate([t.ravel() for t in laws.registers])
    clocks = [] if instants is None else [*instants.columns["start"], *instants.columns["interval"]]
    return [int(r) for r in (*found, *clocks) if r >= 0]


def _flat(programs: Programs) -> list[Program]:
    return [one for p in programs.values() for one in (p if isinstance(p, list) else [p])]


def _registers(values: np.ndarray) -> dict[str, int | list]:
    """Return registers by those that have a value."""
    known = np.flatnonzero(np.isfinite(values))
    return {"count": len(values), "registers": known.tolist(), "values": values[known].tolist()}


def _numbers(values: np.ndarray) -> list[float | None]:
    """Return numbers as JSON has them."""
    return [float(v) if np.isfinite(v) else None for v in values]
