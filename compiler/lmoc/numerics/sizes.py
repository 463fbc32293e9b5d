"""The size of the motion: absolute tolerances are relative to it, and independent of the choice of units."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.numerics.observe.trajectory import Trajectory
from lmoc.numerics.plan import Plan

Sizes = Mapping[tuple[int, int], float]  # by flat variable and order of the derivative

_LOOSE = 1e-3  # of the size that was assumed: of a smaller motion the absolute tolerance is no small part
_REST = 1e-200  # what is smaller does not move: parts of it are zero in double precision
_NOISE = 1e-6  # of the largest of the same unit: what is smaller is not followed for its own sake


def assumed_sizes(plan: Plan, values: np.ndarray, x: np.ndarray, known: Sizes) -> np.ndarray:
    """Return the sizes (n,) of the integrated components: declared, known from a run before, or 1 or the start's.

    Parameters
    ----------
    x : (n,) at the start
    """
    declared = plan.nominal(values)
    found = np.array([known.get(jet, np.nan) for jet in _jets(plan)])
    found = np.where(np.isfinite(found), found, np.fmax(1.0, np.abs(x)))
    return np.where(np.isfinite(declared), declared, found)


def too_loose(run: Trajectory, values: np.ndarray, known: Sizes) -> Sizes | None:
    """Return the sizes of a motion that was much smaller than what its tolerances had been chosen for, else None.

    Rounding in what should be at rest has no size: components are compared with the others of their unit, and with
    what the forces of laws that hold them miss each other by.
    """
    largest: dict[tuple[int, int], float] = {}
    groups: dict[tuple[str, int], float] = {}
    assumed: dict[tuple[int, int], float] = {}
    noise: dict[tuple[int, int], float] = {}
    length = run.last[0] - run.pieces[0].begin
    for piece in run.pieces:
        plan, (_, states) = piece.observer.plan, piece.samples
        if not len(states):
            continue
        tops = np.abs(np.nan_to_num(states)).max(axis=0)
        sizes = assumed_sizes(plan, values, states[0], known)
        free = ~np.isfinite(plan.nominal(values)) & ~plan.ledger
        flat = piece.observer.flat
        for (variable, order), rounding in zip(_jets(plan), piece.rounding.tolist()):
            for lower in range(order, -1, -1):
                drift = rounding * length ** (order - lower + 1)
                noise[variable, lower] = max(drift, noise.get((variable, lower), 0.0))
        for jet, top, size, own in zip(_jets(plan), tops.tolist(), sizes.tolist(), free.tolist(), strict=True):
            if own:
                largest[jet] = max(top, largest.get(jet, 0.0))
                assumed[jet] = size
                group = flat.block_at(jet[0]).unit if jet[0] >= 0 else "", jet[1]
                groups[group] = max(top, groups.get(group, 0.0))
    if not largest:
        return None
    found = {}
    for jet, top in largest.items():
        group = flat.block_at(jet[0]).unit if jet[0] >= 0 else "", jet[1]
        size = max(top, _NOISE * groups[group])
        found[jet] = size if size > max(_REST, noise.get(jet, 0.0)) else assumed[jet]
    return found if any(found[jet] < _LOOSE * assumed[jet] for jet in found) else None


def _jets(plan: Plan) -> list[tuple[int, int]]:
    table = plan.reduced.registers
    return list(zip(table.variable[plan.states].tolist(), table.order[plan.states].tolist(), strict=True))
