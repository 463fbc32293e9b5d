"""What an FMU needs to know of a scene: tapes, the tables of its variables, its start; or why it cannot be one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmoc.export.accuracy import step_factor
from lmoc.export.instants import Instants, Told, instants, message_of
from lmoc.export.jumps import JumpTables, jump_tables
from lmoc.export.laws import LawTables, law_tables, why_not
from lmoc.export.loops import (
    LoopTables,
    Tied,
    as_given,
    closing_parameters,
    in_all_coordinates,
    loop_tables,
    states_along,
    tied_ones,
    values_at_start,
)
from lmoc.export.refusals import refusal
from lmoc.export.settable import Tried, begun
from lmoc.export.variables import Variable, listed
from lmoc.expression.dag import ONE, depends_on_time, slot
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.program import Apply, Program, Solve, Step, Total, needed_steps, read, written
from lmoc.ir.reduced import Reduced
from lmoc.lower.blocks import derivatives_tape, values_tape
from lmoc.lower.tape import Tape
from lmoc.messages.diagnostics import Report
from lmoc.numerics.evaluate.engine_system import has_branches
from lmoc.numerics.laws.switching import all_open
from lmoc.numerics.observe.slices import slice_of
from lmoc.numerics.plan import kinks
from lmoc.numerics.plan.plan import Plan, build_plan
from lmoc.numerics.signals.signals import Constant, Formula, Signal, default_signals
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.structure.laws.degree import dependent
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.dae import CompiledDAE
    from lmoc.run import Run


@dataclass(frozen=True, eq=False)
class Executable:
    """A scene as an FMU holds it.

    Attributes
    ----------
    plan : Plan
    parametric : Tape
        Fills derived parameters and the registers that follow from them; variables of the flat model stand behind the
        registers of the plan.
    right, observe, slopes : Tape
        Derivatives of states, all other variables, derivatives of both.
    known : (parametric.registers,) values that nothing changes, NaN elsewhere
    given, kept : registers that follow from parameters; those from which `observe` begins
    unknowns, guess : unknowns of nonlinear blocks and their values at the start
    turning : which of them are no lengths
    tied : variables of closed loops that are not given at the start
    inputs, input_start : registers and values
    parameters : flat variables that can be set
    start, nominal : (states,)
    breaks : s, kinks and jumps of functions of time
    finer : factor on the tolerance of the steps of a co-simulation
    outputs : registers behind the derivatives among the rows of `slopes`
    rows, columns : (entries,) of `slopes`
    branches : nonlinear blocks are closures of loops
    events : Instants
    laws : LawTables; None where there are none
    jumps : JumpTables; None where nothing steps
    loops : closed loops whose coordinates are all states; None where minimal coordinates serve all the way
    closing : (parameters,) whether their closures depend on one
    variables : in the order of their value references, from 1 on
    assumed : assertions about parameters that can be set; places behind the registers of `parametric`
    zero_inputs : {name: 0} of inputs that the model leaves open
    held : names of parameters that cannot be set, since structure or start depend on them
    dae : CompiledDAE
    run : the run from which start and nominal values are taken
    """

    dae: CompiledDAE
    run: Run
    plan: Plan
    parametric: Tape
    right: Tape
    observe: Tape
    slopes: Tape
    known: np.ndarray
    given: np.ndarray
    kept: np.ndarray
    unknowns: np.ndarray
    guess: np.ndarray
    turning: np.ndarray
    tied: Tied
    inputs: np.ndarray
    input_start: np.ndarray
    parameters: np.ndarray
    start: np.ndarray
    nominal: np.ndarray
    finer: float
    breaks: np.ndarray
    outputs: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    branches: bool
    events: Instants
    laws: LawTables | None
    jumps: JumpTables | None
    loops: LoopTables | None
    closing: np.ndarray
    variables: tuple[Variable, ...]
    assumed: Told
    zero_inputs: dict[str, float]
    held: tuple[str, ...]


def executable(dae: CompiledDAE) -> Executable:
    """Return a scene as an FMU holds it.

    Raises
    ------
    ModelError
        E0669: it has what cannot be exported. E0520 and others as `DAE.simulate` raises them.
    """
    _refuse(dae)
    flat, reduced = dae.flat, dae.reduced
    signals, open_inputs = _signals(flat, reduced)
    report = Report()
    plan = build_plan(reduced, signals, False, report)
    report.check()
    if why := why_not(plan):
        raise refusal(flat, why)
    zero_inputs = {flat.variable_name(v): 0.0 for v in open_inputs}
    run = dae.simulate(energy=False, inputs=zero_inputs)
    minimal = plan
    of_loops = in_all_coordinates(dae, run)
    if of_loops is not None:
        plan = build_plan(of_loops, signals, False, report)
        report.check()
    base = plan.base(plan.reduced.flat.extended(dae.values), signals)
    span = float(run.time[0]), float(run.time[-1])
    inputs = _inputs(plan)
    right, observing, exported = _programs(plan)
    observe = values_tape(observing, plan.count)
    unknowns = np.concatenate([_unknowns(right), _unknowns(observe)]).astype(int)
    guessed, start, motion = _motion(run, plan, unknowns, of_loops is not None)
    values = plan.reduced.flat.extended(dae.values)
    laws = law_tables(plan, values, signals, _inputs, (run.time, motion)) if reduced.switched is not None else None
    jumps = jump_tables(plan)
    nothing = np.zeros(0, int)
    read = nothing if laws is None else laws.read.ravel(), nothing if jumps is None else jumps.registers
    events = instants(plan, values, lambda: _longest(dae, plan, base, signals, span), np.concatenate(read))
    loops = None if of_loops is None else loop_tables(plan, values, start, inputs, minimal)
    from_parameters, known = _parameter_program(dae, plan)
    tried = Tried(dae, plan, signals, zero_inputs, span, begun(run, len(minimal.states)), from_parameters)
    settable, held = tried.settable()
    closing = closing_parameters(loops, from_parameters, settable + plan.count, len(known))
    if loops is not None and not loops.free.any():  # with other values they are closed elsewhere
        held = (*held, *(flat.variable_name(v) for v in settable[closing]))
        settable, closing = settable[~closing], closing[~closing]
    from_parameters, known, assumed = _assumed(plan, from_parameters, known, settable)
    variables = listed(dae, plan, inputs, exported, settable, events, [] if laws is None else laws.indicator_texts)
    variables = variables if loops is None else as_given(variables, loops, closing)
    outputs = np.array(sorted({v.register for v in variables if v.causality == "output"}), int)
    rule = _slopes(plan, observing, inputs, outputs)
    nominal = np.abs(motion).max(axis=0, initial=0.0)
    return Executable(
        dae, run, plan, values_tape(from_parameters, len(known)), right, observe,
        derivatives_tape(plan.program + observing, rule, plan.count),
        known, _given(plan), _kept(plan, observing), unknowns,
        guessed, _turning(plan, unknowns), tied_ones(plan, dae.reduced, run, loops),
        inputs, base[inputs], settable, start, np.where(nominal > 0, nominal, 1.0),
        step_factor(dae, plan, run, zero_inputs),
        kinks.break_times(plan, base, *span), outputs, rule.rows, rule.columns, has_branches(plan), events, laws,
        jumps, loops, closing, variables, assumed, zero_inputs, held,
    )  # fmt: skip


def _motion(
    run: Run, plan: Plan, unknowns: np.ndarray, of_loops: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the unknowns of blocks and the states at the start of a run, and the states along it (times, states)."""
    trajectory = run.trajectory
    if of_loops:
        guessed, start = (values_at_start(trajectory, plan, r) for r in (unknowns, plan.states))
        return guessed, start, states_along(trajectory, plan)
    first = trajectory.segments[0]
    guess = slice_of(first.observer.plan, unknowns).bind(first.observer.base, first.observer.signals)
    guessed = guess(first.time[:1], first.table[:1])[0] if len(unknowns) else np.zeros(0)
    motion = np.concatenate([segment.table[:, : len(plan.states)] for segment in trajectory.segments])
    return guessed, begun(run, len(plan.states)), motion


def _slopes(plan: Plan, observing: Program, inputs: np.ndarray, outputs: np.ndarray) -> Jacobian:
    """Return the derivatives of states' rates and outputs by states and inputs."""
    return Jacobian(
        plan.program + observing, np.concatenate([plan.states, inputs]).astype(int),
        np.concatenate([plan.derivatives, outputs]).astype(int), plan.count,
    )  # fmt: skip


def _refuse(dae: CompiledDAE) -> None:
    """Refuse samples that the start determines."""
    flat = dae.flat
    if flat.events is not None and (flat.kind[flat.events.clocks()] == Kind.UNKNOWN).any():
        raise refusal(flat, "the equations of its start determine when it samples")


def _inputs(plan: Plan) -> np.ndarray:
    """Return the registers that are set from outside: not those of discrete variables, whose derivatives are zero, nor
    of the laws' modes."""
    register, variable, _ = plan.reduced.inputs
    own, form = register[plan.reduced.flat.kind[variable] == Kind.DISCRETE], plan.reduced.switched
    if form is not None:
        own = np.concatenate([own, register[np.isin(variable, form.modes)], plan.held])
    found = np.array([r for r, _ in plan.constants], int)
    return found[~np.isin(found, own)]


def _longest(
    dae: CompiledDAE, plan: Plan, base: np.ndarray, signals: dict[int, Signal], span: tuple[float, float]
) -> float:
    """Return the longest step, in s, that looks often enough at relations of time."""
    if dae.flat.events is None:
        return np.inf
    from lmoc.numerics.events.discrete_state import DiscreteState
    from lmoc.numerics.events.event_handler import longest_step
    from lmoc.numerics.events.layout import EventLayout

    values = plan.reduced.flat.extended(dae.values)
    return longest_step(DiscreteState(plan.once(EventLayout), values, base, signals, span[0]), span[1] - span[0])


def _members(flat: FlatDAE, name: str) -> list[int]:
    """The variables of a name that has been found before."""
    found = flat.find(name)
    return [] if found is None else found.tolist()


def _no_column(column: int, order: int) -> float:
    raise ValueError(f"a shape without variables reads column {column}")


def _signals(flat: FlatDAE, reduced: Reduced) -> tuple[dict[int, Signal], list[int]]:
    """Return the signals of inputs: a formula of the model stays inside, all others are set from outside; and those
    that the model leaves open."""
    signals: dict[int, Signal] = default_signals(flat)
    opened = [int(v) for v in np.flatnonzero(flat.kind == Kind.INPUT) if int(v) not in signals]
    for v, signal in signals.items():
        if isinstance(signal, Formula) and not signal.variables and not depends_on_time(signal.shape):
            from lmoc.expression.evaluate import evaluate

            signals[v] = Constant(float(evaluate(signal.shape, _no_column, 0.0)))
    own = [] if flat.events is None else flat.events.discrete.tolist()
    if reduced.switched is not None:
        signals |= all_open(reduced.switched)
    return {**signals, **{v: Constant(0.0) for v in (*opened, *own)}}, opened


# ---------------------------------------------------------------------- programs


def _programs(plan: Plan) -> tuple[Tape, Program, np.ndarray]:
    """Return the tape of derivatives, the program of what is observed, and which registers it can fill."""
    reduced = plan.reduced
    good = np.zeros(plan.count, bool)
    good[plan.known[0]] = True
    good[plan.states] = True
    good[[r for r, _ in plan.constants]] = True
    good[plan.absent] = False
    for step in (*reduced.parameter_program, *plan.program, *reduced.observe):
        if isinstance(step, Apply):
            good[step.out] = good[step.slots].all(axis=1)
        elif isinstance(step, Total):
            lengths = np.diff(step.start)
            missing = np.bincount(np.repeat(np.arange(len(lengths)), lengths), ~good[step.index], len(lengths))
            good[step.out] = missing == 0
        else:
            assert isinstance(step, Solve)
            inside = read(step)
            good[written(step)] = good[inside].all()
    wanted = reduced.register_of[reduced.register_of >= 0]
    observing = needed_steps(reduced.observe, wanted[good[wanted]], plan.count)
    return values_tape(plan.program, plan.count), observing, good


def _kept(plan: Plan, observing: Program) -> np.ndarray:
    filled = np.zeros(plan.count, bool)
    for step in observing:
        filled[written(step)] = True
    return np.flatnonzero(~filled)


def _given(plan: Plan) -> np.ndarray:
    """Return the registers that follow from parameters alone."""
    filled = [plan.known[0], *(written(step) for step in plan.reduced.parameter_program)]
    return np.unique(np.concatenate(filled)).astype(int)


def _unknowns(tape: Tape) -> np.ndarray:
    return np.concatenate([np.zeros(0, int), *(b.unknowns.ravel() for b in tape.blocks if b.work)])


def _turning(plan: Plan, unknowns: np.ndarray) -> np.ndarray:
    variables = plan.reduced.registers.variable[unknowns]
    is_length = plan.reduced.flat.per_variable(lambda b: b.unit == "m", np.bool_)
    return np.asarray((variables < 0) | ~is_length[variables])


def _parameter_program(dae: CompiledDAE, plan: Plan) -> tuple[Program, np.ndarray]:
    """Return what fills bindings and derived parameters, and the values with which it begins."""
    flat, count = plan.reduced.flat, plan.count
    known = np.full(count + flat.count, np.nan)
    known[count : count + len(dae.values)] = dae.values
    given = np.array([v for name in flat.overrides for v in _members(flat, name)], np.int64)
    steps: list[Step] = []
    for a in flat._parameter_bindings[1]:
        free = np.flatnonzero(~np.isin(a.target, given))
        # one by one: a row may use what the row before has filled
        steps += [Apply(a.shape, a.slots[i : i + 1] + count, a.target[i : i + 1] + count) for i in free.tolist()]
    taken = Apply(slot(0) * ONE, (plan.known[1] + count)[:, None], plan.known[0])
    return (*steps, taken, *plan.reduced.parameter_program), known


def _assumed(
    plan: Plan, program: Program, known: np.ndarray, settable: np.ndarray
) -> tuple[Program, np.ndarray, Told]:
    """Return the program of parameters, the values with which it begins, and the assertions that it judges, too: those
    about parameters alone that depend on what can be set."""
    flat, count = plan.reduced.flat, plan.count
    moved = dependent(program, settable + count, len(known))[count:]
    steps: list[Step] = []
    places: list[np.ndarray] = []
    errors: list[int] = []
    texts: list[str] = []
    for check in flat.checks:
        judged = check in flat.constant_checks
        rows = np.flatnonzero(moved[check.slots].any(axis=1)) if judged else np.zeros(0, int)
        if not len(rows):
            continue
        places.append(len(known) + sum(map(len, places)) + np.arange(len(rows)))
        steps.append(Apply(check.condition * ONE, check.slots[rows] + count, places[-1]))
        errors += [int(check.error)] * len(rows)
        texts += [message_of(flat, check)(int(row)) for row in rows]
    found = np.concatenate([np.zeros(0, int), *places]).astype(int)
    values = np.concatenate([known, np.full(len(found), np.nan)])
    return (*program, *steps), values, Told(found, np.array(errors, int), tuple(texts))
