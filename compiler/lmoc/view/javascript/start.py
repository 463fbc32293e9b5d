"""The start of a run as a program: which values of the model determine it, solved again for other parameters.

A start is the answer to a problem of least squares (`numerics/start`). Which of the values wanted were met, and which
of them determine the states, is decided here, for the run at hand; the page then solves these equations alone.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from lmoc.expression.dag import slot
from lmoc.ir.flat import Kind
from lmoc.ir.program import Apply, Program, Solve, needed_steps
from lmoc.messages.diagnostics import Report
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.numerics.solve.rounding import Rounding
from lmoc.numerics.start.start_system import term_sizes, without_gradient
from lmoc.numerics.start.targets import Targets, targets
from lmoc.support.records import dataclass

_MET = 1e-9  # of the size of a value wanted: by how much it may be missed
_RANK = 1e-9  # pivots below are none; rows have length 1


class Room(Protocol):
    """Gives registers."""

    def add(self, count: int, values: np.ndarray | None = None) -> np.ndarray: ...

    def of_parameters(self, variables: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class StartProgram:
    """The start of a run.

    Attributes
    ----------
    wanted : steps that compute the start values of the model from its parameters
    program : fills the states, from those values and from the states of the run at hand
    held : names of the states that stay as they are in that run, though they are not zero there
    met : [register, register of the value wanted, name] of the values that the run at hand meets; where another run
        misses one, they contradict each other, and its start is a compromise
    """

    wanted: Program
    program: Program
    held: list[str]
    met: list[list]


def start_program(observer: Observer, time: float, x: np.ndarray, room: Room) -> StartProgram:
    """Return what determines the start of a run, as far as it is the model's own.

    Parameters
    ----------
    time, x : of the start of the run
    """
    plan = observer.plan
    own = targets(plan, observer.values, {}, Report())
    steps, register = _wanted(observer, own, room)
    measured = plan.reduced.register_of[own.variable]
    order = np.flatnonzero((register >= 0) & (measured >= 0))
    order = order[np.argsort(~own.hard[order], kind="stable")]  # fixed values first
    states = dict(zip(plan.states.tolist(), range(len(x)), strict=True))
    direct, rest = {}, []
    for k in order.tolist():
        j = states.get(int(measured[k]))
        if j is None:
            rest.append(k)
        elif j not in direct and _same(own.value[k], x[j]):
            direct[j] = k
    open_ = np.array([j for j in range(plan.state_count) if j not in direct], int)
    rows, columns, met = _determining(observer, time, x, own, np.array(rest, int), measured, open_)
    chosen = list(direct)
    kept = np.array([j for j in range(len(x)) if j not in direct and j not in set(columns.tolist())], int)
    program = _copies(plan.states[chosen], register[[direct[j] for j in chosen]])
    program += _copies(plan.states[kept], room.add(len(kept), x[kept]))
    if len(rows):
        residual = room.add(len(rows))
        guess = room.add(len(columns), x[columns])
        slots = np.stack([measured[rows], register[rows]], axis=1)
        missed = Apply(slot(0) - slot(1), slots, residual)
        inner = (*needed_steps(plan.full_program, measured[rows], plan.count), missed)
        unknowns = plan.states[columns]
        program += (Solve(inner, unknowns[None], residual[None], False, False, guess[None]),)
    held = [plan.reduced.register_name(int(plan.states[j])) for j in kept if j < plan.state_count and x[j] != 0]
    decided = [*direct.values(), *rows.tolist()]
    firm = own.hard[decided].all()  # what is wished for beside fixed values gives way to them
    names = observer.flat.variable_name
    told = [
        [int(measured[k]), int(register[k]), names(int(own.variable[k]))]
        for k in (*direct.values(), *met.tolist()) if own.hard[k] or not firm
    ]  # fmt: skip
    return StartProgram(steps, program, held, told)


def _copies(to: np.ndarray, source: np.ndarray) -> Program:
    return (Apply(slot(0), np.asarray(source, int)[:, None], np.asarray(to, int)),) if len(to) else ()


def _same(a: float, b: float) -> bool:
    return abs(a - b) <= _MET * max(1.0, abs(a))


def _wanted(observer: Observer, own: Targets, room: Room) -> tuple[Program, np.ndarray]:
    """Return what computes the start values, and the register of each."""
    flat, place = observer.flat, np.full(observer.flat.count, -1)
    place[own.variable] = np.arange(len(own))
    register = room.add(len(own), own.value)
    steps = []
    for a in flat.starts:
        rows = np.flatnonzero(place[a.target] >= 0)
        of_parameters = a.slots.shape[1] and (flat.kind[a.slots] <= Kind.PARAMETER).all()
        if a.numbers is None and of_parameters and len(rows):
            slots = room.of_parameters(a.slots[rows].ravel()).reshape(len(rows), -1)
            steps.append(Apply(a.shape, slots, register[place[a.target[rows]]]))
    return tuple(steps), register


def _determining(
    observer: Observer,
    time: float,
    x: np.ndarray,
    own: Targets,
    rest: np.ndarray,
    measured: np.ndarray,
    open_: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which of the values wanted determine which of the open states, as many of both, and which are met.

    By Gauss elimination over the rows that the run meets, in their order, with column pivoting.
    """
    none = np.zeros(0, int)
    if not len(rest):
        return none, none, none
    plan = observer.plan
    outputs = measured[rest]
    program = needed_steps(plan.full_program, outputs, plan.count)
    w = observer.base.copy()
    w[plan.states] = x
    for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
        w[register] = observer.signals[variable].value(time, order)
    jacobian = Jacobian(program, plan.states[open_], outputs, plan.count)
    Interpreter(program, plan.count).run(w, time)
    matrix = np.zeros((len(rest), len(open_)))
    matrix[jacobian.rows, jacobian.columns] = jacobian.values(w, time)
    met = np.array([_same(v, r) for v, r in zip(own.value[rest], w[outputs], strict=True)])
    size = np.sqrt((matrix**2).sum(axis=1))
    rounding = Rounding(program, outputs, plan.count)
    moved = ~without_gradient(size, own.value[rest], lambda: term_sizes(rounding, w, time, plan.states))
    matrix /= np.where(moved, size, np.inf)[:, None]
    rows, columns = [], []
    for k in np.flatnonzero(met & np.isfinite(matrix).all(axis=1)).tolist() if len(open_) else ():
        j = int(np.abs(matrix[k]).argmax())
        if abs(matrix[k, j]) > _RANK:
            rows.append(rest[k])
            columns.append(open_[j])
            matrix[k + 1 :] -= np.outer(matrix[k + 1 :, j] / matrix[k, j], matrix[k])
            matrix[k + 1 :, j] = 0.0
    return np.array(rows, int), np.array(columns, int), rest[met]
