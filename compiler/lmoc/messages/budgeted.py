"""The words for work whose budget is spent: a diagnostic, or the failure of a run with what it has computed."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from lmoc.messages.diagnostics import Diagnostic, ModelError, RunInterrupted, SimulationError
from lmoc.support.budget import Spent, within

_NO_ROOM = "failed to map segment"
Action = TypeVar("Action", bound=Callable[..., Any])


class BudgetSpent(ModelError):
    """The work has been given up (E0557)."""


def budgeted(what: str, suspicion: Callable[..., str] | None = None) -> Callable[[Action], Action]:
    """Give a function or method a budget.

    Parameters
    ----------
    what : what it does, as in "the linear model"
    suspicion : called with its arguments; what may be the reason that it does not end

    Raises
    ------
    BudgetSpent
        E0557: it has not moved on for as long as the budget allows.
    SimulationError
        The same of a run, with what it has computed.
    """

    def decorate(function: Action) -> Action:
        @wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            try:
                return within(what, lambda: function(*args, **kwargs))
            except Spent as spent:
                raise _error(spent, "" if suspicion is None else suspicion(*args, **kwargs)) from spent.__cause__
            except MemoryError as error:
                raise _out_of_memory(what) from error
            except ImportError as error:
                if _NO_ROOM in str(error):  # of a library, while it is loaded
                    raise _out_of_memory(what) from error
                raise

        return call  # type: ignore[return-value]

    return decorate


class OutOfMemory(ModelError, MemoryError):
    """The work takes more memory than there is (E0559)."""


def _out_of_memory(what: str) -> OutOfMemory:
    hint = "fewer parts, fewer output times (--points), or fewer variables kept (--keep); arrays of parts take least"
    return OutOfMemory([Diagnostic("E0559", f"{what}: there is not enough memory", hint=hint)])


def told(what: str, action: Callable[[], Any]) -> Any:
    """Return what an action returns; errors as of `budgeted`."""
    return budgeted(what)(action)()


def _error(spent: Spent, suspicion: str) -> ModelError | SimulationError:
    """Return the error that says what was reached, why it ends there, and what to change."""
    cause = spent.__cause__
    more = f"{4 * spent.seconds:g}"
    hint = f"--budget {more} allows four times as long (in Python: with lmoc.budget({more}))"
    hint = f"{suspicion}; {hint}" if suspicion else hint
    if suspicion in str(cause):  # a run has told it
        hint = hint.removeprefix(f"{suspicion}; ")
    if isinstance(cause, (SimulationError, RunInterrupted)):
        return SimulationError(f"{cause}\n  = hint: {hint}", cause.time, cause.partial)
    doing = f" ({spent.doing})" if spent.doing and spent.doing != spent.work else ""
    message = f"{spent.work}{doing}: nothing has moved on for {spent.seconds:g} s of work"
    return BudgetSpent([Diagnostic("E0557", message, hint=hint)])
