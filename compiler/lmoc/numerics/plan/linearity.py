"""Scenes whose motion is linear: their errors obey the equations of the motion itself, and do not outgrow it."""

from __future__ import annotations

from enum import IntFlag

import numpy as np

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import Expr, depends_on_time, slots
from lmoc.ir.program import Apply, Program, Total, read, written
from lmoc.numerics.plan.plan import Plan


class _Kind(IntFlag):
    """What a register's value is made of, as a function of time and the states."""

    CONSTANT = 0
    GIVEN = 1  # a function of time
    LINEAR = 2  # a term that is linear in the states, with constant coefficients
    OTHER = 4


def is_linear(plan: Plan) -> bool:
    """Return whether the states' derivatives are linear in them with constant coefficients, and nothing switches.

    Read off the program; to be asked for by `Plan.once`. A scene may be linear of which this cannot be seen.
    """
    reduced = plan.reduced
    if reduced.switched is not None or reduced.flat.events is not None:
        return False
    n = plan.state_count
    kinds = _kinds(plan, plan.program, plan.states[:n], plan.sampled)
    return not (kinds[plan.derivatives[:n]] & _Kind.OTHER).any()


def linear_registers(plan: Plan, program: Program, sampled: np.ndarray) -> np.ndarray:
    """Return (count,) which registers are linear in the states, with coefficients that depend on parameters alone.

    Parameters
    ----------
    sampled : registers that are given as functions of time
    """
    return (_kinds(plan, program, plan.states, sampled) & ~_Kind.LINEAR) == 0


def _kinds(plan: Plan, program: Program, states: np.ndarray, sampled: np.ndarray) -> np.ndarray:
    kinds = np.zeros(plan.count, int)
    kinds[sampled] = _Kind.GIVEN
    kinds[plan.states] = _Kind.OTHER
    kinds[states] = _Kind.LINEAR
    _spread(program, kinds)
    return kinds


def _spread(program: Program, kinds: np.ndarray) -> None:
    """Fill in the kinds (count,) of what a program computes."""
    for step in program:
        if isinstance(step, Apply):
            patterns, which = np.unique(kinds[step.slots], axis=0, return_inverse=True)
            kinds[step.out] = np.array([_kind(step.shape, p) for p in patterns], int)[which.ravel()]
        elif isinstance(step, Total):
            owner = np.repeat(np.arange(len(step.out)), np.diff(step.start))
            found = np.zeros(len(step.out), int)
            np.bitwise_or.at(found, owner, kinds[step.index])
            kinds[step.out] = found
        elif not step.constant:
            kinds[written(step)] = _Kind.OTHER
        else:  # a combination of the residuals without the unknowns, with constant coefficients
            kinds[step.unknowns] = np.bitwise_or.reduce(kinds[read(step)], initial=0)
            _spread(step.inner, kinds)
            kinds[step.unknowns] |= np.bitwise_or.reduce(kinds[step.residuals], axis=None, initial=0)
            _spread(step.inner, kinds)


def _kind(shape: Expr, columns: np.ndarray) -> int:
    """Return the kind of an expression of slots of the given kinds."""
    whole = int(np.bitwise_or.reduce(columns, initial=0))
    given = _Kind.GIVEN if depends_on_time(shape) else _Kind.CONSTANT
    if not whole & (_Kind.LINEAR | _Kind.OTHER):
        return whole | given
    parts = linear_parts(shape, [leaf for leaf in slots(shape) if columns[leaf.value[0]] & _Kind.LINEAR])
    if whole & _Kind.OTHER or parts is None:
        return _Kind.OTHER
    varies = any(
        depends_on_time(c) or any(columns[leaf.value[0]] != _Kind.CONSTANT for leaf in slots(c))
        for c in parts[0].values()
    )
    return _Kind.OTHER if varies else whole | given
