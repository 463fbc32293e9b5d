"""Taylor series of a program's registers in C: the coefficients of order k of everything from those of lower orders.

The recurrences are those of `recurrences`. A block needs Newton's method for order zero alone, which is an ordinary
evaluation; every further order is one solution with the same matrix (Nedialkov and Pryce, Solving DAEs by Taylor
series (I), BIT 45, 2005).
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.expression.functions import FUNCTIONS
from lmoc.ir.program import Apply, Program, Solve, Total
from lmoc.numerics.evaluate.jacobian import Jacobian
from lmoc.numerics.evaluate.native.c_code import CFunction, Unsupported, Writer, number_text
from lmoc.numerics.evaluate.native.c_derivatives import sweep
from lmoc.numerics.evaluate.native.c_matrices import Matrices
from lmoc.numerics.evaluate.recurrences import Nodes, prepared
from lmoc.support.records import dataclass

LENGTH = 32  # coefficients that a series has room for

# Recurrences for order k of c from a and b; s is a number.
RECURRENCES = (
    f"#define N_SERIES {LENGTH}\n"
    + r"""
static inline double lmoc_convolve(int64_t k, const double *a, const double *b) {
  double s = 0;
  for (int64_t j = 0; j <= k; j++) s += a[j] * b[k - j];
  return s;
}
static inline double lmoc_square(int64_t k, const double *a) {
  double s = 0;
  int64_t j = 0;
  for (; 2*j < k; j++) s += a[j] * a[k - j];
  return 2*j == k ? 2*s + a[j]*a[j] : 2*s;
}
static inline double lmoc_quotient_rest(int64_t k, const double *b, const double *c) {
  double s = 0;
  for (int64_t j = 1; j <= k; j++) s += b[j] * c[k - j];
  return s;
}
static inline double lmoc_chain(int64_t k, const double *x, const double *g) {
  double s = 0;
  for (int64_t j = 1; j <= k; j++) s += (double)j * x[j] * g[k - j];
  return s / (double)k;
}
static inline double lmoc_power(int64_t k, const double *a, double p, const double *c) {
  double s = 0;
  for (int64_t j = 0; j < k; j++) s += (p * (double)(k - j) - (double)j) * a[k - j] * c[j];
  return s / ((double)k * a[0]);
}
"""
)


def generate_series(program: Program, count: int, constant: np.ndarray, registers: int) -> CFunction:
    """Write ``int lmoc_order(k, time, w, series, m, tab)``: order k of all registers; order 0 stands in `w`.

    Parameters
    ----------
    count : registers of the program
    constant : (count,) whether a register keeps its value
    registers : length of the register vector with the scratch of the program's own function

    Raises
    ------
    Unsupported
        The program has a function with kinks, an input that is sampled, or a block inside a block.
    """
    series = _Series(Writer(registers, literal=False), count, constant)
    series.write(program)
    writer = series.writer
    head = (
        "static int lmoc_order(int64_t k, double time, double *w, double *s, const int64_t *m, "
        "const void *const *tab) {\n  double clock[N_SERIES] = {time, 1};\n  int status = 0;\n"
    )
    body = "\n".join("  " + line for line in writer.lines)
    text = f"{RECURRENCES}{head}{body}\n  (void)clock; (void)w; (void)m; (void)tab;\n  return status;\n}}\n"
    numbers = np.array(writer.numbers, np.int64)
    return CFunction(text, numbers, writer.tables, writer.scratch, [], writer.matrices, [])


class _Series:
    """Writes the steps of a program for one order."""

    def __init__(self, writer: Writer, count: int, constant: np.ndarray) -> None:
        self.writer, self.count, self.constant = writer, count, constant

    def write(self, program: Program) -> None:
        for step in program:
            if isinstance(step, Solve):
                self._solve(step)
            elif isinstance(step, Total):
                self._total(step)
            elif len(step.out):
                self._apply(step)

    def _total(self, step: Total) -> None:
        writer = self.writer
        start, index, out = (writer.indices(v) for v in (step.start, step.index, step.out))
        c = writer.table(np.ascontiguousarray(step.coefficient, np.float64))
        writer.add(
            f"for (int64_t i = 0; i < {writer.number(len(step.out))}; i++) {{",
            f"  const int32_t *start = {start}, *index = {index}, *out = {out};",
            f"  const double *c = (const double *){c};",
            "  double sum = 0;",
            "  for (int32_t j = start[i]; j < start[i + 1]; j++) sum += c[j]*s[index[j]*(int64_t)N_SERIES + k];",
            "  s[out[i]*(int64_t)N_SERIES + k] = sum;",
            "}",
        )

    def _apply(self, step: Apply) -> None:
        """A loop over the rows; every inner node has a series of its own in each of them."""
        fixed = {c for c in range(step.slots.shape[1]) if self.constant[step.slots[:, c]].all()}
        shape = prepared(step.shape, fixed)
        nodes = Nodes(shape, fixed)
        names = _Names(nodes)
        writer = self.writer
        work = writer.space(len(step.out) * len(nodes.inner) * LENGTH)
        writer.add("{", f"double *work = {work};", "(void)work;")
        access = {}
        for column in nodes.columns:
            declare, index = writer.address(step.slots[:, column], f"a{column}")
            writer.add(*declare)
            access[column] = f"(s + N_SERIES*(int64_t)({index}))"
        declare, out = writer.address(step.out, "o")
        writer.add(*declare, f"for (int64_t i = 0; i < {writer.number(len(step.out))}; i++) {{")
        writer.add(*names.pointers(access), f"double *result = s + N_SERIES*(int64_t)({out});")
        writer.add("if (k == 0) {", *names.zero(), "} else {", *names.order(), "}")
        writer.add(f"result[k] = {names.result(shape)};", "}", "(void)o;", "}")

    def _solve(self, step: Solve) -> None:
        """Order 0 is known; then the matrix is factorized, and each order is one solution with it."""
        writer = self.writer
        jacobian = Jacobian(step.inner, step.unknowns.ravel(), step.residuals.ravel(), self.count)
        instances, size = step.unknowns.shape
        instance, row = np.divmod(jacobian.rows, size)
        writer.add("{")
        matrices = Matrices(writer, step.unknowns.shape, instance, row, jacobian.columns % size)
        if matrices.is_sparse and instances > 1:
            raise Unsupported("several large blocks at once")
        n, own, each = writer.number(instances), matrices.number(size), matrices.number(matrices.each)
        pivots = writer.space(8 * instances)
        writer.add(
            f"const int32_t *u = {writer.indices(step.unknowns)}, *r = {writer.indices(step.residuals)};",
            f"double *b = {writer.space(size)}, det;",
            f"int *pivots = (int *){pivots};",
            "if (k == 0) {",
        )
        matrices.fill(sweep(writer, step.inner, jacobian, values=False), jacobian.source)
        factor = f"lmoc_factor(&{matrices.name}, {matrices.a} + i*{each}, pivots + 16*i, &det)"
        writer.add(
            f"for (int64_t i = 0; i < {n}; i++) if (!{factor}) status = LMOC_FAILED;",
            f"}} else for (int64_t i = 0; i < {n}*{own}; i++) s[u[i]*(int64_t)N_SERIES + k] = 0;",
            "for (int pass = 0; pass < (k == 0 ? 1 : 2); pass++) {",
        )
        self.write(step.inner)
        writer.add(
            f"if (k > 0 && pass == 0) for (int64_t i = 0; i < {n}; i++) {{",
            f"  for (int64_t j = 0; j < {own}; j++) b[j] = -s[r[i*{own} + j]*(int64_t)N_SERIES + k];",
            f"  lmoc_solve(&{matrices.name}, {matrices.a} + i*{each}, pivots + 16*i, b);",
            f"  for (int64_t j = 0; j < {own}; j++) s[u[i*{own} + j]*(int64_t)N_SERIES + k] = b[j];",
            "} }",
            "}",
        )


@dataclass(frozen=True)
class _Term:
    """A C expression, with Python's operators."""

    text: str

    def __neg__(self) -> _Term:
        return _Term(f"-{self.text}")

    def __add__(self, other: _Term) -> _Term:
        return _Term(f"({self.text} + {other.text})")

    def __sub__(self, other: _Term) -> _Term:
        return _Term(f"({self.text} - {other.text})")

    def __mul__(self, other: _Term) -> _Term:
        return _Term(f"{self.text}*{other.text}")

    def __truediv__(self, other: _Term) -> _Term:
        return _Term(f"{self.text}/{other.text}")


class _Names:
    """The nodes of a shape by their names in C: numbers, or series (`recurrences.Coefficients`)."""

    def __init__(self, nodes: Nodes) -> None:
        self.nodes = nodes
        self.name: dict[Expr, str] = {}

    def pointers(self, access: dict[int, str]) -> list[str]:
        """Declarations of the values of the nodes: a number, or a series."""
        lines = []
        work = 0
        for node, k in self.nodes.place.items():
            if node.op == "const":
                self.name[node] = number_text(node.value)
            elif node.op == "time":
                self.name[node] = "clock"
            elif self.nodes.steady[node]:
                value = f"{access[node.value[0]]}[0]" if node.op == "slot" else self._value(node)
                lines.append(f"const double n{k} = {value};")
                self.name[node] = f"n{k}"
            elif node.op == "slot":
                lines.append(f"const double *n{k} = {access[node.value[0]]};")
                self.name[node] = f"n{k}"
            else:
                lines.append(f"double *n{k} = work + N_SERIES*(i*{len(self.nodes.inner)} + {work});")
                self.name[node] = f"n{k}"
                work += 1
        return lines + [f"(void){name};" for name in self.name.values() if name.startswith("n")]

    def result(self, node: Expr) -> str:
        """The coefficient of order k."""
        if self.nodes.steady[node]:
            return f"(k == 0 ? {self.name[node]} : 0)"
        return f"{self.name[node]}[k]"

    def _value(self, node: Expr) -> str:
        return FUNCTIONS[node.op].c.format(*(self.name[a] + ("" if self.nodes.steady[a] else "[0]") for a in node.args))

    def zero(self) -> list[str]:
        """Values of the inner nodes."""
        return [f"{self.name[node]}[0] = {self._value(node)};" for node in self.nodes.inner]

    def order(self) -> list[str]:
        """Coefficients of order k ≥ 1 of the inner nodes."""
        return [f"{self.name[node]}[k] = {self.nodes.coefficient(node, self).text};" for node in self.nodes.inner]

    def number(self, node: Expr) -> _Term:
        return _Term(self.name[node])

    def first(self, node: Expr) -> _Term:
        return _Term(f"{self.name[node]}[0]")

    def at(self, node: Expr) -> _Term:
        return _Term("0.0" if self.nodes.steady[node] else f"{self.name[node]}[k]")

    def convolve(self, a: Expr, b: Expr) -> _Term:
        return _Term(f"lmoc_convolve(k, {self.name[a]}, {self.name[b]})")

    def square(self, a: Expr) -> _Term:
        return _Term(f"lmoc_square(k, {self.name[a]})")

    def quotient_rest(self, b: Expr, c: Expr) -> _Term:
        return _Term(f"lmoc_quotient_rest(k, {self.name[b]}, {self.name[c]})")

    def chain(self, x: Expr, g: Expr) -> _Term:
        return _Term(f"lmoc_chain(k, {self.name[x]}, {self.name[g]})")

    def power(self, a: Expr, exponent: Expr, c: Expr) -> _Term:
        return _Term(f"lmoc_power(k, {self.name[a]}, {self.name[exponent]}, {self.name[c]})")
