"""Cubic springs in a row, at their own zero: the equations that share out the force are solved there, and singular.

Springs k1, k2, … in a row carry f with x = Σ (f/ki)^(1/3): they are one spring K = (Σ ki^(-1/3))^-3.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from oracles.by_numpy import VectorSystem

import lmoc
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.run.simulate import Simulator
from lmoc.numerics.signals.signals import bind_signals
from lmoc.numerics.solve.newton import Newton, shortest_solution, vanishes
from lmoc.report.result import Result

STIFFNESS = (1.0, 2.0, 3.0)
SOLVERS = ["dop853", "radau", "cvode", "ida"]
WAYS = {"numpy": VectorSystem, "engine": EngineSystem}


def effective(count: int) -> float:
    return float(sum(k ** (-1 / 3) for k in STIFFNESS[:count]) ** -3)


def end(g: float) -> float:
    """When a row without weight has been through its middle; with weight it has fallen and come back."""
    return 3.0 if g else 6.5


@cache
def alone(count: int, g: float) -> Result:
    """The motion on one spring that is as stiff as a row."""
    mass = f"Mass m(m = 1, g = {g}, v(start = 1, fixed = true));"
    one = f"""model M Fixed w; CubicSpring s(k = {effective(count)!r}); {mass}
        equation connect(w.flange, s.a); connect(s.b, m.flange); end M;"""
    return lmoc.compile_text(one).simulate(stop=end(g), points=27, rtol=1e-10, solver="dop853")


@cache
def row(count: int, g: float = 0.0) -> lmoc.DAE:
    """A mass on `count` springs, pushed from where all are relaxed."""
    ports = ["w.flange", *(f"s{i}.{end}" for i in range(count) for end in "ab"), "m.flange"]
    joints = [f"connect({a}, {b});" for a, b in zip(ports[::2], ports[1::2], strict=True)]
    springs = [f"CubicSpring s{i}(k = {STIFFNESS[i]});" for i in range(count)]
    mass = f"Mass m(m = 1, g = {g}, v(start = 1, fixed = true));"
    return lmoc.compile_text(f"model M Fixed w; {' '.join(springs)} {mass} equation {' '.join(joints)} end M;")


@pytest.mark.parametrize(
    ("count", "g", "solver"),
    [
        *((2, 0.0, solver) for solver in SOLVERS if solver != "ida"),
        (3, 0.0, "ida"),
        (2, 9.81, "cvode"),
    ],
)
def test_a_row_of_cubic_springs_moves_as_one_spring(count, g, solver):
    K, expected = effective(count), alone(count, g)
    run = row(count, g).simulate(stop=end(g), points=27, rtol=1e-8, solver=solver)
    assert np.min(expected["m.q"][1:]) < 0 or g  # it has been through the middle
    assert run["m.q"] == pytest.approx(expected["m.q"], abs=1e-4 if g else 4e-6)
    assert run["m.v"] == pytest.approx(expected["m.v"], abs=3e-4 if g else 4e-6)
    energy = run["m.v"] ** 2 / 2 + K * run["m.q"] ** 4 / 4 - g * run["m.q"]
    assert energy == pytest.approx(0.5, abs=1e-5 * (1 + g**2))
    assert run.energy.balance < 1e-5
    share = (K / STIFFNESS[0]) ** (1 / 3)
    assert run["s0.extension"] == pytest.approx(share * run["m.q"], abs=1e-4 if g else 1e-7)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("count", [2, 3])
def test_forces_and_slopes_near_the_middle(count, way):
    """To rounding, or far below any tolerance where the last of Newton's steps are short."""
    dae = row(count)
    report = Report()
    signals = bind_signals(dae.flat, None, report)
    plan, _ = Simulator(dae.reduced).system(signals, False, report)
    system, K = WAYS[way](plan), effective(count)
    for q in (0.0, 1e-160, 1e-110, 1e-60, -1e-30, 1e-12, 1e-6, -1e-3, 0.1, -2.0):
        system.prepare(plan.base(dae.values, signals), signals)
        x, rate = np.array([q, 0.3]), np.empty(2)
        for _ in range(2):  # from the first guess, and from the solution
            system.rhs(0.0, x, rate)
            slopes = system.jacobian(0.0, x)
            assert rate[0] == 0.3 and slopes[0].tolist() == [0.0, 1.0]
            assert rate[1] == pytest.approx(-K * q**3, rel=1e-9, abs=1e-22)
            assert slopes[1] == pytest.approx([-3 * K * q**2, 0.0], rel=1e-6, abs=1e-14)


@pytest.mark.parametrize("solver", ["dop853", "cvode"])
def test_what_is_relaxed_and_at_rest_stays(solver):
    run = row(2).simulate(stop=5, points=11, initial={"m.v": 0.0}, solver=solver)
    assert not run["m.q"].any() and not run["m.v"].any() and not run["s1.extension"].any()


def test_the_linear_model_has_no_stiffness_and_no_share():
    dae = row(2)
    (rest,) = dae.equilibria()
    assert float(rest["m.q"]) == 0 and rest.stability == "undecided"
    for at in (None, rest, {"m.q": 0.0}):
        assert dae.linearize(at=at).A.tolist() == [[0.0, 1.0], [0.0, 0.0]]
    with pytest.raises(ModelError, match=r"E0663.*'s1\.extension'.*no derivative"):
        dae.linearize(outputs=["s1.extension"])


def test_under_a_weight_it_rests_where_the_one_spring_does():
    dae, K, g = row(2, 9.81), effective(2), 9.81
    (rest,) = dae.equilibria()
    assert float(rest["m.q"]) == pytest.approx((g / K) ** (1 / 3), rel=1e-9)
    assert dae.linearize().A[1] == pytest.approx([-3 * K * (g / K) ** (2 / 3), 0.0], rel=1e-6)


def test_a_guess_without_residual_is_the_solution_whatever_its_matrix():
    newton, guess = Newton((3, 1)), np.array([[0.0], [1.0], [3.0]])
    shift = np.array([[0.0], [1.0], [2.0]])
    found = newton.solve(lambda u: (u - shift) ** 3, lambda u: 3 * (u - shift)[..., None] ** 2, guess)
    assert found[:2].tolist() == [[0.0], [1.0]] and found[2] == pytest.approx(2.0, abs=1e-6)


def test_a_singular_matrix_whose_equations_contradict_gives_nothing():
    newton = Newton((1, 2))
    singular = np.array([[[1.0, 1.0], [1.0, 1.0]]])
    assert np.isnan(
        newton.solve(lambda u: (singular @ u[..., None])[..., 0] - [1.0, 2.0], lambda _: singular, np.zeros((1, 2)))
    ).all()


def test_shortest_solutions():
    a, x = np.array([[2.0, 0.0, 0.0], [0.0, 1e-9, 1e-9], [0.0, 0.0, 0.0]]), np.array([[3.0], [0.5], [0.5]])
    found, determined = shortest_solution(a, a @ x)
    assert found == pytest.approx(x, rel=1e-12) and determined.tolist() == [True, False, False]
    assert np.isnan(shortest_solution(a, np.ones((3, 1)))[0]).all()
    assert not shortest_solution(np.full((2, 2), np.nan), np.zeros((2, 1)))[1].any()


def test_a_residual_vanishes_against_its_terms():
    a, u = np.array([[[3.0, -1.0]]]), np.array([[1e6, 3e6]])
    assert vanishes(a, np.array([[1e-9]]), u).all() and not vanishes(a, np.array([[1e-6]]), u).any()
    assert vanishes(a, np.zeros((1, 1)), np.zeros((1, 2))).all() and not vanishes(a, np.ones((1, 1)), 0 * u).any()
