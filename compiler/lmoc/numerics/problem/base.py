"""The interface of integrators: problems, outcomes, and the table of their properties."""

from __future__ import annotations

import signal
import threading
import time as clock
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import field
from typing import Protocol

import numpy as np

from lmoc.numerics.plan.activity import Lookout
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.roots import Roots
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.system import OpenedSystem, System
from lmoc.support import budget
from lmoc.support.records import dataclass


@dataclass
class PlanCost:
    """What a run has spent on one plan so far.

    Attributes
    ----------
    steps : by DOP853
    series : a Taylor series has been worth its compilation
    """

    steps: int = 0
    series: bool = False


@dataclass(frozen=True, eq=False)
class Pieces:
    """What follows a problem that ends at a kink, from one kink to the next until the end of the run.

    Attributes
    ----------
    bounds : (k,) where each piece begins and ends, and its longest step, s
    times : output times behind those of the problem, each within its piece
    """

    bounds: tuple[np.ndarray, np.ndarray, np.ndarray]
    times: np.ndarray

    @property
    def count(self) -> int:
        return len(self.bounds[0])

    def behind(self, passed: int, reached: int) -> Pieces:
        """Return what is left behind some pieces and output times."""
        begin, end, longest = self.bounds
        return Pieces((begin[passed:], end[passed:], longest[passed:]), self.times[reached:])


@dataclass(frozen=True, eq=False, repr=False)
class Problem:
    """An initial value problem and how it is to be solved.

    Attributes
    ----------
    system : System
    t, x : where it begins; x is (n,)
    end : s, where it ends
    times : (k,) output times behind t and up to the end, not decreasing
    rtol, atol : tolerances; atol is (n,)
    sink : callable (first, states)
        Takes the states at the output times ``times[first], …`` as an array (count, n).
    max_step : s, the longest step
    lookout : bounds the steps where something short happens in what depends on time alone
    max_steps : steps after which the run is given up
    overrun : steps by which these may be exceeded where so many are expected to reach the end
    deadline : value of ``time.thread_time()`` at which to stop, None for no limit
    progress : called with the time reached, a few times a second at the most
    patience : steps that an explicit method may still need where it finds the problem stiff; beyond, it gives up
    breaks : times within at which the right-hand side jumps or has a kink
    guard : Guard, or None where nobody looks at the steps
    roots : Roots, or None where nothing switches
    first_step : s, which a method of one step may begin with; infinity where it is to find one
    shortest : s, mean length of its steps below which a Taylor series is STIFF
    step : s, the length of all steps of a method with fixed steps; None where it chooses them
    correction : (t, x) -> x, moves the end of an accepted step or returns the same array; None where all stay as they
        are
    compiled_guard : the same and the guard in C; None where they are left to Python
    index_one : what IDA integrates in place of the system, with the states first among its components
    whole : s, the end of the run of which this is a part; NaN where this is all of it
    held : (t, x, length of the latest steps) -> bool, whether jumps of the equations keep the motion there; asked where
        the steps hardly get on. None where nothing jumps
    spent : by plan, what the segments of the run so far have cost; kept up to date on the way
    pieces : what follows behind the kink at its end, for a method that may go on over kinks; None where none may
    """

    system: System
    t: float
    x: np.ndarray
    end: float
    times: np.ndarray
    rtol: float
    atol: np.ndarray
    sink: Callable[[int, np.ndarray], None]
    max_step: float = np.inf
    lookout: Lookout = field(default_factory=Lookout)
    max_steps: int = 5_000_000
    overrun: int = 0
    deadline: float | None = None
    progress: Callable[[float], None] | None = None
    patience: float = np.inf
    breaks: np.ndarray = field(default_factory=lambda: np.zeros(0))
    guard: StepGuard | None = None
    roots: Roots | None = None
    first_step: float = np.inf
    shortest: float = 0.0
    step: float | None = None
    correction: Callable[[float, np.ndarray], np.ndarray] | None = None
    compiled_guard: CompiledGuard | None = None
    index_one: OpenedSystem | None = None
    whole: float = np.nan
    held: Callable[[float, np.ndarray, float], bool] | None = None
    spent: dict[Plan, PlanCost] = field(default_factory=dict)
    pieces: Pieces | None = None

    @property
    def needs_steps(self) -> bool:
        """Return whether every accepted step is inspected."""
        return self.guard is not None or self.roots is not None


REQUESTED = "requested"  # why a solver was taken: the user has named it


class StepGuard(Protocol):
    """Looks at every accepted step before its output is passed on."""

    def __call__(self, t: float, x: np.ndarray) -> Status:
        """Judge the end of a step; anything but OK ends the integration where the step has begun."""

    def stuck(self, status: Status) -> Status:
        """Return why there are no more steps, where the method has found the step size collapsed or values lost.

        With CRAWLING, COORDINATES or a failure that explains it; CRAWLING where short steps have other reasons.
        """


class CompiledGuard(Protocol):
    """Guard and correction in C, for many steps at once."""

    def enter(self, most: int) -> int | None:
        """Return the address of an ``lmoc_step_hook`` (``engine/c/engine.h``) for up to `most` steps from here.

        None where the next step has to be judged in Python.
        """

    def leave(self, t: float, x: np.ndarray) -> None:
        """Take the place that steps judged in C have led to for the last one."""


@dataclass
class Outcome:
    """The outcome of an integration.

    Attributes
    ----------
    time, x : where the integration has ended
    reached : number of output times that have been handed to the sink
    status : why it ended; OK at the end of the problem
    counts : steps, rejected, … for the statistics
    step : s, the last step size, where the method tells
    matrix : how an implicit method has stored its Jacobian, empty for an explicit one
    evaluation : how the equations have been evaluated, empty where as `System.description` says
    solver : the method that has done it, empty where it is the one that was called
    why : what kept that one from it, after a colon, where it has told
    roots : (m,) which root functions vanish there; None where it has not ended at one
    """

    time: float
    x: np.ndarray
    reached: int
    status: Status = Status.OK
    counts: dict[str, int] = field(default_factory=dict)
    step: float = np.inf
    matrix: str = ""
    evaluation: str = ""
    solver: str = ""
    why: str = ""
    roots: np.ndarray | None = None


@dataclass(frozen=True)
class Properties:
    """The properties of an integrator; the rows of the table in the documentation.

    Attributes
    ----------
    method, family : what it is, and the family that charts colour it by
    order, dense : orders of the steps and of the values between them
    stability : "A" or "L" where the method is so, "A(α)" where nearly; empty for a bounded region of stability
    implicit : solves equations in each step, so that it needs the Jacobian
    symplectic : at steps of equal length
    lengths : "own" where it chooses its steps by the tolerance, "fixed" where they are given, "either"
    library : where it comes from
    steps : gives account of every step, so that roots can be found (laws, events) and coordinates watched; else another
        one of the same method does that
    needs : what it asks of the scene or the machine
    good_for : the scenes that it is for
    """

    name: str
    method: str
    family: str
    order: str
    dense: str
    library: str
    stability: str = ""
    implicit: bool = False
    symplectic: bool = False
    lengths: str = "own"
    steps: bool = True
    needs: str = ""
    good_for: str = ""

    @property
    def cells(self) -> tuple[str, ...]:
        """Return the row of the table, in the order of `HEAD`."""
        yes = {True: "yes", False: "no"}
        return (
            self.name, self.method, self.order, self.dense, yes[self.implicit], self.stability or "–",
            yes[self.symplectic], self.lengths, yes[self.steps], self.library, self.needs or "–", self.good_for,
        )  # fmt: skip


HEAD = (
    "name", "method", "order", "between steps", "implicit", "stable", "symplectic", "steps", "roots", "from",
    "needs", "good for",
)  # fmt: skip


class Unattended(Protocol):
    """The ability of a method to go on without Python between its steps, where nobody looks at them."""

    def advance(self, time: float) -> Status:
        """Go to an output time by as many steps as that takes; the integration's `x` is the state there."""


class Walker(Protocol):
    """The ability of a method to make many steps with their output without Python between them."""

    def walk(self, times: np.ndarray, room: int, most: int, hook: int | None) -> tuple[Status, int]:
        """Make up to `most` steps; keep the states at those of `times` that they reach, as far as there is room.

        Where there is none for all that the last step has reached, `Integration.interpolate` tells the others.

        Parameters
        ----------
        hook : address of the ``lmoc_step_hook`` that looks at each step, None for none

        Returns
        -------
        as `Integration.step`, or DOUBTFUL where the next step is to be judged in Python; the number of times kept
        """

    def pass_kinks(self, pieces: Pieces, room: int, most: tuple[int, int, int]) -> tuple[int, int, bool]:
        """Go on from the end of a piece, over kinks, with the output as far as there is room.

        Parameters
        ----------
        most : as of `engine.pieces.passing`

        Returns
        -------
        the number of pieces passed and of times kept; whether the next piece takes more steps or room, or another
        method. It has left no trace then, and the method stands where the last one has ended
        """


class Integration(ABC):
    """A method at work on one problem: its state, and one accepted step at a time. A context manager.

    Attributes
    ----------
    t, x : the current point
    before : s, where the last step began
    steps, rejected : counted so far
    step_size : s, the step it would try next, infinity where it does not tell
    wanted : s, the earliest time at which values between steps will be requested; the loop sets it
    looks : places of a step at which coordinates are looked at. The steps of a high order may lead from one good
        place to another across places where other coordinates are needed, of which nothing is seen at their ends
    series : where the last step begins, the order of its polynomial and the address of the coefficients for C; None
        where values between the steps are others
    """

    t: float
    x: np.ndarray
    before: float
    step_size: float = np.inf
    wanted: float = np.inf
    looks = 1
    series: Callable[[], tuple[float, int, int]] | None = None
    matrix = ""
    evaluation = ""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.steps = self.rejected = 0
        self._collected: list[np.ndarray] = []

    @property
    def unattended(self) -> Unattended | None:
        """Return what goes to output times without Python between the steps; None where the method cannot."""
        return None

    @property
    def walker(self) -> Walker | None:
        """Return what makes many steps at once; None where the method cannot."""
        return None

    @abstractmethod
    def step(self) -> Status:
        """Make one step, not beyond the problem's end.

        OK, or STIFF where it is made but shall be the last one; otherwise why there is none.
        """

    @abstractmethod
    def interpolate(self, times: np.ndarray) -> np.ndarray:
        """Return the states (k, n) at times within the last step."""

    @abstractmethod
    def jump(self, x: np.ndarray) -> None:
        """Go on from another state at the same time."""

    def begin_piece(self, problem: Problem) -> bool:
        """Go on with another problem behind a kink, as if it began there; False where that takes a new method."""
        return False

    def collect(self, times: np.ndarray) -> None:
        """Keep the states at times within the last step."""
        self._collected.append(self.interpolate(times))

    def collect_here(self) -> None:
        """Keep the current state."""
        self._collected.append(self.x.copy()[None])

    def collected(self) -> np.ndarray:
        """Return the states kept since the last call, (k, n)."""
        kept, self._collected = self._collected, []
        return np.concatenate(kept) if kept else np.zeros((0, len(self.x)))

    def counts(self) -> dict[str, int]:
        """Return what it has cost, for the statistics."""
        return {"steps": self.steps, "rejected": self.rejected}

    def __enter__(self):
        return self

    def __exit__(self, *_) -> None:
        """Free what belongs to a library: nothing here."""
        return


@contextmanager
def on_interrupt(action: Callable[..., None]) -> Iterator[None]:
    """Have Ctrl-C, and a budget that is spent, call a function instead of raising KeyboardInterrupt.

    Where others handle Ctrl-C, that stays with them.
    """
    own = threading.current_thread() is threading.main_thread()
    with budget.instead(action):
        if not own or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
            yield
            return
        signal.signal(signal.SIGINT, action)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, signal.default_int_handler)


class Expired(Exception):
    """The time allowed for the run is over."""


class Watch:
    """Looks at the clock now and then: progress, and the deadline."""

    EVERY = 0.2  # s between two reports of progress

    def __init__(self, problem: Problem) -> None:
        self.progress = problem.progress
        self.deadline = problem.deadline
        self._told = clock.monotonic()

    def expired(self, t: float) -> bool:
        """Report progress if it is time to; whether the deadline has passed."""
        now = clock.monotonic()
        if self.progress is not None and now - self._told > self.EVERY:
            self._told = now
            self.progress(t)
        return self.deadline is not None and clock.thread_time() > self.deadline
