"""Whole turns that leave all constraints as they are, and the ones that bring angles nearest to what is wished.

Where one end of a loop follows from the other by sines and cosines, some angles may be whole turns larger or smaller:
the integer vectors by which they may are a lattice, the null space of the linear constraints between angles over the
integers (Cohen, A Course in Computational Algebraic Number Theory, 1993, chapter 2.4). The nearest point of it is found
by rounding (Babai, Combinatorica 6, 1986), by looking at the neighbours as long as one of them is nearer, and for few
turns by looking at all that can be nearer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from itertools import combinations

import numpy as np

from lmoc.structure.linear.generic import spread
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

TURN = 2 * np.pi
_SAME = 1e-9  # of the size of a row's terms: rounding
_RATIO = 64  # the largest denominator of a ratio between angles, as of gears
_MARGIN = 1e-6  # of a turn, and of what is missed
_ROUNDS = 100  # of looking at neighbours
_EXACT, _NODES = 16, 2000  # turns whose combinations are all looked at, and as many of them at the most
_LATER = 1e-3  # how little a level counts beside the one before, where not all combinations are looked at


@dataclass(frozen=True, eq=False)
class Turns:
    """The whole turns that leave the constraints as they are.

    Attributes
    ----------
    angle : (n,) mask of the unknowns that the constraints take as angles
    basis : (k, n) integers: so many turns each
    """

    angle: np.ndarray
    basis: np.ndarray


def turns(
    residual: Callable[[np.ndarray], np.ndarray],
    dense: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    begin: np.ndarray,
    held: np.ndarray,
) -> Turns:
    """Return the angles among the unknowns of some constraints, and their turns.

    Parameters
    ----------
    residual, dense : the constraints at points (…, n)
    begin : (n,) a point; they are looked at beside it
    held : (n,) mask of the unknowns that stay as they are
    """
    n = len(begin)
    points = begin + np.stack([spread(n, k + 1) - 0.5 for k in range(2)])
    at, jacobian = dense(points)
    size = np.abs(jacobian).max(axis=(0, 2), initial=0.0) * (1.0 + np.abs(points).max(initial=0.0))
    constant = np.abs(jacobian[1] - jacobian[0]) <= _SAME * size[:, None]
    there = (np.abs(jacobian) > 0).any(axis=0)
    moved = residual(points[0] + TURN * np.eye(n))  # (n, rows)
    unchanged = (np.abs(moved - at[0]).T <= 1e-7 * size[:, None]) & np.isfinite(moved).T
    periodic = there & ~constant & unchanged
    frozen = (there & ~constant & ~unchanged).any(axis=0)
    angle = periodic.any(axis=0) & ~frozen
    straight = (there <= constant).all(axis=1) & there.any(axis=1)  # rows that are linear altogether
    entries = np.where(there & constant, jacobian[0], 0.0)
    while True:
        named = straight & (entries[:, angle] != 0).any(axis=1)
        more = angle | ((entries[named] != 0).any(axis=0) & ~frozen)
        if (more == angle).all():
            break
        angle = more
    free = np.flatnonzero(angle & ~held)
    rows = _integer_rows(entries[:, free])
    if rows is None:
        return Turns(angle, np.zeros((0, n), np.int64))
    basis = np.zeros((0, n), np.int64)
    _, inner = _echelon(rows, len(free))
    if len(inner):
        basis = np.zeros((len(inner), n), np.int64)
        basis[:, free] = inner
    return Turns(angle, basis)


def _integer_rows(entries: np.ndarray) -> list[dict[int, int]] | None:
    """The rows as multiples of whole numbers, {column: number}; None where some are not."""
    rows = []
    for row in entries:
        columns = np.flatnonzero(row)
        if not len(columns):
            continue
        least = np.abs(row[columns]).min()
        ratios = [Fraction(float(v / least)).limit_denominator(_RATIO) for v in row[columns]]
        if any(abs(float(f) - v / least) > 1e-9 * abs(v / least) for f, v in zip(ratios, row[columns], strict=True)):
            return None
        common = int(np.lcm.reduce([f.denominator for f in ratios]))
        rows.append({int(c): int(f * common) for c, f in zip(columns, ratios, strict=True)})
    return rows


def _echelon(rows: list[dict[int, int]], n: int) -> tuple[np.ndarray, np.ndarray]:
    """A basis of all integer vectors, by unimodular steps on columns (Euclid's algorithm).

    Returns
    -------
    moved : (r, n) such that the rows are independent on them
    null : (n - r, n) those that the rows map to zero
    """
    vectors, moved = [{k: 1} for k in range(n)], []
    for row in rows:
        value = [sum(row.get(k, 0) * v for k, v in vector.items()) for vector in vectors]
        active = [k for k, v in enumerate(value) if v]
        while len(active) > 1:
            least = min(active, key=lambda k: abs(value[k]))
            for k in active:
                if k != least:
                    times = value[k] // value[least]
                    value[k] -= times * value[least]
                    for j, v in vectors[least].items():
                        vectors[k][j] = vectors[k].get(j, 0) - times * v
            active = [k for k in active if value[k]]
        if active:
            moved.append(vectors.pop(active[0]))
    return _table(moved, n), _table(vectors, n)


def _table(vectors: list[dict[int, int]], n: int) -> np.ndarray:
    """Vectors as the rows (k, n) of a table."""
    table = np.zeros((len(vectors), n), np.int64)
    for k, vector in enumerate(vectors):
        table[k, list(vector)] = list(vector.values())
    return table


def nearest_turns(missed: np.ndarray, steps: np.ndarray, size: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Integers z (k,) that bring values nearest to what is wished: those of the lowest level first.

    Parameters
    ----------
    missed : (f,) weighted distances from what is wished; their sum of squares counts
    steps : (k, f) integers: how often one turn of each basis vector turns each of the values
    size : (f,) what one turn adds to the distances
    level : (f,) what counts first: the values of the next level choose among what is equally near in those before
    """
    if len(steps) > _EXACT:
        weight = _LATER ** level.astype(float)
        return _nearby(missed * weight, steps * (size * weight)).astype(np.int64)
    z, free = np.zeros(len(steps), np.int64), np.eye(len(steps), dtype=np.int64)
    for own in (level == k for k in distinct(level).tolist()):
        effect = z @ steps[:, own]
        moving, free = _split(free, free @ steps[:, own])
        left, moves = missed[own] + effect * size[own], moving @ steps[:, own] * size[own]
        start = _nearby(left, moves)
        z = z + (start + _nearest_point(left + start @ moves, moves)).astype(np.int64) @ moving
    return z


def _split(vectors: np.ndarray, effect: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Another basis of the same lattice: vectors whose effects are independent, and such without an effect."""
    rows = [{int(k): int(v) for k, v in enumerate(column) if v} for column in effect.T]
    moving, still = _echelon([row for row in rows if row], len(vectors))
    return moving @ vectors, still @ vectors


def _nearby(missed: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Integers that make ``|missed + z @ effect|`` small: rounded, and then improved step by step."""
    if not len(effect):
        return np.zeros(0)
    # of +180 and -180 degrees the first, whatever rounding makes of them
    z: np.ndarray = np.ceil(np.linalg.lstsq(effect.T, -missed, rcond=1e-12)[0] - 0.5 + _MARGIN)
    single = list(np.eye(len(z)))
    if len(z) <= _EXACT:
        single += [a + sign * b for a, b in combinations(list(np.eye(len(z))), 2) for sign in (1, -1)]
    steps = np.array([sign * s for s in single for sign in (1, -1)])
    moves = steps @ effect
    left = missed + z @ effect
    for _ in range(_ROUNDS):
        cost = ((left + moves) ** 2).sum(axis=1)
        k = int(np.argmin(cost))
        if cost[k] >= (1 - _MARGIN) * (left**2).sum():
            break
        z, left = z + steps[k], left + moves[k]
    return z


def _nearest_point(left: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Integers z (k,) that make ``|left + z @ effect|`` least; zero unless others are nearer by the margin.

    Depth first from the last row of a triangular factor, the nearest integers first, and no further than what has been
    found (Schnorr and Euchner; Agrell, Eriksson, Vardy and Zeger, IEEE Trans. Information Theory 48, 2002).
    """
    k = len(effect)
    q, factor = np.linalg.qr(effect.T)
    r, aim = factor.tolist(), (-(q.T @ left)).tolist()
    fixed = max(float(left @ left) - sum(a * a for a in aim), 0.0)  # what no turn changes
    best, bound, nodes, z = [0] * k, (1 - _MARGIN) * float(left @ left) - fixed, 0, [0] * k

    def descend(row: int, so_far: float) -> None:
        nonlocal best, bound, nodes
        if row < 0:
            best, bound = z.copy(), so_far - _MARGIN * (so_far + fixed)
            return
        rest = aim[row] - sum(r[row][j] * z[j] for j in range(row + 1, k))
        first = math.ceil(rest / r[row][row] - 0.5 + _MARGIN)
        towards = 1 if rest / r[row][row] >= first else -1
        for step in range(_NODES):  # first, first + 1, first - 1, first + 2, …
            z[row] = first + towards * (step // 2 + step % 2) * (1 if step % 2 else -1)
            cost = so_far + (rest - r[row][row] * z[row]) ** 2
            nodes += 1
            if cost >= bound or nodes > _NODES:
                break
            descend(row - 1, cost)

    descend(k - 1, 0.0)
    return np.array(best, float)
