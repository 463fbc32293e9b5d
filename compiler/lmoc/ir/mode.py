"""A mode: which laws of a flat model are closed, the equations that then hold, and what it is called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmoc.expression.dag import ZERO, Expr, const, function, mul, neg, slot
from lmoc.ir.flat import Block, FlatDAE, Group, Kind
from lmoc.ir.law import COMPLEMENTARY, LawKind, Laws, law_count

ORIGIN = "law"
WORDS = {"release": "open", "unlock": "unlocked", "lock": "locked"}  # modes whose names are not those of the events

REVERSAL = "reversal"  # of friction that slips on, the other way


def law_rows(flat: FlatDAE, groups: tuple[Laws, ...]) -> list[tuple[str, Laws]]:
    """Return the name of each law's part, and its group."""
    return [(_owner(flat, int(v)), g) for g in groups for v in g.force]


def law_names(flat: FlatDAE, groups: tuple[Laws, ...]) -> list[str]:
    """Return a name for each law: that of its part, or of its force where the part has several laws."""
    parts = [name for name, _ in law_rows(flat, groups)]
    forces = [flat.variable_name(int(v)) for g in groups for v in g.force]
    return [force if parts.count(part) > 1 else part for part, force in zip(parts, forces, strict=True)]


def mode_word(laws: Laws, closed: bool) -> str:
    """Return what the mode of one law is called, such as taut or slack."""
    word = laws.closing if closed else laws.opening
    return WORDS.get(word, word)


def event_word(laws: Laws, was: bool, now: bool) -> str:
    """Return what it is called that the mode of a law changes; friction that goes on the other way opens nothing."""
    return laws.closing if now else laws.opening if was else REVERSAL


def mode_words(flat: FlatDAE, groups: tuple[Laws, ...], closed: np.ndarray) -> dict[str, str]:
    """Return {law name: what its mode is called}."""
    rows = zip(law_names(flat, groups), law_rows(flat, groups), closed, strict=True)
    return {name: mode_word(laws, bool(own)) for name, (_, laws), own in rows}


def _owner(flat: FlatDAE, force: int) -> str:
    """Return the name of the part that has a force; that of the force itself at the top of the model."""
    name = flat.variable_name(force)
    own = flat.block_at(force).path[-1][0]  # of an argument that is an expression, with dots of its own
    return name[: name.rindex(own)].rstrip(".") or name


def with_mode(flat: FlatDAE, closed: np.ndarray, direction: np.ndarray | None = None) -> FlatDAE:
    """Return the flat model with one equation for each law.

    An open complementarity has ``force = 0``; slipping friction has ``force = -direction·limit``, where `direction` is
    a discrete variable, so that both directions are one mode, unless it is given. A closed law has ``motion = 0``: of a
    gap on position level, which index reduction differentiates, of a velocity on velocity level, so that the position
    that has been reached stays a state.

    Parameters
    ----------
    flat : without a mode so far
    closed : (laws,) bool, in the order of `flat.laws` and their rows
    direction : (laws,) in which friction slips, -1 or 1; 0 for the sign of its velocity, as a person writes it
    """
    if flat.closed is not None:
        raise ValueError("the flat model has a mode already")
    if len(closed) != law_count(flat.laws):
        raise ValueError(f"{law_count(flat.laws)} laws, but the mode has {len(closed)}")
    groups, first = list(flat.groups), 0
    for laws in flat.laws:
        rows = slice(first, first + laws.rows)
        own = np.asarray(closed[rows], bool)
        first += laws.rows
        groups += [_closed(laws, np.flatnonzero(own))]
        if direction is None or laws.kind in COMPLEMENTARY:
            groups += [_open(laws, np.flatnonzero(~own), slot(1), "direction")]
            continue
        for way in (-1, 0, 1):
            sense = const(way) if way else function("sign", slot(1))
            groups += [_open(laws, np.flatnonzero(~own & (direction[rows] == way)), sense, "motion")]
    groups = [g for g in groups if g.rows]
    blocks = flat.blocks if direction is None else _without_directions(flat)
    return replace(flat, blocks=blocks, groups=tuple(groups), closed=np.asarray(closed, bool))


def _without_directions(flat: FlatDAE) -> tuple[Block, ...]:
    """Return the blocks with the laws' directions as constants, which no equation uses."""
    held = {int(v) for laws in flat.laws if laws.direction is not None for v in laws.direction}
    return tuple(replace(b, kind=Kind.CONSTANT) if b.size and b.offset in held else b for b in flat.blocks)


def _closed(laws: Laws, rows: np.ndarray) -> Group:
    return _group(laws, rows, ZERO, "motion")


def _open(laws: Laws, rows: np.ndarray, sense: Expr, second: str) -> Group:
    """Return the equation of an open law; `sense` is the direction of slipping, over the column `second`."""
    if laws.kind in COMPLEMENTARY:
        return _group(laws, rows, ZERO, "force")
    if laws.kind is LawKind.DRY_FRICTION:
        return _group(laws, rows, neg(mul(sense, slot(2))), "force", second, "slip")
    limit = mul(slot(2), slot(3))
    return _group(laws, rows, neg(mul(sense, limit)), "force", second, "friction", "normal")


def _group(laws: Laws, rows: np.ndarray, right: Expr, *names: str) -> Group:
    """``first column = right`` for some rows, over the named columns."""
    columns = laws.columns()
    return Group(slot(0), right, np.stack([columns[n][rows] for n in names], axis=1), laws.span, laws.part, ORIGIN)
