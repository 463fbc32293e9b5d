"""Taylor series of the states as one casadi function, where there is no C compiler: all orders written out.

The recurrences are those of `recurrences`. The nonlinear blocks are solved before, for order zero; every further order
is one product with the inverse of the same matrix, as are the linear ones in all orders but the first (Nedialkov and
Pryce, Solving DAEs by Taylor series (I), BIT 45, 2005). The rows of a step are written together, as vectors.
"""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.ir.program import Apply, Program, Solve, Total, walk
from lmoc.numerics.evaluate.casadi_system import eliminate, exactly, lower_node, shared
from lmoc.numerics.evaluate.native.c_code import Unsupported
from lmoc.numerics.evaluate.recurrences import Nodes, constant_registers, prepared
from lmoc.numerics.evaluate.segments import outside
from lmoc.numerics.evaluate.unrolled import block_function
from lmoc.numerics.plan import Plan

if TYPE_CHECKING:
    import casadi

LARGEST = 500_000  # operations of a function
_LARGEST_BLOCK = 16  # unknowns of a block whose inverse is written out


def jets_function(plan: Plan, order: int) -> casadi.Function:
    """Return ``(t, x, p, z) -> coefficients``, (n, order + 1) for the states x.

    p are the values of `Plan.parameters`, z those of the unknowns of nonlinear blocks (`nonlinear_unknowns`).

    Raises
    ------
    Unsupported
        The program has functions with kinks, sampled inputs, a block inside a block, or is too large.
    """
    import casadi as ca

    if len(plan.sampled):
        raise Unsupported("an input has no formula")
    unknowns = nonlinear_unknowns(plan.program)
    t, x = ca.SX.sym("t"), ca.SX.sym("x", len(plan.states))
    p, z = ca.SX.sym("p", len(plan.parameters)), ca.SX.sym("z", len(unknowns))
    jets = _Jets(plan, order, t)
    for registers, symbols in ((plan.parameters, p), (plan.states, x), (unknowns, z)):
        jets.take(registers, symbols)
    found = [x]
    for k in range(order):
        jets.run(jets.steps, k)
        found.append(ca.densify(ca.vertcat(*[jets.series[r][k] for r in plan.derivatives.tolist()])) / (k + 1))
        for register, value in zip(plan.states.tolist(), ca.vertsplit(found[-1]), strict=True):
            jets.series[register][k + 1] = value
    return ca.Function("jets", [t, x, p, z], [ca.densify(ca.horzcat(*found))])


def nonlinear_unknowns(program: Program) -> np.ndarray:
    """Return the registers of the unknowns of all nonlinear blocks."""
    blocks = [s.unknowns.ravel() for s in program if isinstance(s, Solve) and not s.linear]
    return np.concatenate([np.zeros(0, int), *blocks])


class _Jets:
    """The coefficients of all registers, as far as they have been written.

    Attributes
    ----------
    series : by register, one casadi scalar for each order
    steps : of the program, made ready
    """

    def __init__(self, plan: Plan, order: int, time) -> None:
        import casadi as ca

        self.zero, self.time, self.count, self.order = ca.SX(0), time, plan.count, order
        self.series: list[list] = [[self.zero] * (order + 1) for _ in range(plan.count)]
        self.constant = constant_registers(plan.program, plan.count, plan.states)
        self.steps = self._ready(plan.program)
        operations = sum(step.operations for step in self.steps)
        if operations > LARGEST:
            text = f"without a C compiler the series would take {operations:.2g} operations a step"
            raise Unsupported(f"{text}, more than {LARGEST:.2g}")

    def _ready(self, program: Program) -> list[_Apply | _Total | _Solve]:
        kinds = {Apply: _Apply, Total: _Total, Solve: _Solve}
        return [kinds[type(step)](step, self) for step in program if not isinstance(step, Apply) or len(step.out)]

    def ready(self, step: Solve) -> list[_Apply | _Total | _Solve]:
        """Return the inner steps of a block, made ready."""
        if any(isinstance(inner, Solve) for inner in walk(step.inner)):
            raise Unsupported("a block stands inside a block")
        return self._ready(step.inner)

    def take(self, registers: np.ndarray, symbols) -> None:
        """Have symbols for the values of registers."""
        import casadi as ca

        for register, symbol in zip(registers.tolist(), ca.vertsplit(symbols) if len(registers) else [], strict=True):
            self.series[register][0] = symbol

    def run(self, steps: list, k: int) -> None:
        """Write order k of everything that the steps compute."""
        for step in steps:
            step.run(k)


class _Total:
    def __init__(self, step: Total, jets: _Jets) -> None:
        self.step, self.jets = step, jets
        self.operations: int = 2 * len(step.index) * jets.order

    def run(self, k: int) -> None:
        step, series = self.step, self.jets.series
        start, index, coefficient = step.start.tolist(), step.index.tolist(), step.coefficient.tolist()
        for i, target in enumerate(step.out.tolist()):
            parts = [coefficient[j] * series[index[j]][k] for j in range(start[i], start[i + 1])]
            series[target][k] = reduce(add, parts, self.jets.zero)


class _Apply:
    """Rows of one shape: for each of its nodes a matrix of coefficients, rows by orders (`Coefficients`)."""

    def __init__(self, step: Apply, jets: _Jets) -> None:
        self.jets, self.out = jets, step.out.tolist()
        fixed = {c for c in range(step.slots.shape[1]) if jets.constant[step.slots[:, c]].all()}
        self.shape = prepared(step.shape, fixed)
        self.nodes = Nodes(self.shape, fixed)
        self.columns = {c: step.slots[:, c].tolist() for c in self.nodes.columns}
        self.of: dict[Expr, Any] = {}
        self.k = 0
        products = sum(node.op not in ("neg", "add", "sub") for node in self.nodes.inner)
        self.operations: int = len(self.out) * (products * jets.order**2 + 2 * len(self.nodes.inner) * jets.order)

    def run(self, k: int) -> None:
        self.k = k
        with exactly():  # where a function has a value but no derivative, there is no series
            for node in self.nodes.place:
                if not k:
                    self._begin(node)
                elif not self.nodes.steady[node]:
                    self.of[node][:, k] = self._higher(node)
        for row, target in enumerate(self.out):
            self.jets.series[target][k] = self.of[self.shape][row, k]

    def _begin(self, node: Expr) -> None:
        import casadi as ca

        value = lower_node(node, [self.of[a][:, 0] for a in node.args], self._column, self.jets.time)
        self.of[node] = ca.SX.zeros(len(self.out), self.jets.order + 1)
        self.of[node][:, 0] = value

    def _column(self, column: int):
        import casadi as ca

        return ca.vertcat(*[self.jets.series[r][self.k] for r in self.columns[column]])

    def _higher(self, node: Expr):
        if node.op == "slot":
            return self._column(node.value[0])
        if node.op == "time":
            return 1.0 if self.k == 1 else 0.0
        return self.nodes.coefficient(node, self)

    def number(self, node: Expr):
        return self.of[node][:, 0]

    first = number

    def at(self, node: Expr):
        return self.of[node][:, self.k]

    def convolve(self, a: Expr, b: Expr):
        return _sum(self._from(a, 0) * self._back(b, 0))

    def square(self, a: Expr):
        k, x = self.k, self.of[a]
        half = (k + 1) // 2
        twice = 2 * _sum(x[:, :half] * x[:, k : k - half : -1])
        return twice if k % 2 else twice + x[:, k // 2] * x[:, k // 2]

    def quotient_rest(self, b: Expr, c: Expr):
        return _sum(self._from(b, 1) * self._back(c, 1))

    def chain(self, x: Expr, g: Expr):
        weights = np.arange(1.0, self.k + 1.0) / self.k
        return _sum(self._from(x, 1) * self._back(g, 1) * np.tile(weights, (len(self.out), 1)))

    def power(self, a: Expr, exponent: Expr, c: Expr):
        import casadi as ca

        k, j = self.k, np.arange(float(self.k))[None]
        weights = ca.mtimes(self.number(exponent), k - j) - np.tile(j, (len(self.out), 1))
        products = self.of[c][:, :k] * self.of[a][:, k:0:-1]
        return _sum(weights * products) / (k * self.first(a))

    def _from(self, node: Expr, j: int):
        """Return the coefficients j … k."""
        return self.of[node][:, j : self.k + 1]

    def _back(self, node: Expr, j: int):
        """Return the coefficients k-j … 0."""
        return self.of[node][:, list(range(self.k - j, -1, -1))]


def _sum(terms):
    import casadi as ca

    return ca.sum2(terms)


class _Solve:
    """Blocks: order 0 is solved on its own, or stands already; then each order takes the inverse of the matrix."""

    def __init__(self, step: Solve, jets: _Jets) -> None:
        self.step, self.jets = step, jets
        instances, size = step.unknowns.shape
        if size > _LARGEST_BLOCK:
            raise Unsupported(f"without a C compiler a block of {size} unknowns has no series")
        self.inner = jets.ready(step)
        inverses = 2 * instances * size**2 * (jets.order + size**2)
        self.operations: int = 2 * sum(s.operations for s in self.inner) + inverses
        self.inverses: list = []

    def run(self, k: int) -> None:
        if k:
            self._higher(k)
        else:
            self._begin()
        self.jets.run(self.inner, k)

    def _begin(self) -> None:
        """Invert the matrices at order 0, and find the unknowns of a linear block."""
        import casadi as ca

        step, jets = self.step, self.jets
        unknowns = step.unknowns.ravel()
        reads = outside(step.inner, unknowns, jets.count).tolist()
        values = ca.vertcat(ca.SX(0, 1), *[jets.series[r][0] for r in reads])
        found = ca.vertcat(*[jets.series[r][0] for r in unknowns.tolist()])
        function = block_function(step, np.array(reads, int), jets.count)
        parts = function(jets.time, found, values)
        for own, residual, matrix in zip(step.unknowns, parts[::2], parts[1::2], strict=True):
            if step.linear:
                jets.take(own, ca.vertcat(*eliminate(matrix, -residual)))
            unit = ca.DM.eye(len(own))
            columns = [ca.vertcat(*eliminate(matrix, ca.SX(unit[:, j]))) for j in range(len(own))]
            self.inverses += shared([ca.horzcat(*columns)])

    def _higher(self, k: int) -> None:
        import casadi as ca

        step, jets = self.step, self.jets
        for register in step.unknowns.ravel().tolist():
            jets.series[register][k] = jets.zero
        jets.run(self.inner, k)
        for own, residual, inverse in zip(step.unknowns, step.residuals.tolist(), self.inverses, strict=True):
            rest = ca.vertcat(*[jets.series[r][k] for r in residual])
            for register, value in zip(own.tolist(), ca.vertsplit(ca.mtimes(inverse, -rest)), strict=True):
                jets.series[register][k] = value
