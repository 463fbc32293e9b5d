"""Code shared by CVODE and IDA: the objects of one integration, steps, and values between them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from ctypes import byref, c_double, c_long, c_void_p

import numpy as np

from lmoc.numerics.problem.status import Status
from lmoc.numerics.sundials import sundials as sun
from lmoc.numerics.sundials.matrix import JacobianStorage, Solver
from lmoc.support.records import dataclass


@dataclass(frozen=True)
class Given:
    """The problem of an integration, its start and its accuracy.

    Attributes
    ----------
    x : (n,) at t
    t, end : s
    rtol, atol : tolerances; atol is (n,)
    matrix : Matrix
    max_steps : in one call
    max_step : s
    """

    x: np.ndarray
    t: float
    end: float
    rtol: float
    atol: np.ndarray
    matrix: JacobianStorage
    max_steps: int
    max_step: float


class SundialsSession(ABC):
    """Owns the SUNDIALS objects of one integration.

    What a callback raises must not unwind through C: it is kept in `error`, ends the call, and is raised afterwards.

    Attributes
    ----------
    t, x : the current point
    """

    name: str  # with which SUNDIALS' functions begin
    counters: tuple[str, str, str]
    no_value: tuple[int, ...]  # flags for a function without a finite value

    def __init__(self, given: Given) -> None:
        """
        Raises
        ------
        NotFound
            The libraries are not at hand.
        """
        self.lib = lib = sun.load()
        self.given, self.n = given, len(given.x)
        self.error: BaseException | None = None
        self.reached = c_double(given.t)
        self.context = c_void_p()
        lib.SUNContext_Create(0, byref(self.context))
        lib.SUNContext_ClearErrHandlers(self.context)  # failures are reported by the return value, not on stderr
        self.vectors: list[c_void_p] = []
        self._between: np.ndarray | None = None
        self.x, self.atol = np.array(given.x, float), np.array(given.atol, float)
        self.state, self.tolerance = self.vector(self.x), self.vector(self.atol)
        self.memory = self.create()
        self.solver = Solver(lib, given.matrix, self.state, self.context)
        self.call("SetLinearSolver", self.solver.solver, self.solver.matrix)
        self.attach()
        self.call("SetStopTime", given.end)
        self.call("SetMaxNumSteps", given.max_steps)
        self.least = sun.least_step(given.t, given.end)
        self.call("SetMinStep", self.least)
        if np.isfinite(given.max_step):
            self.limit_steps(given.max_step)

    def limit_steps(self, longest: float) -> None:
        """Make no step longer than so many seconds; infinity where there is no limit."""
        self.call("SetMaxStep", longest if np.isfinite(longest) else 0.0)  # the library's word for none

    @abstractmethod
    def create(self) -> c_void_p:
        """Make the integrator and give it the equations."""

    @abstractmethod
    def attach(self) -> None:
        """Give it the function that fills the matrix."""

    @abstractmethod
    def solve(self, t: float, task: int) -> int:
        """Call the library: `sun.NORMAL` up to t, `sun.ONE_STEP` towards it."""

    def vector(self, array: np.ndarray) -> c_void_p:
        """A SUNDIALS vector on the numbers of an array, which must live as long."""
        self.vectors.append(c_void_p(self.lib.N_VMake_Serial(self.n, array.ctypes.data, self.context)))
        return self.vectors[-1]

    def view(self, vector: int) -> np.ndarray:
        """The numbers of a SUNDIALS vector."""
        return sun.view(self.lib.N_VGetArrayPointer(vector), self.n)

    def call(self, function: str, *arguments) -> int:
        return getattr(self.lib, self.name + function)(self.memory, *arguments)

    def guarded(self, action: Callable[[], int]) -> int:
        """Run `action` in a callback and return its result, or the code of an error that ends the run."""
        try:
            return -1 if self.error is not None else action()
        except BaseException as error:
            self.error = error
            return -1

    def callback(self, function: Callable[..., None]) -> Callable[..., int]:
        """A Python function ``(t, vectors…)`` as SUNDIALS calls it; what it writes into the last has to be finite."""

        def call(t: float, *pointers) -> int:
            try:
                arrays = [self.view(p) for p in pointers[:-1]]  # behind them stands the user's data
                function(t, *arrays)
                if self.error is not None:
                    return -1
                return 0 if np.isfinite(arrays[-1]).all() else 1  # 1: a shorter step is tried
            except BaseException as error:
                self.error = error
                return -1

        return call

    @property
    def t(self) -> float:
        return self.reached.value

    def step(self) -> Status:
        """Make one step; raises what a callback has raised."""
        return self._judged(self.solve(self.given.end, sun.ONE_STEP))

    def advance(self, t: float) -> Status:
        """Integrate up to a time; raises what a callback has raised."""
        return self._judged(self.solve(t, sun.NORMAL)) if t - self.reached.value > self.least else Status.OK

    def _judged(self, flag: int) -> Status:
        if self.error is not None:
            raise self.error
        return Status.OK if flag in (sun.SUCCESS, sun.TSTOP_RETURN) else sun.status_of(flag, self.no_value)

    def at(self, t: float) -> np.ndarray:
        """Return the values at a time within the last step."""
        if t == self.t:
            return self.x
        if self._between is None:
            self._between = np.empty(self.n)
            self._between_vector = self.vector(self._between)
        self.call("GetDky", t, 0, self._between_vector)
        return self._between

    def interrupt(self, *_) -> None:
        """Take Ctrl-C.

        Raised where it falls, an interrupt could fall on the first or last line of a callback: ctypes would drop it and
        tell C that all is well.
        """
        self.error = KeyboardInterrupt()

    def counts(self) -> dict[str, int]:
        """Return steps, evaluations and Jacobians so far."""
        counts = {}
        for name, counter in zip(("steps", "evaluations", "jacobians"), self.counters, strict=True):
            value = c_long()
            self.call(f"GetNum{counter}", byref(value))
            counts[name] = value.value
        return counts

    def free(self) -> None:
        """Give the library's objects back."""
        getattr(self.lib, f"{self.name}Free")(byref(self.memory))
        self.solver.free()
        for vector in self.vectors:
            self.lib.N_VDestroy(vector)
        self.lib.SUNContext_Free(byref(self.context))
