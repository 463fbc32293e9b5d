"""A program compiled to C, with its data: called from Python, or by SUNDIALS without Python in between."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping

import numpy as np

from lmoc.ir.program import Program, Solve, program_rows, walk
from lmoc.numerics.evaluate.native.c_code import CFunction
from lmoc.numerics.evaluate.native.c_program import generate
from lmoc.numerics.evaluate.native.c_text import c_text
from lmoc.numerics.evaluate.native.compiler import load_library
from lmoc.numerics.evaluate.native.pivots import Factors
from lmoc.numerics.integrate.sundials import sundials
from lmoc.support.records import dataclass

_SHORT = 2500  # rows up to which loops are short: scalar code is better, and compiled in two thirds of the time
_LONG = 20_000  # rows from which the compiler's time for -O3, twice that for -O2, is soon won back
# How Newton's corrections have to shrink, how many there are, and how far off the first one may point. A mechanism has
# branches that must not be left. The equations of springs have one solution, which cubic ones approach by a factor of
# 2/3 an iteration where they relax.
_STRICT = {"LMOC_RATE": "0.5", "LMOC_ITERATIONS": "10", "LMOC_NEAR": "0.25"}
_PATIENT = {"LMOC_RATE": "0.95", "LMOC_ITERATIONS": "60", "LMOC_NEAR": "0.75"}

CHOOSE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int64, ctypes.POINTER(ctypes.c_double))
RESCUE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double)


class Call(ctypes.Structure):
    """The arguments with which C functions evaluate derivatives (``lmoc_call`` in ``c/evaluate.c``)."""

    _fields_ = [
        ("w", ctypes.c_void_p),
        ("m", ctypes.c_void_p),
        ("tab", ctypes.c_void_p),
        ("n", ctypes.c_int64),
        ("first_state", ctypes.c_int64),
        ("states", ctypes.c_void_p),
        ("derivatives", ctypes.c_void_p),
        ("data", ctypes.c_void_p),
        ("remembered", ctypes.c_int64),
        ("solved", ctypes.c_int64),
        ("unknowns", ctypes.c_void_p),
        ("solution", ctypes.c_void_p),
        ("x", ctypes.c_void_p),
        ("time", ctypes.c_double),
        ("rescue", RESCUE),
        ("marked_time", ctypes.c_double),
        ("marked", ctypes.c_int64),
        ("last", ctypes.c_void_p),
    ]


class Hold(ctypes.Structure):
    """The functions that judge and correct steps made in C (``lmoc_hold`` in ``c/hold.c``)."""

    _fields_ = [*[(name, ctypes.c_void_p) for name in ("own", "look", "land", "keep")], ("pieces", ctypes.c_int64)]


@dataclass(frozen=True, eq=False)
class Source:
    """The input of the C compiler for a program: the whole text, the compiler's options, and the function's data."""

    text: str
    optimization: str
    function: CFunction
    further: CFunction | None = None  # a second function on the same registers


def source_of(program: Program, registers: int, strict: bool = False, blocks: bool = False) -> Source:
    """Write a program as C.

    Parameters
    ----------
    blocks : with the functions for blocks, even if there are none
    strict : the nonlinear blocks have several solutions, of which only the one that continues the last counts

    Raises
    ------
    c_code.Unsupported
        Where the program has a block that is not written as C.
    """
    function = generate(program, registers)
    used = _blocks(_STRICT if strict else _PATIENT) if blocks or "lmoc_matrix" in function.text else ""
    text = c_text("prelude") + used + function.text + c_text("evaluate", "hold", "dop853", "dop853_walk")
    return Source(text, _optimization(program_rows(program)), function)


def _optimization(rows: int) -> str:
    if rows <= _SHORT:
        return "-O3 -fno-tree-vectorize"
    return "-O3" if rows > _LONG else "-O2"


def with_blocks(text: str) -> str:
    """Return the text of a function after what it calls for the matrices of blocks."""
    return c_text("prelude") + _blocks(_PATIENT) + text


def _blocks(options: Mapping[str, object]) -> str:
    """Return what solves blocks, with the options of Newton's method."""
    defined = "".join(f"#define {name} {value}\n" for name, value in options.items())
    return defined + c_text("matrices", "newton")


class Data:
    """Arguments of a generated function beside the registers.

    Attributes
    ----------
    numbers, pointers : its arguments ``m`` and ``tab``
    """

    def __init__(self, function: CFunction) -> None:
        self.numbers, self.tables = function.numbers, list(function.tables)
        self.pointers = np.array([t.ctypes.data for t in self.tables] or [0], np.uintp)
        self._choose = CHOOSE(self._choose_pivots)
        self.matrices = [Factors(k, m.indptr, m.rows) for k, m in enumerate(function.matrices)]
        for matrix, factors in zip(function.matrices, self.matrices, strict=True):
            self.pointers[matrix.handle] = factors.handle.ctypes.data
            self.pointers[matrix.handle + 1] = ctypes.cast(self._choose, ctypes.c_void_p).value

    def _choose_pivots(self, number: int, values) -> int:
        factors = self.matrices[number]
        return factors.choose(np.ctypeslib.as_array(values, (len(factors.rows),)))

    def put(self, first: int, tables: list[np.ndarray]) -> None:
        """Replace tables."""
        for k, values in enumerate(tables, first):
            self.tables[k] = np.ascontiguousarray(values)
            self.pointers[k] = self.tables[k].ctypes.data

    def forget(self) -> None:
        """Have pivots reselected."""
        for factors in self.matrices:
            factors.forget()


class Kernel:
    """A compiled program that owns its register vector.

    Attributes
    ----------
    w : (registers + scratch,) float
        Fill the known, input and state registers, then call.
    nonlinear : list of Solve
        The blocks that Newton's method solves.
    unknowns : (k,) registers of their unknowns
    """

    def __init__(
        self,
        program: Program,
        registers: int,
        strict: bool = False,
        source: Source | None = None,
    ) -> None:
        """
        Parameters
        ----------
        strict : as in `source_of`
        source : of this program, where it has been written already

        Raises
        ------
        c_code.Unsupported
            Where the program has a block that is not written as C.
        OSError
            Where no compiler is at hand.
        """
        source = source_of(program, registers, strict) if source is None else source
        function = source.function
        library = load_library(source.text, source.optimization)
        if library is None:
            raise OSError("no C compiler")
        self.library, self._made_from = library, (program, registers, strict, source)
        self._run = library.lmoc_program
        self._run.restype = ctypes.c_int
        self._run.argtypes = [ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
        self._evaluate = library.lmoc_evaluate
        self._evaluate.restype = ctypes.c_int
        self._evaluate.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
        self._mark = library.lmoc_mark
        self._mark.restype, self._mark.argtypes = None, [ctypes.c_void_p]
        further = 0 if source.further is None else source.further.scratch
        self.w = np.zeros(registers + function.scratch + further)
        self.nonlinear = [s for s in walk(program) if isinstance(s, Solve) and not s.linear]
        self.unknowns = np.concatenate([np.zeros(0, int), *(s.unknowns.ravel() for s in self.nonlinear)])
        self._guesses = np.concatenate([np.zeros(0, int), *(_guess(s) for s in self.nonlinear)])
        self._determinants = [(b.determinants, len(b.step.unknowns)) for b in function.blocks]
        self._factors, self.data = function.factors, Data(function)
        self._calls: dict[bytes, Call] = {}
        self._last = np.zeros(1, np.uintp)  # the call whose solution stands in the registers

    def copy(self) -> Kernel:
        """Return the same program on other registers."""
        return Kernel(*self._made_from)

    def forget(self) -> None:
        """Forget the solutions of blocks and the order of pivots: parameters or start are others now.

        Where the register of an unknown holds no value, Newton's method starts from the guess in the model.
        """
        self.data.forget()
        for call in self._calls.values():
            call.solved = call.marked = 0
        self.seed()

    def seed(self) -> None:
        """Put guesses in the place of unknowns that have no value."""
        lost = ~np.isfinite(self.w[self.unknowns])
        guess = self._guesses[lost]
        given = np.where(guess >= 0, self.w[guess], 0.0)
        self.w[self.unknowns[lost]] = np.where(np.isfinite(given), given, 0.0)

    def determinants(self) -> np.ndarray:
        """Of the Jacobians of the nonlinear blocks' instances, where they were solved last."""
        return np.concatenate([np.zeros(0), *(self.w[first : first + n] for first, n in self._determinants)])

    def factorize(self, matrix: Callable[[Solve], object]) -> None:
        """Factorize the constant linear blocks for the parameter values that stand in `w`.

        Parameters
        ----------
        matrix : callable
            Gives the sparse matrix ∂residuals/∂unknowns of a Solve step.
        """
        for step, first in self._factors:
            self.data.put(first, _factors(matrix(step)))

    @property
    def has_constant_blocks(self) -> bool:
        """Return whether `factorize` has anything to do."""
        return bool(self._factors)

    def __call__(self, time: float) -> int:
        """Run the program on `w`; returns what C does (`c_code.CFunction`)."""
        return self._run(time, self.w.ctypes.data, self.data.numbers.ctypes.data, self.data.pointers.ctypes.data)

    def evaluate(self, call: Call, time: float, x: np.ndarray) -> bool:
        """Run the program for states x, with the nonlinear blocks near their last solution; whether there is one."""
        return not self._evaluate(call.reference, time, x.ctypes.data)

    def call(self, states: np.ndarray, derivatives: np.ndarray, rescue: Callable[[float], bool] | None = None) -> Call:
        """Return what C functions need to evaluate derivatives; valid as long as the kernel lives.

        Parameters
        ----------
        rescue : called where Newton's method finds no solution in C; whether it has put one into the registers
        """
        key = np.concatenate([states, derivatives]).tobytes()
        if key not in self._calls:
            self._calls[key] = self._new_call(states, derivatives, rescue)
        return self._calls[key]

    def _new_call(self, states: np.ndarray, derivatives: np.ndarray, rescue) -> Call:
        tables = [np.ascontiguousarray(r, np.int32) for r in (states, derivatives, self.unknowns)]
        memory = np.zeros(3 * (len(self.unknowns) + len(states)))
        contiguous = len(states) > 0 and (np.diff(states) == 1).all()
        call = Call(
            self.w.ctypes.data,
            self.data.numbers.ctypes.data,
            self.data.pointers.ctypes.data,
            len(states),
            int(states[0]) if contiguous else -1,
            *(t.ctypes.data for t in tables[:2]),
            None,
            len(self.unknowns),
            0,
            tables[2].ctypes.data,
            memory.ctypes.data,
            memory[3 * len(self.unknowns) :].ctypes.data,
            0.0,
            RESCUE() if rescue is None else RESCUE(rescue),
            last=self._last.ctypes.data,
        )
        call.tables, call.reference = (tables, memory), ctypes.byref(call)  # kept alive with it
        return call

    def address(self, name: str) -> int:
        """Return where a function of the library stands."""
        return ctypes.cast(getattr(self.library, name), ctypes.c_void_p).value or 0

    def mark(self, call: Call) -> None:
        """Mark the last solution of nonlinear blocks as one to go back to where the way from a later one fails."""
        self._mark(ctypes.byref(call))

    def callback(self, call: Call, implicit: bool):
        """The right-hand side as CVODE calls it, or y' - f as IDA does; and what to hand it as user data."""
        call.data = ctypes.cast(sundials.load().N_VGetArrayPointer, ctypes.c_void_p).value
        kind, name = (sundials.RESIDUAL, "lmoc_residual") if implicit else (sundials.RHS, "lmoc_rhs")
        return kind(self.address(name)), ctypes.byref(call)


def _guess(step: Solve) -> np.ndarray:
    """Registers of the guesses of a block's unknowns, -1 for none."""
    return np.full(step.unknowns.size, -1) if step.guess is None else step.guess.ravel()


def _factors(matrix) -> list[np.ndarray]:
    """The eight tables that `lmoc_sparse_solve` reads; of a singular matrix such that the solution is no number."""
    from scipy.sparse.linalg import splu

    try:
        lu = splu(matrix.tocsc())
    except RuntimeError:  # exactly singular: whoever asks for the values reports them with their place
        n = np.arange(matrix.shape[0] + 1, dtype=np.int32)
        return [n, n[:-1], np.ones(len(n) - 1), n, n[:-1], np.full(len(n) - 1, np.nan), n[:-1], n[:-1]]
    tables: list[np.ndarray] = []
    for factor in (lu.L.tocsc(), lu.U.tocsc()):
        factor.sort_indices()  # the diagonal stands first in L and last in U
        tables += [factor.indptr.astype(np.int32), factor.indices.astype(np.int32), factor.data.astype(float)]
    return [*tables, lu.perm_r.astype(np.int32), lu.perm_c.astype(np.int32)]
