"""Radau IIA in C (`c/radau.c`), with functions of C or of Python."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.library import library

_POINTER, _REAL = ctypes.c_void_p, ctypes.c_double
_RATES = ctypes.CFUNCTYPE(None, _POINTER, _REAL, _POINTER, _POINTER)
_PLACE = ctypes.CFUNCTYPE(None, _POINTER)
_FACTOR = ctypes.CFUNCTYPE(ctypes.c_int, _POINTER, _REAL)
_SUBSTITUTE = ctypes.CFUNCTYPE(None, _POINTER, ctypes.c_int, _POINTER)
_FUNCTIONS = (
    ("rates", _RATES), ("mark", _PLACE), ("go_back", _PLACE), ("slopes", _RATES), ("factor", _FACTOR),
    ("substitute", _SUBSTITUTE),
)  # fmt: skip


class Way(ctypes.Structure):
    """An integration under way (``lmoc_radau`` in ``c/radau.h``)."""

    _fields_ = [
        ("n", ctypes.c_int64),
        ("owner", _POINTER),
        *_FUNCTIONS,
        ("atol", _POINTER),
        *[(name, _REAL) for name in ("rtol", "end", "max_step", "step_size", "t", "before", "length")],
        *[(name, ctypes.c_int64) for name in ("rejected", "evaluations", "jacobians")],
        *[(name, _POINTER) for name in ("x", "last", "f", "dense", "jacobian", "real", "both", "z", "w", "k")],
        *[(name, _POINTER) for name in ("first", "second", "scale", "next", "error", "pivots")],
        *[(name, _REAL) for name in ("factored", "earlier", "earlier_error")],
        *[(name, ctypes.c_int) for name in ("fresh", "rejected_last")],
    ]


class RatesInC(NamedTuple):
    """Addresses of what evaluates a system in C, and of the functions that do it with that."""

    owner: int
    rates: int
    mark: int
    go_back: int


class Functions(NamedTuple):
    """What Python gives; arrays are to be read, or filled, before the function returns.

    Attributes
    ----------
    rates : (t, x, out), x' at a place
    mark, go_back : keep what nonlinear blocks have been solved for, and go on from there
    slopes : (t, x, out), ∂x'/∂x there as (n, n), or with `factor` as it likes
    factor : (h), prepares for steps of that length; whether it could. None where C does that
    substitute : (which, v), solves with the real matrix for v (n,), or with the complex one for v (2, n), in place
    """

    rates: Callable[[float, np.ndarray, np.ndarray], None]
    mark: Callable[[], None]
    go_back: Callable[[], None]
    slopes: Callable[[float, np.ndarray, np.ndarray], None]
    factor: Callable[[float], bool] | None
    substitute: Callable[[int, np.ndarray], None] | None


class Radau:
    """The method, with its memory.

    Attributes
    ----------
    way : the state of the method
    x, last, f : (n,) the state, that before the last step, derivatives
    dense : (3, n) coefficients of θ, θ², θ³ behind `last`
    """

    def __init__(self, n: int, own: Functions, in_c: RatesInC | None, atol: np.ndarray, rtol: float) -> None:
        self._atol, self._own = np.ascontiguousarray(atol, float), own
        self._views: dict[tuple[int, tuple[int, ...]], NDArray[np.float64]] = {}
        self._raised: BaseException | None = None
        self.way = Way(n, rtol=rtol, atol=self._atol.ctypes.data)
        self._put(in_c)
        self._library = library()
        self._reference = ctypes.byref(self.way)
        self._memory = np.zeros(self._library.lmoc_radau_place(self._reference, None))
        self._library.lmoc_radau_place(self._reference, self._memory.ctypes.data)
        self.x, self.last, self.f = (self._view(getattr(self.way, name), (n,)) for name in ("x", "last", "f"))
        self.dense = self._view(self.way.dense, (3, n))

    def jump(self, t: float, x: np.ndarray) -> None:
        """Go on from a state, without a step behind."""
        self.way.t, self.x[:] = t, x
        self._library.lmoc_radau_jump(self._reference)
        self._raise()

    def step(self) -> bool:
        """Make a step; whether there was one."""
        found = self._library.lmoc_radau_step(self._reference)
        self._raise()
        return bool(found)

    def undo(self) -> None:
        """Stand where the last step began, without a step behind."""
        self.jump(self.way.before, self.last)

    def _put(self, in_c: RatesInC | None) -> None:
        """Give C its functions."""
        way, n, own = self.way, self.way.n, self._own
        if in_c is None:
            way.rates = _RATES(self._safe(lambda _, t, x, out: own.rates(t, self._view(x, (n,)), self._out(out))))
            way.mark, way.go_back = (_PLACE(self._safe(lambda _, f=f: f())) for f in (own.mark, own.go_back))
        else:
            way.owner = in_c.owner
            way.rates, way.mark, way.go_back = _RATES(in_c.rates), _PLACE(in_c.mark), _PLACE(in_c.go_back)
        way.slopes = _RATES(self._safe(lambda _, t, x, out: own.slopes(t, self._view(x, (n,)), self._matrix(out))))
        if own.factor is not None and own.substitute is not None:
            factor, substitute = own.factor, own.substitute
            way.factor = _FACTOR(self._safe(lambda _, h: factor(h)))
            way.substitute = _SUBSTITUTE(
                self._safe(lambda _, which, v: substitute(which, self._view(v, (2, n) if which else (n,))))
            )

    def _safe(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that keeps what it raises for after the step: C cannot pass it on.

        From there on there are no numbers, so that the step ends soon.
        """

        def call(*arguments: Any) -> Any:
            try:
                if self._raised is None:
                    return function(*arguments)
            except BaseException as error:
                self._raised = error
            if len(arguments) == 4:
                self._out(arguments[3])[:] = np.nan
            return 0

        return call

    def _raise(self) -> None:
        if self._raised is not None:
            error, self._raised = self._raised, None
            raise error

    def _out(self, address: int) -> np.ndarray:
        return self._view(address, (self.way.n,))

    def _matrix(self, address: int) -> np.ndarray:
        n = self.way.n
        return self._view(address, (n, n)) if self._own.factor is None else self._memory[:0]

    def _view(self, address: int, shape: tuple[int, ...]) -> np.ndarray:
        """Return the memory at an address; one array for each place, since C asks for the same ones again."""
        key = address, shape
        if key not in self._views:
            count = math.prod(shape)
            own = (ctypes.c_double * count).from_address(address)
            self._views[key] = np.ctypeslib.as_array(own).reshape(shape)
        return self._views[key]
