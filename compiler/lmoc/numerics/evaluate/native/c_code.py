"""Programs as C: one loop a step, whatever the number of rows.

The text of a large program depends on shapes and addressing patterns only. Row counts, first registers and index tables
are data that the function gets when called, so a chain of a hundred masses and one of a hundred thousand share one
compiled file. In a small program the numbers stand in the text, and its few rows are written one by one: nobody shares
it, and the compiler sees through it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

import numpy as np

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.functions import FUNCTIONS
from lmoc.ir.program import Apply, Solve, Step, Total, written
from lmoc.support.records import dataclass

FEW = 4  # rows of a step that are written one by one


class Unsupported(Exception):
    """The program has a step that is not written as C."""


@dataclass(frozen=True, eq=False)
class Matrix:
    """The sparse matrix of a block, whose pivots are chosen at run time.

    Attributes
    ----------
    handle : number of the table that holds its `native.pivots.Factors`
    indptr, rows : pattern by columns, common to all instances
    """

    handle: int
    indptr: np.ndarray
    rows: np.ndarray


@dataclass(frozen=True, eq=False)
class Block:
    """A nonlinear block, as the generated code keeps it.

    Attributes
    ----------
    step : Solve
    determinants : number of the first of the doubles in scratch that hold its instances' determinants
    """

    step: Solve
    determinants: int


@dataclass(frozen=True, eq=False)
class CFunction:
    """The text of one C function and its data.

    The function is ``int name(double time, double *w, const int64_t *m, const void *const *tab)``. It returns 0, or the
    bits FAILED (a block has no solution that was found) and FAR (one is not near the one before).

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
    matrices : list of Matrix
    blocks : list of Block
    """

    text: str
    numbers: np.ndarray
    tables: list[np.ndarray]
    scratch: int
    factors: list[tuple[Solve, int]]
    matrices: list[Matrix]
    blocks: list[Block]


class Writer:
    """Collects the lines of one function and the data they read."""

    def __init__(self, registers: int, literal: bool) -> None:
        self.lines: list[str] = []
        self.numbers: list[int] = []
        self.tables: list[np.ndarray] = []
        self.factors: list[tuple[Solve, int]] = []
        self.matrices: list[Matrix] = []
        self.blocks: list[Block] = []
        self.registers = registers
        self.literal = literal
        self.scratch = 0
        self._names = 0

    def add(self, *lines: str) -> None:
        self.lines += lines

    def name(self, lead: str) -> str:
        """A C name that is used nowhere else."""
        self._names += 1
        return f"{lead}{self._names}"

    def number(self, value: int) -> str:
        if self.literal:
            return str(int(value))
        self.numbers.append(int(value))
        return f"m[{len(self.numbers) - 1}]"

    def table(self, values: np.ndarray) -> str:
        self.tables.append(values)
        return f"tab[{len(self.tables) - 1}]"

    def indices(self, values: np.ndarray) -> str:
        """A table of registers or places, as a C expression of type ``const int32_t *``."""
        return f"((const int32_t *){self.table(np.ascontiguousarray(values, np.int32).ravel())})"

    def reserve(self, count: int) -> int:
        """The first of `count` doubles behind the registers."""
        self.scratch += count
        return self.registers + self.scratch - count

    def space(self, count: int) -> str:
        """C expression of a pointer to `count` doubles behind the registers."""
        return f"(w + {self.number(self.reserve(count))})"

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
        return [f"const int32_t *{name} = {self.indices(registers)};"], f"{name}[i]"


def write_step(writer: Writer, step: Apply | Total) -> None:
    """Write an explicit step: its rows one by one where they are few and the program is small, else a loop."""
    if isinstance(step, Total):
        _write_total(writer, step)
    elif is_short(writer, step):
        for row, out in zip(step.slots.tolist(), step.out.tolist(), strict=True):
            body, results = expression_lines([step.shape], {k: f"w[{r}]" for k, r in enumerate(row)}, writer)
            writer.add(*body, f"w[{out}] = {results[0]};")
    else:
        with_loop(writer, step, [step.shape], lambda results, out: [f"w[{out}] = {results[0]};"])


def write_rounds(writer: Writer, steps: tuple[Apply, ...], rounds: int) -> None:
    """Write a loop over rounds, each of which runs row k of all steps in order."""
    writer.add("{")
    body = []
    for j, step in enumerate(steps):
        access = {}
        for column in range(step.slots.shape[1]):
            declare, index = writer.address(step.slots[:, column], f"a{j}_{column}")
            writer.add(*declare)
            access[column] = f"w[{index}]"
        declare, out = writer.address(step.out, f"o{j}")
        writer.add(*declare)
        lines, results = expression_lines([step.shape], access, writer)
        body += [*lines, f"w[{out}] = {results[0]};"]
    writer.add(f"for (int64_t i = 0; i < {writer.number(rounds)}; i++) {{", *body, "}", "}")


def is_short(writer: Writer, step: Step) -> bool:
    """Return whether the rows of a step are written one by one."""
    return writer.literal and len(written(step)) <= FEW


def with_loop(writer: Writer, step: Apply, shapes: list[Expr], use) -> None:
    """Write a loop over the rows of a step that computes some shapes of its columns; `use` says what becomes of them.

    Parameters
    ----------
    use : callable (C expressions of the shapes, C index of the row's own register) -> lines
    """
    columns = sorted({node.value[0] for shape in shapes for node in postorder(shape) if node.op == "slot"})
    declarations, access = [], {}
    for k in columns:
        declare, index = writer.address(step.slots[:, k], f"a{k}")
        declarations += declare
        access[k] = f"w[{index}]"
    declare, out = writer.address(step.out, "o")
    body, results = expression_lines(shapes, access)
    writer.add("{", *("  " + line for line in declarations + declare))
    writer.add(f"  const int64_t n = {writer.number(len(step.out))};")
    # the rows of a step do not read each other's results, which the compiler cannot see
    writer.add("#pragma GCC ivdep", "  for (int64_t i = 0; i < n; i++) {", *("    " + line for line in body))
    writer.add(*("    " + line for line in use(results, out)), "  }", "  (void)o;", "}")


class Namer(Protocol):
    """Gives names that are used nowhere else."""

    def name(self, lead: str) -> str: ...


def expression_lines(
    shapes: Iterable[Expr], access: dict[int, str], writer: Namer | None = None, declare: str = "const double"
) -> tuple[list[str], list[str]]:
    """C statements that compute the inner nodes of some shapes, and the expressions of their values.

    Parameters
    ----------
    access : C expression of what is in each column
    writer : gives names that are used nowhere else; without it names are good for one scope
    declare : what stands before a name
    """
    text: dict[int, str] = {}
    lines: list[str] = []
    results = []
    for shape in shapes:
        for node in postorder(shape):
            if id(node) in text:
                continue
            if node.op == "const":
                text[id(node)] = number_text(node.value)
            elif node.op == "slot":
                text[id(node)] = access[node.value[0]]
            elif node.op == "time":
                text[id(node)] = "time"
            else:
                name = writer.name("t") if writer else f"t{len(lines)}"
                lines.append(f"{declare} {name} = {_operation(node, [text[id(a)] for a in node.args])};")
                text[id(node)] = name
        results.append(text[id(shape)])
    return lines, results


def number_text(value: float) -> str:
    """A number as C writes it."""
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "(-INFINITY)"
    return f"({value!r})" if value < 0 else repr(value)


def _operation(node: Expr, args: list[str]) -> str:
    if node.op == "pow" and node.args[1].op == "const" and node.args[1].value in (2.0, 3.0):
        return "*".join([args[0]] * int(node.args[1].value))
    return FUNCTIONS[node.op].c.format(*args)


def _write_total(writer: Writer, step: Total) -> None:
    if is_short(writer, step) and len(step.index) <= 10 * FEW:
        for k, out in enumerate(step.out.tolist()):
            terms = range(int(step.start[k]), int(step.start[k + 1]))
            parts = (f"{number_text(float(step.coefficient[j]))}*w[{step.index[j]}]" for j in terms)
            writer.add(f"w[{out}] = {' + '.join(parts) or '0'};")
        return
    declare, out = writer.address(step.out, "o")
    start, index = writer.indices(step.start), writer.indices(step.index)
    coefficient = writer.table(np.ascontiguousarray(step.coefficient, np.float64))
    writer.add(
        "{",
        *("  " + line for line in declare),
        f"  const int32_t *start = {start}, *index = {index};",
        f"  const double *c = (const double *){coefficient};",
        f"  const int64_t n = {writer.number(len(step.out))};",
        "  for (int64_t i = 0; i < n; i++) {",
        "    double s = 0;",
        "    for (int32_t j = start[i]; j < start[i + 1]; j++) s += c[j]*w[index[j]];",
        f"    w[{out}] = s;",
        "  }",
        "}",
    )
