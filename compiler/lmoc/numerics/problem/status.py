"""The outcome of an integration, and errors of missing solver libraries."""

from __future__ import annotations

from enum import Enum

from lmoc.messages.source import Span
from lmoc.support import budget


class Status(Enum):
    """Why an integration is where it is; the value is the text for people."""

    OK = ""
    COLLAPSED = "the step size collapsed"
    CRAWLING = "the steps have become so short that they make hardly any progress"
    TOO_MANY_STEPS = "too many steps"
    TOO_LONG = "the time limit of the run was reached"
    INTERRUPTED = "it was interrupted"
    SPENT = "it has hardly moved on for as long as its budget allows"
    NOT_FINITE = "the derivatives have no finite value"
    TOO_FINE = "the tolerances are finer than rounding allows"
    NO_LINEAR_SOLVER = "the linear solver could not be set up"
    NO_CONVERGENCE = "Newton's method does not solve the equations of a step of this length"
    SINGULAR_MATRIX = "the Jacobian is singular"
    REFUSED = "the solver's library refused the problem"
    SINGULAR = "the coordinates do not determine the rest"  # no choice of coordinates does, or none was looked for
    CHATTERING = "a condition switches back and forth without end"
    UNSETTLED = "the equations of an event have no solution"
    CONTRADICTION = "the laws contradict each other"
    ASSERTION = "an assertion does not hold"
    # not failures: somebody else takes over
    STIFF = "the problem is stiff and the method explicit"
    ROOT = "a root function vanishes"
    COORDINATES = "other coordinates are better by a margin"
    DOUBTFUL = "the next step has to be looked at more closely"

    @property
    def failed(self) -> bool:
        """Return whether the run cannot go on."""
        return self not in (Status.OK, Status.STIFF, Status.ROOT, Status.COORDINATES, Status.DOUBTFUL)


def interruption() -> Status:
    """Return what has interrupted a run: its budget, or the keyboard."""
    return Status.SPENT if budget.interrupted() else Status.INTERRUPTED


class Stopped(Exception):
    """The run ends at an instant: with an error, or because the model requests it (`Status.OK`).

    Parameters
    ----------
    span : what to look at where that is known
    hint : what to do about it
    """

    def __init__(self, status: Status, reason: str, span: Span | None = None, hint: str = "") -> None:
        super().__init__(reason)
        self.status, self.reason, self.span, self.hint = status, reason, span, hint


class NotFound(Exception):
    """A library that an integrator is made of is not installed in a layout that is known here."""


class Unsuitable(Exception):
    """A method does not apply to a scene: why, and what does."""

    def __init__(self, reason: str, hint: str) -> None:
        super().__init__(reason)
        self.hint = hint


class Inapplicable(Exception):
    """A method does not serve for a run, which DOP853 then does: why."""
