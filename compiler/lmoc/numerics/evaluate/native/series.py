"""Taylor series of a program's registers in C: the coefficients of order k of everything from those of lower orders.

Sums, products and quotients have recurrences of their own. Any smooth function f follows from its derivatives in the
table of functions: with ``f' = g·x'``, ``k·f[k] = Σ j·x[j]·g[k-j]``, where g is a series like the others (Moore,
Methods and Applications of Interval Analysis, 1979; Griewank and Walther, Evaluating Derivatives, 2008, chapter 13). A
block needs Newton's method for order zero alone, which is an ordinary evaluation; every further order is one solution
with the same matrix (Nedialkov and Pryce, Solving DAEs by Taylor series (I), BIT 45, 2005).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from lmoc.expression.dag import ONE, Expr, function, lift, mul, neg, postorder, rebuild
from lmoc.expression.functions import FUNCTIONS, Kind
from lmoc.ir.program import Apply, Program, Solve, Total, written
from lmoc.numerics.evaluate.jacobian import Jacobian
from lmoc.numerics.evaluate.native.c_code import CFunction, Unsupported, Writer, number_text
from lmoc.numerics.evaluate.native.c_derivatives import sweep
from lmoc.numerics.evaluate.native.c_matrices import Matrices
from lmoc.support.records import dataclass

LENGTH = 32  # coefficients that a series has room for
_POWERS = 8  # whole exponents up to which a power is a product

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
        shape = _prepared(step.shape, fixed)
        nodes = _Nodes(shape, fixed)
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
        writer.add(*nodes.pointers(access), f"double *result = s + N_SERIES*(int64_t)({out});")
        writer.add("if (k == 0) {", *nodes.zero(), "} else {", *nodes.order(), "}")
        writer.add(f"result[k] = {nodes.coefficient(shape)};", "}", "(void)o;", "}")

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


def _prepared(shape: Expr, fixed: set[int]) -> Expr:
    """The shape with powers written as products, or by exponential and logarithm where both parts vary.

    Squares stand apart from constant factors: they take half the operations of a product.
    """
    new: dict[int, Expr] = {}
    for node in postorder(shape):
        if not node.args:
            new[id(node)] = node
            continue
        args = tuple(new[id(a)] for a in node.args)
        exponent = args[1].value if node.op == "pow" and args[1].is_const else None
        if exponent is not None and exponent == int(exponent) and 2 <= exponent <= _POWERS:
            product = args[0]
            for _ in range(int(exponent) - 1):
                product = mul(product, args[0])
            new[id(node)] = product
        elif node.op == "pow" and not _is_constant(args[1], fixed):
            new[id(node)] = function("exp", mul(args[1], function("log", args[0])))
        elif node.op == "mul":
            (c, x), (d, y) = (_without_factor(a, fixed) for a in args)
            new[id(node)] = mul(mul(c, d), mul(x, x)) if x is y else rebuild(node.op, args)
        else:
            new[id(node)] = rebuild(node.op, args)
    return new[id(shape)]


def _without_factor(node: Expr, fixed: set[int]) -> tuple[Expr, Expr]:
    """Return the constant factor of an expression, and the rest."""
    factor: Expr = ONE
    while node.op in ("mul", "div", "neg"):
        if node.op == "neg":
            factor, node = neg(factor), node.args[0]
        elif _is_constant(node.args[1], fixed):
            factor, node = rebuild(node.op, (factor, node.args[1])), node.args[0]
        elif node.op == "mul" and _is_constant(node.args[0], fixed):
            factor, node = mul(factor, node.args[0]), node.args[1]
        else:
            break
    return factor, node


def _is_constant(node: Expr, fixed: set[int]) -> bool:
    return not any(leaf.op == "time" or _varies(leaf, fixed) for leaf in postorder(node))


def _varies(leaf: Expr, fixed: set[int]) -> bool:
    return leaf.op == "slot" and leaf.value[0] not in fixed


@dataclass(frozen=True)
class _Rule:
    """A smooth function: the series that its own follows from, one for each argument."""

    partials: tuple[Expr, ...]


class _Nodes:
    """The nodes of a shape, and of the derivatives of its functions, in an order in which they can be computed."""

    def __init__(self, shape: Expr, fixed: set[int]) -> None:
        """`fixed` are the columns whose registers are constant."""
        self.fixed = fixed
        self.place: dict[Expr, int] = {}
        self.rules: dict[Expr, _Rule] = {}
        self.steady: dict[Expr, bool] = {}
        ahead = [shape]
        while ahead:  # a function at order k needs its derivatives up to k - 1: these may stand behind it
            for node in postorder(ahead.pop()):
                if node not in self.place:
                    self.place[node] = len(self.place)
                    self.steady[node] = self._is_steady(node)
                    if not self.steady[node]:
                        ahead += self._derivatives(node)
        self.columns = sorted({node.value[0] for node in self.place if node.op == "slot"})
        self.inner = [node for node in self.place if node.args and not self.steady[node]]

    def _is_steady(self, node: Expr) -> bool:
        if node.op == "slot":
            return node.value[0] in self.fixed
        return node.op != "time" and all(self.steady[a] for a in node.args)

    def _derivatives(self, node: Expr) -> Iterable[Expr]:
        """The derivatives of a function by its arguments, which its own series follows from."""
        if not node.args or node.op in ("add", "sub", "mul", "div", "neg"):
            return ()
        if node.op == "pow":  # with a constant exponent
            return ()
        entry = FUNCTIONS[node.op]
        if entry.kind is not Kind.SMOOTH:
            raise Unsupported(f"'{entry.text}' has kinks or jumps")
        partials = tuple(_prepared(lift(rule(function, node, *node.args)), self.fixed) for rule in entry.derivatives)
        self.rules[node] = _Rule(partials)
        return partials

    # ------------------------------------------------------------------ C

    def pointers(self, access: dict[int, str]) -> list[str]:
        """Declarations of the values of the nodes: a number, or a series."""
        self.name: dict[Expr, str] = {}
        lines = []
        work = 0
        for node, k in self.place.items():
            if node.op == "const":
                self.name[node] = number_text(node.value)
            elif node.op == "time":
                self.name[node] = "clock"
            elif self.steady[node]:
                value = f"{access[node.value[0]]}[0]" if node.op == "slot" else self._value(node)
                lines.append(f"const double n{k} = {value};")
                self.name[node] = f"n{k}"
            elif node.op == "slot":
                lines.append(f"const double *n{k} = {access[node.value[0]]};")
                self.name[node] = f"n{k}"
            else:
                lines.append(f"double *n{k} = work + N_SERIES*(i*{len(self.inner)} + {work});")
                self.name[node] = f"n{k}"
                work += 1
        return lines + [f"(void){name};" for name in self.name.values() if name.startswith("n")]

    def coefficient(self, node: Expr) -> str:
        """The coefficient of order k."""
        if self.steady[node]:
            return f"(k == 0 ? {self.name[node]} : 0)"
        return f"{self.name[node]}[k]"

    def _value(self, node: Expr) -> str:
        return FUNCTIONS[node.op].c.format(*(self.name[a] + ("" if self.steady[a] else "[0]") for a in node.args))

    def zero(self) -> list[str]:
        """Values of the inner nodes."""
        return [f"{self.name[node]}[0] = {self._value(node)};" for node in self.inner]

    def order(self) -> list[str]:
        """Coefficients of order k ≥ 1 of the inner nodes."""
        return [f"{self.name[node]}[k] = {self._coefficient(node)};" for node in self.inner]

    def _coefficient(self, node: Expr) -> str:
        names = [self.name[a] for a in node.args]
        steady = [self.steady[a] for a in node.args]
        at = ["0.0" if fixed else f"{name}[k]" for name, fixed in zip(names, steady, strict=True)]
        own = self.name[node]
        if node.op == "neg":
            return f"-{at[0]}"
        if node.op in ("add", "sub"):
            return f"{at[0]} {'+' if node.op == 'add' else '-'} {at[1]}"
        if node.op == "mul":
            if any(steady):
                return f"{names[0]}*{at[1]}" if steady[0] else f"{at[0]}*{names[1]}"
            same = names[0] == names[1]
            return f"lmoc_square(k, {names[0]})" if same else f"lmoc_convolve(k, {names[0]}, {names[1]})"
        if node.op == "div":
            if steady[1]:
                return f"{at[0]}/{names[1]}"
            return f"({at[0]} - lmoc_quotient_rest(k, {names[1]}, {own}))/{names[1]}[0]"
        if node not in self.rules:  # a power with a constant exponent
            return f"lmoc_power(k, {names[0]}, {names[1]}, {own})"
        terms = []
        for name, fixed, at_k, partial in zip(names, steady, at, self.rules[node].partials, strict=True):
            if not fixed:
                g = self.name[partial]
                terms.append(f"{g}*{at_k}" if self.steady[partial] else f"lmoc_chain(k, {name}, {g})")
        return " + ".join(terms)


def constant_registers(program: Program, count: int, states: np.ndarray) -> np.ndarray:
    """(count,) whether a register is neither a state nor computed by the program."""
    constant = np.ones(count, bool)
    constant[states] = False
    for step in program:
        constant[written(step)] = False
    return constant
