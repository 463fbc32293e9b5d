"""IDA (Hindmarsh et al. 2005) on a Python residual F(t, y, y') = 0, with output by its own interpolation."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from ctypes import byref, c_double, c_long, c_void_p
from dataclasses import dataclass

import numpy as np

from lmoc.numerics.native import sundials as sun
from lmoc.numerics.native.cvode import Matrix, Outcome, Solver, _view


@dataclass(frozen=True)
class Equations:
    """F(t, y, y') = 0.

    Attributes
    ----------
    residual : (t, y, yp, out)
    matrix : Matrix
        `fill` is called as (t, y, data, cj) and writes ∂F/∂y + cj·∂F/∂y'.
    differential : (n,) bool
        Which components have derivatives in F; the others stay out of the error test.
    """

    residual: Callable[[float, np.ndarray, np.ndarray, np.ndarray], None]
    matrix: Matrix
    differential: np.ndarray


def integrate(
    equations: Equations,
    y0: np.ndarray,
    yp0: np.ndarray,
    times: np.ndarray,
    rtol: float,
    atol: np.ndarray,
    sink: Callable[[int, np.ndarray], None],
    max_steps: int = 10_000_000,
    progress: Callable[[float], None] | None = None,
) -> Outcome:
    """Integrate from a consistent (y0, yp0) at ``times[0]``; `sink` takes (k, y at ``times[k]``) for k ≥ 1."""
    with _Session(equations, y0, yp0, float(times[0]), rtol, atol) as session:
        return session.run(np.asarray(times, float), max_steps, progress, sink)


class _Session:
    """Owns the SUNDIALS objects of one integration."""

    def __init__(self, equations: Equations, y0, yp0, t0: float, rtol: float, atol) -> None:
        self.lib = sun.load()
        if self.lib is None:
            raise RuntimeError("the SUNDIALS libraries were not found")
        lib, n = self.lib, len(y0)
        self.equations, self.error = equations, None
        self.context = c_void_p()
        lib.SUNContext_Create(0, byref(self.context))
        lib.SUNContext_ClearErrHandlers(self.context)
        self.y, self.yp = np.array(y0, float), np.array(yp0, float)
        self.atol = np.array(np.broadcast_to(atol, n), float)
        self.id = equations.differential.astype(float)
        self.vectors = [
            c_void_p(lib.N_VMake_Serial(n, a.ctypes.data, self.context)) for a in (self.y, self.yp, self.atol, self.id)
        ]
        y, yp, tolerance, kind = self.vectors
        self.memory = c_void_p(lib.IDACreate(self.context))
        self.residual = sun.RESIDUAL(self._residual(n))
        lib.IDAInit(self.memory, self.residual, t0, y, yp)
        lib.IDASVtolerances(self.memory, rtol, tolerance)
        if not equations.differential.all():
            lib.IDASetId(self.memory, kind)
            lib.IDASetSuppressAlg(self.memory, 1)
        self.solver = Solver(lib, equations.matrix, y, n, self.context)
        lib.IDASetLinearSolver(self.memory, self.solver.solver, self.solver.matrix)
        self.jacobian = sun.RESIDUAL_JACOBIAN(self._filler(n))
        lib.IDASetJacFn(self.memory, self.jacobian)

    def _residual(self, n: int):
        address = self.lib.N_VGetArrayPointer

        def call(t, y, yp, residual, data) -> int:
            try:
                out = _view(address(residual), n)
                self.equations.residual(t, _view(address(y), n), _view(address(yp), n), out)
                return 0 if np.isfinite(out).all() else 1  # 1: IDA tries a shorter step
            except BaseException as error:  # must not unwind through C: kept, and raised when IDA has returned
                self.error = error
                return -1

        return call

    def _filler(self, n: int):
        lib, matrix = self.lib, self.equations.matrix

        def fill(t, cj, y, yp, residual, jacobian, data, tmp1, tmp2, tmp3) -> int:
            try:
                target = self.solver.view(jacobian)
                matrix.fill(t, _view(lib.N_VGetArrayPointer(y), n), target, cj)
                return self.solver.accept(target)
            except BaseException as error:
                self.error = error
                return -1

        return fill

    def run(self, times: np.ndarray, max_steps: int, progress, sink) -> Outcome:
        lib, reached, told = self.lib, c_double(times[0]), clock.monotonic()
        lib.IDASetStopTime(self.memory, float(times[-1]))
        lib.IDASetMaxNumSteps(self.memory, max_steps)
        lib.IDASetMinStep(self.memory, sun.least_step(times))
        for k in range(1, len(times)):
            y, yp = self.vectors[:2]
            flag = lib.IDASolve(self.memory, float(times[k]), byref(reached), y, yp, sun.NORMAL)
            if self.error is not None:
                raise self.error
            if flag not in (sun.SUCCESS, sun.TSTOP_RETURN):
                return self._outcome(reached.value, _failure_text(flag))
            sink(k, self.y)
            if progress is not None and clock.monotonic() - told > 0.2:
                told = clock.monotonic()
                progress(float(times[k]))
        return self._outcome(float(times[-1]), "")

    def _outcome(self, time: float, failure: str) -> Outcome:
        counts = []
        for name in ("IDAGetNumSteps", "IDAGetNumResEvals", "IDAGetNumJacEvals"):
            value = c_long()
            getattr(self.lib, name)(self.memory, byref(value))
            counts.append(value.value)
        return Outcome(self.y[None], time, failure, *counts, 0.0, self.y.copy())

    def __enter__(self) -> _Session:
        return self

    def __exit__(self, *_) -> None:
        lib = self.lib
        lib.IDAFree(byref(self.memory))
        self.solver.free()
        for vector in self.vectors:
            lib.N_VDestroy(vector)
        lib.SUNContext_Free(byref(self.context))


def _failure_text(flag: int) -> str:
    if flag == sun.TOO_MUCH_WORK:
        return "too many steps"
    if flag in (sun.ERR_FAILURE, sun.CONV_FAILURE):
        return "the step size collapsed"
    if flag in (-8, -9, -10):  # residual failed unrecoverably, at the first call, repeatedly
        return "the residual has no finite value"
    if flag in (-5, -6, -7):  # set-up or solution of the linear system, initialization of the linear solver
        return "the Jacobian is singular"
    return f"IDA returned {flag}"
