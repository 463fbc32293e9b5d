"""Run a reduced system: start it, integrate it, and hand out the trajectory."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, Report, RunInterrupted, SimulationError, nearest
from lmoc.messages.ranges import LOOKED_AT, over_range, report_alike
from lmoc.numerics.evaluate.segmented_system import SegmentedSystem
from lmoc.numerics.evaluate.select import make_system
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.failures.checks import run_checks
from lmoc.numerics.failures.diagnosis import first_not_finite, lost_ahead, moving_risks, suspects
from lmoc.numerics.failures.singular import singular_place
from lmoc.numerics.integrate import choice
from lmoc.numerics.integrate.base import Outcome, Problem
from lmoc.numerics.integrate.status import Status
from lmoc.numerics.observe.trajectory import Observer, Recorder, Trajectory, find
from lmoc.numerics.options import FORMULATIONS, SOLVERS, RunOptions, solver_hint
from lmoc.numerics.plan import Plan, build_plan
from lmoc.numerics.signals import kinks
from lmoc.numerics.signals.signals import Constant, Formula, Signal, bind_signals, break_times, gives, note_held_ends
from lmoc.numerics.start.initialization import initial_state, seed_blocks
from lmoc.numerics.start.targets import targets
from lmoc.semantics.parameter_checks import given_without_value
from lmoc.structure.messages.equations import SHOWN
from lmoc.support.distinct import distinct

Progress = Callable[[float, float], None]  # (time reached, stop time)


class Simulator:
    """A reduced system made ready to run many times.

    What does not depend on parameter values, on numbers given as inputs, or on the start is made once: the plan, the
    casadi functions, the integrators' workspaces.
    """

    def __init__(self, reduced: Reduced) -> None:
        self.reduced = reduced
        self._systems: dict[object, tuple[Plan, System]] = {}

    def system(self, signals: Mapping[int, Signal], energy: bool, report: Report) -> tuple[Plan, System]:
        """The plan and the system for signals of these kinds."""
        key = energy, tuple(sorted((v, _kind_key(s)) for v, s in signals.items()))
        if key not in self._systems:
            found = Report()
            plan = build_plan(self.reduced, signals, energy, found)
            report.diagnostics += [d for d in found.diagnostics if d.severity != "error"]
            report_alike(dict.fromkeys(found.errors), report, SHOWN)  # an input and its derivative lack one signal
            report.check()
            self._systems[key] = plan, make_system(plan)
        return self._systems[key]

    def run(
        self,
        values: np.ndarray | None = None,
        options: RunOptions | None = None,
        inputs: Mapping[str, object] | None = None,
        initial: Mapping[str, float] | None = None,
        progress: Progress | None = None,
    ) -> Trajectory:
        """Simulate once.

        Parameters
        ----------
        values : (flat.count,) parameter values (`FlatDAE.parameter_values`); those of the reduction without it.
            Whether they keep its guards is the caller's business.
        options : RunOptions
        inputs : {name: number, formula, callable, table or CSV file} in place of the inputs' own bindings
        initial : {name: value}, fixed at the start
        progress : called with (time reached, stop time) a few times a second

        Raises
        ------
        ModelError
            Inputs, parameters or start are wrong.
        SimulationError
            The run failed on its way; `time` and `partial` (a Trajectory) say how far it came.
        RunInterrupted
            The same where it was interrupted from the keyboard.
        """
        began = clock.perf_counter()
        options = options or RunOptions()
        values = self.reduced.values if values is None else values
        report = Report()
        times = check_options(options, self.reduced, report)
        signals = bind_signals(self.reduced.flat, inputs, report, self.reduced.inputs[1:], (times[0], times[-1]))
        report.check()
        note_held_ends(signals, self.reduced.flat, times, report)
        plan, system = self.system(signals, options.energy, report)
        lowered = clock.perf_counter()
        base = plan.base(values, signals)
        _check_parameters(plan, base, values, report)
        report.check()
        _check_derived(plan, base, report)
        run = _Run(plan, system, Observer(plan, values, base, signals), options, times, report, progress)
        return run.go(initial or {}, began, lowered)


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


class _Run:
    """One run on its way."""

    def __init__(self, plan, system, observer: Observer, options: RunOptions, times, report: Report, progress) -> None:
        self.plan: Plan = plan
        self.system: System = system
        self.observer = observer
        self.options = options
        self.times = times
        self.report = report
        self.progress = None if progress is None else lambda t: progress(t, float(times[-1]))
        ledger = _ledger_names(observer) if options.energy else ()
        keep = None if options.keep is None else (*options.keep, *ledger)
        self.recorder = Recorder(observer, times, keep)
        self.lost = ""  # why the coordinates do not serve

    def go(self, initial: Mapping[str, float], began: float, lowered: float) -> Trajectory:
        plan, report = self.plan, self.report
        observer = self.observer
        wanted = targets(observer.flat, observer.values, initial, report)
        report.check()
        seed_blocks(plan, observer.base, wanted)
        self.system.prepare(observer.base, observer.signals)
        x = initial_state(plan, observer.base, observer.signals, observer.values, float(self.times[0]), wanted, report)
        report.check()
        self._check_start(x)
        self.recorder(0, x[None])
        started = clock.perf_counter()
        outcome, stats = self._integrate(x)
        stats |= {
            "seconds": clock.perf_counter() - began,
            "lower_seconds": lowered - began,
            "start_seconds": started - lowered,
            "states": plan.state_count,
            "rtol": self.options.tolerance(plan.reduced.flat.experiment),
        }
        if not outcome.status.failed:
            self._check_way(outcome)
            outcome = self._up_to_a_singular_place(outcome)
        run = self._trajectory(outcome, stats)
        if outcome.status.failed:
            failure = RunInterrupted if outcome.status is Status.INTERRUPTED else SimulationError
            raise failure(self._explain(outcome), outcome.time, run)
        return run_checks(run)

    def _check_start(self, x: np.ndarray) -> None:
        """All derivatives must be finite at the start, else the run says what is not.

        Equations that no derivative needs must have a solution too; of their other values those that are not finite
        are only warned of, since the motion does not depend on them.
        """
        derivative = np.empty(len(x))
        time, hint = float(self.times[0]), "look at the start values, and at divisions by zero"
        self.system.rhs(time, x, derivative)
        needed = not (np.isfinite(derivative).all() and np.isfinite(x).all())
        program = None if needed else self.plan.full_program
        found, span, nonlinear = first_not_finite(self.observer, time, x, program)
        if needed or nonlinear:
            self.report.error("E0535", f"{found} at the start", span, hint=hint)
            self.report.check()
        elif found:
            self.report.warning("W0537", f"{found} at the start", span, hint=hint)

    def _check_way(self, outcome: Outcome) -> None:
        """Values that the motion does not depend on may be lost on the way, as a square root: the run tells it."""
        if any(d.code == "W0537" for d in self.report.diagnostics):
            return
        times, rows = self.times, np.zeros(0, int)
        if self.recorder.variables is None:
            rows = suspects(self.observer, times, self.recorder.table)
        if self.plan.once(moving_risks).others or self.recorder.variables is not None:
            rows = np.append(rows, len(times) - 1)
        for k in rows.tolist():
            x, near = self.recorder.table[k], None
            if k == len(times) - 1:
                x, near = outcome.x, self.system.registers
            found, span, nonlinear = first_not_finite(self.observer, float(times[k]), x, self.plan.full_program, near)
            if found and not nonlinear:  # nonlinear equations are solved along the way, not from their start
                self.report.warning("W0537", f"{found} at t = {times[k]:g} s", span)
                return

    def _up_to_a_singular_place(self, outcome: Outcome) -> Outcome:
        """A run ends before a place where the coordinates do not determine the rest: it may have gone on wrongly."""
        system = self.system
        if not isinstance(system, SegmentedSystem):
            return outcome
        count = system.evaluations
        times, states = self.recorder.sampled()
        found = singular_place(system, times, states)
        system.evaluations = count
        if found is None:
            return outcome
        reduced, (time, lost) = self.plan.reduced, found
        self.recorder.reached = int(np.searchsorted(self.times, time, "right"))
        self.lost = (
            f"the coordinates {', '.join(reduced.state_names)} do not determine {reduced.register_name(lost)} shortly "
            "after; choose some that determine the rest all the way, by states=[…] (--states) or stateSelect"
        )
        last = states[np.searchsorted(times, time)]
        return replace(outcome, time=time, x=last, reached=self.recorder.reached, status=Status.SINGULAR)

    def _integrate(self, x: np.ndarray) -> tuple[Outcome, dict[str, object]]:
        if not len(x):
            table = np.zeros((len(self.times) - 1, 0))
            self.recorder(1, table)
            return Outcome(float(self.times[-1]), x, len(self.times)), {"solver": "none", "reason": "no states"}
        if len(self.times) == 1:
            return Outcome(float(self.times[0]), x, 1), {"solver": "none", "reason": "only the start"}
        options, experiment = self.options, self.plan.reduced.flat.experiment
        rtol = options.tolerance(experiment)
        deadline = None if options.max_seconds is None else clock.monotonic() + options.max_seconds
        span = float(self.times[0]), float(self.times[-1])
        breaks = kinks.break_times(self.plan, self.observer.base, *span)
        if len(breaks) == kinks.MOST:
            self.report.warning("W0526", f"the formulas of time have kinks or jumps behind t = {breaks[-1]:g} s, too")
        breaks = np.union1d(breaks, break_times(self.observer.signals, *span, kinks.MOST // 10))
        problem = Problem(
            self.system,
            x,
            self.times,
            rtol,
            self._absolute_tolerances(x, rtol),
            self.recorder,
            options.max_steps,
            deadline,
            self.progress,
            breaks=breaks,
        )
        return choice.run(problem, options.solver)

    def _absolute_tolerances(self, x: np.ndarray, rtol: float) -> np.ndarray:
        """(n,); those of the ledger are no finer than what the scene holds at the start has to be known."""
        plan, atol = self.plan, self.options.atol
        result = np.full(len(x), atol, float) if atol is not None else rtol * 1e-3 * plan.nominal(self.observer.values)
        if plan.ledger.any():
            stored = self.observer(find(self.observer.flat, "ledger.stored"), self.times[:1], x[None])
            result[plan.ledger] = np.fmax(result[plan.ledger], rtol * np.abs(stored[0]))
        return result

    def _trajectory(self, outcome: Outcome, stats: dict[str, object]) -> Trajectory:
        times, table = self.recorder.taken()
        if outcome.status.failed and outcome.time > times[-1] and np.isfinite(outcome.x).all():
            times = np.append(times, outcome.time)
            table = np.vstack([table, self.recorder.kept(times[-1:], outcome.x[None])])
        notes: tuple[Diagnostic, ...] = (*self.plan.notes, *self.report.diagnostics)
        return Trajectory(
            self.observer,
            times,
            table,
            self.recorder.variables,
            self.recorder.sampled(),
            stats
            | {"evaluations": self.system.evaluations}
            | outcome.counts
            | {"evaluation": outcome.evaluation or self.system.description, "matrix": outcome.matrix},
            notes=tuple(dict.fromkeys(notes)),
        )

    def _explain(self, outcome: Outcome) -> str:
        found = ""
        if outcome.status in (Status.NOT_FINITE, Status.COLLAPSED):
            found = lost_ahead(self.observer, self.system, outcome.time, outcome.x, float(self.times[-1]))
        detail = f": {found}" if found else ""
        reason = self.lost or outcome.status.value
        return f"the run stopped at t = {outcome.time:.6g} s of {self.times[-1]:g} s: {reason}{detail}"


def check_options(options: RunOptions, reduced: Reduced, report: Report) -> np.ndarray:
    """The output times; errors for what cannot be done."""
    if options.solver not in SOLVERS:
        report.error("E0540", f"there is no solver '{options.solver}'", expected=", ".join(SOLVERS),
                     hint=solver_hint(str(options.solver)))  # fmt: skip
    if options.formulation not in FORMULATIONS:
        report.error("E0626", f"formulation '{options.formulation}' is not available", expected=", ".join(FORMULATIONS))
    for name in options.keep or ():
        if reduced.flat.find(name) is None:
            hint = nearest(name, [".".join(n for n, _ in b.path) for b in reduced.flat.blocks])
            report.error("E0542", f"'{name}' cannot be kept: there is no such variable", hint=hint)
    try:
        options.check_tolerances(reduced.flat.experiment)
        return options.grid(reduced.flat.experiment)
    except ValueError as error:
        report.error("E0541", str(error))
        return np.zeros(1)


def _kind_key(signal: Signal) -> tuple:
    if isinstance(signal, Formula):
        return "formula", signal.shape, signal.variables
    if isinstance(signal, Constant):
        return ("constant",)
    return type(signal).__name__, *(gives(signal, order, needed) for order in range(4) for needed in (True, False))


def _check_parameters(plan: Plan, base: np.ndarray, values: np.ndarray, report: Report) -> None:
    """Every parameter that the equations read has a value."""
    flat, (registers, variables) = plan.reduced.flat, plan.read_parameters
    missing = variables[np.isnan(base[registers])]
    if not len(missing):
        missing = _needed_for_derived(plan, base)
    if len(missing):
        _report_missing(flat, missing, values, report)


def _report_missing(flat: FlatDAE, missing: np.ndarray, values: np.ndarray, report: Report) -> None:
    sources, found = sources_without_value(flat, missing, values), Report()
    bound = np.isin(sources, np.concatenate([np.zeros(0, int), *(a.target for a in flat.bindings)])).tolist()
    given = given_without_value(flat, values)
    for variable, has_binding in list(zip(sources, bound, strict=True))[:LOOKED_AT]:
        block = flat.block_at(variable)
        name = flat.variable_name(variable)
        span = flat.declared_at(variable) if block.part else block.span
        message, hint = f"parameter '{name}' has no value", f"--set {name}=…, or bind it in the model"
        if given[variable]:
            message, span, hint = f"the value given for parameter '{name}' is not a number (nan)", None, ""
        elif has_binding:
            message = f"the value of parameter '{name}' is not a number (nan)"
            hint = "look for 0/0, and for roots or logarithms of negative numbers"
        found.error("E0530", message, span, hint=hint)
    report_alike(found.diagnostics, report, SHOWN, max(0, len(sources) - LOOKED_AT))


def _check_derived(plan: Plan, base: np.ndarray, report: Report) -> None:
    """What follows from parameters alone has a value, too; nothing that moves depends on it if it has none."""
    variables, registers = plan.derived
    lost = variables[~np.isfinite(base[registers])]
    if len(lost) and not np.isnan(base[plan.known[0]]).any():
        flat, first = plan.reduced.flat, int(lost[0])
        value, block = base[registers[variables == first][0]], flat.block_at(first)
        names = [flat.variable_name(v) for v in distinct(lost).tolist() if flat.block_at(v) is block]
        name = over_range(names) or f"{flat.variable_name(first)} (and {len(names) - 1} more of its array)"
        span = flat.declared_at(first) if block.part else block.span
        report.warning("W0537", f"{name} has no finite value ({value})", span)


def sources_without_value(flat: FlatDAE, variables: np.ndarray | int, values: np.ndarray) -> list[int]:
    """The parameters without value that the bindings of some come from; themselves where nothing else lacks one."""
    lacking, wanted = np.isnan(values), np.zeros(flat.count, bool)
    wanted[variables] = True
    for binding in reversed(flat.bindings):  # each uses only what stands before it
        rows = np.flatnonzero(wanted[binding.target])
        slots = binding.slots[rows]
        from_others = lacking[slots]
        wanted[binding.target[rows[from_others.any(axis=1)]]] = False
        wanted[slots[from_others]] = True
    return np.flatnonzero(wanted).tolist()


def _needed_for_derived(plan: Plan, base: np.ndarray) -> np.ndarray:
    """Parameters without value that only derived parameters read."""
    from lmoc.ir.program import needed_steps, read

    bad = plan.parameters[np.isnan(base[plan.parameters])]
    if not len(bad):
        return np.zeros(0, int)
    used = [read(s) for s in needed_steps(plan.reduced.parameter_program, bad, plan.count)]
    if not used:
        return np.zeros(0, int)
    own = np.isin(plan.known[0], np.concatenate(used)) & np.isnan(base[plan.known[0]])
    return plan.known[1][own]


def _ledger_names(observer: Observer) -> tuple[str, ...]:
    names = ("ledger.stored", "ledger.work", "ledger.heat")
    return names if all(observer.flat.find(n) is not None for n in names) else ()
