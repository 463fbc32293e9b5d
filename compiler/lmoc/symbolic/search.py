"""Zeros of a few functions from many starts by Newton's method, and the families that they lie in.

Where the Jacobian is singular at a zero, it may be one of a family: a trolley that may stand anywhere. The unknowns in
which the null space is largest are moved a little and held, and the others are sought again; where they are found,
those unknowns are free, and the family is represented by its member at which they are zero.

How far is searched, and what counts as the same place, follows the size of the scene: a mast of 100 m, a comb of 1 µm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.numerics.limits import INFINITE
from lmoc.numerics.start.targets import own_starts
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    import sympy

_REACH = 10.0  # half the side of the box that is searched, in SI units …
_SIZES = 3.0  # … and in sizes of the scene, where that is more
_LOOKED_AT = 5  # starts at which the sizes of equations are taken
_SMALL = 1e3  # sizes of the scene: a metre is no larger than so many of them
SINGULAR = 1e-7  # of the largest singular value
STEPS = 60  # of Newton's method
_NOTHING = 1e-9  # of the size of the scene, or radians: what rounding leaves of zero
ASIDE = (0.05, -0.11, 0.23)  # how far along a family other members are looked for

Functions = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Rest:
    """A zero, or a family of them.

    Attributes
    ----------
    at : (n,) the zero; of a family the member at which the free unknowns are zero
    free : indices of the unknowns that may have any value
    along : (n, len(free)) how the unknowns change with the free ones
    straight : whether they do so everywhere
    """

    at: np.ndarray
    free: tuple[int, ...]
    along: np.ndarray
    straight: bool = True


def scene_size(flat: FlatDAE, values: np.ndarray) -> float:
    """Return the largest length among parameters and start values, m; 1 where there is none.

    Parameters
    ----------
    values : parameter values of the model as it is written, or with those that a reduction has added
    """
    values = flat.extended(values)
    own = np.where(flat.kind <= Kind.PARAMETER, values, own_starts(flat, values)[0])
    lengths = np.abs(own[flat.per_variable(lambda b: b.unit == "m", bool)])
    return float(lengths[lengths <= INFINITE].max(initial=0.0)) or 1.0


def reach_of(size: float) -> float:
    """Return how far from zero a scene of a size is searched, m."""
    return max(_REACH, _SIZES * size)


def dense_about_zero(share: np.ndarray, reach: float, density: float) -> np.ndarray:
    """Return places within a reach for shares of the way there, from -1 to 1: the nearer to zero, the denser."""
    places: np.ndarray = reach * np.sinh(density * share) / np.sinh(density)
    return places


def fineness(size: float) -> float:
    """Return the length, m, of which tolerances are parts: 1, and less where the scene is smaller than a millimetre."""
    return min(1.0, _SMALL * size)


def rests(f: Functions, jacobian: Functions, turning: np.ndarray, starts: int, size: float = 1.0) -> list[Rest]:
    """Return the zeros and families that Newton's method finds, by rising values.

    Parameters
    ----------
    f, jacobian : of an array (n,); (m,) and (m, n)
    turning : (n,) which unknowns are angles with a period of one turn
    starts : how many, the first at zero, the others random in the box
    size : of the scene, m
    """
    n = len(turning)
    unit = np.where(turning, 1.0, fineness(size))
    box = np.where(turning, np.pi, reach_of(size))
    places = np.random.default_rng(1).uniform(-box, box, (starts - 1, n))
    # the largest length may be that of the earth, or a gap: every other one is within 10 m, or a small scene's reach
    places[1::2] *= np.where(turning, 1.0, _REACH * unit / box)
    starting = [np.zeros(n), *(places / unit)]
    with np.errstate(all="ignore"):
        row = _row_sizes([np.asarray(jacobian(unit * y), float) * unit for y in starting[:_LOOKED_AT]])
    found: list[Rest] = []

    def values(y: np.ndarray) -> np.ndarray:
        return np.asarray(f(unit * y), float) / row

    def slopes(y: np.ndarray) -> np.ndarray:
        return np.asarray(jacobian(unit * y), float) * unit / row[:, None]

    for start in starting:
        root = newton(values, slopes, start)
        if root is None or any(_member(root, other, turning) for other in found):
            continue
        rest = _family(values, slopes, root)
        rest = Rest(within_a_turn(rest.at, turning), rest.free, rest.along, rest.straight)
        if not any(rest.free == o.free and _same(rest.at, o.at, turning) for o in found):
            found.append(rest)
    found = sorted(found, key=lambda rest: tuple(np.round(rest.at, 9)))
    return [_scaled(rest, unit) for rest in found]


def _row_sizes(slopes: list[np.ndarray]) -> np.ndarray:
    """Return the sizes of as many equations as there are unknowns: one that is 1e13 times another is no rank lost.

    Where there are more equations, least squares weigh them as they are.
    """
    m, n = np.atleast_2d(slopes[0]).shape
    found = np.array([np.abs(a).max(axis=1, initial=0.0) for a in slopes if np.isfinite(a).all()])
    largest = found.max(axis=0, initial=0.0) if len(found) else np.zeros(m)
    return np.where((largest > 0) & (m == n), largest, 1.0)


def _scaled(rest: Rest, unit: np.ndarray) -> Rest:
    """Return a state of rest found in units of the scene, in SI units."""
    return Rest(rest.at * unit, rest.free, rest.along * unit[:, None] / unit[list(rest.free)], rest.straight)


def within_a_turn(x: np.ndarray, turning: np.ndarray) -> np.ndarray:
    """Angles from −π, excluded, to π."""
    return np.where(turning, (x + np.pi - 1e-9) % (2 * np.pi) - np.pi + 1e-9, x)


def _same(x: np.ndarray, y: np.ndarray, turning: np.ndarray) -> bool:
    apart = x - y
    apart = np.where(turning, apart - 2 * np.pi * np.round(apart / (2 * np.pi)), apart)
    return bool(np.abs(apart).max(initial=0.0) <= 1e-7 * (1.0 + np.abs(y).max(initial=0.0)))


def _member(x: np.ndarray, rest: Rest, turning: np.ndarray) -> bool:
    """Return whether a zero belongs to what is known."""
    return rest.straight and _same(x, rest.at + rest.along @ x[list(rest.free)], turning)


def _family(f: Functions, jacobian: Functions, root: np.ndarray) -> Rest:
    """The family of a zero, or it alone."""
    n = len(root)
    alone = Rest(root, (), np.zeros((n, 0)))
    _, singular, right = np.linalg.svd(np.atleast_2d(np.asarray(jacobian(root), float)))
    rank = int(np.sum(singular > SINGULAR * singular.max(initial=0.0)))
    null = right[rank:].T
    free = largest_rows(null)
    held = list(free)
    for aside in ASIDE if held else ():
        moved = root + null @ np.linalg.solve(null[held], np.full(len(held), aside))
        if _with_held(f, jacobian, moved, held) is None:
            return alone
    if not held:
        return alone
    along = null @ np.linalg.inv(null[held])
    at_zero = _with_held(f, jacobian, root - along @ root[held], held)
    if at_zero is None:
        return Rest(root, free, along, straight=False)
    points = [at_zero + along @ np.full(len(held), aside) for aside in (0.7, -1.3)]
    straight = all(_is_zero(f, jacobian, p) for p in points)
    return Rest(at_zero, free, np.round(along, 12) + 0.0, straight)


def largest_rows(null: np.ndarray) -> tuple[int, ...]:
    """Return as many independent rows of a basis as it has columns, the largest first (pivoted Gram–Schmidt)."""
    rest, chosen = null.copy(), []
    for _ in range(null.shape[1]):
        sizes = np.linalg.norm(rest, axis=1)
        i = int(np.argmax(np.round(sizes, 9)))
        chosen.append(i)
        direction = rest[i] / sizes[i]
        rest = rest - np.outer(rest @ direction, direction)
    return tuple(sorted(chosen))


def _with_held(f: Functions, jacobian: Functions, x: np.ndarray, held: Sequence[int]) -> np.ndarray | None:
    """A zero at which some unknowns are as given."""
    others = np.setdiff1d(np.arange(len(x)), held)

    def full(y: np.ndarray) -> np.ndarray:
        z = x.copy()
        z[others] = y
        return z

    if not len(others):
        return x if _is_zero(f, jacobian, x) else None
    found = newton(lambda y: f(full(y)), lambda y: np.asarray(jacobian(full(y)), float)[:, others], x[others])
    return None if found is None else full(found)


def _is_zero(f: Functions, jacobian: Functions, x: np.ndarray) -> bool:
    scale = np.abs(np.asarray(jacobian(x), float)).sum() + 1.0
    return bool(np.abs(np.asarray(f(x), float)).max(initial=0.0) < 1e-9 * scale)


def newton(f: Functions, jacobian: Functions, x: np.ndarray) -> np.ndarray | None:
    """Return a zero by Newton's method, the shortest step where there is a choice; None where it does not converge."""
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            value = np.asarray(f(x), float)
            if not np.isfinite(value).all():  # where a block has no solution its matrix would be sought as long again
                return None
            matrix = np.asarray(jacobian(x), float)
            if not np.isfinite(matrix).all():
                return None
            step = np.linalg.lstsq(matrix, value, rcond=1e-10)[0]
            x = x - step
            if np.abs(step).max(initial=0.0) < 1e-12 * (1.0 + np.abs(x).max(initial=0.0)):
                return x if _is_zero(f, jacobian, x) else None
    return None


def plain(value: float, fine: float = 1.0) -> sympy.Expr:
    """Return a float, or the multiple of π/2 that it is.

    Parameters
    ----------
    fine : `fineness` of the scene, of which a part is nothing
    """
    import sympy as sp

    turns = round(value / (np.pi / 2))
    near = abs(value - turns * np.pi / 2) < _NOTHING * (1.0 if turns else fine)
    return turns * sp.pi / 2 if near else sp.Float(value)


def values_at(rest: Rest, unknowns: Sequence[sympy.Symbol], fine: float = 1.0) -> dict[sympy.Symbol, sympy.Expr]:
    """Return {unknown: value}; a free one stands for itself, and those that follow from it contain it.

    Parameters
    ----------
    fine : `fineness` of the scene
    """
    import sympy as sp

    values = {}
    for i, x in enumerate(unknowns):
        if i in rest.free:
            values[x] = x
        else:
            moved = zip(rest.along[i].tolist(), rest.free, strict=True) if rest.straight else ()
            values[x] = sp.Add(plain(float(rest.at[i]), fine), *(_whole(c) * unknowns[k] for c, k in moved if c))
    return values


def _whole(value: float) -> sympy.Expr:
    import sympy as sp

    near = round(value)
    return sp.Integer(near) if abs(value - near) < 1e-9 else sp.Float(value)
