"""What holds at one point: the forces of laws with which a nonlinear scene is at rest there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmoc.symbolic.laws.statics import ZERO, AffineRows, Array, LawChoice, Polyhedra, Statics, conditions

ROUNDING = 1e-12  # of what is compared


def holds(statics: Statics, x: Array, choice: LawChoice) -> bool:
    """Return whether there are forces with which a choice holds at a point."""
    equal, least = _all_conditions(statics, choice)
    force = _forces(equal, x)
    if force is None:  # some of them may do
        return Polyhedra(_about_point(statics, x)).has_point(choice)
    z = np.concatenate([x, force])
    sizes = np.concatenate([np.abs(x), np.maximum(np.abs(force).max(initial=0.0), _able(equal, x))])
    value = np.array([row @ z + c for row, c in equal + least])
    size = np.array([np.abs(row) @ sizes + abs(c) for row, c in equal + least])
    balanced = np.abs(value[: len(equal)]) <= ZERO * size[: len(equal)]
    return bool(balanced.all() and (value[len(equal) :] >= -ROUNDING * size[len(equal) :]).all())


def held_forces(statics: Statics, x: Array, choice: LawChoice) -> Array:
    """Return the forces, (laws,), with which a point is at rest; NaN where they are not determined."""
    force = _forces(_all_conditions(statics, choice)[0], x)
    return np.full(statics.laws, np.nan) if force is None else force


def _all_conditions(
    statics: Statics, choice: LawChoice
) -> tuple[list[tuple[Array, float]], list[tuple[Array, float]]]:
    """Return what vanishes at rest, and what is not negative."""
    equal = [statics.rates[k] for k in range(statics.states)]
    least: list[tuple[Array, float]] = []
    for law in range(statics.laws):
        own_equal, own_least = conditions(statics, choice, law)
        equal, least = equal + own_equal, least + own_least
    return equal, least


def _forces(equal: list[tuple[Array, float]], x: Array) -> Array | None:
    """Return the forces that come nearest to what vanishes at a point; None where they are not determined."""
    matrix = np.array([row for row, _ in equal])
    constant = matrix[:, : len(x)] @ x + np.array([c for _, c in equal])
    force, _, rank, _ = np.linalg.lstsq(matrix[:, len(x) :], -constant, rcond=None)
    found: Array | None = None if rank < matrix.shape[1] - len(x) else force
    return found


def _able(equal: list[tuple[Array, float]], x: Array) -> Array:
    """Return the forces, (laws,), that could balance the largest terms at a point: rounding is a part of them.

    A law that is open carries what the rounding of a root leaves, which is all that there is of forces.
    """
    matrix, n = np.array([row for row, _ in equal]), len(x)
    terms = np.abs(matrix[:, :n]) @ np.abs(x) + np.abs([c for _, c in equal])
    acts = np.abs(matrix[:, n:])
    found: Array = np.divide(terms[:, None], acts, out=np.zeros_like(acts), where=acts > 0).max(axis=0, initial=0.0)
    return found


def _about_point(statics: Statics, x: Array) -> Statics:
    """Return the conditions with the states held: in the forces alone."""

    def held(rows: AffineRows) -> AffineRows:
        constant = rows.constant + rows.matrix[:, : statics.states] @ x
        matrix = rows.matrix.copy()
        matrix[:, : statics.states] = 0.0
        return AffineRows(matrix, constant)

    parts = {name: held(getattr(statics, name)) for name in ("rates", "motion", "slip", "stick")}
    return replace(statics, **parts)
