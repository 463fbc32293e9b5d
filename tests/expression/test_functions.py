"""The table of functions: every entry means the same to Python, numpy, casadi, C and SymPy, edges and NaN included."""

from __future__ import annotations

import math
import random
import threading

import numpy as np
import pytest
import sympy

from lmoc.engine.kernel import Kernel
from lmoc.expression import to_sympy
from lmoc.expression.calculus import differentiate
from lmoc.expression.dag import Expr, const, function, rebuild, slot
from lmoc.expression.evaluate import evaluate
from lmoc.expression.functions import CALLABLE, FUNCTIONS, Kind
from lmoc.ir.program import Apply
from lmoc.lower.blocks import values_tape
from lmoc.numerics.evaluate.casadi_system import CasadiDerivatives

EDGES = [-math.inf, -3.0, -1.0, -0.5, -0.0, 0.0, 0.5, 1.0, 2.0, 3.0, 700.0, math.inf, math.nan]
RANDOM = random.Random(11)
POINTS = EDGES + [RANDOM.uniform(-4, 4) for _ in range(12)]
NUMERIC = sorted(name for name, f in FUNCTIONS.items() if f.kind is not Kind.LOGICAL and name != "if")
SMOOTH_AT = [RANDOM.uniform(-3, 3) for _ in range(40)]


def node(name: str) -> Expr:
    return rebuild(name, tuple(slot(k) for k in range(FUNCTIONS[name].arity)))


def places(name: str) -> np.ndarray:
    """(points, arity) arguments."""
    return np.array(np.meshgrid(*[POINTS] * FUNCTIONS[name].arity)).reshape(FUNCTIONS[name].arity, -1).T


def by_numpy(name: str, at: np.ndarray) -> np.ndarray:
    return np.asarray(evaluate(node(name), lambda k, order: at[:, k]), float)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_casadi_and_c_agree_with_numpy(name):
    if name == "if":
        at = np.array([[c, x, y] for c in (0.0, 1.0) for x in EDGES for y in EDGES])
    else:
        at = places(name)
    rows, arity = at.shape
    count = at.size + rows
    program = (Apply(node(name), np.arange(at.size).reshape(rows, arity), at.size + np.arange(rows)),)
    expected, outputs = by_numpy(name, at), at.size + np.arange(rows)
    lowered = CasadiDerivatives(program, count, np.arange(at.size), [], [], outputs).function()
    found = {"casadi": np.array(lowered(0.0, at.ravel(), [], [])).ravel()}
    kernel = Kernel(values_tape(program, count))
    kernel.w[: at.size] = at.ravel()
    kernel(0.0)
    found["engine"] = kernel.w[outputs]
    for tool, values in found.items():
        # infinite arguments and zero to a power: what is finite somewhere is the same everywhere
        both = np.isfinite(expected) & np.isfinite(values)
        np.testing.assert_allclose(values[both], expected[both], rtol=1e-13, atol=1e-15, err_msg=tool)
        finite = np.isfinite(at).all(axis=1)
        assert (np.isfinite(values) == np.isfinite(expected))[finite].all(), tool
        drops = FUNCTIONS[name].kind is Kind.LOGICAL or name in ("pow", "if", "given")
        lost = np.isnan(at).any(axis=1) & (not drops)
        assert np.isnan(values[lost]).all() and np.isnan(expected[lost]).all(), tool


def test_casadi_keeps_what_has_no_value():
    x = slot(0)
    shapes = [x / x, function("sqrt", x) ** 2, x * (1 / x), function("sqrt", x) * function("sqrt", x), (x + x) / x]
    for shape in shapes:
        program = (Apply(shape, np.array([[0]]), np.array([1])),)
        rhs = CasadiDerivatives(program, 2, np.array([0]), [], [], np.array([1])).function()
        for number in (0.0, -1.0):
            with np.errstate(all="ignore"):
                expected = float(evaluate(shape, lambda k, order, number=number: np.float64(number)))
            assert math.isfinite(float(rhs(0.0, number, [], []))) == math.isfinite(expected), (shape, number)


@pytest.mark.parametrize("name", NUMERIC)
def test_folded_constants_are_what_is_computed(name):
    for arguments in (places(name) + 0.0).tolist():  # a constant has no negative zero
        folded = rebuild(name, tuple(const(a) for a in arguments))
        expected = by_numpy(name, np.array([arguments]))[0]
        if folded.is_const and np.isfinite(arguments).all():
            assert folded.value == pytest.approx(expected, rel=1e-13, abs=1e-300), arguments


@pytest.mark.parametrize("name", NUMERIC)
def test_sympy_agrees_with_numpy(name):
    at = np.array([[RANDOM.uniform(-4, 4) for _ in range(FUNCTIONS[name].arity)] for _ in range(12)])
    for arguments, expected in zip(at.tolist(), by_numpy(name, at), strict=True):
        numbers = [sympy.Float(a, 30) for a in arguments]
        found = complex(to_sympy.lower(node(name), lambda k, order, n=numbers: n[k]))
        assert found.imag != 0 if math.isnan(expected) else found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", NUMERIC)
def test_defined_where_the_table_says(name):
    entry = FUNCTIONS[name]
    for arguments in places(name).tolist():
        if not all(map(math.isfinite, arguments)):
            continue
        inside = entry.domain is None or bool(entry.domain(*arguments))
        inside &= not (entry.divides and arguments[1] == 0)
        finite = math.isfinite(by_numpy(name, np.array([arguments]))[0])
        assert finite == inside or inside and entry.may_give_nan, arguments  # what grows fast may overflow


@pytest.mark.parametrize("name", NUMERIC)
def test_derivatives_agree_with_differences(name):
    entry, h, rng = FUNCTIONS[name], 1e-5, random.Random(name)  # whatever other tests have drawn
    looked_at = 0
    for k in range(60 * entry.arity):
        at = [rng.uniform(-3, 3) for _ in range(entry.arity)]
        if entry.divides:  # remainders of small divisors jump more often than the differences can see
            at[1] += math.copysign(0.1, at[1])
        for j in range(entry.arity):
            ahead = [[x + d * h * (i == j) for i, x in enumerate(at)] for d in (-2, -1, 0, 1, 2)]
            values = by_numpy(name, np.array(ahead))
            if not np.isfinite(values).all():
                continue
            slope = (values[0] - 8 * values[1] + 8 * values[3] - values[4]) / (12 * h)
            other = (values[3] - values[1]) / (2 * h)
            if abs(slope - other) > 1e-6 * (1 + abs(slope)):  # a jump within, or a pole near
                continue
            found = float(evaluate(differentiate(node(name), slot(j)), lambda i, order, at=at: at[i]))
            assert found == pytest.approx(slope, rel=1e-7, abs=1e-7), (k, at, j)
            looked_at += 1
    assert looked_at > 10


def test_new_functions_can_be_called_in_a_model():
    import lmoc

    text = "model M Real x(start = 0.3, fixed = true); Real y; equation der(x) = 1; y = {}; end M;"
    values = {"asinh(x)": math.asinh, "acosh(1 + x)": lambda x: math.acosh(1 + x), "atanh(x)": math.atanh}
    for name, value in values.items():
        run = lmoc.compile_text(text.format(name)).simulate(stop=0.5, points=3)
        assert run["y"] == pytest.approx([value(x) for x in run["x"]], rel=1e-12)


def test_the_language_page_names_every_function():
    from pathlib import Path

    page = (Path(__file__).parents[2] / "docs" / "language.md").read_text()
    words = set(page.replace("`", " ").replace(",", " ").split())
    assert not [name for name in CALLABLE if name not in words]


def test_an_expression_made_by_many_threads_is_one_object():
    for round_ in range(200):
        start, made = threading.Barrier(8), [None] * 8

        def make(k: int, round_=round_, start=start, made=made) -> None:
            start.wait()
            made[k] = function("sin", slot(round_ + 1000) * const(round_ + 0.125) + slot(3))

        threads = [threading.Thread(target=make, args=(k,)) for k in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert all(expression is made[0] for expression in made)
