"""What an instant comes to: its effect, or why there is none."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.observe.one_state import why_not
from lmoc.support.records import dataclass


class NotAState(Exception):
    """A `reinit` of a variable that does not follow from one state alone, or not so far.

    Attributes
    ----------
    variable : which
    followed : (k,) indices of the states that it follows from
    """

    def __init__(self, variable: int, followed: np.ndarray) -> None:
        super().__init__()
        self.variable, self.followed = variable, followed

    def reason(self, layout: EventLayout) -> str:
        """Return why the `reinit` has failed, with its line."""
        name = layout.flat.variable_name(self.variable)
        span = next(r.span for r in layout.events.reinits if self.variable in r.target)
        why = why_not(self.followed, layout.plan.reduced.state_names)
        return f"'{name}' cannot be given a new value by reinit ({span.source.name}, line {span.line}): {why}"


@dataclass(frozen=True, eq=False)
class Happened:
    """The effect of an event.

    Attributes
    ----------
    whens : (when-clause, row) of each branch that was carried out, in order
    terminations : those whose guard was true
    broken : (check of the flat model, row) of those that belong to events and did not hold
    """

    whens: tuple[tuple[int, int], ...]
    terminations: tuple[int, ...]
    broken: tuple[tuple[int, int], ...]
