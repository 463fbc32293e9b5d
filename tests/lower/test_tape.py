"""Tapes: the same numbers as the program, each value once, and every place in range."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from conftest import ROOT

import lmoc
from lmoc.engine.kernel import Kernel
from lmoc.engine.library import library
from lmoc.expression import dag
from lmoc.expression.dag import function, slot
from lmoc.expression.functions import BINARY, FUNCTIONS, UNARY
from lmoc.ir.program import Apply, Solve, Total
from lmoc.lower.blocks import derivatives_tape, values_tape
from lmoc.lower.operations import OPERATIONS
from lmoc.lower.tape import CHUNK
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.jacobian import Jacobian

SIN = function("sin", slot(0))


def filled(program, count: int, given: np.ndarray, time: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """The registers as the engine and as numpy fill them."""
    tape = values_tape(program, count)
    tape.check()
    kernel, w = Kernel(tape), np.zeros(count)
    w[: len(given)] = kernel.w[: len(given)] = given
    kernel(time)
    Interpreter(program, count).run(w, time)
    return kernel.w[:count], w


def test_the_operations_have_their_numbers_in_the_engine():
    names = library().lmoc_operations().decode().split()
    assert tuple(names) == OPERATIONS
    known = set(FUNCTIONS) - {"event", "given"}  # which are their arguments
    assert known <= set(OPERATIONS) and len(OPERATIONS) == len(set(OPERATIONS))


@pytest.mark.parametrize("rows", [1, 8, 9, CHUNK, CHUNK + 1, 3 * CHUNK + 5])
@pytest.mark.parametrize("order", ["contiguous", "strided", "random"])
def test_rows_in_any_order_and_number(rows, order):
    random = np.random.default_rng(rows)
    places = {"contiguous": np.arange(rows), "strided": 2 * np.arange(rows), "random": random.permutation(3 * rows)}
    a, b, out = places[order][:rows], places[order][:rows][::-1] + 3 * rows, places[order][:rows] + 6 * rows
    shape = (slot(0) * slot(1) + dag.TIME) / (slot(2) ** 2 + 2.0) - slot(1) ** 3 * SIN
    one = np.full(rows, 9 * rows)
    program = (Apply(shape, np.column_stack([a, b, one]), out),)
    given = np.concatenate([random.normal(size=6 * rows), np.zeros(3 * rows), [0.7]])
    mine, theirs = filled(program, 9 * rows + 1, given, 0.3)
    np.testing.assert_allclose(mine, theirs, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("rows", [3, 300])
def test_all_functions_on_few_and_on_many_rows(rows):
    random = np.random.default_rng(1)
    x, y = random.uniform(-2, 2, rows), random.uniform(0.1, 2, rows)
    steps, at = [], 2 * rows
    for name in sorted(UNARY | BINARY - {"pow"}):
        args = [slot(k) for k in range(FUNCTIONS[name].arity)]
        node = dag.interned(name, tuple(args))
        steps.append(Apply(node, np.column_stack([np.arange(rows), rows + np.arange(rows)]), at + np.arange(rows)))
        at += rows
    mine, theirs = filled(tuple(steps), at, np.concatenate([x, y]))
    np.testing.assert_allclose(mine, theirs, rtol=4e-16, atol=1e-300)


def test_one_number_for_all_rows_is_computed_once_and_moved_to_each():
    rows, one = 20, np.full((20, 1), 0)
    program = (Apply(SIN, one, 1 + np.arange(rows)), Apply(slot(0), one, 21 + np.arange(rows)))
    mine, theirs = filled(program, 41, np.array([0.4]))
    assert np.array_equal(mine, theirs) and (mine[1:21] == np.sin(0.4)).all()
    assert values_tape(program, 41).text().count(" sin ") == 1


def test_a_value_that_is_there_is_not_computed_again_until_what_it_comes_from_changes():
    two = np.array([[0], [0]])
    program = (Apply(SIN + 1, two[:1], np.array([1])), Apply(SIN * 2, two[:1], np.array([2])))
    assert values_tape(program, 3).text().count("sin") == 1
    # u + sin(u)/2 = x by Newton's method: the sine of each iterate
    inner = (Apply(slot(0) + function("sin", slot(0)) * 0.5 - slot(1), np.array([[1, 0]]), np.array([2])),)
    block = Solve(inner, np.array([[1]]), np.array([[2]]), False, False)
    after = Apply(function("sin", slot(0)), np.array([[1]]), np.array([3]))
    mine, theirs = filled((Apply(SIN, np.array([[1]]), np.array([4])), block, after), 5, np.array([0.8]))
    assert mine[1] + np.sin(mine[1]) / 2 == pytest.approx(0.8, abs=1e-15)
    assert mine[3] == np.sin(mine[1]) and mine[4] == 0.0
    np.testing.assert_allclose(mine[[1, 3]], theirs[[1, 3]], rtol=1e-14)


@pytest.mark.parametrize("rows", [1, 5, 50])
def test_sums_of_no_one_and_many_terms(rows):
    random = np.random.default_rng(rows)
    lengths = np.r_[0, 1, 40, random.integers(0, 4, rows)]
    start = np.concatenate([[0], np.cumsum(lengths)])
    index = random.integers(0, 30, start[-1])
    for coefficients in ([1.0], [-1.0], [1.0, -1.0, 2.5]):
        total = Total(start, index, random.choice(coefficients, start[-1]), 30 + np.arange(len(lengths)))
        mine, theirs = filled((total,), 30 + len(lengths), random.normal(size=30))
        np.testing.assert_allclose(mine, theirs, rtol=1e-14, atol=1e-14)


def test_a_block_inside_a_block():
    """v = cos(u)/2 within u + v = x."""
    inside = (Apply(slot(1) - function("cos", slot(0)) * 0.5, np.array([[1, 2]]), np.array([3])),)
    inner = (
        Solve(inside, np.array([[2]]), np.array([[3]]), True, False),
        Apply(slot(0) + slot(1) - slot(2), np.array([[1, 2, 0]]), np.array([4])),
    )
    program = (Solve(inner, np.array([[1]]), np.array([[4]]), False, False),)
    mine, _ = filled(program, 5, np.array([1.2]))
    assert mine[2] == pytest.approx(np.cos(mine[1]) / 2) and mine[1] + mine[2] == pytest.approx(1.2)


@pytest.mark.parametrize("rows", [4, 40])
def test_derivatives_are_those_of_numpy(rows):
    random = np.random.default_rng(2)
    x, y, z = (k * rows + np.arange(rows) for k in range(3))
    steps = (
        Apply(slot(0) * function("sin", slot(1)) + slot(0) ** 3, np.column_stack([x, np.roll(x, 1)]), y),
        Total(np.arange(0, 2 * rows + 1, 2), np.ravel([y, x], order="F"), np.tile([2.0, -1.0], rows), z),
    )
    rule = Jacobian(steps, x, np.concatenate([y, z]), 3 * rows)
    tape, w = derivatives_tape(steps, rule, 3 * rows), np.zeros(3 * rows)
    tape.check()
    w[x] = random.normal(size=rows)
    Interpreter(steps, 3 * rows).run(w, 0.0)
    kernel = Kernel(tape)
    kernel.w[: 3 * rows] = w
    kernel(0.0)
    np.testing.assert_allclose(kernel.results(), rule.values(w, 0.0), rtol=1e-14, atol=1e-15)
    both = Kernel(derivatives_tape(steps, rule, 3 * rows, values=True))
    both.w[x] = w[x]
    both(0.0)
    np.testing.assert_allclose(both.w[: 3 * rows], w, rtol=1e-14)
    np.testing.assert_allclose(both.results(), kernel.results(), rtol=1e-14)


def test_the_factors_of_a_constant_block_are_made_again_when_parameters_change():
    inner = (Apply(slot(0) * slot(1) - slot(2), np.array([[0, 2, 1]]), np.array([3])),)
    tape = values_tape((Solve(inner, np.array([[2]]), np.array([[3]]), True, True),), 4)
    kernel = Kernel(tape)
    kernel.w[:2] = 2.0, 3.0
    kernel(0.0)
    assert kernel.w[2] == 1.5
    kernel.w[0] = 4.0
    kernel.forget()
    kernel(0.0)
    assert kernel.w[2] == 0.75


def test_nothing_that_is_not_a_number_passes_for_one():
    program = (Apply(function("max", slot(0), slot(1)), np.array([[0, 1], [1, 0]]), np.array([2, 3])),)
    mine, _ = filled(program, 4, np.array([np.nan, 1.0]))
    assert np.isnan(mine[2:]).all()


def test_a_tape_checks_and_prints_itself():
    tape = lmoc.compile(ROOT / "models/classic/slider_crank.lmo").prepare()
    program, count = tape.reduced.rhs, tape.reduced.registers.count
    made = values_tape(program, count)
    made.check()
    lines = made.text().splitlines()
    assert lines[-1].split()[1] == "end" and any(" correct " in line for line in lines)
    damaged = values_tape(program, count)
    damaged.code[1] = damaged.size
    with pytest.raises(AssertionError):
        damaged.check()
    assert ctypes.sizeof(ctypes.c_int32) == made.code.itemsize
