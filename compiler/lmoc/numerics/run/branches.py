"""Where the nonlinear blocks stand along a segment: those, too, that its motion does not depend on.

The integration solves the blocks that the motion needs. Others (the rocker without mass that a crank moves) are
followed along the way from where the segment has begun: a linkage closes in several ways, and an angle may have turned
round many times since.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.coordinates.change import all_unknowns, block_unknowns, with_solutions
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.slices import slice_of
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.task.task import Segment


def _idle_unknowns(plan: Plan) -> np.ndarray:
    """Return the registers of the unknowns of the nonlinear blocks that the motion does not depend on."""
    return np.setdiff1d(all_unknowns(plan), plan.once(block_unknowns))


def idle_solutions(segment: Segment, t: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the unknowns of the blocks that the motion does not depend on, and their solutions where it stands.

    Those that cannot be followed up to there are left out.

    Parameters
    ----------
    t, x : s, (n,) a place of the segment, behind all of its output times so far
    """
    unknowns = segment.plan.once(_idle_unknowns)
    if not len(unknowns):
        return unknowns, np.zeros(0)
    old = segment.observer
    path = old.path if segment.watch is None else segment.watch.path
    along = Observer(old.plan, old.values, old.base, old.signals, path)
    times, states = segment.recorder.sampled()
    before = times < t
    times, states = np.append(times[before], t), np.vstack([states[before], x])
    found = along.followed(slice_of(old.plan, unknowns))(times, states)[-1]
    known = np.isfinite(found)
    return unknowns[known], found[known]


def standing(segment: Segment, t: float, x: np.ndarray) -> Observer:
    """Return the observer of a segment with such blocks where they stand at a place; parameters as above."""
    unknowns, found = idle_solutions(segment, t, x)
    old = segment.observer
    if not len(unknowns):
        return old
    return Observer(old.plan, old.values, with_solutions(old.base, unknowns, found), old.signals)
