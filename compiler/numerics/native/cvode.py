"""CVODE (Cohen & Hindmarsh 1996) on a compiled or a Python right-hand side, with output by its own interpolation."""

from __future__ import annotations

import ctypes
import time as clock
from collections.abc import Callable
from ctypes import byref, c_double, c_long, c_void_p
from dataclasses import dataclass

import numpy as np

from lmoc.numerics.native import sundials as sun


@dataclass(frozen=True)
class Matrix:
    """How the Jacobian is stored.

    Attributes
    ----------
    kind : "dense", "band" or "sparse"
    lower, upper : half-bandwidths ("band")
    indptr, indices : CSC pattern ("sparse")
    fill : callable (t, x, data)
        Writes the Jacobian into `data`: dense (n, n) in Fortran order as ``data[column, row]``; band as
        ``data[column, upper + row - column]`` of width lower+upper+1; sparse the CSC values.
    """

    kind: str
    fill: Callable[[float, np.ndarray, np.ndarray], None]
    lower: int = 0
    upper: int = 0
    indptr: np.ndarray | None = None
    indices: np.ndarray | None = None


@dataclass
class Outcome:
    """States at the times reached, and what it cost; `failure` is empty where all times were reached."""

    states: np.ndarray  # (reached, n)
    time: float
    failure: str
    steps: int
    rhs_evaluations: int
    jacobian_evaluations: int
    last_step: float
    x: np.ndarray | None = None  # the state at `time`


def integrate(
    rhs,
    user_data,
    x0: np.ndarray,
    times: np.ndarray,
    rtol: float,
    atol: np.ndarray,
    matrix: Matrix,
    method: str = "bdf",
    max_steps: int = 10_000_000,
    progress: Callable[[float], None] | None = None,
    sink: Callable[[int, np.ndarray], None] | None = None,
) -> Outcome:
    """Integrate x' = rhs(t, x) from ``times[0]``.

    Parameters
    ----------
    rhs : `sundials.RHS`
        A compiled function or a wrapped Python one.
    user_data : ctypes pointer or None
        Handed to `rhs`.
    times : (k,) increasing, the first is the start
    atol : (n,)
    method : "bdf" or "adams" (both with Newton's method on the Jacobian)
    progress : called with the time reached, a few times a second at the most
    sink : called with (k, state at ``times[k]``) for k ≥ 1; the outcome then has no `states`
    """
    with _Session(rhs, user_data, np.ascontiguousarray(x0, float), times[0], rtol, atol, matrix, method) as session:
        return session.run(np.asarray(times, float), max_steps, progress, sink)


class _Session:
    """Owns the SUNDIALS objects of one integration."""

    def __init__(self, rhs, user_data, x0, t0, rtol, atol, matrix: Matrix, method: str) -> None:
        self.lib = sun.load()
        if self.lib is None:
            raise RuntimeError("the SUNDIALS libraries were not found")
        lib, n = self.lib, len(x0)
        self.error: BaseException | None = None
        self.context = c_void_p()
        lib.SUNContext_Create(0, byref(self.context))
        lib.SUNContext_ClearErrHandlers(self.context)  # failures are told by the return value, not on stderr
        self.x, self.atol = x0.copy(), np.ascontiguousarray(np.broadcast_to(atol, n), float)
        self.out = np.empty(n)
        self.vector, self.atol_vector, self.out_vector = map(self._vector, (self.x, self.atol, self.out))
        self.memory = c_void_p(lib.CVodeCreate(sun.ADAMS if method == "adams" else sun.BDF, self.context))
        self.rhs = rhs  # keep the callbacks alive as long as CVODE may call them
        lib.CVodeInit(self.memory, rhs, float(t0), self.vector)
        lib.CVodeSVtolerances(self.memory, rtol, self.atol_vector)
        lib.CVodeSetUserData(self.memory, user_data)
        self._attach(matrix, n)

    def _vector(self, array: np.ndarray) -> c_void_p:
        return c_void_p(self.lib.N_VMake_Serial(len(array), array.ctypes.data, self.context))

    def _attach(self, matrix: Matrix, n: int) -> None:
        lib = self.lib
        self.solver = Solver(lib, matrix, self.vector, n, self.context)
        lib.CVodeSetLinearSolver(self.memory, self.solver.solver, self.solver.matrix)
        self.jacobian = sun.JACOBIAN(self._filler(matrix, n))
        lib.CVodeSetJacFn(self.memory, self.jacobian)

    def _filler(self, matrix: Matrix, n: int):
        lib = self.lib

        def fill(t, y, fy, jacobian, data, tmp1, tmp2, tmp3) -> int:
            try:
                x = _view(lib.N_VGetArrayPointer(y), n)
                target = self.solver.view(jacobian)
                matrix.fill(t, x, target)
                return self.solver.accept(target)
            except BaseException as error:  # must not unwind through C: kept, and raised when CVODE has returned
                self.error = error
                return -1

        return fill

    def run(self, times: np.ndarray, max_steps: int, progress, sink=None) -> Outcome:
        lib, reached = self.lib, c_double(times[0])
        states = np.empty((len(times) if sink is None else 1, len(self.x)))
        states[0] = self.x
        lib.CVodeSetStopTime(self.memory, float(times[-1]))
        lib.CVodeSetMaxNumSteps(self.memory, max_steps)
        lib.CVodeSetMinStep(self.memory, sun.least_step(times))
        told = clock.monotonic()
        for k in range(1, len(times)):
            flag = lib.CVode(self.memory, float(times[k]), self.vector, byref(reached), sun.NORMAL)
            if self.error is not None:
                raise self.error
            if flag not in (sun.SUCCESS, sun.TSTOP_RETURN):
                return self._outcome(states[:k], reached.value, _failure_text(flag))
            if sink is None:
                states[k] = self.x
            else:
                sink(k, self.x)
            if progress is not None and clock.monotonic() - told > 0.2:
                told = clock.monotonic()
                progress(float(times[k]))
        return self._outcome(states, float(times[-1]), "")

    def _outcome(self, states: np.ndarray, time: float, failure: str) -> Outcome:
        counts = []
        for name in ("CVodeGetNumSteps", "CVodeGetNumRhsEvals", "CVodeGetNumJacEvals"):
            value = c_long()
            getattr(self.lib, name)(self.memory, byref(value))
            counts.append(value.value)
        step = c_double()
        self.lib.CVodeGetLastStep(self.memory, byref(step))
        return Outcome(states, time, failure, *counts, step.value, self.x.copy())

    def __enter__(self) -> _Session:
        return self

    def __exit__(self, *_) -> None:
        lib = self.lib
        lib.CVodeFree(byref(self.memory))
        self.solver.free()
        for vector in (self.vector, self.atol_vector, self.out_vector):
            lib.N_VDestroy(vector)
        lib.SUNContext_Free(byref(self.context))


class Solver:
    """A SUNDIALS matrix and the linear solver for it."""

    def __init__(self, lib, matrix: Matrix, vector: c_void_p, n: int, context: c_void_p) -> None:
        self.lib, self.kind, self.n, self.layout = lib, matrix.kind, n, matrix
        self.used = False
        if matrix.kind == "dense":
            self.matrix = c_void_p(lib.SUNDenseMatrix(n, n, context))
            self.solver = c_void_p(lib.SUNLinSol_Dense(vector, self.matrix, context))
        elif matrix.kind == "band":
            self.matrix = c_void_p(lib.SUNBandMatrix(n, matrix.upper, matrix.lower, context))
            self.solver = c_void_p(lib.SUNLinSol_Band(vector, self.matrix, context))
        else:
            self.matrix = c_void_p(lib.SUNSparseMatrix(n, n, len(matrix.indices), sun.CSC, context))
            self.solver = c_void_p(lib.SUNLinSol_SuperLUMT(vector, self.matrix, 1, context))

    def view(self, address: int) -> np.ndarray:
        """The numbers of a SUNDIALS matrix in the layout that `Matrix.fill` writes."""
        lib, matrix, n = self.lib, self.layout, self.n
        if matrix.kind == "dense":
            return _view(lib.SUNDenseMatrix_Data(address), n * n).reshape(n, n)
        if matrix.kind == "band":
            width, stored = lib.SUNBandMatrix_LDim(address), lib.SUNBandMatrix_StoredUpperBandwidth(address)
            whole = _view(lib.SUNBandMatrix_Data(address), n * width).reshape(n, width)
            return whole[:, stored - matrix.upper : stored + matrix.lower + 1]
        for name, values in (("IndexPointers", matrix.indptr), ("IndexValues", matrix.indices)):
            ctypes.memmove(getattr(lib, f"SUNSparseMatrix_{name}")(address), values.ctypes.data, values.nbytes)
        return _view(lib.SUNSparseMatrix_Data(address), len(matrix.indices))

    def accept(self, numbers: np.ndarray) -> int:
        """What a Jacobian callback returns: 0, or 1 for a matrix with which a step cannot be made."""
        finite = bool(np.isfinite(numbers).all())
        self.used |= finite
        return 0 if finite else 1

    def free(self) -> None:
        # SuperLU_MT's interface frees factors that it has not made and crashes; one that was never used is left behind
        if self.used or self.kind != "sparse":
            self.lib.SUNLinSolFree(self.solver)
        self.lib.SUNMatDestroy(self.matrix)


def _view(address: int, size: int) -> np.ndarray:
    return np.frombuffer((c_double * size).from_address(address), float)


def _failure_text(flag: int) -> str:
    if flag == sun.TOO_MUCH_WORK:
        return "too many steps"
    if flag in (sun.ERR_FAILURE, sun.CONV_FAILURE):
        return "the step size collapsed"
    if flag in sun.RHS_FAILURES:
        return "the right-hand side has no finite value"
    if flag == sun.LSETUP_FAIL:
        return "the Jacobian is singular"
    return f"CVODE returned {flag}"


def wrap_python(rhs: Callable[[float, np.ndarray, np.ndarray], None], n: int, errors: list[BaseException]):
    """A Python function ``rhs(t, x, out)`` as a callback; what it raises is put into `errors` and ends the run."""
    lib = sun.load()

    def call(t, y, ydot, data) -> int:
        try:
            out = _view(lib.N_VGetArrayPointer(ydot), n)
            rhs(t, _view(lib.N_VGetArrayPointer(y), n), out)
            return 0 if np.isfinite(out).all() else 1
        except BaseException as error:
            errors.append(error)
            return -1

    return sun.RHS(call)


