"""The record of an event in a run."""

from __future__ import annotations

from lmoc.support.records import dataclass

STEP = "step"  # kind of a jump of velocities that a step or a kink of what is prescribed makes


@dataclass(frozen=True)
class Event:
    """Something that happened at an instant.

    Attributes
    ----------
    time : s
    name : the part, or the condition, that it happened to
    kind : taut, slack, contact, release, impact, stick, slip, lock, unlock, reversal (of friction that slips on, the
        other way), when, time, accumulation, start, step, …
    before, after : names of the mode
    impulse : along the law, ≥ 0: N·s or N·m·s
    energy_lost : J
    note : what deserves a word, such as the law of an impact
    passed_on : (name, impulse) of laws that were closed, have remained so, and have passed the impact on
    """

    time: float
    name: str
    kind: str
    before: str = ""
    after: str = ""
    impulse: float = 0.0
    energy_lost: float = 0.0
    note: str = ""
    passed_on: tuple[tuple[str, float], ...] = ()
