"""Bounds for the rounding of a program's registers, against exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest

from lmoc.expression.dag import slot
from lmoc.ir.program import Apply, Solve
from lmoc.numerics.solve.rounding import Rounding, shape_rounding

A, B, C, D = (slot(k) for k in range(4))


@pytest.mark.parametrize(
    "shape, exact",
    [
        (A + B - C, lambda a, b, c, d: a + b - c),
        (A * B - C * D, lambda a, b, c, d: a * b - c * d),
        ((A + B) / (C + D) - A / C, lambda a, b, c, d: (a + b) / (c + d) - a / c),
        (A**2 - B**2 - (A - B) * (A + B), lambda a, b, c, d: Fraction(0)),
    ],
)
def test_rounding_stays_within_its_bound_and_not_far_below(shape, exact):
    from lmoc.expression.evaluate import evaluate

    draw = np.random.default_rng(1)
    rows = draw.uniform(0.1, 10.0, (200, 4))
    rows[:100, 2:] = rows[:100, 1::-1] * (1 + 1e-15)  # nothing is left of the sums
    off = shape_rounding(shape, rows, np.zeros(rows.shape), 0.0)
    found = evaluate(shape, lambda k, _: rows[:, k])
    true = [exact(*map(Fraction, row)) for row in rows.tolist()]
    missed = np.array([abs(float(Fraction(value) - t)) for value, t in zip(found.tolist(), true, strict=True)])
    assert (missed <= off).all()
    assert off.max() < 100 * missed.max()


def test_rounding_passes_through_linear_blocks():
    """x + y = a, x - y = b: half of what a and b are off by each; a number that is whole is off by nothing."""
    x, y, a, b, r, s = range(6)
    inner = (
        Apply(A + B - C, np.array([[x, y, a]]), np.array([r])),
        Apply(A - B - C, np.array([[x, y, b]]), np.array([s])),
    )
    block = Solve(inner, np.array([[x, y]]), np.array([[r, s]]), linear=True, constant=False)
    bounds = Rounding((block,), np.array([x, y]), 6)
    w = np.array([np.nan, np.nan, 0.3, 0.1, np.nan, np.nan])
    off = bounds(w, 0.0)
    assert w[[x, y]] == pytest.approx([0.2, 0.1]) and ((off > 1e-17) & (off < 2e-16)).all()
    w[[a, b]] = 0.0
    assert not bounds(w, 0.0).any()
    wide = bounds(w, 0.0, (np.array([a]), np.array([1e-3])))
    assert wide == pytest.approx([5e-4, 5e-4])


def test_what_newtons_method_leaves_counts_as_rounding():
    """x + x³ = a at zero: where nothing is rounded, the last correction may have left some 1e-17, or 1e-53."""
    x, a, r = range(3)
    inner = (Apply(A + A**3 - B, np.array([[x, a]]), np.array([r])),)
    block = Solve(inner, np.array([[x]]), np.array([[r]]), linear=False, constant=False)
    off = Rounding((block,), np.array([x]), 3)(np.array([np.nan, 0.0, np.nan]), 0.0)
    assert 0 < off[0] < 1e-16
