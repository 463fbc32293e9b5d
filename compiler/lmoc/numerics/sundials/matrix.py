"""SUNDIALS' matrices and the linear solvers for them."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from ctypes import c_void_p

import numpy as np

from lmoc.numerics.sundials import sundials as sun
from lmoc.support.records import dataclass


@dataclass(frozen=True)
class JacobianStorage:
    """The storage of the Jacobian.

    Attributes
    ----------
    kind : "dense", "band" or "sparse"
    fill : callable (t, x, data), of IDA (t, y, data, cj)
        Writes the Jacobian ∂f/∂x, of IDA ∂F/∂y + cj·∂F/∂y', into `data`: dense (n, n) in Fortran order as
        ``data[column, row]``; band as ``data[column, upper + row - column]`` of width lower+upper+1; sparse the CSC
        values.
    lower, upper : half-bandwidths ("band")
    indptr, indices : CSC pattern ("sparse")
    """

    kind: str
    fill: Callable[..., None]
    lower: int = 0
    upper: int = 0
    indptr: np.ndarray | None = None
    indices: np.ndarray | None = None


class Solver:
    """A SUNDIALS matrix and the linear solver for it."""

    def __init__(self, lib: sun.Library, layout: JacobianStorage, vector: c_void_p, context: c_void_p) -> None:
        n = lib.N_VGetLength(vector)
        self.lib, self.n, self.layout = lib, n, layout
        self.used = False
        if layout.kind == "dense":
            self.matrix = c_void_p(lib.SUNDenseMatrix(n, n, context))
            self.solver = c_void_p(lib.SUNLinSol_Dense(vector, self.matrix, context))
        elif layout.kind == "band":
            self.matrix = c_void_p(lib.SUNBandMatrix(n, layout.upper, layout.lower, context))
            self.solver = c_void_p(lib.SUNLinSol_Band(vector, self.matrix, context))
        else:
            self.matrix = c_void_p(lib.SUNSparseMatrix(n, n, len(layout.indices), sun.CSC, context))
            self.solver = c_void_p(lib.SUNLinSol_SuperLUMT(vector, self.matrix, 1, context))

    def fill(self, address: int, *at) -> int:
        """Fill a SUNDIALS matrix; what a Jacobian callback returns: 0, or 1 where no step can be made with it."""
        numbers = self._view(address)
        t, x, *more = at
        self.layout.fill(t, x, numbers, *more)
        finite = bool(np.isfinite(numbers).all())
        self.used |= finite
        return 0 if finite else 1

    def _view(self, address: int) -> np.ndarray:
        """The numbers of a SUNDIALS matrix in the layout that `JacobianStorage.fill` writes."""
        lib, layout, n = self.lib, self.layout, self.n
        if layout.kind == "dense":
            return sun.view(lib.SUNDenseMatrix_Data(address), n * n).reshape(n, n)
        if layout.kind == "band":
            width, stored = lib.SUNBandMatrix_LDim(address), lib.SUNBandMatrix_StoredUpperBandwidth(address)
            whole = sun.view(lib.SUNBandMatrix_Data(address), n * width).reshape(n, width)
            return whole[:, stored - layout.upper : stored + layout.lower + 1]
        for name, values in (("IndexPointers", layout.indptr), ("IndexValues", layout.indices)):
            ctypes.memmove(getattr(lib, f"SUNSparseMatrix_{name}")(address), values.ctypes.data, values.nbytes)
        return sun.view(lib.SUNSparseMatrix_Data(address), len(layout.indices))

    def free(self) -> None:
        # SuperLU_MT's interface frees factors that it has not made and crashes; one that was never used is left behind
        if self.used or self.layout.kind != "sparse":
            self.lib.SUNLinSolFree(self.solver)
        self.lib.SUNMatDestroy(self.matrix)
