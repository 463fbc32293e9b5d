"""What integrators are given, what they give back, and the table of what each can do."""

from __future__ import annotations

import signal
import threading
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from lmoc.numerics.evaluate.system import System
from lmoc.numerics.integrate.status import Status


@dataclass(frozen=True, eq=False, repr=False)
class Problem:
    """An initial value problem and how it is to be solved.

    Attributes
    ----------
    system : System
    x : (n,) state at ``times[0]``
    times : (k,) increasing output times
    rtol, atol : tolerances; atol is (n,)
    sink : callable (first, states)
        Takes the states at the output times ``first …`` as an array (count, n). The start itself is not among them.
    max_steps : int
    deadline : value of ``time.monotonic()`` at which to stop, None for no limit
    progress : called with the time reached, a few times a second at the most
    patience : steps that an explicit method may still need where it finds the problem stiff; beyond, it gives up
    breaks : times within at which the right-hand side jumps or has a kink
    """

    system: System
    x: np.ndarray
    times: np.ndarray
    rtol: float
    atol: np.ndarray
    sink: Callable[[int, np.ndarray], None]
    max_steps: int = 5_000_000
    deadline: float | None = None
    progress: Callable[[float], None] | None = None
    patience: float = np.inf
    breaks: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass
class Outcome:
    """How far an integration came.

    Attributes
    ----------
    time, x : where it stands at the end
    reached : number of output times that have been handed to the sink (the start counted)
    status : why it ended; OK at the last output time
    step : the last step size, where the method tells
    counts : steps, rejected, … for the statistics
    matrix : how an implicit method has stored its Jacobian, empty for an explicit one
    evaluation : how the equations have been evaluated, empty where as `System.description` says
    solver : the method that has done it, empty where it is the one that was called
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


@dataclass(frozen=True)
class Properties:
    """What an integrator can do; the rows of the table in the documentation."""

    name: str
    method: str
    stiff: bool
    order: str
    library: str


@contextmanager
def on_interrupt(action: Callable[..., None]) -> Iterator[None]:
    """Have Ctrl-C call a function instead of raising KeyboardInterrupt; does nothing where others handle it."""
    own = threading.current_thread() is threading.main_thread()
    if not own or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, action)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


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
        return self.deadline is not None and now > self.deadline
