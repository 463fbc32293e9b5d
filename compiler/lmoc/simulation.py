"""One simulation, from what a user asks for to the `Run` that the user holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lmoc import pipeline
from lmoc.ir.flat import FlatDAE
from lmoc.ir.names import hint_for
from lmoc.ir.prepared import Prepared
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report, RunInterrupted, SimulationError, Subject
from lmoc.parameters import Value, check_initial, check_mappings, extreme_values, indexed
from lmoc.pipeline import Clock
from lmoc.session import Session
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.numerics.evaluate.functions import StartValues
    from lmoc.numerics.events.occasion import Occasion
    from lmoc.numerics.observe.trajectory import End, SegmentRecord, Trajectory
    from lmoc.numerics.options.options import RunOptions
    from lmoc.numerics.run.sensitivities import Direction, Sensitivities, Tangent
    from lmoc.run import Run
    from lmoc.symbolic.places import Point



@dataclass(frozen=True)
class Request:
    """The options and arguments of one simulation.

    Attributes
    ----------
    options : span, output times, tolerances, solver
    parameters, initial, inputs, progress : as in `lmoc.DAE.simulate`
    compiled : {stage: seconds} of the compilation, for the run's timings
    occasions : takes the instants at which something happens; None where nobody asks
    """

    options: RunOptions
    parameters: Mapping[str, Value] | None = None
    initial: Point | str | None = None
    inputs: Mapping[str, object] | None = None
    progress: Callable[[float, float], None] | None = None
    compiled: Mapping[str, float] = field(default_factory=dict)
    occasions: list[Occasion] | None = None


def simulate(session: Session, request: Request, clock: Clock | None = None) -> Run:
    """Simulate once, in other coordinates where the preferred ones do not serve at the start.

    Errors as of `lmoc.DAE.simulate`.
    """
    from lmoc.numerics.observe.trajectory import End

    clock = clock or Clock()
    initial = request.initial
    check_mappings(
        parameters=request.parameters, initial=None if isinstance(initial, str) else initial, inputs=request.inputs
    )
    initial = _start_in_numbers(session, request)
    check_initial(initial or {})
    request = replace(request, initial=initial)
    at_work, prepared = session.prepare(request.parameters, clock)
    if isinstance(initial, End):
        prepared = at_work.continuing(prepared, initial.states, clock)
    prepared = at_work.started(prepared, initial, clock)
    try:
        return run_prepared(at_work, prepared, request, clock)
    except ModelError as error:
        other = at_work.elsewhere(prepared, initial, clock) if _missed_its_start(error) else None
        if other is None:
            raise
    return run_prepared(at_work, other, request, clock)


def _missed_its_start(error: ModelError) -> bool:
    """Return whether other coordinates, or another side of the closures, may start where these have not come to."""
    from lmoc.numerics.start.singular import StartSingular

    return isinstance(error, StartSingular) or any(d.subject is Subject.NO_START for d in error.diagnostics)


def run_prepared(session: Session, prepared: Prepared, request: Request, clock: Clock) -> Run:
    """Simulate what is prepared; errors as of `simulate`, a partial result as a `Run`."""
    from lmoc.numerics.start.singular import StartSingular

    report = Report()
    session.check(prepared.values, report)
    report.check()
    prepared = session.formulated(prepared, request.options.requested, clock)
    with clock.stage("lower"):
        import lmoc.run  # noqa: F401  (the time of its import belongs here, not to the simulation)

        session.simulator(prepared.reduced)

    def result(trajectory: Trajectory, broke_off: float | None = None) -> Run:
        return _as_run(session, prepared, request, report, clock, trajectory, broke_off)

    try:
        with clock.stage("simulate"):
            given = request.options, request.inputs, request.initial, request.progress, request.occasions
            trajectory = session.run(prepared, *given)
    except ModelError as error:
        doubts = () if request.initial or not _missed_its_start(error) else _doubts(prepared)
        if doubts:
            raise ModelError((*report.diagnostics, *doubts)) from None
        if isinstance(error, StartSingular):
            raise StartSingular((*report.diagnostics, *error.diagnostics), error.coordinates, error.place) from None
        raise ModelError((*report.diagnostics, *error.diagnostics)) from error.__cause__
    except (SimulationError, RunInterrupted) as failure:
        if failure.partial is not None:
            failure.partial = result(failure.partial, failure.time)
        suspicion = extreme_values(prepared.flat, prepared.values, {})
        if suspicion and isinstance(failure, SimulationError):
            failure.args = (f"{failure}; {suspicion}",)
        raise
    return result(trajectory)


def _doubts(prepared: Prepared) -> tuple[Diagnostic, ...]:
    """Return why closed loops may not close with what the model fixes."""
    reduced, values = prepared.reduced, prepared.values
    if reduced.guess is None or np.array_equal(values, reduced.values[: len(values)], equal_nan=True):
        return () if reduced.guess is None else reduced.guess.doubts
    nothing = np.zeros(0, int), np.zeros(0)
    return () if reduced.guess_at is None else reduced.guess_at(reduced.flat.extended(values), nothing).doubts


def start_values(session: Session, registers: np.ndarray) -> StartValues:
    """Return the start of a run with the default values, with the values of some registers."""
    from lmoc.numerics.evaluate.functions import StartValues
    from lmoc.numerics.observe.slices import slice_of
    from lmoc.numerics.options.options import RunOptions

    run = simulate(session, Request(RunOptions(times=[session.flat.experiment.start or 0.0])))
    segment = run.trajectory.segments[0]
    observer, times, inputs = segment.observer, segment.time, segment.reduced.inputs[0]
    part = slice_of(observer.plan, np.concatenate([registers, inputs])).bind(observer.base, observer.signals)
    z, u = np.split(part(times, segment.table)[0], [len(registers)])
    return StartValues(float(times[0]), segment.table[0, : len(session.reduced.states)], z, u)


def _start_in_numbers(session: Session, request: Request) -> Mapping[str, float] | None:
    """Return the start as numbers, where it is an equilibrium or given in symbols."""
    initial = request.initial
    if initial is None or initial == {}:
        return initial
    from lmoc.symbolic import starts

    if not starts.in_symbols(initial):
        return initial
    start = request.options.start
    begin = (session.flat.experiment.start or 0.0) if start is None else start
    return starts.start_values(
        session.for_derivation(request.parameters), initial, request.inputs, begin, session.equilibria
    )


def sensitivities(
    session: Session, request: Request, run: Run, names: Sequence[str], rtol: float | None = None
) -> Sensitivities:
    """Return the derivatives of a run by parameters and start values.

    Parameters
    ----------
    rtol : relative tolerance; that of the run, where it is not coarser

    Raises
    ------
    ModelError
        E0575: they are not available, and why; E0622: there is no such parameter or variable.
    """
    from lmoc.numerics.run.along_events import with_events
    from lmoc.numerics.run.sensitivities import check_motion, refused

    check_motion(run.trajectory)
    if not names:
        raise refused("nothing was named")
    prepared = session.prepare(request.parameters)[1]
    if prepared.minimal is not None or any(d.subject is Subject.RESHAPED for d in prepared.notes):
        raise refused("a parameter that was given shapes the model", "give it when the scene is compiled")
    directions = [_direction(request, prepared, run, name) for name in dict.fromkeys(names)]
    changing = [d for d in directions if d.is_parameter]
    if changing:
        sides = np.concatenate([d.around[:, -2:] for d in changing], axis=1)  # what holds a little aside holds nearby
        held = prepared.reduced.guards_hold(sides, near=True)
        if not held.all():
            name = changing[int(np.flatnonzero(~held)[0]) // 2].name
            raise refused(f"the reduction assumes a value of '{name}' that it may not leave")
    first = _first(session, request, run, directions)
    tolerance = max(float(run.stats["rtol"]), rtol or 0.0)
    return with_events(run.trajectory, first, directions, request.occasions or (), tolerance)


def _direction(request: Request, prepared: Prepared, run: Run, name: str) -> Direction:
    """Return what is differentiated by."""
    from lmoc.ir.flat import Kind
    from lmoc.numerics.run.sensitivities import Direction, changed_values, refused, same_values

    segment = run.trajectory.segments[0]
    flat, values = prepared.flat, segment.observer.values
    found = flat.find(name)
    if found is None:
        raise ModelError([Diagnostic("E0622", f"'{name}' is not in '{flat.name}'", hint=hint_for(flat, name))])
    variable, block = int(found[0]), flat.block_at(int(found[0]))
    if len(found) > 1:
        raise refused(f"'{name}' is an array", f"name its members, as {name}[1]")
    if flat.kind[variable] == Kind.PARAMETER:
        value = float(values[variable])
        held = indexed(flat, {**flat.overrides, **(request.parameters or {}), name: value})
        if block.quantity in ("Integer", "Boolean", "String"):
            raise refused(f"'{name}' is no number that changes continuously")
        if block.structural and not block.conditional:
            raise refused(f"'{name}' shapes the model: what is compiled depends on it, as by 'if {name} > 0 then'")
        size = abs(value) or 1.0
        changed = partial(changed_values, flat, held, variable, prepared.reduced.flat.count)
        direction = Direction(name, value, size, changed, True)
        if block.structural and not flat.keeps_shape(direction.around).all():
            raise refused(f"with another value of '{name}' the model has another shape: a condition is on its edge")
        return direction
    if flat.kind[variable] != Kind.UNKNOWN or isinstance(request.initial, str) or hasattr(request.initial, "time"):
        raise refused(f"'{name}' is neither a parameter nor a variable that is free at the start")
    assert run.trajectory.start is not None
    place = run.trajectory.start[None]
    value = float(segment.observer(found, np.array([segment.begin]), place)[0, 0])
    size = max(abs(value), float(np.max(np.abs(segment.observer(found, *segment.samples)), initial=0.0))) or 1.0
    return Direction(name, value, size, partial(same_values, values), False)


def _first(session: Session, request: Request, run: Run, directions: Sequence[Direction]) -> Tangent:
    """Return where a run starts, with derivatives.

    Those of the states follow from the equations of the start where these determine them and nothing happens there;
    else they are differences of starts.
    """
    from lmoc.numerics.run.sensitivities import STEP, Tangent, difference

    segment = run.trajectory.segments[0]
    count = len(segment.observer.plan.states)
    x = run.trajectory.start
    assert x is not None
    own = _slopes_at_start(request, run, directions, x)

    def by_starts(direction: Direction) -> np.ndarray:
        step = STEP * direction.size
        return difference(lambda change: _start_of_changed(session, request, segment, {direction: change}), step)

    table = np.stack([by_starts(d) if known is None else known for d, known in zip(directions, own, strict=True)])
    first = Tangent(segment.begin, x, table[:, :count], np.nan_to_num(table[:, count:]))
    if segment.mode is not None:
        _check_modes(session, request, run, directions, first, all(known is not None for known in own))
    _check_conditions(session, request, run, directions, first)
    return first


def _check_conditions(
    session: Session, request: Request, run: Run, directions: Sequence[Direction], first: Tangent
) -> None:
    """Refuse a start at which a condition is on its edge, and what it decides jumps there."""
    from lmoc.numerics.evaluate.engine_system import EngineSystem
    from lmoc.numerics.run.start_edges import conditions_on_edge, on_edge, refuse_jump

    segment, count = run.trajectory.segments[0], len(first.x)
    for k, by_time in conditions_on_edge(request.occasions or (), directions, first):
        direction, system = directions[k], EngineSystem(segment.observer.plan)
        if by_time and segment.observer.flat.events.whens:  # what follows from it is no rate
            raise on_edge(direction.name)

        def values(change: float, direction: Direction = direction, system: EngineSystem = system) -> np.ndarray:
            found = _start_of_changed(session, request, segment, {direction: change})
            system.prepare(found[count:], segment.observer.signals)
            rates = np.empty(count)
            system.rhs(segment.begin, found[:count], rates)
            return np.concatenate([found[:count], rates])

        refuse_jump(direction.name, values, direction.size)


def _check_modes(
    session: Session, request: Request, run: Run, directions: Sequence[Direction], first: Tangent, smooth: bool
) -> None:
    """Refuse a start at which a mode is on its edge.

    Parameters
    ----------
    smooth : nothing happens there but that laws take their modes
    """
    from lmoc.numerics.run.sensitivities import STEP, mode_registers
    from lmoc.numerics.run.start_edges import check_edges, modes_at_start
    from lmoc.numerics.run.surroundings import OVER_EVENTS

    anew = modes_at_start(request.occasions or (), directions, first) if smooth else None
    if anew is not None:
        check_edges(directions, anew, OVER_EVENTS)
        return
    segment = run.trajectory.segments[0]
    modes = len(first.x) + mode_registers(segment.observer.plan)
    again = any(s.begin == segment.begin for s in run.trajectory.segments[1:])
    held = _start_states(session, request, segment, {}, {}) if again else np.append(first.x, segment.observer.base)
    taken = held[modes]

    def same(changes: np.ndarray) -> bool | None:
        given = {d: c for d, c in zip(directions, changes.tolist(), strict=True) if c}
        try:
            return np.array_equal(_start_of_changed(session, request, segment, given)[modes], taken, equal_nan=True)
        except ModelError:
            return None

    check_edges(directions, same, STEP)


def _slopes_at_start(
    request: Request, run: Run, directions: Sequence[Direction], x: np.ndarray
) -> list[np.ndarray | None]:
    """Return the derivatives (n + registers,) of a start by each direction; None where it has to be started anew."""
    from lmoc.numerics.run.discrete_start import discrete_slopes
    from lmoc.numerics.run.sensitivities import base_derivatives, slope, starts_smoothly
    from lmoc.numerics.start.start_slopes import start_slopes
    from lmoc.numerics.start.targets import own_starts
    from lmoc.symbolic import starts

    initial: Point | End | str = request.initial or {}
    found: list[np.ndarray | None] = [None] * len(directions)
    if isinstance(initial, str) or hasattr(initial, "time") or starts.in_symbols(initial):
        return found
    held = discrete_slopes(run.trajectory, directions, request.occasions or ())
    if held is None or not starts_smoothly(run.trajectory, x):
        return found
    segment = run.trajectory.segments[0]
    observer, flat = segment.observer, segment.observer.flat
    base = base_derivatives(observer, directions)
    if flat.events is not None:
        base[:, observer.plan.reduced.register_of[flat.events.discrete]] = held
    given = np.concatenate([np.zeros(0, int), *(flat.find(name) for name in initial)])
    own = [k for k, direction in enumerate(directions) if direction.is_parameter]
    groups = [(own, initial), *(([k], {**initial, d.name: d.value}) for k, d in enumerate(directions) if k not in own)]
    for group, asked in groups:  # parameters leave the equations of the start as they are
        wished = np.zeros((len(group), flat.count))
        for row, k in zip(wished, group, strict=True):
            direction = directions[k]
            if direction.is_parameter:
                row[:] = slope(lambda values: own_starts(flat, values)[0], direction)
                row[given] = 0.0
            else:
                row[flat.find(direction.name)] = 1.0
        states = start_slopes(observer, segment.begin, x, asked, wished, base[group]) if group else []
        for k, own in zip(group, states, strict=True):
            found[k] = None if own is None else np.concatenate([own, base[k]])
    return found


def _start_of_changed(
    session: Session, request: Request, segment: SegmentRecord, changes: Mapping[Direction, float]
) -> np.ndarray:
    """Return as `_start_states` where a run starts with some quantities changed."""
    given = {d.name: d.value + change for d, change in changes.items() if not d.is_parameter}
    parameters = {name: value for d, change in changes.items() for name, value in d.parameters(change).items()}
    return _start_states(session, request, segment, parameters, given)


def _start_states(
    session: Session,
    request: Request,
    segment: SegmentRecord,
    parameters: Mapping[str, Value],
    initial: Mapping[str, float],
) -> np.ndarray:
    """Return the states where a run starts with some values changed, and what stays as it is (n + registers,)."""
    from lmoc.numerics.run.sensitivities import refused

    options = replace(request.options, start=segment.begin, stop=None, points=None, times=[segment.begin], keep=None)
    given = {**(request.initial or {}), **initial} if initial else request.initial
    changed = {**(request.parameters or {}), **parameters}
    own = replace(request, options=options, parameters=changed, initial=given, progress=None, occasions=None)
    found = simulate(session, own)
    start = found.trajectory.segments[-1]
    if start.coordinates != segment.coordinates:
        raise refused("the coordinates at the start depend on its values")
    return np.concatenate([found.trajectory.last[1], start.observer.base])


def _as_run(
    session: Session,
    prepared: Prepared,
    request: Request,
    report: Report,
    clock: Clock,
    trajectory: Trajectory,
    broke_off: float | None,
) -> Run:
    """Return what a user holds of a trajectory: with all notes, timings, and the way to more output times."""
    from lmoc.run import Run

    def again(times: np.ndarray) -> Run:
        finer = replace(request.options, stop=None, points=None, times=times, max_seconds=None)  # it has an end
        origin = replace(prepared, reduced=prepared.minimal or prepared.reduced, minimal=None)
        return run_prepared(session, origin, replace(request, options=finer, progress=None), Clock())

    def extended(flat: FlatDAE, inputs: Mapping[str, float], initial: Mapping[str, float] | None = None) -> Run:
        own = Session(session.scene, flat, Clock())
        values = np.concatenate([prepared.values[: prepared.flat.count], own.values[prepared.flat.count :]])
        reduced = pipeline.reduce(flat, values, session.scene.states, Clock())
        if not reduced.has_states_of(prepared.reduced):  # what was added has led to others that serve as well
            reduced = pipeline.reduce(flat, values, prepared.reduced.state_names, Clock())
        begun = {**(request.initial or {}), **initial} if initial else request.initial
        wanted = replace(request, inputs={**(request.inputs or {}), **inputs}, initial=begun, progress=None)
        return run_prepared(own, Prepared(flat, reduced, values), wanted, Clock())

    notes = *session.flat.notes, *prepared.reduced.notes, *prepared.notes, *report.diagnostics, *trajectory.notes
    lower, start = (float(trajectory.stats[f"{stage}_seconds"]) for stage in ("lower", "start"))
    spent = {**request.compiled, **clock.seconds}
    spent |= {"lower": spent["lower"] + lower, "start": start, "simulate": spent["simulate"] - lower - start}
    return Run(prepared.reduced, trajectory, tuple(dict.fromkeys(notes)), spent, broke_off, again, extended)
