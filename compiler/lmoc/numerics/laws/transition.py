"""Transitions: what happens to the laws of a scene at an instant (``engine/c/transition.c``)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.law import JENKINS
from lmoc.numerics.laws.complementarity import Array
from lmoc.numerics.laws.contact_in_c import Asked
from lmoc.numerics.laws.instant import ContactKinematics, Instant, Mask
from lmoc.numerics.laws.jenkins import Relaxed, decide, relax
from lmoc.numerics.laws.mode import Settled, SettledInC
from lmoc.numerics.problem.mode import Mode
from lmoc.support.records import dataclass

_IMPACT_LAWS = ("Newton", "Poisson")


@dataclass(frozen=True, eq=False)
class Trigger:
    """The reason for the end of a segment.

    Attributes
    ----------
    closing : (n,) open laws whose gap or sliding velocity has come to zero
    opening : (n,) laws whose force has come to its end here; those that have opened at the same time before among them
    direction : (n,) in which friction among them begins to slide
    jumped : the states have been changed from outside: what is closed may move
    """

    closing: Mask
    opening: Mask
    direction: NDArray[np.int64]
    jumped: bool = False

    @classmethod
    def nothing(cls, count: int) -> Trigger:
        return cls(np.zeros(count, bool), np.zeros(count, bool), np.zeros(count, int))


@dataclass(frozen=True, eq=False)
class Transition:
    """The consequences of an instant.

    Attributes
    ----------
    before, now : the instants before and behind the impulses, moved onto what is closed
    settled : the new mode with its forces
    impulse, lost : (n,) along the laws, and the energy that each takes out
    impact_law : name of the law of impact, empty without one
    touched : (n,) laws whose motion, the gap or the velocity that closes it, is zero
    accumulated : (n,) laws whose bounces are over
    until : s, when those bounces would have ended
    undecided : (n,) laws that would be left with other rates if they were hit one after the other
    """

    before: Instant
    now: Instant
    settled: Settled
    impulse: Array
    lost: Array
    impact_law: str
    touched: Mask
    accumulated: Mask
    until: float
    undecided: Mask

    @property
    def x(self) -> Array:
        return self.now.x

    @property
    def mode(self) -> Mode:
        return self.settled.mode


class _Trigger(ctypes.Structure):
    """``lmoc_trigger``."""

    _fields_ = [
        *[(name, ctypes.c_void_p) for name in ("closing", "opening", "direction")],
        ("jumped", ctypes.c_int64),
    ]


class _Changed(ctypes.Structure):
    """``lmoc_changed``."""

    _fields_ = [
        ("settled", SettledInC),
        *[(name, ctypes.c_void_p) for name in ("before", "x", "bias", "impulse", "lost")],
        *[(name, ctypes.c_void_p) for name in ("touched", "accumulated", "undecided")],
        ("until", ctypes.c_double),
        ("law", ctypes.c_int64),
    ]


def transition(
    kinematics: ContactKinematics, t: float, x: Array, mode: Mode, trigger: Trigger, unresolved: Array | float = 0.0
) -> Transition:
    """Return what follows at an instant.

    Parameters
    ----------
    unresolved : (states,) what the integrator tells the states apart by no more, such as a multistep method that has
        just begun

    Raises
    ------
    Contradiction
        The laws contradict each other.
    """
    n, asked = len(mode.closed), Asked(kinematics, unresolved)
    masks = [np.ascontiguousarray(v, bool) for v in (mode.closed, trigger.closing, trigger.opening)]
    direction = np.ascontiguousarray(trigger.direction, np.int64)
    settled = Settled.empty(n)
    before, behind = np.empty((2, len(x)))
    bias, impulse, lost = np.empty((3, n))
    touched, accumulated, undecided = np.zeros((3, n), bool)
    arrays = before, behind, bias, impulse, lost, touched, accumulated, undecided
    given = _Trigger(masks[1].ctypes.data, masks[2].ctypes.data, direction.ctypes.data, trigger.jumped)
    found = _Changed(settled.in_c, *(a.ctypes.data for a in arrays))
    if (kinematics.table.degree == JENKINS).any():
        _with_springs(asked, mode, trigger, settled)
    asked.call(
        "lmoc_transition", settled.laws, t, np.ascontiguousarray(x), masks[0], ctypes.addressof(given),
        ctypes.addressof(found),
    )  # fmt: skip
    law = _IMPACT_LAWS[found.law] if found.law >= 0 else ""
    return Transition(
        asked.instant(before), asked.instant(behind), settled, impulse, lost, law, touched, accumulated,
        float(found.until), undecided,
    )  # fmt: skip


def _with_springs(asked: Asked, mode: Mode, trigger: Trigger, settled: Settled) -> None:
    """Have friction between springs give way and decide."""
    kept: list[Relaxed] = []

    def give_way(now: Instant) -> tuple[Array, Array]:
        kept.append(relax(asked.kinematics, now, mode, trigger.opening, trigger.direction))
        return kept[0].now.x, kept[0].lost

    asked.springs(give_way, lambda now: settled.take(decide(asked.kinematics, kept[0].behind(now), settled.mode)))
