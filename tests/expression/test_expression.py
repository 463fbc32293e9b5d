"""The expression DAG: folding, derivatives, linear parts, text; differences and SymPy are the oracles."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy

from lmoc.expression import to_sympy
from lmoc.expression.calculus import differentiate, linear_parts, total_derivative
from lmoc.expression.dag import ONE, TIME, ZERO, const, function, if_, neg, rebuild, slot, slots
from lmoc.expression.evaluate import evaluate, evaluate_together
from lmoc.expression.functions import BINARY, LOGICAL, UNARY
from lmoc.expression.text import number_text, to_text

X, Y = slot(0), slot(1)
# points inside the domain of each operator, away from kinks
AT = {"acos": 0.3, "asin": 0.3, "sqrt": 0.7, "log": 0.7, "log10": 0.7, "acosh": 1.9, "atanh": 0.3, "not": 0.0}


def value(expr, x=0.0, y=0.0, time=0.0) -> float:
    return float(evaluate(expr, lambda k, order: (x, y)[k], time))


@pytest.mark.parametrize("op", sorted(UNARY - LOGICAL))
def test_derivative_of_one_argument(op):
    expr, x, h = rebuild(op, (X * 1.5,)), AT.get(op, 0.83) / 1.5, 1e-6
    difference = (value(expr, x + h) - value(expr, x - h)) / (2 * h)
    assert value(differentiate(expr, X), x) == pytest.approx(difference, abs=1e-8)


@pytest.mark.parametrize("op", sorted(BINARY - LOGICAL))
@pytest.mark.parametrize("swapped", [False, True])
def test_derivative_of_two_arguments(op, swapped):
    expr = rebuild(op, (Y + 0.2, X * 2.0) if swapped else (X * 2.0, Y + 0.2))
    x, y, h = 0.93, 0.41, 1e-6
    by_x = (value(expr, x + h, y) - value(expr, x - h, y)) / (2 * h)
    by_y = (value(expr, x, y + h) - value(expr, x, y - h)) / (2 * h)
    assert value(differentiate(expr, X), x, y) == pytest.approx(by_x, abs=1e-8)
    assert value(differentiate(expr, Y), x, y) == pytest.approx(by_y, abs=1e-8)


def test_derivative_of_cases():
    expr = if_(function("lt", X, const(1.0)), X * X, 3 * X)
    assert [value(differentiate(expr, X), x) for x in (0.5, 2.0)] == [1.0, 3.0]


def test_total_derivative():
    shape = X * function("sin", 2 * TIME) + Y**2
    found = total_derivative(shape, constant={1})
    assert slots(found) == (X, slot(0, 1))
    assert total_derivative(found, constant={1}) is not ZERO
    numbers = {(0, 0): 0.4, (0, 1): -1.3, (1, 0): 7.0}
    got = evaluate(found, lambda k, order: numbers[k, order], 0.3)
    assert got == pytest.approx(-1.3 * math.sin(0.6) + 0.4 * 2 * math.cos(0.6))


def test_linear_parts():
    coefficients, rest = linear_parts((X + 2 * Y) / slot(2) - 3 * X + 5, [X, Y])
    at = lambda e: float(evaluate(e, lambda k, order: 4.0))  # noqa: E731
    assert {leaf: at(c) for leaf, c in coefficients.items()} == {X: 0.25 - 3, Y: 0.5}
    assert at(rest) == 5.0
    assert linear_parts(X * Y, [X, Y]) is None
    assert linear_parts(X * Y, [X]) == ({X: Y}, ZERO)
    assert linear_parts(function("sin", X), [X]) is None
    assert linear_parts(X - X + Y, [X])[0] == {}


def test_equal_expressions_are_one_object():
    assert X + Y is slot(0) + slot(1)
    assert X * 1 is X and X + 0 is X and X * 0 is ZERO and X**1 is X and X**0 is ONE and X - X is ZERO
    assert neg(neg(X)) is X and -(X - Y) is Y - X
    assert const(-0.0) is ZERO
    assert const(2) * const(3) is const(6.0)


@pytest.mark.parametrize(
    "expr",
    [const(1) / const(0), function("log", const(-1.0)), function("sqrt", const(-2.0)), const(-8) ** const(1 / 3)],
)
def test_what_has_no_finite_value_is_not_folded(expr):
    assert expr.op != "const"


@pytest.mark.parametrize(
    ("expr", "text"),
    [
        ((X + Y) * X - Y, "(x + y)*x - y"),
        (X - (Y - X), "x - (y - x)"),
        (X / (Y * X), "x/(y*x)"),
        (-X * Y, "(-x)*y"),
        ((X**Y) ** 2, "(x^y)^2"),
        (-(X**2), "-x^2"),
        ((-X) ** 2, "(-x)^2"),
        (const(-2) ** X, "(-2)^x"),
        (function("not", function("lt", X, Y)), "not x < y"),
        (if_(function("lt", X, Y), X, Y) + 1, "(if x < y then x else y) + 1"),
        (function("div_integer", X, Y), "div(x, y)"),
        (slot(0, 2) * TIME, "der(der(x))*time"),
    ],
)
def test_text(expr, text):
    def name(column: int, order: int) -> str:
        return "der(" * order + "xy"[column] + ")" * order

    assert to_text(expr, name) == text


@pytest.mark.parametrize("number", [0.1, 1e300, -5e-324, 3.0, 1e15, 123456789.123])
def test_numbers_read_back(number):
    assert float(number_text(number)) == number


def test_numbers_that_are_none():
    assert [number_text(x) for x in (math.inf, -math.inf, math.nan)] == ["inf", "-inf", "nan"]
    assert to_sympy.exact(math.inf) is sympy.oo


@pytest.mark.parametrize("op", sorted((UNARY | BINARY) - LOGICAL))
def test_sympy_says_the_same(op):
    expr = rebuild(op, (X,) if op in UNARY else (X, Y))
    for x, y in ((AT.get(op, 0.83), 1.7), (1.31 if op == "acosh" else 0.31, -0.6)):
        numbers = (sympy.Float(x, 30), sympy.Float(y, 30))
        lowered = complex(to_sympy.lower(expr, lambda k, order, n=numbers: n[k]))
        with np.errstate(all="ignore"):
            assert lowered == pytest.approx(value(expr, x, y), rel=1e-12)


@pytest.mark.parametrize("depth", [5_000])
def test_depth_is_no_limit(depth):
    expr = X
    for _ in range(depth):
        expr = function("sin", expr)
    assert value(differentiate(expr, X), 0.0) == 1.0
    assert len(to_text(expr, lambda k, order: "x")) == 5 * depth + 1


def test_shapes_evaluated_together_share_what_they_have_in_common():
    """Each has the value that it has alone, to the last bit; a leaf of several is asked for once."""
    shared = function("sin", X * Y) + TIME
    roots = (shared, shared * shared, differentiate(shared * shared, X), X, const(2.0), differentiate(shared, Y))
    asked = []

    def column(k: int, order: int) -> np.ndarray:
        asked.append(k)
        return np.array([0.3, -1.2, 0.0]) + k

    found = evaluate_together(roots, column, 0.7)
    assert sorted(asked) == [0, 1]
    for root, got in zip(roots, found, strict=True):
        assert np.array_equal(got, evaluate(root, column, 0.7))
