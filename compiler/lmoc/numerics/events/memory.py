"""What events and laws know before an instant, with which it can be repeated."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.events.event_handler import HandlerMemory
from lmoc.numerics.laws.switching import LawSwitching
from lmoc.numerics.plan.plan import Plan
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Memory:
    """What events and laws know before an instant.

    Attributes
    ----------
    plan, values, open, laws : as of `HybridDynamics`
    reached : s, the instant before
    law_roots : how many root functions are the laws'
    push : (laws,) as of `Mode`
    next : s, of the next time event
    of_laws, of_handler, stepping : what each of them knows
    """

    plan: Plan
    values: np.ndarray
    open: np.ndarray
    reached: float
    law_roots: int
    push: np.ndarray
    next: float
    laws: LawSwitching | None
    of_laws: dict[str, np.ndarray] | None
    of_handler: HandlerMemory | None
    stepping: int


Begun = tuple[Memory, np.ndarray]  # what is known where laws are to take their modes, and the states (n,) there
