"""Implicit blocks on a tape, and whole programs with them.

The matrix of a block comes from the derivatives of its inner steps, computed in the same sweep as its residuals.
"""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Program, Solve, needed_steps, written
from lmoc.lower.chain_rule import ChainRule, Implicit
from lmoc.lower.derivatives import Ahead, Derivatives, write_derivatives
from lmoc.lower.steps import write_step
from lmoc.lower.tape import Block, Tape
from lmoc.lower.writer import Writer
from lmoc.support.sizes import DENSE_IN_C


def values_tape(program: Program, registers: int) -> Tape:
    """Write a program as a tape."""
    writer = Writer(registers)
    write_program(writer, program)
    return writer.finish()


def derivatives_tape(program: Program, rule: ChainRule, registers: int, values: bool = False) -> Tape:
    """Write the derivatives of a program as a tape; its results are the entries in the order of `rule.rows`.

    Parameters
    ----------
    values : whether it computes the registers as well, else they are as the program has left them
    """
    writer = Writer(registers)
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
    fill, pattern = _matrix(writer, (instances, size), instance, row, rule.columns % size, found.results)
    work = 0 if step.linear else writer.reserve(instances * (2 * size + 2))
    return writer.block(
        Block(
            step, step.unknowns, step.residuals, fill, np.zeros((instances, 0, size), np.int32), pattern,
            writer.reserve(fill.size if kept else fill.shape[1]), writer.reserve(size), work, 0, kept,
        )  # fmt: skip
    )


def _matrix(writer: Writer, shape: tuple[int, int], instance, row, column, places):
    """Where the entries of the matrices stand, (instances, each), and the pattern of sparse ones."""
    instances, size = shape
    if size <= DENSE_IN_C:
        fill = np.full((instances, size * size), writer.zero, np.int32)
        fill[instance, row * size + column] = places
        return fill, None
    entries, place = np.unique(column * size + row, return_inverse=True)
    fill = np.full((instances, len(entries)), writer.zero, np.int32)
    fill[instance, place.ravel()] = places
    columns, rows = np.divmod(entries, size)
    return fill, (np.searchsorted(columns, np.arange(size + 1)).astype(np.int32), rows.astype(np.int32))


def write_implicit(found: Derivatives, stage: Implicit) -> None:
    """Write ``x = -A⁻¹ B``, the derivatives of a block's unknowns, one column after the other."""
    writer, (instances, size, width) = found.writer, stage.shape
    if not width:
        return
    fill, pattern = _matrix(writer, (instances, size), *stage.a_place, found.place[stage.a_source])
    right = np.full((instances, width, size), writer.zero, np.int32)
    instance, row, column = stage.b_place
    right[instance, column, row] = found.place[stage.b_source]
    x = writer.reserve(right.size)
    instance, row, column = stage.result
    found.place[stage.first : stage.stop] = x + (instance * width + column) * size + row
    step = stage.step
    a, b = writer.reserve(fill.shape[1]), writer.reserve(size)
    number = writer.block(Block(step, step.unknowns, step.residuals, fill, right, pattern, a, b, 0, x, False))
    writer.on_block("implicit", number)
