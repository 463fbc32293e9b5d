"""The size of the motion: absolute tolerances are relative to it, and independent of the choice of units.

The elements of an array are alike and have one size: the nodes of a swinging chain are no motions of their own.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.slices import Evaluate, slice_of
from lmoc.numerics.observe.trajectory import SegmentRecord, Trajectory
from lmoc.numerics.plan.plan import Plan

Array = tuple[int, int]  # declared name (index of its block) and order of the derivative; -1 for what has no name
Sizes = Mapping[Array, float]

ABSOLUTE = 1e-3  # absolute tolerance: this part of the size of a motion, times the relative one
_LOOSE = 1e-3  # of the size that was assumed: of a smaller motion the absolute tolerance is no small part
_LOOKED_AT = 5  # places of a segment at which rounding of the rates is judged
_EPSILON = 2e-16  # relative rounding of a number
_MARGIN = 1e3  # so many times as much the stages of a step may make of it
_REST = 1e-200  # what is smaller does not move: parts of it are zero in double precision
_NOISE = 1e-6  # of the largest of the same unit: what is smaller is not followed for its own sake

_TIED = 1.0  # the same where closures tie the coordinates: one that stays at rest is known as well as the others


def assumed_sizes(plan: Plan, values: np.ndarray, x: np.ndarray, known: Sizes) -> np.ndarray:
    """Return the sizes of the integrated components: declared, known from a run before, or 1 or the start's.

    Parameters
    ----------
    values, x : (flat.count,) parameters and (n,) states at the start, for (n,); or (flat.count, runs) and (runs, n)
    """
    found = np.fmax(1.0, np.abs(x))
    if known:
        arrays, number = plan.once(_arrays)
        before = np.array([known.get(array, np.nan) for array in arrays])[number]
        found = np.where(np.isfinite(before), before, found)
    if not plan.reduced.flat.nominals:
        return found
    declared = plan.nominal(values).T
    return np.where(np.isfinite(declared), declared, found)


def too_loose(run: Trajectory, values: np.ndarray, known: Sizes, rtol: float) -> Sizes | None:
    """Return the sizes of a motion that was much smaller than what its tolerances had been chosen for, else None.

    Rounding in what should be at rest has no size: components are compared with the others of their unit, and with
    what the forces that hold them miss each other by. No size asks for a tolerance below the rounding of the motion:
    what is near an equilibrium may owe its whole motion to the errors of a pass with long steps.

    Parameters
    ----------
    rtol : relative tolerance of the run
    """
    if not any(_is_small(segment, values, known) for segment in run.segments):
        return None
    largest: dict[Array, float] = {}
    assumed: dict[Array, float] = {}
    for segment in run.segments:
        for array, top, size in _extents(segment, values, known):
            largest[array] = max(top, largest.get(array, 0.0))
            assumed[array] = size
    groups: dict[tuple[str, int], float] = {}
    for array, top in largest.items():
        group = _group(run.flat, array)
        groups[group] = max(top, groups.get(group, 0.0))
    noise = _TIED if any(p.reduced.in_all_coordinates for p in run.segments) else _NOISE
    met = {array: max(top, noise * groups[_group(run.flat, array)]) for array, top in largest.items()}
    if not any(met[array] < _LOOSE * assumed[array] for array in met):
        return None
    drift = _drift(run)
    found = dict(assumed)
    for array, size in met.items():
        moved = drift.get(array, 0.0)
        if size > max(_REST, moved):
            found[array] = max(size, min(assumed[array], moved / (_MARGIN * ABSOLUTE * rtol)))
    return found if any(found[array] < _LOOSE * assumed[array] for array in found) else None


def _drift(run: Trajectory) -> dict[Array, float]:
    """Return how far rounding in the forces may have moved each array, and the one it is the rate of."""
    length, drift = run.last[0] - run.segments[0].begin, {}
    for segment in run.segments:
        rounding = _rounding(segment)
        if segment.rounding is not None:
            rounding = np.fmax(rounding, segment.rounding)
        arrays, number = segment.observer.plan.once(_arrays)
        for k, rate in zip(number.tolist(), rounding.tolist(), strict=True):
            block, order = arrays[k]
            for lower in range(order + 1):
                way = rate * length ** (order - lower + 1)
                drift[block, lower] = max(way, drift.get((block, lower), 0.0))
    return drift


def _rounding(segment: SegmentRecord) -> np.ndarray:
    """Return what rounding of the states makes of their rates (n,): forces in equilibrium cancel up to it."""
    observer, (times, states) = segment.observer, segment.samples
    plan = observer.plan
    few = np.unique(np.linspace(0, len(times) - 1, _LOOKED_AT).astype(int)) if len(times) else np.zeros(0, int)
    if not len(few):
        return np.zeros(len(plan.states))
    rates = _rates(observer)
    # neighbours move against each other, or pairs of them (a coordinate and its rate), or all alike
    number = np.arange(len(plan.states))
    ways = [np.where(number // size % 2, 1.0, -1.0) for size in (1, 2, len(number))]
    with np.errstate(all="ignore"):
        middle = rates(times[few], states[few])
        beside = [rates(times[few], states[few] * (1 + _EPSILON * signs)) for signs in ways]
        return np.nan_to_num(_MARGIN * np.fmax.reduce([np.abs(b - middle).max(axis=0) for b in beside]))


def _rates(observer: Observer) -> Evaluate:
    plan = observer.plan
    if plan.reduced.switched is None:
        return slice_of(plan, plan.derivatives).bind(observer.base, observer.signals)
    from lmoc.numerics.laws.reading import rates  # imported late: most scenes have no laws

    return rates(plan, observer.base, observer.signals)


def _is_small(segment: SegmentRecord, values: np.ndarray, known: Sizes) -> bool:
    """Return whether some component stays well below its assumed size, as one at least does where `too_loose` is."""
    plan, (start, tops) = segment.observer.plan, _magnitudes(segment)
    if not len(tops):
        return False
    return bool(is_small(tops, assumed_sizes(plan, values, start, known), plan.ledger))


def is_small(tops: np.ndarray, assumed: np.ndarray, ledger: np.ndarray) -> np.ndarray:
    """Return whether some component, the ledger's (n,) left out, stays well below its assumed size.

    Parameters
    ----------
    tops, assumed : (…, n) the largest magnitudes met, and the sizes
    """
    return (tops < _LOOSE * assumed)[..., ~ledger].any(axis=-1)


def _magnitudes(segment: SegmentRecord) -> tuple[np.ndarray, np.ndarray]:
    """Return a state of a segment, and the largest magnitude of each component, at its steps where these are known."""
    states = segment.samples[1]
    if segment.largest is not None:
        states = np.concatenate([states, segment.largest[None]])
    return (states[0], np.fmax.reduce(np.abs(states))) if len(states) else (np.zeros(0), np.zeros(0))


def _extents(segment: SegmentRecord, values: np.ndarray, known: Sizes) -> list[tuple[Array, float, float]]:
    """Return the largest value in a segment, and the assumed size, of each array whose size is not declared."""
    plan, (start, tops) = segment.observer.plan, _magnitudes(segment)
    if not len(tops):
        return []
    arrays, number = plan.once(_arrays)
    free = np.flatnonzero(~np.isfinite(plan.nominal(values)) & ~plan.ledger)
    top, size = np.full(len(arrays), -1.0), np.zeros(len(arrays))
    np.fmax.at(top, number[free], tops[free])
    np.fmax.at(size, number[free], assumed_sizes(plan, values, start, known)[free])
    return [e for e in zip(arrays, top.tolist(), size.tolist(), strict=True) if e[1] >= 0.0]


def _arrays(plan: Plan) -> tuple[list[Array], np.ndarray]:
    """Return the arrays that the integrated components belong to, and which of them (n,) each does."""
    table, flat = plan.reduced.registers, plan.reduced.flat
    variable, order = table.variable[plan.states], table.order[plan.states].tolist()
    block = np.where(variable >= 0, flat.block_of[variable], -1).tolist()
    numbers: dict[Array, int] = {}
    number = [numbers.setdefault(array, len(numbers)) for array in zip(block, order, strict=True)]
    return list(numbers), np.array(number, int)


def _group(flat: FlatDAE, array: Array) -> tuple[str, int]:
    """Return the unit of an array, with the order of the derivative."""
    block, order = array
    return flat.blocks[block].unit if block >= 0 else "", order
