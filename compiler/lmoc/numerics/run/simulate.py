"""Run a reduced system: what is kept between runs, and the door to a single one."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lmoc.expression.dag import slots
from lmoc.ir.flat import Kind, Simplified
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import ModelError, Report, nearest
from lmoc.messages.ranges import report_alike
from lmoc.numerics.coordinates.change import RunState
from lmoc.numerics.failures.pace import Pace
from lmoc.numerics.laws.select import make_system
from lmoc.numerics.observe.trajectory import End, Trajectory
from lmoc.numerics.options.options import (
    FIXED_STEP,
    MOREAU,
    SOLVERS,
    RunOptions,
    TimeSpan,
    checked_formulation,
    solver_hint,
)
from lmoc.numerics.plan.plan import Plan, build_plan
from lmoc.numerics.problem.system import System
from lmoc.numerics.run.segments import run_segments, starting_place
from lmoc.numerics.signals.signals import Constant, Formula, Signal, bind_signals, gives, note_held_ends
from lmoc.numerics.start.constant_way import stays
from lmoc.numerics.start.parameters import check_derived, check_parameters
from lmoc.numerics.task.sizes import too_loose
from lmoc.numerics.task.task import Coordinates, Progress, Task
from lmoc.structure.messages.equations import SHOWN
from lmoc.support import budget

if TYPE_CHECKING:
    from lmoc.numerics.events.occasion import Occasion

_FIRST_STEP = 0.25  # of the way from a simplified model to the actual one
_SHORTEST_STEP = 1e-4
_PASSES = 4  # runs of a motion whose size is not known beforehand


class Simulator:
    """A reduced system made ready to run many times.

    What does not depend on parameter values, on numbers given as inputs, or on the start is made once: the plan, the
    casadi functions, the integrators' workspaces.
    """

    def __init__(self, reduced: Reduced) -> None:
        self.reduced = reduced
        self._way: WayToStart | None = None  # of a model with homotopies
        self._systems: dict[object, tuple[Plan, System]] = {}

    def system(self, signals: Mapping[int, Signal], energy: bool, report: Report) -> tuple[Plan, System]:
        """Return the plan and the system for signals of these kinds."""
        key = energy, tuple(sorted((v, _kind_key(s)) for v, s in signals.items()))
        if key not in self._systems:
            found = Report()
            plan = build_plan(self.reduced, signals, energy, found)
            report.diagnostics += [d for d in found.diagnostics if d.severity != "error"]
            report_alike(dict.fromkeys(found.errors), report, SHOWN)  # an input and its derivative lack one signal
            report.check()
            self._systems[key] = plan, make_system(plan, signals)
        return self._systems[key]

    def start(
        self,
        values: np.ndarray,
        options: RunOptions,
        inputs: Mapping[str, object] | None,
        initial: Mapping[str, float] | End | None,
        near: RunState | None = None,
    ) -> RunState:
        """Return where a run starts. Parameters and errors as of `run`; `near` as of `Task`."""
        task, plan, system, base = self._task(values, options, inputs, initial, None, None)
        task = task if near is None else replace(task, near=near)
        return starting_place(task, plan, system, base, initial or {})

    @property
    def orders(self) -> np.ndarray:
        """Return which derivatives of which inputs are in use, (2, k): initial equations may ask for rates as well."""
        flat, used = self.reduced.flat, self.reduced.inputs[1:]
        leaves = [n for g in flat.initial_groups for e in (g.left, g.right) for n in slots(e)]
        if not any(order for _, order in (n.value for n in leaves)):
            return used
        rates = np.flatnonzero(flat.kind == Kind.INPUT)
        return np.concatenate([used, np.stack([rates, np.ones_like(rates)])], axis=1)

    def with_modes(self, signals: Mapping[int, Signal]) -> dict[int, Signal]:
        """Return signals with those that the run itself sets: all laws open, and what events change as it begins."""
        found = dict(signals)
        if self.reduced.switched is not None:
            from lmoc.numerics.laws.switching import all_open

            found |= all_open(self.reduced.switched)
        if self.reduced.flat.events is not None:
            from lmoc.numerics.events.event_handler import held

            found |= held(self.reduced.flat.events)
        return found

    def run(
        self,
        values: np.ndarray | None = None,
        options: RunOptions | None = None,
        inputs: Mapping[str, object] | None = None,
        initial: Mapping[str, float] | End | RunState | None = None,
        progress: Progress | None = None,
        others: Coordinates | None = None,
        occasions: list[Occasion] | None = None,
    ) -> Trajectory:
        """Simulate once.

        Parameters
        ----------
        values : (flat.count,) parameter values (`FlatDAE.parameter_values`); those of the reduction without it.
            Whether they keep its guards is the caller's business.
        options : RunOptions
        inputs : {name: number, formula, callable, table or CSV file} in place of the inputs' own bindings
        initial : {name: value}, fixed at the start, or where another run has ended, or where one begins
        progress : called with (time reached, stop time) a few times a second
        others : simulators of the same model with other coordinates
        occasions : takes the instants at which something happens; None where nobody asks

        Raises
        ------
        ModelError
            Inputs, parameters or start are wrong.
        SimulationError
            The run failed on its way; `time` and `partial` (a Trajectory) say how far it came.
        RunInterrupted
            The same where it was interrupted from the keyboard.
        """
        task, plan, system, base = self._task(values, options or RunOptions(), inputs, initial, progress, others)
        task = task if occasions is None else replace(task, occasions=occasions)
        return _run_at_its_size(task, plan, system, base, initial or {})

    def _task(
        self,
        values: np.ndarray | None,
        options: RunOptions,
        inputs: Mapping[str, object] | None,
        initial: Mapping[str, float] | End | RunState | None,
        progress: Progress | None,
        others: Coordinates | None,
    ) -> tuple[Task, Plan, System, np.ndarray]:
        """Return what a run does, with its plan, its system, and the registers that stay as they are."""
        began = clock.perf_counter()
        values = self.reduced.flat.extended(self.reduced.values if values is None else values)
        report = Report()
        span = check_options(options, self.reduced, report, initial)
        signals = bind_signals(self.reduced.flat, inputs, report, self.orders, (span.start, span.end))
        report.check()
        signals = self.with_modes(signals)
        if options.solver == MOREAU:
            from lmoc.numerics.laws import time_stepping

            time_stepping.refuse(self.reduced, report)
            report.check()
            signals = {**signals, **time_stepping.recorded(self.reduced.switched)}
        note_held_ends(signals, self.reduced.flat, np.array([span.start, span.end]), report)
        plan, system = self.system(signals, options.energy, report)
        lowered = clock.perf_counter()
        base = plan.base(values, signals)
        check_parameters(plan, base, values, report)
        report.check()
        check_derived(plan, base, report)
        progress, near = _heard(progress, span), self._near(values, options, inputs, initial, span.start, report)
        task = Task(values, signals, options, span, report, progress, others, (began, lowered), near)
        return task, plan, system, base

    def _near(
        self,
        values: np.ndarray,
        options: RunOptions,
        inputs: Mapping[str, object] | None,
        initial: Mapping[str, float] | End | RunState | None,
        time: float,
        report: Report,
    ) -> RunState | None:
        """Return where the start is looked for: the end of the way from the simplified model, if there is one."""
        if self.reduced.flat.simplified is None or isinstance(initial, End | RunState):
            return None
        if self._way is None:
            self._way = WayToStart(self.reduced.flat.simplified)
        return self._way.end(values, options, inputs, initial, time, report)


class WayToStart:
    """The way from the start of a simplified model to that of the model that it stands for (`homotopy`, 3.7.4.4)."""

    def __init__(self, simplified: Simplified) -> None:
        self.simplified, self.flat, self.weight = simplified, simplified.flat, simplified.weight
        self._simulators: list[Simulator] = []  # one for each set of assumptions about the parameters

    def end(
        self,
        values: np.ndarray,
        options: RunOptions,
        inputs: Mapping[str, object] | None,
        initial: Mapping[str, float] | None,
        time: float,
        report: Report,
    ) -> RunState | None:
        """Return the start at the end of the way; None, and a note, where it does not lead there."""
        near, weight, step = None, 0.0, 0.0
        while near is None or weight < 1.0:
            then = min(weight + step, 1.0)
            own = self.flat.extended(values[: self.flat.count])
            own[self.weight] = then
            try:
                near = self._simulator(own).start(own, options, inputs, initial, near)
            except ModelError as error:
                step *= 0.25
                if step < _SHORTEST_STEP:
                    _no_way(report, weight, error)
                    return None
                continue
            if then == 0.0 and stays(self.simplified, near, time):
                return near
            weight, step = then, 2.0 * step or _FIRST_STEP
        return near

    def _simulator(self, values: np.ndarray) -> Simulator:
        for made in self._simulators:
            if not made.reduced.broken_guard(values):
                return made
        from lmoc.structure.laws.reduce import reduce_with_laws

        report = Report()
        reduced = reduce_with_laws(self.flat, values, None, report)
        report.check()
        self._simulators.append(Simulator(reduced))
        return self._simulators[-1]


def _no_way(report: Report, weight: float, error: ModelError) -> None:
    why = next((d.message for d in error.diagnostics if d.severity == "error"), str(error))
    hint = "where there are several solutions, a start value near the one that is meant chooses it"
    text = "homotopy leads to no start, which is looked for with the actual expressions alone: "
    text += f"{100 * weight:.3g} % of the way behind the simplified ones, {why}"
    report.note_once("N0543", text, hint=hint)


def _heard(progress: Progress | None, span: TimeSpan) -> Progress:
    """Return the progress of a run that its budget hears of, too, and that tells of a long run."""
    pace = Pace(span.start, span.end)

    def told(t: float, stop: float) -> None:
        budget.reached((t - span.start) / (span.end - span.start) if span.end > span.start else 1.0)
        pace.reached(t)
        if progress is not None:
            progress(t, stop)

    return told


def _run_at_its_size(
    task: Task, plan: Plan, system: System, base: np.ndarray, initial: Mapping[str, float] | End | RunState
) -> Trajectory:
    """Run; where the motion is much smaller than its tolerances were chosen for, again with tolerances of its size."""
    said = list(task.report.diagnostics)
    for _ in range(_PASSES):
        if task.occasions is not None:
            task.occasions.clear()
        run = run_segments(task, plan, system, base, initial)
        tolerant = task.options.atol is None and task.options.solver not in FIXED_STEP
        sizes = too_loose(run, task.values, task.sizes, run.stats["rtol"]) if tolerant else None
        if sizes is None:
            break
        task = replace(task, sizes=sizes, report=Report(list(said)))
        base = plan.base(task.values, task.signals)
    return run


def simulate(
    reduced: Reduced,
    values: np.ndarray | None = None,
    options: RunOptions | None = None,
    inputs: Mapping[str, object] | None = None,
    initial: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a reduced system once (see `Simulator.run`); for many runs keep a `Simulator`."""
    return Simulator(reduced).run(values, options, inputs, initial, progress)


def check_options(
    options: RunOptions, reduced: Reduced, report: Report, initial: Mapping[str, float] | End | RunState | None = None
) -> TimeSpan:
    """Return the span of the run and its output times; errors for what cannot be done."""
    if options.solver not in SOLVERS:
        hint = solver_hint(str(options.solver))
        report.error("E0540", f"there is no solver '{options.solver}'", expected=", ".join(SOLVERS), hint=hint)
    try:
        checked_formulation(str(options.formulation), options.solver)
    except ModelError as error:
        report.diagnostics += error.diagnostics
    for name in options.keep or ():
        if reduced.flat.find(name) is None:
            hint = nearest(name, [".".join(n for n, _ in b.path) for b in reduced.flat.blocks])
            report.error("E0542", f"'{name}' cannot be kept: there is no such variable", hint=hint)
    try:
        options.check_tolerances(reduced.flat.experiment)
        return options.span(reduced.flat.experiment, initial.time if isinstance(initial, End) else None)
    except ValueError as error:
        report.error("E0541", str(error))
        return TimeSpan(0.0, 0.0, np.zeros(1))


def _kind_key(signal: Signal) -> tuple:
    if isinstance(signal, Formula):
        return "formula", signal.shape, signal.variables
    if isinstance(signal, Constant):
        return ("constant",)
    return type(signal).__name__, *(gives(signal, order, needed) for order in range(4) for needed in (True, False))
