"""Programs run by numpy and by casadi, and their sparse Jacobians, against plain formulas and differences."""

import math

import numpy as np
import pytest

from lmoc.engine.kernel import Kernel
from lmoc.expression import dag
from lmoc.expression.dag import function, slot, slots
from lmoc.expression.functions import BINARY, LOGICAL, UNARY
from lmoc.ir.program import Apply, Solve, Total
from lmoc.lower.blocks import values_tape
from lmoc.numerics.evaluate.casadi_system import CasadiDerivatives
from lmoc.numerics.solve.interpreter import Interpreter, segment_sums
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.numerics.solve.newton import Newton

sin, cos = (lambda x, n=n: dag.function(n, x) for n in ("sin", "cos"))


def test_empty_segments_give_zero():
    terms = np.array([1.0, 2.0, 4.0])
    assert segment_sums(terms, np.array([0, 0, 2, 2, 3, 3])).tolist() == [0, 3, 0, 4, 0]
    assert segment_sums(np.zeros((0, 2)), np.array([0, 0])).tolist() == [[0, 0]]
    assert segment_sums(terms, np.array([0])).shape == (0,)


def explicit():
    """Registers 0-2 are inputs; 3-5 come from an Apply, 6-7 from a Total (7 is empty), 8 from both."""
    return (
        Apply(sin(slot(0)) * slot(1) + dag.TIME, np.array([[0, 1], [1, 2], [2, 2]]), np.array([3, 4, 5])),
        Total(np.array([0, 3, 3]), np.array([3, 0, 4]), np.array([2.0, -1.0, 1.0]), np.array([6, 7])),
        Apply(slot(0) / slot(1) + slot(2), np.array([[6, 5, 7]]), np.array([8])),
    ), 9


def linear_blocks():
    """Two instances of 2 × 2: a·u + x·v = 1, x·u - v = a, with inputs a, x; then u·v."""
    u = np.array([[4, 5], [6, 7]])
    r = np.array([[8, 9], [10, 11]])
    slots = np.array([[0, 1, 4, 5], [2, 3, 6, 7]])
    inner = (
        Apply(slot(0) * slot(2) + slot(1) * slot(3) - 1, slots, r[:, 0]),
        Apply(slot(1) * slot(2) - slot(3) - slot(0), slots, r[:, 1]),
    )
    product = Apply(slot(0) * slot(1), u, np.array([12, 13]))
    return (Solve(inner, u, r, True, False), product), 14


def newton_blocks():
    """Two instances of u + sin(u)/2 = x, torn: the sine is a register of the block."""
    inner = (
        Apply(sin(slot(0)) * 0.5, np.array([[2], [3]]), np.array([4, 5])),
        Apply(slot(0) + slot(1) - slot(2), np.array([[2, 4, 0], [3, 5, 1]]), np.array([6, 7])),
    )
    step = Solve(inner, np.array([[2], [3]]), np.array([[6], [7]]), False, False)
    return (step, Apply(slot(0) * slot(1), np.array([[4, 2], [5, 3]]), np.array([8, 9]))), 10


PROGRAMS = {
    "explicit": (*explicit(), [0, 1, 2], [3, 4, 5, 6, 7, 8]),
    "linear": (*linear_blocks(), [0, 1, 2, 3], [4, 5, 6, 7, 12, 13]),
    "newton": (*newton_blocks(), [0, 1], [2, 3, 4, 8, 9]),
}


def dense(jacobian: Jacobian, w: np.ndarray, shape: tuple[int, int], time: float = 0.3) -> np.ndarray:
    matrix = np.zeros(shape)
    matrix[jacobian.rows, jacobian.columns] = jacobian.values(w, time)
    return matrix


@pytest.mark.parametrize("name", PROGRAMS)
def test_jacobian_against_differences(name):
    program, count, inputs, outputs = PROGRAMS[name]
    inputs, outputs = np.array(inputs), np.array(outputs)
    interpreter = Interpreter(program, count)
    x = np.random.default_rng(1).uniform(0.5, 1.5, len(inputs))

    def run(x):
        w = np.full(count, np.nan)
        w[inputs] = x
        interpreter.run(w, 0.3)
        return w

    jacobian = Jacobian(program, inputs, outputs, count)
    found = dense(jacobian, run(x), (len(outputs), len(inputs)))
    h = 1e-6
    columns = [(run(x + h * e)[outputs] - run(x - h * e)[outputs]) / (2 * h) for e in np.eye(len(inputs))]
    assert found == pytest.approx(np.array(columns).T, abs=1e-8)
    assert (np.lexsort((jacobian.columns, jacobian.rows)) == np.arange(len(jacobian.rows))).all()


@pytest.mark.parametrize("name", PROGRAMS)
def test_many_times_at_once(name):
    program, count, inputs, outputs = PROGRAMS[name]
    x = np.random.default_rng(2).uniform(0.5, 1.5, (len(inputs), 5))
    times = np.linspace(0, 1, 5)
    w = np.full((count, 5), np.nan)
    w[inputs] = x
    Interpreter(program, count).run(w, times)
    jacobian = Jacobian(program, np.array(inputs), np.array(outputs), count)
    values = jacobian.values(w, times)
    for k in range(5):
        one = np.full(count, np.nan)
        one[inputs] = x[:, k]
        Interpreter(program, count).run(one, times[k])
        assert w[outputs, k] == pytest.approx(one[outputs], rel=1e-12)
        assert values[:, k] == pytest.approx(jacobian.values(one, times[k]), rel=1e-10)


@pytest.mark.parametrize("name", ["explicit", "linear"])
def test_casadi_gives_the_same(name):
    program, count, inputs, outputs = PROGRAMS[name]
    lowered = CasadiDerivatives(program, count, inputs, [], [], outputs)
    x = np.random.default_rng(3).uniform(0.5, 1.5, len(inputs))
    w = np.full(count, np.nan)
    w[inputs] = x
    Interpreter(program, count).run(w, 0.3)
    assert np.array(lowered.function()(0.3, x, [], [])).ravel() == pytest.approx(w[outputs], rel=1e-13)
    jacobian = Jacobian(program, np.array(inputs), np.array(outputs), count)
    expected = dense(jacobian, w, (len(outputs), len(inputs)))
    assert np.array(lowered.jacobian()(0.3, x, [], []).full()) == pytest.approx(expected, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_engine_gives_the_same(name):
    program, count, inputs, outputs = PROGRAMS[name]
    kernel, interpreter = Kernel(values_tape(program, count)), Interpreter(program, count)
    for x in np.random.default_rng(5).uniform(0.5, 1.5, (3, len(inputs))):
        one, two = kernel.w, np.full(count, np.nan)
        one[inputs] = two[inputs] = x
        kernel(0.3)
        interpreter.run(two, 0.3)
        assert one[outputs] == pytest.approx(two[outputs], rel=1e-12)


def test_blocks_of_many_unknowns_are_solved_numerically():
    """A Hilbert-like matrix of size 12, its right-hand side a nonlinear function of the input."""
    size = 12
    u, r = np.arange(1, size + 1), np.arange(size + 1, 2 * size + 1)
    matrix = 1 / (1 + np.add.outer(np.arange(size), np.arange(size)) % 7) + 3 * np.eye(size)
    rows = []
    for i in range(size):
        terms = sum((matrix[i, j] * slot(j + 1) for j in range(size)), -cos(slot(0)))
        rows.append(Apply(terms, np.array([[0, *u]]), r[i : i + 1]))
    for linear in (True, False):
        w = np.full(2 * size + 1, np.nan)
        w[0] = 0.7
        kernel = Kernel(values_tape((Solve(tuple(rows), u[None], r[None], linear, False),), len(w)))
        kernel.w[0] = 0.7
        kernel(0.0)
        assert kernel.w[u] == pytest.approx(np.linalg.solve(matrix, np.full(size, np.cos(0.7))), rel=1e-12)
        Interpreter((Solve(tuple(rows), u[None], r[None], linear, False),), len(w)).run(w, 0.0)
        assert w[u] == pytest.approx(np.linalg.solve(matrix, np.full(size, np.cos(0.7))), rel=1e-12)


@pytest.mark.parametrize("constant", [True, False])
@pytest.mark.parametrize("size", [3, 200])
def test_linear_blocks_small_and_sparse(size, constant):
    """-u[i-1] + 3 u[i] - u[i+1] = x[i]."""
    x, u, r = np.arange(size), size + np.arange(size), 2 * size + np.arange(size)
    terms = [[(u[i], 3.0), (x[i], -1.0)] + [(u[j], -1.0) for j in (i - 1, i + 1) if 0 <= j < size] for i in range(size)]
    start = np.cumsum([0, *map(len, terms)])
    flat = [t for row in terms for t in row]
    total = Total(start, np.array([t[0] for t in flat]), np.array([t[1] for t in flat]), r)
    interpreter = Interpreter((Solve((total,), u[None], r[None], True, constant),), 3 * size)
    matrix = 3 * np.eye(size) - np.eye(size, k=1) - np.eye(size, k=-1)
    for tail in ((), (4,)):
        w = np.full((3 * size, *tail), np.nan)
        w[x] = np.random.default_rng(4).normal(size=(size, *tail))
        interpreter.run(w, np.zeros(tail))
        assert w[u] == pytest.approx(np.linalg.solve(matrix, w[x]), abs=1e-12)


def test_singular_blocks_give_no_value():
    inner = Apply(slot(0) * slot(1) - 1, np.array([[0, 2], [1, 3]]), np.array([4, 5]))
    for linear in (True, False):
        interpreter = Interpreter((Solve((inner,), np.array([[2], [3]]), np.array([[4], [5]]), linear, False),), 6)
        w = np.array([0.0, 2.0, *[np.nan] * 4])
        interpreter.run(w, 0.0)
        assert np.isnan(w[2]) and w[3] == pytest.approx(0.5)


def test_newton_is_damped_where_it_must_be():
    newton = Newton((2, 1))

    def residual(u):
        return np.arctan(u - [[1.0], [-2.0]])

    def slope(u):
        return 1 / (1 + (u - [[1.0], [-2.0]]) ** 2)[..., None]

    solution = newton.solve(residual, slope, np.array([[9.0], [30.0]]))
    assert solution == pytest.approx(np.array([[1.0], [-2.0]]), abs=1e-12)


ODD = [-2.0, -0.5, 0.0, 0.5, 3.0, math.inf, math.nan]


def test_all_evaluators_agree_on_every_function_of_odd_numbers():
    """One row a function and pair of numbers; what is no number is none anywhere."""
    shapes = [function(name, slot(0)) for name in sorted(UNARY - LOGICAL)]
    shapes += [function(name, slot(0), slot(1)) for name in sorted(BINARY - LOGICAL)]
    pairs = np.array(np.meshgrid(ODD, ODD)).reshape(2, -1)
    rows, count = pairs.shape[1], 2 * pairs.shape[1]
    inputs = np.arange(count)
    program = []
    for shape in shapes:
        program.append(Apply(shape, inputs.reshape(2, -1).T[:, : len(slots(shape))], count + np.arange(rows)))
        count += rows
    outputs = np.arange(2 * rows, count)
    w = np.full(count, np.nan)
    w[inputs] = pairs.ravel()
    Interpreter(tuple(program), count).run(w, 0.0)
    expected = w[outputs].reshape(len(shapes), rows)
    own = CasadiDerivatives(program, count, inputs, [], [], outputs).function()
    found = {"casadi": np.array(own(0.0, w[inputs], [], []))}
    kernel = Kernel(values_tape(tuple(program), count))
    kernel.w[inputs] = w[inputs]
    kernel(0.0)
    found["engine"] = kernel.w[outputs]
    for name, values in found.items():
        for shape, one, two in zip(shapes, values.reshape(len(shapes), rows), expected, strict=True):
            known = np.isfinite(pairs[: len(slots(shape))]).all(axis=0) | (shape.op in ("min", "max", "sign", "abs"))
            assert one[known] == pytest.approx(two[known], rel=1e-14, nan_ok=True), (name, shape.op)
            assert not np.isfinite(one[np.isnan(two)]).any(), (name, shape.op)
