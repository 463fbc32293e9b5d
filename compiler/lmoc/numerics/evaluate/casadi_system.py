"""Programs as casadi functions, called through buffers: the way of small scenes.

A casadi function costs microseconds where a step of numpy costs tens, but each row becomes nodes of its own, so large
programs are evaluated elsewhere. Nonlinear blocks are not lowered: they are solved by `numerics.newton`, which
knows the last solution.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache

import numpy as np

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.functions import FUNCTIONS, resolve
from lmoc.ir.program import Apply, Program, Solve, Total

CASADI_ROWS = 10_000  # programs with more rows are evaluated faster by numpy
_LARGEST_BLOCK = 8  # a linear block with more unknowns makes too long a function


def can_lower(program: Program) -> bool:
    """Return whether all steps can be written as one explicit casadi function."""
    blocks = [step for step in program if isinstance(step, Solve)]
    return all(b.linear and b.unknowns.shape[1] <= _LARGEST_BLOCK and can_lower(b.inner) for b in blocks)


@lru_cache(maxsize=1)
def _operations() -> dict:
    import casadi

    return {name: resolve(f.casadi, casadi) for name, f in FUNCTIONS.items()}


def lower_shape(shape: Expr, columns, time):
    """A shape with casadi values in its slots; ``columns(k)`` gives that of column k."""
    values: dict[int, object] = {}
    with exactly():
        for node in postorder(shape):
            values[id(node)] = lower_node(node, [values[id(a)] for a in node.args], columns, time)
    return values[id(shape)]


@contextmanager
def exactly() -> Iterator[None]:
    """Have casadi make neither 1 of x/x nor x of sqrt(x)^2, where the other evaluators find that there is no value."""
    import casadi as ca

    before = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(before)


def lower_node(node: Expr, args: list, columns, time):
    """Return a node with casadi values for its arguments; ``columns(k)`` gives that of a slot."""
    if node.op == "const":
        return _constant(node.value)
    if node.op == "slot":
        return columns(node.value[0])
    if node.op == "time":
        return time
    if node.op == "pow" and node.args[1].op == "const" and node.args[1].value in (2.0, 3.0):
        base = args[0]  # as in C: the library's pow costs twenty times as much
        return base * base if node.args[1].value == 2.0 else base * base * base
    return _operations()[node.op](*args)


@lru_cache(maxsize=1024)
def _constant(value: float):
    import casadi as ca

    return ca.SX(value)


def lower_steps(program: Program, w: list, time) -> None:
    """Run a program symbolically: `w` is a list of scalar casadi values, None where nothing has been written yet."""
    for step in program:
        if isinstance(step, Apply):
            _lower_apply(step, w, time)
        elif isinstance(step, Total):
            _lower_total(step, w)
        else:
            lower_linear(step, w, time)


def _lower_apply(step: Apply, w: list, time) -> None:
    import casadi as ca

    slots, out = step.slots.tolist(), step.out.tolist()
    if len(out) <= 3:
        for row, target in zip(slots, out, strict=True):
            w[target] = lower_shape(step.shape, lambda k, row=row: w[row[k]], time)
        return
    result = lower_shape(step.shape, lambda k: ca.vertcat(*[w[row[k]] for row in slots]), time)
    if result.numel() == 1:
        result = ca.repmat(result, len(out), 1)
    for target, value in zip(out, ca.vertsplit(result), strict=True):
        w[target] = value


def _lower_total(step: Total, w: list) -> None:
    start, index, coefficient = step.start.tolist(), step.index.tolist(), step.coefficient.tolist()
    for i, target in enumerate(step.out.tolist()):
        total = _constant(0.0)
        for j in range(start[i], start[i + 1]):
            c, value = coefficient[j], w[index[j]]
            total = total + value if c == 1.0 else total - value if c == -1.0 else total + c * value
        w[target] = total


def lower_linear(step: Solve, w: list, time) -> None:
    """The matrix by symbolic differentiation of the residuals, then elimination (Cramer's rule up to two unknowns)."""
    import casadi as ca

    unknowns = step.unknowns.ravel().tolist()
    symbols = ca.SX.sym("u", len(unknowns))
    for register, symbol in zip(unknowns, ca.vertsplit(symbols), strict=True):
        w[register] = symbol
    lower_steps(step.inner, w, time)
    for own, residual in zip(step.unknowns.tolist(), step.residuals.tolist(), strict=True):
        u = ca.vertcat(*[w[r] for r in own])
        r = ca.vertcat(*[w[k] for k in residual])
        matrix = ca.densify(ca.jacobian(r, u))
        rest = ca.densify(ca.substitute(r, u, ca.SX.zeros(len(own), 1)))
        for register, value in zip(own, eliminate(matrix, -rest), strict=True):
            w[register] = value
    lower_steps(step.inner, w, time)


def shared(expressions: list) -> list:
    """Return expressions in which what occurs several times is computed once."""
    import casadi as ca

    with exactly():
        return ca.cse(expressions)


def eliminate(a, b) -> list:
    """Return the solution of a·x = b, written out."""
    if b.numel() == 1:
        return [b[0] / a[0, 0]]
    if b.numel() == 2:
        determinant = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
        return [(a[1, 1] * b[0] - a[0, 1] * b[1]) / determinant, (a[0, 0] * b[1] - a[1, 0] * b[0]) / determinant]
    entries = [[a[i, j] for j in range(a.size2())] for i in range(a.size1())]
    order = _column_order(entries)
    x = _gauss([[row[j] for j in order] for row in entries], [b[i] for i in range(b.numel())])
    return [value for _, value in sorted(zip(order, x, strict=True), key=lambda pair: pair[0])]


def _column_order(entries: list[list]) -> list[int]:
    """Return an order of the columns in which elimination with row pivoting fills little of a sparse matrix.

    Whichever row is the pivot: each of the candidates may get the entries of all of them (George & Ng, SIAM J. Sci.
    Stat. Comput. 6, 1985). The column with the least product of candidates and entries is the next (Markowitz).
    """
    left = [{j for j, entry in enumerate(row) if not entry.is_zero()} for row in entries]
    order: list[int] = []
    for _ in entries:
        candidates = {j: [row for row in left if j in row] for j in set(range(len(entries))) - set(order)}
        cost = {j: (len(rows) * len(set().union(*rows)), len(rows), j) for j, rows in candidates.items()}
        best = min(cost, key=lambda j: cost[j])
        order.append(best)
        filled = set().union(*candidates[best]) - {best}
        left = [row for row in left if best not in row] + [set(filled) for _ in candidates[best][1:]]
    return order


def _gauss(a: list[list], b: list) -> list:
    """Elimination with row pivoting, written out: rows change places by their numbers.

    (`casadi.solve` orthogonalizes, by a method that loses digits where the rows are of different sizes.)
    """
    import casadi as ca

    n = len(b)
    for k in range(n):
        for i in range(k + 1, n):
            if a[i][k].is_zero():
                continue
            if a[k][k].is_zero():
                a[k], a[i], b[k], b[i] = a[i], a[k], b[i], b[k]
                continue
            larger = ca.fabs(a[i][k]) > ca.fabs(a[k][k])
            for row_k, row_i, j in [*((a[k], a[i], j) for j in range(k, n)), (b, b, None)]:
                upper, lower = (row_k[k], row_i[i]) if j is None else (row_k[j], row_i[j])
                if upper.is_zero() and lower.is_zero():
                    continue
                first, second = ca.if_else(larger, lower, upper), ca.if_else(larger, upper, lower)
                row_k[k if j is None else j], row_i[i if j is None else j] = first, second
        for i in range(k + 1, n):
            if not a[i][k].is_zero():
                factor = a[i][k] / a[k][k]
                for j in range(k + 1, n):
                    a[i][j] = a[i][j] - factor * a[k][j]
                b[i] = b[i] - factor * b[k]
    x: list = [None] * n
    for i in reversed(range(n)):
        for j in range(i + 1, n):
            b[i] = b[i] - a[i][j] * x[j]
        x[i] = b[i] / a[i][i]
    return x


class CasadiDerivatives:
    """The derivatives of a plan as casadi expressions in time, states, parameters and sampled inputs."""

    def __init__(self, program: Program, count: int, states, parameters, sampled, outputs: Sequence[int]) -> None:
        import casadi as ca

        self.time = ca.SX.sym("t")
        self.x = ca.SX.sym("x", len(states))
        self.p = ca.SX.sym("p", len(parameters))
        self.u = ca.SX.sym("u", len(sampled))
        w: list = [None] * count
        for registers, symbols in ((parameters, self.p), (sampled, self.u), (states, self.x)):
            if len(registers):
                for register, symbol in zip(np.asarray(registers).tolist(), ca.vertsplit(symbols), strict=True):
                    w[register] = symbol
        lower_steps(program, w, self.time)
        self.out = ca.densify(ca.vertcat(ca.SX(0, 1), *[w[r] for r in np.asarray(outputs).tolist()]))

    def function(self, name: str = "rhs", more: Sequence = ()):
        """``(t, x, p, u) -> outputs``, and what else has been made of them."""
        import casadi as ca

        return ca.Function(name, [self.time, self.x, self.p, self.u], [self.out, *map(ca.densify, more)])

    def jacobian(self):
        """``(t, x, p, u) -> ∂outputs/∂x``, sparse."""
        import casadi as ca

        return ca.Function("jacobian", [self.time, self.x, self.p, self.u], [ca.jacobian(self.out, self.x)])


class Buffered:
    """A casadi function on fixed arrays: fill the arrays in `arguments`, call, read those in `results`."""

    def __init__(self, function, arguments: Sequence[np.ndarray]) -> None:
        self.function = function
        self.arguments = list(arguments)
        self.results = [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
        self._buffer, self._call = function.buffer()
        for i, array in enumerate(self.arguments):
            self._buffer.set_arg(i, memoryview(array))
        for i, array in enumerate(self.results):
            self._buffer.set_res(i, memoryview(array))

    def __call__(self) -> None:
        self._call()
