"""Operations that can yield NaN from finite operands: quotients, roots, logarithms, solved blocks.

One look at these tells whether all variables have a value: sums and products of what a motion can reach stay finite.
Most of them depend on parameters alone, so that a look at the start is enough; the others are looked at along the run.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lmoc.expression.dag import Expr, depends_on_time, lift, postorder, slot, slots, substitute
from lmoc.expression.functions import FUNCTIONS
from lmoc.ir.program import Apply, Program, Solve, Step, needed_steps, read, written
from lmoc.support.records import dataclass


def nan_sources(program: Program, count: int) -> tuple[Program, np.ndarray, int]:
    """Return the registers that show whether `program` yields NaN, and the steps that fill them.

    Returns
    -------
    The steps of `program` that are needed for it and further ones behind them, the registers to look at, and the
    number of registers with the further ones, which follow the `count` of the program.
    """
    watched, further = [np.zeros(0, int)], []
    for step in program:
        if isinstance(step, Solve):
            watched.append(written(step))
        elif isinstance(step, Apply):
            for risk, columns in risks(step.shape):
                further.append(Apply(risk, step.slots[:, columns], np.arange(count, count + len(step.out))))
                watched.append(further[-1].out)
                count += len(step.out)
    registers = np.concatenate(watched)
    return needed_steps((*program, *further), registers, count), registers, count


@dataclass(frozen=True, eq=False)
class MovingRisks:
    """Those of the registers to look at that change during a run.

    Attributes
    ----------
    registers : can be computed for many times at once
    program, count : what fills them; length of its register vector
    others : whether there are more, behind blocks that are solved for one time after the other
    """

    registers: np.ndarray
    program: Program
    count: int
    others: bool


def moving(
    found: tuple[Program, np.ndarray, int], sources: np.ndarray, largest: int, integrated: Program = ()
) -> MovingRisks:
    """Return the part of `nan_sources` that changes with the registers in `sources` and with the time.

    Parameters
    ----------
    largest : unknowns of a linear block that is quickly solved for many times at once
    integrated : steps that the derivatives need: where one of their blocks has no solution, the run has not gone on
    """
    program, watched, count = found
    changes, alone = np.zeros(count, bool), np.zeros(count, bool)
    changes[sources] = True
    for step in program:
        out = written(step)
        for mark, own in ((changes, _tells_time(step)), (alone, _one_by_one(step, largest))):
            inputs = mark[step.slots].any(axis=1) if isinstance(step, Apply) else mark[read(step)].any()
            mark[out] = inputs | own
    solved = np.zeros(count, bool)
    for step in integrated:
        if isinstance(step, Solve):
            solved[written(step)] = True
    together = watched[changes[watched] & ~alone[watched] & ~solved[watched]]
    others = bool((changes & alone)[watched].any())
    return MovingRisks(together, needed_steps(program, together, count), count, others)


def _tells_time(step: Step) -> bool:
    if isinstance(step, Solve):
        return any(map(_tells_time, step.inner))
    return isinstance(step, Apply) and depends_on_time(step.shape)


def _one_by_one(step: Step, largest: int) -> bool:
    return isinstance(step, Solve) and not (step.linear and step.unknowns.shape[1] <= largest)


@lru_cache(maxsize=10_000)
def risks(shape: Expr) -> tuple[tuple[Expr, list[int]], ...]:
    """Expressions that have no finite value where a part of a shape with finite arguments has none.

    Each comes with the columns of the shape that are its own.
    """
    found: dict[Expr, None] = {}
    for node in postorder(shape):
        if node.args and FUNCTIONS[node.op].may_give_nan:
            risk = _inverse(node.args[1]) if FUNCTIONS[node.op].divides else node
            if not (risk.is_const or _is_polynomial(node)):
                found[risk] = None
        elif node.is_const and node.value != node.value:  # no element for a subscript: where nobody asks, none is lost
            found[shape] = None
    return tuple(_compact(risk) for risk in found)


def _compact(risk: Expr) -> tuple[Expr, list[int]]:
    leaves = slots(risk)
    columns = sorted({leaf.value[0] for leaf in leaves})
    return substitute(risk, {leaf: slot(columns.index(leaf.value[0]), leaf.value[1]) for leaf in leaves}), columns


def _inverse(divisor: Expr) -> Expr:
    return lift(1.0) / divisor


def _is_polynomial(node: Expr) -> bool:
    """Return whether it is a power with a whole, positive exponent."""
    exponent = node.args[-1]
    return node.op == "pow" and exponent.is_const and exponent.value >= 0 and exponent.value == int(exponent.value)
