"""The data of a chart: its points, its reference, and the recommendation that follows from them."""

from __future__ import annotations

import math
from typing import Any

from lmoc.studies.points import Point
from lmoc.studies.reference import Reference
from lmoc.studies.whole import Whole
from lmoc.support.records import dataclass

DIGITS = 6  # that a recommendation is made for
COLUMNS = (
    "solver", "formulation", "rtol", "error", "seconds", "evaluations", "residual", "energy", "status", "note",
    "step", "end_error", "velocity_residual", "steps", "jacobians", "events", "repeats",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Findings:
    """Cost and accuracy of a scene's runs, by method, formulation and tolerance.

    Attributes
    ----------
    name : of the model
    points : in the order of methods, and of tolerances from coarse to fine
    reference : what the errors are measured against
    note : what else there is to say
    interrupted : it was broken off; what had been measured is there
    whole : the points come from the beginning of the scene, and what came of those with the most digits in all of it;
        None where all points are of the whole run
    """

    name: str
    points: tuple[Point, ...]
    reference: Reference
    note: str = ""
    interrupted: bool = False
    whole: Whole | None = None

    def to_dataframe(self):
        """Return a pandas DataFrame with the columns of `COLUMNS`, one row a point."""
        import pandas

        return pandas.DataFrame(self.records(), columns=list(COLUMNS))

    def records(self) -> list[dict[str, Any]]:
        """Return the points as {column: value}."""
        rows = []
        for p in self.points:
            values = {**vars(p), **vars(p.setting)}
            rows.append({column: values[column] for column in COLUMNS})
        return rows

    def recommended(self, digits: int = DIGITS) -> Point | None:
        """Return the fastest point with so many digits; None where no method has them, or the reference has not.

        Where only the beginning is charted, it is a point of the whole run, as far as that has been tried.
        """
        points, doubt = self.points, self.reference.uncertainty
        if self.whole is not None and self.whole.tried:
            points, doubt = self.whole.tried, self.whole.uncertainty
        if doubt > 10.0**-digits:
            return None
        good = [p for p in points if p.ok and p.error <= 10.0**-digits]
        return min(good, key=lambda p: p.seconds, default=None)

    @property
    def recommendation(self) -> str:
        """Return one line: ``for 6 digits: dop853 at rtol 1e-7, 4 ms``; of fewer digits where none has so many."""
        which = ""
        if self.whole is not None:
            which = " for the whole run" if self.whole.tried else "; the whole run takes too long to be tried"
        for digits in range(DIGITS, 0, -1):
            point = self.recommended(digits)
            if point is not None:
                return f"for {digits} digits: {point.setting.text}, {seconds_text(point.seconds)}{which}"
        return "no method reaches one digit"


def seconds_text(seconds: float) -> str:
    """Return ``4 ms``, ``0.12 s``, ``250 µs``."""
    if not math.isfinite(seconds):
        return "–"
    for factor, unit in ((1.0, "s"), (1e-3, "ms")):
        if seconds >= factor:
            return f"{_two_digits(seconds / factor)} {unit}"
    return f"{_two_digits(seconds / 1e-6)} µs"


def _two_digits(value: float) -> str:
    """Return a number with two digits, or all of those before the point."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"
