"""Programs in C with their implicit blocks: constant linear ones from factors, others from their matrix.

The matrix comes from the derivatives of the inner steps, computed in the same sweep as the residuals. Small blocks are
solved by Gauss elimination with row pivoting, larger ones by refactorizing a sparse matrix on a fixed pattern and order
of pivots (`native.pivots`). Newton's method starts from the solution that stands in the registers.
"""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Program, Solve, needed_steps, program_rows, written
from lmoc.numerics.evaluate.jacobian import Jacobian
from lmoc.numerics.evaluate.native.c_code import Block, CFunction, Writer, write_rounds, write_step
from lmoc.numerics.evaluate.native.c_derivatives import sweep
from lmoc.numerics.evaluate.native.c_matrices import Matrices
from lmoc.numerics.evaluate.native.rolled import Rolled, roll

LITERAL_ROWS = 1500  # rows up to which a program is small


def generate(program: Program, registers: int, name: str = "lmoc_program") -> CFunction:
    """Write a program as one C function.

    Parameters
    ----------
    program : Program
    registers : int
        Length of the register vector; the function's scratch lies behind it.

    Raises
    ------
    Unsupported
        For a block that is implicit inside another one.
    """
    writer = Writer(registers, program_rows(program) <= LITERAL_ROWS)
    write_program(writer, program)
    head = f"int {name}(double time, double *w, const int64_t *m, const void *const *tab) {{\n  int status = 0;"
    body = "\n".join("  " + line for line in writer.lines)
    text = f"{head}\n{body}\n  (void)time; (void)w; (void)m; (void)tab;\n  return status;\n}}\n"
    numbers = np.array(writer.numbers, np.int64)
    return CFunction(
        text, numbers, writer.tables, writer.scratch, writer.factors, writer.matrices, writer.blocks
    )  # fmt: skip


def write_program(writer: Writer, program: Program) -> None:
    """Write the steps one after the other."""
    for step in roll(program):
        if isinstance(step, Rolled):
            write_rounds(writer, step.steps, step.rounds)
        elif isinstance(step, Solve):
            write_solve(writer, step)
        elif len(step.out):
            write_step(writer, step)


def write_solve(writer: Writer, step: Solve) -> None:
    """Write one block.

    Raises
    ------
    Unsupported
        There is a block inside of it.
    """
    if step.constant and len(step.unknowns) == 1:
        _write_constant(writer, step)
    else:
        _write_varying(writer, step)
    writer.add("{")
    write_program(writer, _between(step, writer.registers))
    writer.add("}")


def _between(step: Solve, count: int) -> Program:
    """The inner steps that fill more than residuals: they are due once more when the unknowns are known."""
    inside = np.concatenate([written(s) for s in step.inner]) if step.inner else np.zeros(0, int)
    kept = inside[~np.isin(inside, np.concatenate([step.unknowns.ravel(), step.residuals.ravel()]))]
    return needed_steps(step.inner, kept, count)


def _write_constant(writer: Writer, step: Solve) -> None:
    """u := u - A⁻¹ r(u) from u = 0, with the sparse factors of A made beforehand."""
    size = step.unknowns.shape[1]
    declare_u, u = writer.address(step.unknowns[0], "u")
    declare_r, r = writer.address(step.residuals[0], "r")
    first = len(writer.tables)
    names = [writer.table(np.zeros(1)) for _ in range(8)]
    writer.factors.append((step, first))
    b, n = writer.space(2 * size), writer.number(size)
    writer.add("{", *declare_u, *declare_r, f"const int64_t n = {n};")
    writer.add(f"double *b = {b};", f"for (int64_t i = 0; i < n; i++) w[{u}] = 0;", "{")
    write_program(writer, step.inner)
    writer.add(
        "}",
        f"for (int64_t i = 0; i < n; i++) b[i] = -w[{r}];",
        f"lmoc_sparse_solve(n, b, b + n, {', '.join(names)});",
        f"for (int64_t i = 0; i < n; i++) w[{u}] = b[i];",
        "}",
    )


def _write_varying(writer: Writer, step: Solve) -> None:
    """Linear: u = -A⁻¹ r(0). Nonlinear: Newton's method."""
    jacobian = Jacobian(step.inner, step.unknowns.ravel(), step.residuals.ravel(), writer.registers)
    instances, size = step.unknowns.shape
    instance, row = np.divmod(jacobian.rows, size)
    writer.add("{")
    matrices = Matrices(writer, step.unknowns.shape, instance, row, jacobian.columns % size)
    n, s = writer.number(instances), matrices.number(size)
    writer.add(f"const int32_t *u = {writer.indices(step.unknowns)}, *r = {writer.indices(step.residuals)};")
    writer.add(f"double *b = {writer.space(size)};")
    common = f"&{matrices.name}, {n}, {matrices.a}, w, u, r, b"
    if step.linear:
        writer.add(f"for (int64_t k = 0; k < {n}*{s}; k++) w[u[k]] = 0;")
        matrices.fill(sweep(writer, step.inner, jacobian, values=True), jacobian.source)
        writer.add(f"lmoc_linear({common});", "}")
        return
    work = writer.reserve(instances * (2 * size + 2))
    writer.blocks.append(Block(step, work))
    writer.add(
        f"const lmoc_newton s = lmoc_newton_work(w + {writer.number(work)}, {n}, {s});",
        f"lmoc_newton_begin(&s, {n}*{s}, w, u);",
        "int64_t open = 1;",
        "for (int iteration = 0; open > 0; iteration++) {",
    )
    matrices.fill(sweep(writer, step.inner, jacobian, values=True), jacobian.source)
    writer.add(
        f"open = lmoc_newton_step(&s, iteration, {common});",
        "}",
        f"status |= lmoc_newton_end(&s, open, {n}, {s}, w, u);",
        "}",
    )
