"""The SUNDIALS libraries that scikit-sundae brings, called directly.

scikit-sundae's own loop enters Python at every residual. Here the callbacks may be compiled functions, so a whole
trajectory costs no Python between its steps. Only the libraries' files are used; the package itself is not imported.
"""

from __future__ import annotations

import ctypes
from ctypes import CFUNCTYPE, POINTER, c_double, c_int, c_long, c_void_p
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from lmoc.numerics.problem.status import NotFound, Status

# the dependencies first, so that the loader finds them already in the process
_LIBRARIES = (
    "core", "nvecserial", "sunmatrixdense", "sunmatrixband", "sunmatrixsparse",
    "sunlinsoldense", "sunlinsolband", "sunlinsolsuperlumt", "cvode", "ida",
)  # fmt: skip

RHS = CFUNCTYPE(c_int, c_double, c_void_p, c_void_p, c_void_p)
JACOBIAN = CFUNCTYPE(c_int, c_double, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p)
# IDA: (t, y, y', residual, data), and (t, cj, y, y', residual, J, data, three vectors)
RESIDUAL = CFUNCTYPE(c_int, c_double, c_void_p, c_void_p, c_void_p, c_void_p)
RESIDUAL_JACOBIAN = CFUNCTYPE(c_int, c_double, c_double, *[c_void_p] * 8)

_SIGNATURES: dict[str, tuple] = {
    # name: (result, arguments…); int is SUNDIALS' index type in these builds
    "SUNContext_Create": (c_int, c_int, POINTER(c_void_p)),
    "SUNContext_Free": (c_int, POINTER(c_void_p)),
    "SUNContext_ClearErrHandlers": (c_int, c_void_p),
    "N_VMake_Serial": (c_void_p, c_int, c_void_p, c_void_p),
    "N_VDestroy": (None, c_void_p),
    "N_VGetLength": (c_int, c_void_p),
    "N_VGetArrayPointer": (c_void_p, c_void_p),
    "SUNDenseMatrix": (c_void_p, c_int, c_int, c_void_p),
    "SUNDenseMatrix_Data": (c_void_p, c_void_p),
    "SUNBandMatrix": (c_void_p, c_int, c_int, c_int, c_void_p),
    "SUNBandMatrix_Data": (c_void_p, c_void_p),
    "SUNBandMatrix_LDim": (c_int, c_void_p),
    "SUNBandMatrix_StoredUpperBandwidth": (c_int, c_void_p),
    "SUNSparseMatrix": (c_void_p, c_int, c_int, c_int, c_int, c_void_p),
    "SUNSparseMatrix_Data": (c_void_p, c_void_p),
    "SUNSparseMatrix_IndexValues": (c_void_p, c_void_p),
    "SUNSparseMatrix_IndexPointers": (c_void_p, c_void_p),
    "SUNMatDestroy": (None, c_void_p),
    "SUNLinSol_Dense": (c_void_p, c_void_p, c_void_p, c_void_p),
    "SUNLinSol_Band": (c_void_p, c_void_p, c_void_p, c_void_p),
    "SUNLinSol_SuperLUMT": (c_void_p, c_void_p, c_void_p, c_int, c_void_p),
    "SUNLinSolFree": (c_int, c_void_p),
    "CVodeCreate": (c_void_p, c_int, c_void_p),
    "CVodeInit": (c_int, c_void_p, RHS, c_double, c_void_p),
    "CVodeSVtolerances": (c_int, c_void_p, c_double, c_void_p),
    "CVodeSetUserData": (c_int, c_void_p, c_void_p),
    "CVodeSetMaxNumSteps": (c_int, c_void_p, c_long),
    "CVodeSetMinStep": (c_int, c_void_p, c_double),
    "CVodeSetStopTime": (c_int, c_void_p, c_double),
    "CVodeSetLinearSolver": (c_int, c_void_p, c_void_p, c_void_p),
    "CVodeSetJacFn": (c_int, c_void_p, JACOBIAN),
    "CVode": (c_int, c_void_p, c_double, c_void_p, POINTER(c_double), c_int),
    "CVodeSetMaxStep": (c_int, c_void_p, c_double),
    "CVodeGetDky": (c_int, c_void_p, c_double, c_int, c_void_p),
    "CVodeReInit": (c_int, c_void_p, c_double, c_void_p),
    "CVodeGetNumSteps": (c_int, c_void_p, POINTER(c_long)),
    "CVodeGetNumRhsEvals": (c_int, c_void_p, POINTER(c_long)),
    "CVodeGetNumJacEvals": (c_int, c_void_p, POINTER(c_long)),
    "CVodeFree": (None, POINTER(c_void_p)),
    "IDACreate": (c_void_p, c_void_p),
    "IDAInit": (c_int, c_void_p, RESIDUAL, c_double, c_void_p, c_void_p),
    "IDASVtolerances": (c_int, c_void_p, c_double, c_void_p),
    "IDASetUserData": (c_int, c_void_p, c_void_p),
    "IDASetMaxNumSteps": (c_int, c_void_p, c_long),
    "IDASetMinStep": (c_int, c_void_p, c_double),
    "IDASetStopTime": (c_int, c_void_p, c_double),
    "IDASetLinearSolver": (c_int, c_void_p, c_void_p, c_void_p),
    "IDASetJacFn": (c_int, c_void_p, RESIDUAL_JACOBIAN),
    "IDASetId": (c_int, c_void_p, c_void_p),
    "IDASetSuppressAlg": (c_int, c_void_p, c_int),
    "IDASolve": (c_int, c_void_p, c_double, POINTER(c_double), c_void_p, c_void_p, c_int),
    "IDASetMaxStep": (c_int, c_void_p, c_double),
    "IDAGetDky": (c_int, c_void_p, c_double, c_int, c_void_p),
    "IDAReInit": (c_int, c_void_p, c_double, c_void_p, c_void_p),
    "IDAGetNumSteps": (c_int, c_void_p, POINTER(c_long)),
    "IDAGetNumResEvals": (c_int, c_void_p, POINTER(c_long)),
    "IDAGetNumJacEvals": (c_int, c_void_p, POINTER(c_long)),
    "IDAFree": (None, POINTER(c_void_p)),
}

CSC = 0
ADAMS, BDF = 1, 2
NORMAL, ONE_STEP = 1, 2
SUCCESS, TSTOP_RETURN = 0, 1
# flags that CVODE and IDA share
_FAILURES = {
    -1: Status.TOO_MANY_STEPS,
    -2: Status.TOO_FINE,
    -3: Status.COLLAPSED,  # the error test failed, or Newton's method, even with the shortest step
    -4: Status.COLLAPSED,
    -5: Status.NO_LINEAR_SOLVER,
    -6: Status.SINGULAR_MATRIX,
    -7: Status.SINGULAR_MATRIX,
}


def status_of(flag: int, no_value: tuple[int, ...]) -> Status:
    """Return the meaning of a returned flag; `no_value` are those for a function without a finite value."""
    return Status.NOT_FINITE if flag in no_value else _FAILURES.get(flag, Status.REFUSED)


class Library:
    """The functions of `_SIGNATURES` as attributes."""

    def __init__(self, handles: list[ctypes.CDLL]) -> None:
        for name, (result, *arguments) in _SIGNATURES.items():
            function = next(f for h in handles if (f := getattr(h, name, None)) is not None)
            function.restype, function.argtypes = result, arguments
            setattr(self, name, function)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"SUNDIALS' function {name} is not among those declared here")


def load() -> Library:
    """The libraries.

    Raises
    ------
    NotFound
        On a platform where they are not found in this layout.
    """
    library = _load()
    if library is None:
        raise NotFound
    return library


def available() -> bool:
    """Return whether the libraries are found."""
    return _load() is not None


@lru_cache(maxsize=1)
def _load() -> Library | None:
    spec = find_spec("sksundae")
    if spec is None or spec.origin is None:
        return None
    site = Path(spec.origin).parent.parent
    files = [f for d in ("scikit_sundae.libs", "sksundae/.dylibs") for f in sorted((site / d).glob("*sundials*"))]
    others = [f for f in (site / "scikit_sundae.libs").glob("lib*") if "sundials" not in f.name]
    try:
        for f in sorted(others, key=_dependency_rank):
            ctypes.CDLL(str(f), mode=ctypes.RTLD_GLOBAL)
        paths = [next(f for f in files if f.name.startswith(f"libsundials_{name}")) for name in _LIBRARIES]
        return Library([ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL) for path in paths])
    except (OSError, StopIteration):
        return None


def view(address: int, size: int) -> np.ndarray:
    """Numbers that SUNDIALS owns, as an array without a copy."""
    return np.frombuffer((c_double * size).from_address(address), float)


def least_step(start: float, end: float) -> float:
    """A step below which time hardly moves; without it a run into a pole goes on for millions of steps."""
    return float(16 * np.finfo(float).eps * max(abs(start), abs(end)))


def _dependency_rank(path: Path) -> int:
    order = ("quadmath", "gfortran", "gomp", "openblas")
    return next((i for i, name in enumerate(order) if name in path.name), len(order))
