"""How far the registers of a program may be off by rounding: a running error analysis.

Each operation adds half a unit in the last place of its result to what its arguments bring along, and a linear block
what its residuals are off by, through its inverse (Higham, Accuracy and Stability of Numerical Algorithms, 2002, 3.3
and 7.2). So the size of the terms of a sum shows where nothing is left of it but rounding, function by function:
functions of different units cannot be compared with one number.
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.evaluate import OPERATIONS
from lmoc.expression.functions import RELATIONS
from lmoc.ir.program import Apply, Program, Solve, Step, Total, needed_steps
from lmoc.numerics.limits import HALF_ULP
from lmoc.numerics.solve.interpreter import Interpreter, segment_sums

_EXACT = {"neg", "abs", "if", "event", "min", "max"}  # they round nothing themselves
_DECIDED = {*RELATIONS, *"and or not sign floor ceil integer div_integer xor".split()}  # values that jump
_LEFT = 1e-17  # of the size of the unknowns: what Newton's method may leave of their error where it ends (``newton.c``)
_WHOLE = {"mod", "rem"}  # x − n·y: a jump of n is none of rounding


class Rounding:
    """Bounds for the rounding of some registers.

    Parameters
    ----------
    program : what fills them, among `count`
    registers : which
    """

    def __init__(self, program: Program, registers: np.ndarray, count: int) -> None:
        self._program, self._registers = needed_steps(program, registers, count), registers
        self._interpreter = Interpreter(self._program, count)

    def __call__(self, w: np.ndarray, time: float, given: tuple[np.ndarray, np.ndarray] | None = None) -> np.ndarray:
        """Return by how much each of the registers may be off, (registers,); NaN where it has no value.

        What is no whole number has been computed before: states, inputs, parameters.

        Parameters
        ----------
        w : (count,) registers with all that the program does not fill itself; filled here
        given : registers, and by how much they are off at least
        """
        self._interpreter.reset()
        self._interpreter.run(w, time)
        with np.errstate(all="ignore"):
            off = _rounded(w)
            if given is not None:
                off[given[0]] = np.fmax(off[given[0]], given[1])
            for step in self._program:
                self._step(step, w, off, time)
        return off[self._registers]

    def beside(self, w: np.ndarray, time: float, inputs: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Return the registers where each of the inputs is moved alone to both sides, (2, inputs, count), as changes.

        Parameters
        ----------
        w : (count,) registers with all that the program does not fill itself
        inputs, by : registers, and how far each is moved
        """
        n = len(inputs)
        own, columns = np.arange(n), np.repeat(w[:, None], 2 * n + 1, axis=1)
        columns[inputs, own] += by
        columns[inputs, n + own] -= by
        self._interpreter.reset()
        self._interpreter.run(columns, np.full(2 * n + 1, time))
        with np.errstate(invalid="ignore"):
            return (columns[:, :-1] - columns[:, -1:]).T.reshape(2, n, len(w))

    def _step(self, step: Step, w: np.ndarray, off: np.ndarray, time: float) -> None:
        if isinstance(step, Apply):
            off[step.out] = shape_rounding(step.shape, w[step.slots], off[step.slots], time)
        elif isinstance(step, Total):
            terms = np.abs(step.coefficient)
            sizes = terms * np.abs(w[step.index])
            lengths = np.diff(step.start)
            own = segment_sums(sizes, step.start) * np.maximum(lengths - 1, 0) * HALF_ULP
            off[step.out] = segment_sums(terms * off[step.index], step.start) + own
        else:
            self._solve(step, w, off, time)

    def _solve(self, step: Solve, w: np.ndarray, off: np.ndarray, time: float) -> None:
        """Let the residuals' rounding at the solution move the unknowns, and these what follows from them."""
        off[step.unknowns] = 0.0
        for inner in step.inner:
            self._step(inner, w, off, time)
        matrix = self._interpreter.matrix(step, w, time)
        for rows, residuals, one in zip(step.unknowns, step.residuals, matrix, strict=True):
            off[rows] = _carried(one, off[residuals]) + (0.0 if step.linear else _LEFT * (1.0 + np.abs(w[rows])))
        for inner in step.inner:
            self._step(inner, w, off, time)


def _rounded(value: np.ndarray) -> np.ndarray:
    """Return by how much numbers are off that have been computed; whole ones are not."""
    return np.where(value == np.rint(value), 0.0, HALF_ULP * np.abs(value))


def _carried(matrix: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Return by how much unknowns move at most where their residuals do so much."""
    try:
        return np.abs(np.linalg.inv(matrix)) @ off
    except np.linalg.LinAlgError:
        return np.full(len(off), np.nan)


def shape_rounding(shape: Expr, values: np.ndarray, off: np.ndarray, time: float) -> np.ndarray:
    """Return by how much a shape is off, (rows,), for values (rows, columns) of its slots that are off themselves."""
    known: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    zero = np.zeros(len(values))
    for node in postorder(shape):
        if node.args:
            known[id(node)] = _node_rounding(node, [known[id(a)] for a in node.args])
        elif node.op == "slot":
            known[id(node)] = values[:, node.value[0]], off[:, node.value[0]]
        else:
            value = zero + (time if node.op == "time" else node.value)
            known[id(node)] = value, _rounded(value)
    return known[id(shape)][1]


def _node_rounding(node: Expr, args: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Return the value of a node and by how much it is off: the changes by its arguments, and its own rounding."""
    operation = OPERATIONS[node.op]
    values = [value for value, _ in args]
    value = np.asarray(operation(*values), float) + np.zeros(len(values[0]))
    if node.op in _DECIDED:
        return value, np.zeros(len(value))
    found = np.zeros(len(value)) if node.op in _EXACT else HALF_ULP * np.abs(value)
    if node.op in _WHOLE:
        (x, by_x), (y, by_y) = args
        return value, found + by_x + np.abs((x - value) / y) * by_y
    for k, (own, off) in enumerate(args):
        if node.op == "if" and k == 0:
            continue
        moved = [np.abs(operation(*values[:k], own + side * off, *values[k + 1 :]) - value) for side in (1.0, -1.0)]
        found = found + np.fmax(np.fmax(*moved), 0.0)
    return value, found
