"""The tableau of small constraint matrices as casadi expressions: numpy takes longer to call than to compute it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.reduced import Constraints

if TYPE_CHECKING:
    import casadi

MOST_ROWS = 8  # beyond, the written-out elimination is longer than the calls


def unrolled(entries: casadi.SX, own: Constraints) -> tuple[casadi.SX, casadi.SX]:
    """Return T = A⁻¹B in the rows of the watched coordinates, without scales, and the sign of the determinant of A.

    By elimination with row pivoting, written out: rows change places by their numbers. The sign is 0 where A is
    singular or not finite.
    """
    import casadi as ca

    count, width = own.rows, len(own.variable)
    rows = [[ca.SX(0)] * width for _ in range(count)]
    places = zip(own.row.tolist(), own.column.tolist(), strict=True)
    for (i, j), value in zip(places, ca.vertsplit(entries), strict=True):
        rows[i][j] = rows[i][j] + value
    finite = ca.sum1(ca.fabs(ca.vertcat(*[x for row in rows for x in row[:count]]))) < np.inf
    sign = ca.SX(1)
    for k in range(count):
        for i in range(k + 1, count):
            if rows[i][k].is_zero():
                continue
            if rows[k][k].is_zero():
                rows[k], rows[i], sign = rows[i], rows[k], -sign
                continue
            larger = ca.fabs(rows[i][k]) > ca.fabs(rows[k][k])
            sign = ca.if_else(larger, -sign, sign)
            for j in range(k, width):
                x, y = rows[k][j], rows[i][j]
                if not (x.is_zero() and y.is_zero()):
                    rows[k][j], rows[i][j] = ca.if_else(larger, y, x), ca.if_else(larger, x, y)
        sign = sign * ca.sign(rows[k][k])
        for i in range(k + 1, count):
            if not rows[i][k].is_zero():
                factor = rows[i][k] / rows[k][k]
                for j in range(k + 1, width):
                    rows[i][j] = rows[i][j] - factor * rows[k][j]
    solution: list[list] = [[] for _ in range(count)]
    for k in reversed(range(count)):
        for j in range(count, width):
            known = sum((rows[k][i] * solution[i][j - count] for i in range(k + 1, count)), ca.SX(0))
            solution[k].append((rows[k][j] - known) / rows[k][k])
    table = [ca.horzcat(*solution[k]) for k in own.watched.tolist()]
    return ca.densify(ca.vertcat(ca.SX(0, width - count), *table)), ca.if_else(finite, sign, 0)
