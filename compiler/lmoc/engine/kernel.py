"""A tape with its memory: called from Python, or by steppers and SUNDIALS without Python in between."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable

import numpy as np

from lmoc.engine.library import Many, address, library
from lmoc.lower.tape import SolveBlock, Tape

RESCUE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double)


class _Block(ctypes.Structure):
    """``lmoc_block`` in ``c/tape.h``."""

    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("instances", "size", "each", "width")],
        *[(name, ctypes.c_void_p) for name in ("unknowns", "residuals", "fill", "right", "start", "rows")],
        *[(name, ctypes.c_void_p) for name in ("pivots", "lu")],
        *[(name, ctypes.c_int64) for name in ("a", "b", "work", "x", "ready", "iteration", "patient")],
    ]


class _Tape(ctypes.Structure):
    """``lmoc_tape`` in ``c/tape.h``."""

    _fields_ = [
        *[(name, ctypes.c_void_p) for name in ("run", "code", "index", "blocks", "functions")],
        ("time", ctypes.c_int64),
    ]


class Call(ctypes.Structure):
    """The arguments with which C functions evaluate derivatives (``lmoc_call`` in ``c/engine.h``)."""

    _fields_ = [
        ("w", ctypes.c_void_p),
        ("tape", ctypes.c_void_p),
        *[(name, ctypes.c_int64) for name in ("n", "given", "first_state")],
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
        ("samples", ctypes.c_void_p),
        ("tables", ctypes.c_void_p),
    ]


class StepHook(ctypes.Structure):
    """The functions that judge and correct steps made in C (``lmoc_step_hook`` in ``c/engine.h``)."""

    _fields_ = [*[(name, ctypes.c_void_p) for name in ("own", "look", "land", "keep")], ("pieces", ctypes.c_int64)]


class Kernel:
    """A tape that owns its registers.

    Attributes
    ----------
    tape : Tape
    w : (tape.size,) float
        Fill the known, input and state registers, then call.
    nonlinear : list of Block
        What Newton's method solves.
    unknowns : (k,) registers of their unknowns
    blocks : of the tape, as C knows them
    addresses : of `w` and of the ``lmoc_tape``
    """

    def __init__(self, tape: Tape, patient: bool = True, w: np.ndarray | None = None, many: Many | None = None) -> None:
        """
        Parameters
        ----------
        patient : nonlinear blocks may be approached slowly; else they have several solutions, of which only the one
            that continues the last counts
        w : memory that it shares with others
        many : what takes several runs at a time, (tape.size, lanes) in `w`; else it is one, which Python may run
        """
        self.tape, self._patient, self._lanes = tape, patient, many.lanes if many else 1
        self.w = np.zeros(tape.size) if w is None else w
        self.w.reshape(-1, self._lanes)[tape.constants[0]] = tape.constants[1][:, None]
        self._library = library()
        self._kept: list[object] = []  # what C points to
        self.blocks = (_Block * max(1, len(tape.blocks)))(*map(self._block, tape.blocks))
        self._tape = _Tape(
            many.run if many else address("lmoc_tape_run"), tape.code.ctypes.data, tape.index.ctypes.data,
            ctypes.addressof(self.blocks), many.blocks if many else address("lmoc_block_functions"), tape.time,
        )  # fmt: skip
        self.nonlinear = [b for b in tape.blocks if b.work]
        self.unknowns = np.concatenate([np.zeros(0, int), *(b.unknowns.ravel() for b in self.nonlinear)])
        self._guesses = np.concatenate([np.zeros(0, int), *(_guess(b) for b in self.nonlinear)])
        self._run = self._library.lmoc_tape_run
        self._calls: dict[bytes, Call] = {}
        self._last = np.zeros(1, np.uintp)  # the call whose solution stands in the registers
        self.addresses = self.w.ctypes.data, ctypes.addressof(self._tape)

    def _block(self, block: SolveBlock) -> _Block:
        instances, size = block.unknowns.shape
        tables = [np.ascontiguousarray(t, np.int32) for t in block.tables]
        pivots = np.zeros((instances if block.kept else 1) * size * self._lanes, np.int32)
        self._kept += [*tables, pivots]
        start, rows, lu = 0, 0, 0
        if block.pattern is not None:
            start, rows = (p.ctypes.data for p in block.pattern)
            lu = self._library.lmoc_lu_new(size, start, rows)
            if not lu:
                raise MemoryError
            weakref.finalize(self, self._library.lmoc_lu_free, lu)
        return _Block(
            instances, size, block.fill.shape[1], block.right.shape[1], *(t.ctypes.data for t in tables), start, rows,
            pivots.ctypes.data, lu, block.a, block.b, block.work, block.x, 0, 0, self._patient,
        )  # fmt: skip

    def copy(self) -> Kernel:
        """Return the same tape on other registers."""
        return Kernel(self.tape, self._patient)

    def forget(self) -> None:
        """Forget the solutions of blocks and the order of pivots: parameters or start are others now.

        Where the register of an unknown holds no value, Newton's method starts from the guess in the model.
        """
        for block in self.blocks[: len(self.tape.blocks)]:
            block.ready = 0
        self._forget_pivots()
        for call in self._calls.values():
            call.solved = call.marked = 0
        self.seed()

    def _forget_pivots(self) -> None:
        for block in self.blocks[: len(self.tape.blocks)]:
            if block.lu:
                self._library.lmoc_lu_forget(block.lu)

    def seed(self) -> None:
        """Put guesses in the place of unknowns that have no value."""
        if not len(self.unknowns):
            return
        lost = ~np.isfinite(self.w[self.unknowns])
        guess = self._guesses[lost]
        given = np.where(guess >= 0, self.w[guess], 0.0)
        self.w[self.unknowns[lost]] = np.where(np.isfinite(given), given, 0.0)

    def determinants(self) -> np.ndarray:
        """Of the Jacobians of the nonlinear blocks' instances, where they were solved last."""
        return np.concatenate([np.zeros(0), *(self.w[b.work : b.work + len(b.unknowns)] for b in self.nonlinear)])

    def accelerate(self, compiled: ctypes.CDLL) -> None:
        """Have a compiled tape take the interpreter's place: with the same bits."""
        self._compiled = compiled
        self._tape.run = ctypes.cast(compiled.lmoc_program, ctypes.c_void_p).value
        self._run = compiled.lmoc_program
        self._run.restype, self._run.argtypes = ctypes.c_int, [ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p]

    def __call__(self, time: float) -> int:
        """Run the tape on `w`; 0, or the bits FAILED (a block has no solution that was found) and FAR (none near)."""
        return int(self._run(time, *self.addresses))

    def results(self) -> np.ndarray:
        """Return what has been asked for beside registers."""
        found: np.ndarray = self.w[self.tape.results]
        return found

    def evaluate(self, call: Call, time: float, x: np.ndarray) -> bool:
        """Run the tape for states x, with the nonlinear blocks near their last solution; whether there is one."""
        return not self._library.lmoc_evaluate(call.reference, time, x.ctypes.data)

    def evaluate_near(self, call: Call, time: float, x: np.ndarray) -> bool:
        """The same on the branch of the solutions that stand in the registers, with pivots selected for this place."""
        self._forget_pivots()
        return not self._library.lmoc_evaluate_near(call.reference, time, x.ctypes.data)

    def call(
        self,
        states: np.ndarray,
        derivatives: np.ndarray,
        sampled: np.ndarray | None = None,
        rescue: Callable[[float], bool] | None = None,
    ) -> Call:
        """Return what C functions need to evaluate derivatives; valid as long as the kernel lives.

        Parameters
        ----------
        sampled : inputs that stand behind the states; None where Python gives none
        rescue : called where Newton's method finds no solution in C; whether it has put one into the registers
        """
        key = np.concatenate([states, derivatives]).tobytes() + (b"" if sampled is None else sampled.tobytes())
        if key not in self._calls:
            self._calls[key] = self._new_call(states, derivatives, sampled, rescue)
        return self._calls[key]

    def _new_call(
        self,
        states: np.ndarray,
        derivatives: np.ndarray,
        sampled: np.ndarray | None,
        rescue: Callable[[float], bool] | None,
    ) -> Call:
        given = states if sampled is None else np.concatenate([states, sampled])
        tables = [np.ascontiguousarray(r, np.int32) for r in (given, derivatives, self.unknowns)]
        memory = np.zeros(3 * (len(self.unknowns) + len(given)))
        contiguous = len(given) > 0 and (np.diff(given) == 1).all()
        call = Call(
            *self.addresses, len(states), len(given), int(given[0]) if contiguous else -1,
            *(t.ctypes.data for t in tables[:2]), None, len(self.unknowns), 0, tables[2].ctypes.data,
            memory.ctypes.data, memory[3 * len(self.unknowns) :].ctypes.data, 0.0,
            RESCUE() if rescue is None else RESCUE(rescue), last=self._last.ctypes.data,
        )  # fmt: skip
        call.kept, call.reference = (tables, memory), ctypes.byref(call)  # kept alive with it
        return call

    def mark(self, call: Call) -> None:
        """Mark the last solution of nonlinear blocks as one to go back to where the way from a later one fails."""
        self._library.lmoc_mark(call.reference)

    def go_back(self, call: Call) -> None:
        """Go on from the solution marked last."""
        if call.marked:
            self._library.lmoc_go_back(call.reference)


def _guess(block: SolveBlock) -> np.ndarray:
    """Registers of the guesses of a block's unknowns, -1 for none."""
    return np.full(block.unknowns.size, -1) if block.step.guess is None else block.step.guess.ravel()
