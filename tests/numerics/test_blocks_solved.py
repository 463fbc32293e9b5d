"""Implicit blocks in the engine: the same solutions as elsewhere, their branch kept, pivots watched, failures told."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.by_numpy import VectorSystem

import lmoc
from lmoc.engine.kernel import Kernel
from lmoc.expression.dag import function, slot
from lmoc.ir.program import Apply, Program, Solve
from lmoc.lower.blocks import values_tape
from lmoc.messages.diagnostics import Report
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.plan.plan import build_plan
from lmoc.numerics.signals.signals import bind_signals
from lmoc.numerics.solve.interpreter import Interpreter

CHAIN = "models/planar/chain.lmo"
# x is given by a crank, u follows from cos(u) = x/2 near one of its two solutions
ARC = """
model Arc
  Real x(start = 0.3, fixed = true), y(start = 0, fixed = true), u(start = {start});
equation
  der(x) = 0.1; der(y) = sin(u); cos(u) = x;
end Arc;
"""
PAIRS = """
model Pairs
  parameter Integer N = 3;
  Fixed wall; CubicSpring a[N](k = {i + 0.5 for i in 1:N}), b[N](each k = 2);
  Mass mass[N](each m = 1, each q(start = 1, fixed = true), each v(start = 0, fixed = true));
equation
  for i in 1:N loop
    connect(wall.flange, a[i].a); connect(a[i].b, b[i].a); connect(b[i].b, mass[i].flange);
  end for;
end Pairs;
"""


def both(dae: lmoc.DAE, energy: bool = True) -> tuple[EngineSystem, VectorSystem]:
    """The system of a model in C and in numpy, ready to be called."""
    report = Report()
    signals = bind_signals(dae.flat, None, report)
    plan = build_plan(dae.reduced, signals, energy, report)
    found = EngineSystem(plan), VectorSystem(plan)
    for system in found:
        system.prepare(plan.base(dae.values, signals), signals)
    return found


def rates(system, t: float, x: np.ndarray) -> np.ndarray:
    out = np.empty(system.n)
    system.rhs(t, x, out)
    return out


def linear_program(n: int) -> tuple[Program, np.ndarray, np.ndarray]:
    """A·u = b with A tridiagonal, whose diagonal and off-diagonal are registers; all registers, then the unknowns."""
    unknowns, diagonal, beside, b, residuals, zero = np.arange(n), n, n + 1, n + 2, n + 3 + np.arange(n), 2 * n + 3
    shape = slot(3) * slot(1) + slot(4) * (slot(0) + slot(2)) - slot(5)
    left, right = np.r_[zero, unknowns[:-1]], np.r_[unknowns[1:], zero]
    full = np.full(n, 1)
    slots = np.column_stack([left, unknowns, right, diagonal * full, beside * full, b * full])
    solve = Solve((Apply(shape, slots, residuals),), unknowns[None], residuals[None], True, False)
    return (solve,), np.array([diagonal, beside, b]), unknowns


@pytest.mark.parametrize("n", [3, 40, 300])
def test_a_varying_block_is_refactorized_and_gets_new_pivots_where_they_have_become_weak(n):
    program, given, unknowns = linear_program(n)
    count = 2 * n + 4
    kernel, numpy = Kernel(values_tape(program, count)), Interpreter(program, count)
    for values in ([4.0, 1.0, 1.0], [4.1, 1.2, 1.0], [1e-9, 1.0, 1.0], [4.0, 1e-9, 2.0], [1e-30, 1e-30, 1e-30]):
        if values[0] == 1e-9 and n % 2:
            continue  # singular to rounding: an odd number of unknowns and no diagonal
        w = np.zeros(count)
        w[given] = values
        numpy.run(w, 0.0)
        kernel.w[:count] = 0.0
        kernel.w[given] = values
        kernel(0.0)
        size = np.abs(w[unknowns]).max()
        np.testing.assert_allclose(kernel.w[unknowns], w[unknowns], rtol=1e-9, atol=1e-12 * size)


@pytest.mark.parametrize("n", [3, 40])
def test_a_singular_block_gives_no_numbers_and_later_ones_do(n):
    program, given, unknowns = linear_program(n)
    kernel = Kernel(values_tape(program, 2 * n + 4))
    for values, good in (([4.0, 1.0, 1.0], True), ([0.0, 0.0, 1.0], False), ([np.nan, 1.0, 1.0], False)):
        kernel.w[given] = values
        kernel(0.0)
        assert np.isfinite(kernel.w[unknowns]).all() == good
    kernel.w[given] = [4.0, 1.0, 1.0]
    kernel(0.0)
    assert np.isfinite(kernel.w[unknowns]).all()


@pytest.mark.parametrize("n", [10, 40, 100])
def test_a_chain_of_bars_as_numpy_has_it(n):
    c, numpy = both(lmoc.compile(CHAIN, parameters={"n": n}))
    for seed in range(3):
        x = np.random.default_rng(seed).uniform(-2, 2, c.n)
        reference = rates(numpy, 0.0, x)
        np.testing.assert_allclose(rates(c, 0.0, x), reference, rtol=1e-9, atol=1e-10 * np.abs(reference).max())


def test_single_rows_read_what_the_one_before_has_written():
    steps = []
    for k in range(20):  # w[k+1] = w[k] + sin(w[k]), then its square behind
        steps.append(Apply(slot(0) + function("sin", slot(0)), np.array([[k]]), np.array([k + 1])))
        steps.append(Apply(slot(0) * slot(0), np.array([[k + 1]]), np.array([30 + k])))
    kernel, w = Kernel(values_tape(tuple(steps), 60)), np.zeros(60)
    w[0] = kernel.w[0] = 0.1
    Interpreter(tuple(steps), 60).run(w, 0.0)
    kernel(0.0)
    np.testing.assert_allclose(kernel.w[:60], w, rtol=1e-14)


# -------------------------------------------------------------------------------------------------------- Newton


@pytest.mark.parametrize(("start", "sign"), [(1.2, 1), (-1.2, -1)])
def test_a_solution_follows_the_one_before_even_over_long_ways(start, sign):
    c, _ = both(lmoc.compile_text(ARC.format(start=start)), energy=False)
    for x in (0.3, 0.9, -0.95, 0.99, -0.2):
        rates(c, 0.0, np.array([x, 0.0]))
        assert c.w[c.unknowns[0]] == pytest.approx(sign * np.arccos(x), abs=1e-9)


def test_where_there_is_no_solution_the_evaluation_says_so_and_the_last_one_is_kept():
    c, _ = both(lmoc.compile_text(ARC.format(start=1.2)), energy=False)
    assert np.isfinite(rates(c, 0.0, np.array([0.3, 0.0]))).all()
    assert np.isnan(rates(c, 0.0, np.array([1.1, 0.0]))).any()
    rates(c, 0.0, np.array([0.5, 0.0]))
    assert c.w[c.unknowns[0]] == pytest.approx(np.arccos(0.5), abs=1e-12)


def test_cubic_springs_in_series_relax_and_go_on():
    """Their equations have a singular matrix where both are relaxed; f = k·d³ with k^(-1/3) the sum of both."""
    dae = lmoc.compile_text(PAIRS)
    c, _ = both(dae, energy=False)
    names = [dae.reduced.register_name(int(r)) for r in c.plan.states]
    k = np.array([((i + 1.5) ** (-1 / 3) + 2.0 ** (-1 / 3)) ** -3 for i in range(3)])
    for q in (1.0, 0.5, 0.1, 0.0, 1e-3, -0.2, -2.0):
        x = np.array([q if name.endswith("q") else 0.25 for name in names])
        found = rates(c, 0.0, x)
        expected = [0.25 if n.endswith("q") else -k[int(n[5]) - 1] * q**3 for n in names]
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("solver", ["dop853", "cvode", "adams", "ida"])
def test_solvers_run_compiled_blocks(solver):
    dae = lmoc.compile_text(PAIRS)
    fine = dae.simulate(stop=3, points=7, rtol=1e-11)
    run = dae.simulate(stop=3, points=7, rtol=1e-7, solver=solver)
    np.testing.assert_allclose(run["mass[2].q"], fine["mass[2].q"], atol=3e-5)


def test_determinants_are_those_of_the_blocks():
    c, _ = both(lmoc.compile_text(ARC.format(start=1.2)), energy=False)
    for x in (0.3, 0.9, 0.999):
        rates(c, 0.0, np.array([x, 0.0]))
        assert abs(c.determinants()[0]) == pytest.approx(np.sqrt(1 - x * x), rel=1e-6)


def test_a_second_run_has_the_same_bits():
    dae = lmoc.compile("models/classic/slider_crank.lmo")
    for solver in ("auto", "radau"):  # radau asks for many Jacobians
        first, later = (dae.simulate(stop=0.5, points=11, rtol=1e-6, solver=solver) for _ in range(2))
        for name in dae.states:
            assert first[name].tobytes() == later[name].tobytes()


@pytest.mark.parametrize("model", ["planar/four_bar"])
def test_ida_gets_the_same_from_c_and_from_python(model, monkeypatch):
    dae = lmoc.compile(f"models/{model}.lmo")
    options = {"solver": "ida", "stop": 0.2, "points": 11, "rtol": 1e-7}
    dae.simulate(**options)
    asked: list[bool] = []

    def none(system, order, implicit=False):
        asked.append(implicit)

    in_c = dae.simulate(**options)
    monkeypatch.setattr(EngineSystem, "callback", none)
    in_python = dae.simulate(**options)
    assert in_c.stats["evaluations"] == in_python.stats["evaluations"]
    assert asked == [True]
    for name in dae.states:
        np.testing.assert_allclose(in_c[name], in_python[name], rtol=1e-9, atol=1e-12)


def test_elimination_written_out_pivots():
    import casadi as ca

    from lmoc.numerics.evaluate.casadi_system import eliminate

    random = np.random.default_rng(5)
    for n in (3, 5, 9):
        a, b = ca.SX.sym("a", n, n), ca.SX.sym("b", n)
        solve = ca.Function("solve", [a, b], [ca.vertcat(*eliminate(a, b))])
        for _ in range(10):
            matrix, right = random.normal(size=(n, n)) * 10.0 ** random.uniform(-8, 8, (n, 1)), random.normal(size=n)
            matrix[0, 0] = 0.0
            exact = np.linalg.solve(matrix, right)
            assert np.array(solve(matrix, right)).ravel() == pytest.approx(exact, rel=1e-9)
