"""What CVODE and IDA have in common: the objects of one integration, the loop over output times, what comes back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from ctypes import byref, c_double, c_long, c_void_p
from dataclasses import dataclass

import numpy as np

from lmoc.numerics.integrate.base import on_interrupt
from lmoc.numerics.integrate.status import Status
from lmoc.numerics.integrate.sundials import sundials as sun
from lmoc.numerics.integrate.sundials.matrix import Matrix, Solver


@dataclass(frozen=True)
class Given:
    """What is integrated, from where and how accurately.

    Attributes
    ----------
    x : (n,) at ``times[0]``
    times : (k,) increasing
    rtol, atol : tolerances; atol is (n,)
    matrix : Matrix
    sink : called with (k, state at ``times[k]``) for k ≥ 1; it has to copy what it keeps
    max_steps : between two output times
    """

    x: np.ndarray
    times: np.ndarray
    rtol: float
    atol: np.ndarray
    matrix: Matrix
    sink: Callable[[int, np.ndarray], None]
    max_steps: int


@dataclass(frozen=True)
class Ended:
    """Where an integration has ended and what it cost; `status` is OK where all times were reached."""

    time: float
    x: np.ndarray
    status: Status
    steps: int
    evaluations: int
    jacobians: int


class Session(ABC):
    """Owns the SUNDIALS objects of one integration; a context manager that frees them.

    What a callback raises must not unwind through C: it is kept in `error`, ends the run, and is raised afterwards.
    """

    name: str  # with which SUNDIALS' functions begin
    counters: tuple[str, str, str]

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
        self.context = c_void_p()
        lib.SUNContext_Create(0, byref(self.context))
        lib.SUNContext_ClearErrHandlers(self.context)  # failures are told by the return value, not on stderr
        self.vectors: list[c_void_p] = []
        self.x, self.atol = np.array(given.x, float), np.array(given.atol, float)
        self.state, self.tolerance = self.vector(self.x), self.vector(self.atol)
        self.memory = self.create()
        self.solver = Solver(lib, given.matrix, self.state, self.context)
        self.call("SetLinearSolver", self.solver.solver, self.solver.matrix)
        self.attach()
        self.call("SetStopTime", float(given.times[-1]))
        self.call("SetMaxNumSteps", given.max_steps)
        self.call("SetMinStep", sun.least_step(given.times))

    @abstractmethod
    def create(self) -> c_void_p:
        """Make the integrator and give it the equations."""

    @abstractmethod
    def attach(self) -> None:
        """Give it the function that fills the matrix."""

    @abstractmethod
    def advance(self, t: float, reached: c_double) -> int:
        """Integrate up to t."""

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
        """What a callback returns: what `action` does, or the sign of an error that ends the run."""
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

    def run(self) -> Ended:
        """Integrate over the output times; raises what a callback has raised."""

        def keep(*_) -> None:
            self.error = KeyboardInterrupt()

        # raised where it falls, an interrupt could fall on the first or last line of a callback: ctypes would drop it
        # and tell C that all is well
        with on_interrupt(keep):
            return self._loop()

    def _loop(self) -> Ended:
        given, reached = self.given, c_double(self.given.times[0])
        least = sun.least_step(given.times)
        for k, t in enumerate(given.times[1:].tolist(), 1):
            flag = self.advance(t, reached) if t - reached.value > least else sun.SUCCESS
            if self.error is not None:
                raise self.error
            if flag not in (sun.SUCCESS, sun.TSTOP_RETURN):
                return self.ended(reached.value, self.status(flag))
            given.sink(k, self.x)
        return self.ended(float(given.times[-1]), Status.OK)

    @abstractmethod
    def status(self, flag: int) -> Status:
        """Return the meaning of a returned flag."""

    def ended(self, time: float, status: Status) -> Ended:
        counts = []
        for counter in self.counters:
            value = c_long()
            self.call(f"GetNum{counter}", byref(value))
            counts.append(value.value)
        return Ended(time, self.x.copy(), status, *counts)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_) -> None:
        getattr(self.lib, f"{self.name}Free")(byref(self.memory))
        self.solver.free()
        for vector in self.vectors:
            self.lib.N_VDestroy(vector)
        self.lib.SUNContext_Free(byref(self.context))
