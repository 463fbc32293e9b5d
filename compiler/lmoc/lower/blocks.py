"""Implicit blocks on a tape, and whole programs with them.

The matrix of a block comes from the derivatives of its inner steps, computed in the same sweep as its residuals.
"""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Program, Solve, needed_steps, written
from lmoc.lower.chain_rule import ChainRule
from lmoc.lower.derivatives import Ahead, Derivatives, write_derivatives
from lmoc.lower.matrices import block_matrix
from lmoc.lower.steps import write_step
from lmoc.lower.tape import SolveBlock, Tape
from lmoc.lower.writer import Writer
from lmoc.support.sizes import DENSE_IN_C


def values_tape(program: Program, registers: int, taken: int = 0) -> Tape:
    """Write a program as a tape; `taken` as of `Writer`."""
    writer = Writer(registers, taken)
    write_program(writer, program)
    return writer.finish()


def derivatives_tape(
    program: Program, rule: ChainRule, registers: int, values: bool = False, taken: int = 0
) -> Tape:
    """Write the derivatives of a program as a tape; its results are the entries in the order of `rule.rows`.

    Parameters
    ----------
    values : whether it computes the registers as well, else they are as the program has left them
    taken : as of `Writer`
    """
    writer = Writer(registers, taken)
    found = Derivatives(writer, rule)
    write_derivatives(found, program, Ahead(rule), values, write_solve)
    return writer.finish(found.results)


def write_program(writer: Writer, program: Program) -> None:
    """Write the steps one after the other."""
    for step in program:
        if isinstance(step, Solve):
            write_solve(writer, step)
        elif len(step.out):
            write_step(writer, step)


def write_solve(writer: Writer, step: Solve) -> None:
    """Write one block."""
    rule = ChainRule(step.inner, step.unknowns.ravel(), step.residuals.ravel(), writer.registers)
    if step.constant and (len(step.unknowns) == 1 or step.unknowns.shape[1] <= DENSE_IN_C):
        _write_constant(writer, step, rule)
    elif step.linear:
        _write_linear(writer, step, rule)
    else:
        _write_newton(writer, step, rule)
    write_program(writer, _between(step, writer.registers))


def _between(step: Solve, count: int) -> Program:
    """The inner steps that fill more than residuals: they are due once more when the unknowns are known."""
    inside = np.concatenate([written(s) for s in step.inner]) if step.inner else np.zeros(0, int)
    kept = inside[~np.isin(inside, np.concatenate([step.unknowns.ravel(), step.residuals.ravel()]))]
    return needed_steps(step.inner, kept, count)


def _write_constant(writer: Writer, step: Solve, rule: ChainRule) -> None:
    """u = -A⁻¹ r(0), with a matrix that is filled only where its factors are not at hand."""
    writer.fill(step.unknowns.ravel(), writer.zero)
    write_program(writer, step.inner)
    begun = writer.begin_unless_ready()
    found = Derivatives(writer, rule)
    write_derivatives(found, step.inner, Ahead(rule), False, write_solve)
    number = _block(writer, step, rule, found, kept=True)
    writer.end_unless_ready(begun, number)
    writer.on_block("constant", number)


def _write_linear(writer: Writer, step: Solve, rule: ChainRule) -> None:
    """u = -A⁻¹ r(0)."""
    writer.fill(step.unknowns.ravel(), writer.zero)
    found = Derivatives(writer, rule)
    write_derivatives(found, step.inner, Ahead(rule), True, write_solve)
    writer.on_block("linear", _block(writer, step, rule, found))


def _write_newton(writer: Writer, step: Solve, rule: ChainRule) -> None:
    """Newton's method from what stands in the registers."""
    begin = writer.begin_newton(np.concatenate([step.unknowns.ravel(), *(written(s) for s in step.inner)]))
    found = Derivatives(writer, rule)
    write_derivatives(found, step.inner, Ahead(rule), True, write_solve)
    writer.end_newton(begin, _block(writer, step, rule, found))


def _block(writer: Writer, step: Solve, rule: ChainRule, found: Derivatives, kept: bool = False) -> int:
    """The block whose matrix has been written."""
    instances, size = step.unknowns.shape
    instance, row = np.divmod(rule.rows, size)
    fill, pattern = block_matrix(writer, (instances, size), found.results, instance, row, rule.columns % size)
    work = 0 if step.linear else writer.reserve(instances * (2 * size + 2))
    return writer.block(
        SolveBlock(
            step, step.unknowns, step.residuals, fill, np.zeros((instances, 0, size), np.int32), pattern,
            writer.reserve(fill.size if kept else fill.shape[1]), writer.reserve(size), work, 0, kept,
        )  # fmt: skip
    )
