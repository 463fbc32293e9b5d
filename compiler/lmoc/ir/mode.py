"""A mode: which laws of a flat model are closed, and the equations that then hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmoc.expression.dag import ZERO, Expr, mul, neg, slot
from lmoc.ir.flat import FlatDAE, Group
from lmoc.ir.law import COMPLEMENTARY, LawKind, Laws, law_count

ORIGIN = "law"


def with_mode(flat: FlatDAE, closed: np.ndarray) -> FlatDAE:
    """The flat model with one equation for each law.

    An open complementarity has ``force = 0``; slipping friction has ``force = -direction·limit``, where `direction` is
    a discrete variable, so that both directions are one mode. A closed law has ``motion = 0``: of a gap on position
    level, which index reduction differentiates, of a velocity on velocity level, so that the position that has been
    reached stays a state.

    Parameters
    ----------
    flat : without a mode so far
    closed : (laws,) bool, in the order of `flat.laws` and their rows
    """
    if flat.closed is not None:
        raise ValueError("the flat model has a mode already")
    if len(closed) != law_count(flat.laws):
        raise ValueError(f"{law_count(flat.laws)} laws, but the mode has {len(closed)}")
    groups, first = list(flat.groups), 0
    for laws in flat.laws:
        own = np.asarray(closed[first : first + laws.rows], bool)
        first += laws.rows
        groups += [g for g in (_open(laws, np.flatnonzero(~own)), _closed(laws, np.flatnonzero(own))) if g.rows]
    return replace(flat, groups=tuple(groups), closed=np.asarray(closed, bool))


def _closed(laws: Laws, rows: np.ndarray) -> Group:
    return _group(laws, rows, ZERO, "motion")


def _open(laws: Laws, rows: np.ndarray) -> Group:
    if laws.kind in COMPLEMENTARY:
        return _group(laws, rows, ZERO, "force")
    if laws.kind is LawKind.DRY_FRICTION:
        return _group(laws, rows, neg(mul(slot(1), slot(2))), "force", "direction", "slip")
    limit = mul(slot(2), slot(3))
    return _group(laws, rows, neg(mul(slot(1), limit)), "force", "direction", "friction", "normal")


def _group(laws: Laws, rows: np.ndarray, right: Expr, *names: str) -> Group:
    """``first column = right`` for some rows, over the named columns."""
    columns = laws.columns()
    return Group(slot(0), right, np.stack([columns[n][rows] for n in names], axis=1), laws.span, laws.part, ORIGIN)
