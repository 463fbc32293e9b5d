"""Judgement of the loops of a scene: constraints that are redundant, contradictory, or leave rest only."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np

from lmoc.expression.dag import ZERO
from lmoc.expression.evaluate import evaluate
from lmoc.ir.reduced import Guard
from lmoc.messages.diagnostics import Diagnostic, Label, Report, Subject
from lmoc.messages.ranges import LOOKED_AT, report_alike
from lmoc.structure.linear.coefficients import UNKNOWN, is_constant
from lmoc.structure.linear.derived import DerivedParameters
from lmoc.structure.linear.elimination import Elimination
from lmoc.structure.linear.substitution import Rows
from lmoc.structure.linear.vanishing import Missing
from lmoc.structure.loops.redundancy import Constraints
from lmoc.structure.messages.equations import HELD, Loops, listed
from lmoc.support.distinct import distinct
from lmoc.support.quoted import parent

# of mistakes of one sort, this many are shown; one made in every row of an array counts once
SHOWN = 3
# a search that has walked along so many equations ends: what else may be wrong is only counted
_WALKED = 400_000
_READABLE = 120  # characters of an expression


def closed(work: Elimination, report: Report) -> list[int]:
    """Judge the equations in which no unknown is left; returns those that repeat others."""
    repeated: list[int] = []
    for g in work.closed:
        if g.shape is ZERO:
            repeated += g.source.tolist()
        elif is_constant(g.shape, g.kinds):
            zero = work.splitter.vanishing(g, g.shape, Missing.FITTING)
            repeated += g.source[zero].tolist()
            _judge(work.loops, np.flatnonzero(~zero), partial(_contradiction, work, g), report)
        else:
            _judge(work.loops, g.source, partial(_prescribed_twice, work.loops), report)
    return repeated


def _judge(loops: Loops, members: np.ndarray, judge: Callable[[int, Report], None], report: Report) -> None:
    """Let `judge` say of each member what is wrong there, and tell once what is the same in all."""
    found, seen, limit = Report(), 0, loops.walked + _WALKED
    for member in members[:LOOKED_AT].tolist():
        if loops.walked > limit and len(found.diagnostics) >= SHOWN:
            break
        judge(member, found)
        seen += 1
    report_alike(found.diagnostics, report, SHOWN, len(members) - seen)


def _contradiction(work: Elimination, g: Rows, row: int, report: Report) -> None:
    loops, number = work.loops, int(g.source[row])
    around = loops.around(number)
    if any(map(loops.equations.is_balance, around)):
        _unresisted(loops, around, report)
        return
    parts = loops.equations.parts(around)
    who = f"{listed(parts)} contradict each other" if len(parts) > 1 else "this equation contradicts others"
    if len(around) == 1:
        who = "this equation cannot hold"
    found = f"{work.splitter.text(g, g.shape, row)} = 0 would have to hold"
    if len(found) > _READABLE:
        value = evaluate(g.shape, lambda k, order: work.derived.known[g.slots[row, k]])
        found = f"they miss each other by {abs(float(value)):.6g}"
    _at_loop(loops, around, report, "E0411", f"{who}: no position satisfies all of them", found=found)


def _unresisted(loops: Loops, around: list[int], report: Report) -> None:
    who = listed(loops.equations.parts(around)) or f"'{loops.equations.text(around[0])}'"
    message = f"nothing takes the force of {who}: no mass, spring or support is there to resist it"
    hint = "connect it to a part with mass, or to one that holds it"
    _at_loop(loops, around, report, "E0416", message, hint=hint)


def _prescribed_twice(loops: Loops, number: int, report: Report) -> None:
    around = loops.around(number)
    if any(map(loops.equations.is_balance, around)):
        _unresisted(loops, around, report)
        return
    who = listed(loops.equations.parts(around)) or f"'{loops.equations.text(number)}'"
    message = f"a motion is prescribed twice, through {who}"
    _at_loop(loops, around, report, "E0413", message, hint="prescribe one of them, or put a spring between")


def overdetermined(work: Elimination, report: Report) -> None:
    """Loops whose ratios do not agree: an error among coordinates of a mechanism, an equation elsewhere."""
    if not work.overdetermined:
        return
    potential = work.marked(lambda b: b.connector and not b.flow) | _over_ports(work)
    loops = work.loops
    for g in work.overdetermined:
        variable = g.slots[:, [k for k, kind in enumerate(g.kinds) if kind == UNKNOWN]][:, 0]

        def judge(row: int, found: Report, g: Rows = g, variable: np.ndarray = variable) -> None:
            v = int(variable[row])
            # by now it hangs on the constant that the loop has given it: look at its class as it was
            if work.differentiated[v] or potential[v]:
                _only_rest(work, g, row, found)

        _judge(loops, np.arange(len(variable)), judge, report)


def _only_rest(work: Elimination, g: Rows, row: int, report: Report) -> None:
    loops, number = work.loops, int(g.source[row])
    around = loops.around(number)
    if any(map(loops.equations.is_balance, around)):
        return  # the position of a massless point between springs to the ground
    parts = listed(loops.equations.parts(around)) or f"'{loops.equations.text(number)}'"
    held = _held_points(work, around)
    if held:
        spans = loops.equations.spans(around)
        labels = tuple(Label(s, "also here") for s in spans[1:SHOWN])
        message = f"{parts} leave {listed(held)} no freedom: only rest is possible"
        report.warning("W0417", message, spans[0] if spans else None, hint=HELD, labels=labels)
        return
    message = f"{parts} form a loop whose ratios do not agree: only rest is possible"
    found = work.splitter.text(g, g.shape, row) + " = 0"
    _at_loop(loops, around, report, "E0412", message, found=found if len(found) <= _READABLE else "")


def _held_points(work: Elimination, around: list[int]) -> list[str]:
    """Return the names of coordinates of one point that a loop relates to each other; none where it has no such point.

    Two straight lines cross in one point, which is a place like any other. Two ratios between the same shafts are a
    mistake.
    """
    flat, unknowns = work.flat, work.loops.equations.unknowns
    coordinates: dict[str, list[str]] = {}
    for v in dict.fromkeys(v for number in around for v in unknowns(number)):
        block = flat.block_at(v)
        if block.connector and not block.flow:
            name = flat.variable_name(v)
            coordinates.setdefault(parent(name), []).append(name)
    return next((sorted(names) for names in coordinates.values() if len(names) > 1), [])


def _over_ports(work: Elimination) -> np.ndarray:
    """(variables,) mask of those on which the position of a connector hangs, their own included."""
    mask = np.zeros(len(work.loops.parent), bool)
    new = np.flatnonzero(work.flat.per_variable(lambda b: b.connector and not b.flow, bool))
    while len(new):
        mask[new] = True
        parents = work.loops.parent[new]
        above = distinct(parents[parents >= 0])
        new = above[~mask[above]]
    return mask


def dependent(work: Elimination, core: Constraints, guards: list[Guard], report: Report) -> dict[int, list[int]]:
    """Judge the constraints that may be combinations of others; drops those that are.

    Returns
    -------
    {equation: those that say the same together}
    """
    judged = core.judged(work.derived.known, work.derived)
    loops = work.loops
    if core.depends_on_parameters:
        holds = partial(_judged_alike, core, work.derived, judged)
        parts = loops.equations.parts(core.source.tolist())
        text = f"which constraints of {listed(parts) or 'the model'} are redundant"
        guards.append(Guard(holds, text, open=not judged))
    dropped: dict[int, list[int]] = {}
    contradictory: dict[int, list[int]] = {}
    for number, others, consistent in judged:
        if consistent:
            dropped[number] = others
        else:
            contradictory[number] = others

    def judge(number: int, found: Report) -> None:
        around = loops.among([number, *contradictory[number]])
        parts = listed(loops.equations.parts(around)) or f"'{loops.equations.text(number)}'"
        message = f"{parts} contradict each other: no position satisfies all of them"
        _at_loop(loops, around, found, "E0411", message)

    _judge(loops, np.array(list(contradictory), int), judge, report)
    if dropped:
        gone = np.zeros(work.flat.equation_count, bool)
        gone[list(dropped)] = True
        work.groups = [g.take(np.flatnonzero(~gone[g.source])) for g in work.groups]
    return dropped


def _judged_alike(
    core: Constraints, derived: DerivedParameters, judged: list[tuple[int, list[int], bool]], values: np.ndarray
) -> bool:
    return core.judged(derived.extended(values), derived) == judged


def _at_loop(loops: Loops, around: list[int], report: Report, code: str, message: str, **more: str) -> None:
    spans = loops.equations.spans(around)
    labels = tuple(Label(s, "also here") for s in spans[1:])
    report.error(code, message, spans[0] if spans else None, labels=labels, **more)


def redundancy_notes(loops: Loops, repeated: dict[int, list[int]]) -> Iterable[Diagnostic]:
    """Report the constraints that were dropped.

    Parameters
    ----------
    repeated : {equation: those that say the same, [] where the spanning forest knows the loop}
    """
    more = len(repeated) - SHOWN
    for i, (number, others) in enumerate(list(repeated.items())[:SHOWN]):
        around = loops.among([number, *others]) if others else loops.around(number)
        parts = listed(loops.equations.parts(around))
        where = f"; the forces in the loop {parts} are not unique" if parts else ""
        message = f"the constraint '{loops.equations.text(number)}' is redundant{where}"
        hint = f"{more} more constraints are redundant" if i == SHOWN - 1 and more > 0 else ""
        spans = loops.equations.spans(around)
        labels = tuple(Label(s, "also here") for s in spans[1:])
        span = spans[0] if spans else None
        yield Diagnostic("N0415", message, span, hint=hint, labels=labels, subject=Subject.LEFT_OUT)
