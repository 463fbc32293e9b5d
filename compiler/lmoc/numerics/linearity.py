"""Scenes whose motion is linear: their errors obey the equations of the motion itself, and do not outgrow it."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import Expr, depends_on_time, slots
from lmoc.ir.program import Apply, Program, Total, read, written
from lmoc.numerics.plan import Plan


class _Kind(IntEnum):
    """What a register's value is, as a function of time and the states; a sum is of the highest kind in it."""

    CONSTANT = 0
    GIVEN = 1  # a function of time
    LINEAR = 2  # in the states, with constant coefficients, and a function of time
    OTHER = 3


def is_linear(plan: Plan) -> bool:
    """Return whether the states' derivatives are linear in them with constant coefficients, and nothing switches.

    Read off the program; to be asked for by `Plan.once`. A scene may be linear of which this cannot be seen.
    """
    reduced = plan.reduced
    if reduced.switched is not None or reduced.flat.events is not None:
        return False
    n, kinds = plan.state_count, np.full(plan.count, _Kind.CONSTANT)
    kinds[plan.sampled] = _Kind.GIVEN
    kinds[plan.states[:n]], kinds[plan.states[n:]] = _Kind.LINEAR, _Kind.OTHER
    _spread(plan.program, kinds)
    return bool((kinds[plan.derivatives[:n]] <= _Kind.LINEAR).all())


def _spread(program: Program, kinds: np.ndarray) -> None:
    """Fill in the kinds (count,) of what a program computes."""
    for step in program:
        if isinstance(step, Apply):
            patterns, which = np.unique(kinds[step.slots], axis=0, return_inverse=True)
            kinds[step.out] = np.array([_kind(step.shape, p) for p in patterns], int)[which.ravel()]
        elif isinstance(step, Total):
            owner = np.repeat(np.arange(len(step.out)), np.diff(step.start))
            found = np.full(len(step.out), _Kind.CONSTANT)
            np.maximum.at(found, owner, kinds[step.index])
            kinds[step.out] = found
        elif not step.constant:
            kinds[written(step)] = _Kind.OTHER
        else:  # a combination of the residuals without the unknowns, with constant coefficients
            kinds[step.unknowns] = kinds[read(step)].max(initial=_Kind.CONSTANT)
            _spread(step.inner, kinds)
            kinds[step.unknowns] = max(kinds[step.unknowns].max(), kinds[step.residuals].max())
            _spread(step.inner, kinds)


def _kind(shape: Expr, columns: np.ndarray) -> int:
    """Return the kind of an expression of slots of the given kinds."""
    highest = int(columns.max(initial=_Kind.CONSTANT))
    if highest < _Kind.LINEAR:
        return max(highest, _Kind.GIVEN if depends_on_time(shape) else _Kind.CONSTANT)
    parts = linear_parts(shape, [leaf for leaf in slots(shape) if columns[leaf.value[0]] == _Kind.LINEAR])
    if highest > _Kind.LINEAR or parts is None:
        return _Kind.OTHER
    varies = any(
        depends_on_time(c) or any(columns[leaf.value[0]] != _Kind.CONSTANT for leaf in slots(c))
        for c in parts[0].values()
    )
    return _Kind.OTHER if varies else _Kind.LINEAR
