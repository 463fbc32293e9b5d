"""Tables of points in time as signals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Span
from lmoc.numerics.signals import curves
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Table:
    """Points in time joined by a curve that stays between neighbouring points.

    Attributes
    ----------
    times, values : (n,); a time that occurs twice is a jump
    curve : Curve, as smooth as the equations need it
    """

    times: np.ndarray
    values: np.ndarray
    curve: curves.Curve

    @property
    def jumps(self) -> np.ndarray:
        """Times at which the values jump."""
        return self.curve.jumps

    def gives(self, order: int) -> bool:
        """Return whether the curve has a derivative of that order: where the values jump, the first is an impulse."""
        return order <= (1 if len(self.jumps) else curves.SMOOTHEST)

    def smooth(self, order: int) -> Table:
        """Return the points joined by a curve with that many continuous derivatives, at most two."""
        return make_table(self.times, self.values, min(order, curves.SMOOTHEST))

    def value(self, t: float, order: int) -> float:
        return self.curve.at(t, order)


def make_table(times: np.ndarray, values: np.ndarray, smoothness: int = 0) -> Table:
    """Return a table of points that are known to be in order."""
    return Table(times, values, curves.fit(times, values, smoothness))


@dataclass(frozen=True)
class Points:
    """Points as they were given, and where each number stands if they come from a file."""

    times: np.ndarray
    values: np.ndarray
    place: Callable[[int, str], Span | None] = lambda row, column: None  # noqa: E731
    title: str = "the table"


def checked_table(points: Points, name: str, report: Report) -> Table | None:
    """Return the points as a table; None, with errors in the report (E0625), where they are none.

    Parameters
    ----------
    name : of the input, for messages
    """
    times, values = points.times, points.values
    message = f"{points.title} for input '{name}' cannot be used"

    def refuse(problem: str, row: int | None = None, column: str = "time", hint: str = "") -> None:
        report.error("E0625", f"{message}: {problem}", None if row is None else points.place(row, column), hint=hint)

    for column, numbers in (("time", times), ("value", values)):
        for row in np.flatnonzero(~np.isfinite(numbers))[:1].tolist():
            refuse(f"{numbers[row]} is not a finite number", row, column)
            return None
    if len(times) < 2:
        refuse(f"it has {'one point' if len(times) else 'no points'}, and needs two")
        return None
    steps = np.diff(times)
    for row in (np.flatnonzero(steps < 0) + 1)[:1].tolist():
        hint = "a time that occurs twice is a jump; otherwise times increase"
        refuse(f"its times decrease: {times[row]:g} follows {times[row - 1]:g}", row, hint=hint)
        return None
    for row in (np.flatnonzero((steps[1:] == 0) & (steps[:-1] == 0)) + 2)[:1].tolist():
        hint = "two lines with one time are a jump, from the value of the first to that of the second"
        refuse(f"the time {times[row]:g} occurs more than twice", row, hint=hint)
        return None
    finest = curves.fit(times, values, curves.SMOOTHEST)
    for row in np.flatnonzero(~np.isfinite(finest.coefficients).all(axis=0))[:1].tolist():
        refuse("its times are too close together, or its values too large", row)
        return None
    return make_table(times, values)
