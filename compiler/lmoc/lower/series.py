"""The Taylor series of a program as instructions for one order (``engine/c/series.c``, ``series_code.py``).

What is computed on the way has a series of its own, each value once. The coefficients of order zero come from a tape,
which also factorizes the matrices of blocks.
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.ir.program import Apply, Program, Solve, Total
from lmoc.lower.blocks import write_solve
from lmoc.lower.chain_rule import ChainRule
from lmoc.lower.derivatives import Ahead, Derivatives, write_derivatives
from lmoc.lower.matrices import block_matrix
from lmoc.lower.recurrences import Nodes, NoSeries, constant_registers, prepared
from lmoc.lower.series_code import NUMBER, PRODUCTS, RECURRENCES, dependent, needed, of_one_order, simplified
from lmoc.lower.steps import single_node
from lmoc.lower.tape import SolveBlock, Tape
from lmoc.lower.writer import Writer
from lmoc.support.records import dataclass

LENGTH = 32  # coefficients that a series has room for (``LMOC_LENGTH``)


@dataclass(frozen=True, eq=False)
class Series:
    """The series of a program.

    Attributes
    ----------
    start : the tape of order zero, on the registers and scratch of the program's own tape
    code : int32
    source : (count,) where the coefficients of order zero stand
    clock : the series of time, or -1
    of_register : (registers,) series, or -1
    share_of_products : products, quotients and functions among all operations of the program
    passing : series that nobody reads at another order
    """

    start: Tape
    code: np.ndarray
    source: np.ndarray
    clock: int
    of_register: np.ndarray
    share_of_products: float
    passing: frozenset[int]


def series_of(program: Program, registers: int, size: int, states: np.ndarray, wanted: np.ndarray) -> Series:
    """Write the series of a program.

    Parameters
    ----------
    registers : of the program
    states : registers whose series are given: states, and inputs
    size : of its own tape, behind which there is room
    wanted : registers whose series are needed, beside those of the states

    Raises
    ------
    NoSeries
        It has a function with kinks, or several large blocks at once.
    """
    writer = _SeriesWriter(size, constant_registers(program, registers, states))
    writer.program(program)
    for register in states.tolist():
        writer.of(register)
    return writer.finish(registers, [writer.of(register) for register in wanted.tolist()])


class _SeriesWriter:
    def __init__(self, size: int, constant: np.ndarray) -> None:
        self.tape, self.constant = Writer(size), constant
        self.code: list[tuple[int, ...]] = []
        self.source: list[int] = []
        self.series: dict[int, int] = {}  # by the place of order zero
        self.even: set[int] = set()  # series that grow evenly with time: of two coefficients
        self.filled: set[int] = set()  # places whose series has its instruction
        self.numbers: set[int] = set()  # places of numbers that instructions read
        self.blocks: dict[int, tuple[set[int], set[int]]] = {}  # series of their unknowns and residuals

    def finish(self, registers: int, wanted: list[int]) -> Series:
        of_register = np.full(registers, -1, np.int32)
        for place, own in self.series.items():
            if place < registers:
                of_register[place] = own
        tape = self.tape.finish(np.array([*self.source, *self.numbers], np.int64))
        code = needed(self.code, wanted, self.blocks)
        share = sum(RECURRENCES[c[0]] in PRODUCTS for c in code) / max(1, len(code))
        code = needed(simplified(code), wanted, self.blocks)
        flat, source = np.array([x for c in code for x in c] + [0] * 4, np.int32), np.array(self.source, np.int32)
        clock = self.series.get(self.tape.time, -1)
        passing = of_one_order(code, {*wanted, *(k for both in self.blocks.values() for own in both for k in own)})
        return Series(tape, flat, source, clock, of_register, share, frozenset(passing))

    def of(self, place: int) -> int:
        """Return the series of what stands at a place; a new one is a number as long as nothing is written to it."""
        if place not in self.series:
            self.series[place] = len(self.source)
            self.source.append(place)
        return self.series[place]

    def write(self, op: str, out: int, a: int = 0, b: int = 0) -> None:
        self.code.append((NUMBER[op], out, a, b))

    # ------------------------------------------------------------------ steps

    def program(self, program: Program) -> None:
        for step in program:
            if isinstance(step, Solve):
                self._solve(step)
            elif isinstance(step, Total):
                self._total(step)
            else:
                self._apply(step)

    def _total(self, step: Total) -> None:
        edges, index, coefficient = step.start.tolist(), step.index.tolist(), step.coefficient.tolist()
        for k, out in enumerate(step.out.tolist()):
            terms = [j for j in range(edges[k], edges[k + 1]) if not self.constant[index[j]]]
            pairs = [x for j in terms for x in (self.of(index[j]), self._number(coefficient[j]))]
            if terms:
                self.code.append((NUMBER["total"], self.of(out), len(terms), 0, *pairs))

    def _number(self, value: float) -> int:
        place = self.tape.constant(value)
        self.numbers.add(place)
        return place

    def _apply(self, step: Apply) -> None:
        if not len(step.out):
            return
        fixed = {c for c in range(step.slots.shape[1]) if self.constant[step.slots[:, c]].all()}
        shape = prepared(step.shape, fixed)
        nodes = Nodes(shape, fixed)
        for row, out in zip(step.slots.tolist(), step.out.tolist(), strict=True):
            place: dict[Expr, int] = {}
            for node in nodes.place:
                place[node] = single_node(self.tape, node, row, place)
            for node in nodes.inner:
                if place[node] not in self.filled:
                    self.filled.add(place[node])
                    self._recurrence(node, nodes, place)
            if not nodes.steady[shape]:
                self.series[out] = self.of(place[shape])

    def _recurrence(self, node: Expr, nodes: Nodes, place: dict[Expr, int]) -> None:
        """Write the coefficient of order k of one node."""
        out, args, steady = self.of(place[node]), node.args, [nodes.steady[a] for a in node.args]
        own = [-1 if s else self.of(place[a]) for a, s in zip(args, steady, strict=True)]
        self.numbers.update(place[a] for a, s in zip(args, steady, strict=True) if s)
        op = node.op
        linear = op in ("neg", "add", "sub") or (op == "mul" and any(steady)) or (op == "div" and steady[1])
        if linear and all(s < 0 or self._grows_evenly(s) for s in own):
            self.even.add(out)
        if op == "neg":
            self.write("neg", out, own[0])
        elif op in ("add", "sub"):
            if any(steady):
                self.write("neg" if op == "sub" and steady[0] else "copy", out, max(own))
            else:
                self.write(op, out, *own)
        elif op == "mul" and any(steady):
            self.write("scale", out, max(own), place[args[int(steady[1])]])
        elif op == "mul":
            self.write("square" if own[0] == own[1] else "convolve", out, *own)
        elif op == "div":
            self.write("ratio" if steady[1] else "quotient", out, own[0], place[args[1]] if steady[1] else own[1])
        elif node not in nodes.partials:
            self.write("power", out, own[0], place[args[1]])
        else:
            self._function(node, nodes, place, out)

    def _grows_evenly(self, series: int) -> bool:
        return series in self.even or series == self.series.get(self.tape.time)

    def _function(self, node: Expr, nodes: Nodes, place: dict[Expr, int], out: int) -> None:
        more = ""
        for x, g in zip(node.args, nodes.partials[node], strict=True):
            if nodes.steady[x]:
                continue
            if nodes.steady[g]:
                self.numbers.add(place[g])
                self.write("scale" + more, out, self.of(place[x]), place[g])
            elif len(node.args) == 1 and self._grows_evenly(self.of(place[x])):
                self.write("of_time", out, self.of(place[x]), self.of(place[g]))
            else:
                self.write("chain" + more, out, self.of(place[x]), self.of(place[g]))
            more = "_more"

    # ------------------------------------------------------------------ blocks

    def _solve(self, step: Solve) -> None:
        """Each order is linear in the unknowns: residuals where they are zero, a solution, what depends on it."""
        block = self._factorized(step)
        unknowns = {self.of(register) for register in step.unknowns.ravel().tolist()}
        self.write("open", 0, block)
        first = len(self.code)
        self.program(step.inner)
        residuals = {self.of(register) for register in step.residuals.ravel().tolist()}
        inner = self.code[first:]
        self.write("solve", 0, block)
        self.code += dependent(inner, unknowns)
        self.blocks[block] = unknowns, residuals

    def _factorized(self, step: Solve) -> int:
        """Have the matrix factorized at order zero; the number of the block."""
        writer, (instances, size) = self.tape, step.unknowns.shape
        rule = ChainRule(step.inner, step.unknowns.ravel(), step.residuals.ravel(), writer.registers)
        found = Derivatives(writer, rule)
        write_derivatives(found, step.inner, Ahead(rule), False, write_solve)
        instance, row = np.divmod(rule.rows, size)
        fill, pattern = block_matrix(writer, (instances, size), found.results, instance, row, rule.columns % size)
        if pattern is not None and instances > 1:
            raise NoSeries("several large blocks at once")
        none = np.zeros((instances, 0, size), np.int32)
        a, b = writer.reserve(fill.size), writer.reserve(size)
        block = SolveBlock(step, step.unknowns, step.residuals, fill, none, pattern, a, b, 0, 0, True)
        number = writer.block(block)
        writer.on_block("factor", number)
        return number

