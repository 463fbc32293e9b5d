"""Programs as C: one loop a step, whatever the number of rows.

The text depends on shapes and addressing patterns only. Row counts, first registers and index tables are data that the
function gets when called, so a chain of a hundred masses and one of a hundred thousand share one compiled file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.functions import FUNCTIONS
from lmoc.ir.program import Apply, Program, Solve, Total

DENSE_LIMIT = 12  # a varying linear block with more unknowns is left to a sparse solver


class Unsupported(Exception):
    """The program has a step that is not written as C."""


@dataclass(frozen=True, eq=False)
class CFunction:
    """The text of one C function and its data.

    The function is ``void name(double time, double *w, const int64_t *m, const void *const *tab)``.

    Attributes
    ----------
    text : str
    numbers : (k,) int64
        Row counts, first registers and strides, in the order in which the text reads ``m[0], m[1], …``.
    tables : list of int32 or float64 arrays
        What ``tab[0], tab[1], …`` point to.
    scratch : int
        Doubles that the function uses behind the registers.
    factors : list of (Solve, int)
        Constant linear blocks, and the number of the first of the eight tables that take their factors
        (L: start, index, value; U: start, index, value; then the two permutations): filled for each parameter set.
    """

    text: str
    numbers: np.ndarray
    tables: list[np.ndarray]
    scratch: int
    factors: list[tuple[Solve, int]]


class _Writer:
    """Collects the lines of one function and the data they read."""

    def __init__(self, registers: int) -> None:
        self.lines: list[str] = []
        self.numbers: list[int] = []
        self.tables: list[np.ndarray] = []
        self.factors: list[tuple[Solve, int]] = []
        self.registers = registers
        self.scratch = 0

    def number(self, value: int) -> str:
        self.numbers.append(int(value))
        return f"m[{len(self.numbers) - 1}]"

    def table(self, values: np.ndarray) -> str:
        self.tables.append(values)
        return f"tab[{len(self.tables) - 1}]"

    def address(self, registers: np.ndarray, name: str) -> tuple[list[str], str]:
        """Declarations and the index expression for the registers of one column over the rows ``i``."""
        first = int(registers[0])
        steps = np.diff(registers)
        if len(steps) == 0 or (steps == steps[0]).all():
            stride = int(steps[0]) if len(steps) else 0
            declare = [f"const int64_t {name} = {self.number(first)};"]
            if stride == 0:
                return declare, name
            if stride == 1:
                return declare, f"{name} + i"
            declare.append(f"const int64_t {name}s = {self.number(stride)};")
            return declare, f"{name} + i*{name}s"
        table = self.table(np.ascontiguousarray(registers, np.int32))
        return [f"const int32_t *{name} = (const int32_t *){table};"], f"{name}[i]"


def generate(program: Program, registers: int, name: str = "lmoc_program") -> CFunction:
    """Write a program as one C function.

    Parameters
    ----------
    program : Program
        Apply, Total, and linear Solve steps (constant ones of any size, others up to `DENSE_LIMIT` unknowns).
    registers : int
        Length of the register vector; the function's scratch lies behind it.

    Raises
    ------
    Unsupported
        For a nonlinear or a large varying block: those are evaluated in another way.
    """
    writer = _Writer(registers)
    _write_program(writer, program)
    head = f"void {name}(double time, double *w, const int64_t *m, const void *const *tab) {{"
    body = "\n".join("  " + line for line in writer.lines)
    text = f"{head}\n{body}\n  (void)time; (void)w; (void)m; (void)tab;\n}}\n"
    return CFunction(text, np.array(writer.numbers, np.int64), writer.tables, writer.scratch, writer.factors)


def _write_program(writer: _Writer, program: Program) -> None:
    for step in program:
        if isinstance(step, Apply):
            if len(step.out):
                _write_apply(writer, step)
        elif isinstance(step, Total):
            _write_total(writer, step)
        elif step.constant and len(step.unknowns) == 1:
            _write_constant_solve(writer, step)
        elif step.linear and step.unknowns.shape[1] <= DENSE_LIMIT:
            _write_dense_solve(writer, step)
        else:
            raise Unsupported("a nonlinear or large varying block")


def _write_apply(writer: _Writer, step: Apply) -> None:
    columns = sorted({node.value[0] for node in postorder(step.shape) if node.op == "slot"})
    declarations, access = [], {}
    for k in columns:
        declare, index = writer.address(step.slots[:, k], f"a{k}")
        declarations += declare
        access[k] = f"w[{index}]"
    declare, out = writer.address(step.out, "o")
    body, result = expression_lines(step.shape, access)
    writer.lines.append("{")
    writer.lines += ["  " + line for line in declarations + declare]
    writer.lines.append(f"  const int64_t n = {writer.number(len(step.out))};")
    # the rows of a step do not read each other's results, which the compiler cannot see
    writer.lines += ["#pragma GCC ivdep", "  for (int64_t i = 0; i < n; i++) {"]
    writer.lines += ["    " + line for line in body]
    writer.lines += [f"    w[{out}] = {result};", "  }", "}"]


def expression_lines(shape: Expr, access: dict[int, str]) -> tuple[list[str], str]:
    """C statements that compute the inner nodes of a shape, and the expression of its value."""
    text: dict[int, str] = {}
    lines: list[str] = []
    for node in postorder(shape):
        if node.op == "const":
            text[id(node)] = _number(node.value)
        elif node.op == "slot":
            text[id(node)] = access[node.value[0]]
        elif node.op == "time":
            text[id(node)] = "time"
        else:
            name = f"t{len(lines)}"
            lines.append(f"const double {name} = {_operation(node, [text[id(a)] for a in node.args])};")
            text[id(node)] = name
    return lines, text[id(shape)]


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "(-INFINITY)"
    return f"({value!r})" if value < 0 else repr(value)


def _operation(node: Expr, args: list[str]) -> str:
    op = node.op
    if op == "pow" and node.args[1].op == "const" and node.args[1].value in (2.0, 3.0):
        return "*".join([args[0]] * int(node.args[1].value))
    return FUNCTIONS[op].c.format(*args)


def _write_total(writer: _Writer, step: Total) -> None:
    declare, out = writer.address(step.out, "o")
    start = writer.table(np.ascontiguousarray(step.start, np.int32))
    index = writer.table(np.ascontiguousarray(step.index, np.int32))
    coefficient = writer.table(np.ascontiguousarray(step.coefficient, np.float64))
    writer.lines += [
        "{",
        *("  " + line for line in declare),
        f"  const int32_t *start = (const int32_t *){start}, *index = (const int32_t *){index};",
        f"  const double *c = (const double *){coefficient};",
        f"  const int64_t n = {writer.number(len(step.out))};",
        "  for (int64_t i = 0; i < n; i++) {",
        "    double s = 0;",
        "    for (int32_t j = start[i]; j < start[i + 1]; j++) s += c[j]*w[index[j]];",
        f"    w[{out}] = s;",
        "  }",
        "}",
    ]


def _write_constant_solve(writer: _Writer, step: Solve) -> None:
    """u := u - A⁻¹ r(u) from u = 0, with the sparse factors of A made beforehand; then the inner steps once more."""
    size = step.unknowns.shape[1]
    declare_u, u = writer.address(step.unknowns[0], "u")
    declare_r, r = writer.address(step.residuals[0], "r")
    first = len(writer.tables)
    names = [writer.table(np.zeros(1)) for _ in range(8)]
    writer.factors.append((step, first))
    base = writer.number(writer.registers + writer.scratch)
    writer.scratch += 2 * size
    n = writer.number(size)
    writer.lines += ["{", *("  " + line for line in declare_u + declare_r), f"  const int64_t n = {n};"]
    writer.lines += [f"  double *b = w + {base};", f"  for (int64_t i = 0; i < n; i++) w[{u}] = 0;"]
    writer.lines += ["  for (int pass = 0; pass < 2; pass++) {"]
    _write_program(writer, step.inner)
    writer.lines += [
        "  if (pass == 0) {",
        f"    for (int64_t i = 0; i < n; i++) b[i] = -w[{r}];",
        f"    lmoc_sparse_solve(n, b, b + n, {', '.join(names)});",
        f"    for (int64_t i = 0; i < n; i++) w[{u}] = b[i];",
        "  } }",
        "}",
    ]


def _write_dense_solve(writer: _Writer, step: Solve) -> None:
    """Columns of the matrix from unit vectors (the residuals are linear), then Gauss elimination for each instance."""
    instances, size = step.unknowns.shape
    base = writer.number(writer.registers + writer.scratch)
    writer.scratch += instances * size * (size + 1)
    unknowns = writer.table(np.ascontiguousarray(step.unknowns, np.int32))
    residuals = writer.table(np.ascontiguousarray(step.residuals, np.int32))
    n = writer.number(instances)
    writer.lines += [
        "{",
        f"  const int32_t *u = (const int32_t *){unknowns}, *r = (const int32_t *){residuals};",
        f"  const int64_t n = {n};",
        f"  double *a = w + {base};",
        f"  for (int pass = 0; pass <= {size + 1}; pass++) {{",
        f"  if (pass <= {size})",
        f"    for (int64_t i = 0; i < n; i++) for (int k = 0; k < {size}; k++) w[u[i*{size} + k]] = k + 1 == pass;",
    ]
    _write_program(writer, step.inner)
    writer.lines += [
        "  for (int64_t i = 0; i < n; i++) {",
        f"    double *row = a + i*{size * (size + 1)};",
        f"    if (pass <= {size})",
        f"      for (int k = 0; k < {size}; k++)",
        f"        row[k*{size + 1} + (pass ? pass - 1 : {size})] ="
        f" w[r[i*{size} + k]] - (pass ? row[k*{size + 1} + {size}] : 0);",
        f"    if (pass == {size}) {{",
        f"      lmoc_dense_solve({size}, row);",
        f"      for (int k = 0; k < {size}; k++) w[u[i*{size} + k]] = -row[k*{size + 1} + {size}];",
        "    }",
        "  } }",
        "}",
    ]
