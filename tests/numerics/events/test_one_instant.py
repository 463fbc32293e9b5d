"""Events that lie within the accuracy of their location are one instant, whichever of them rounding puts first."""

from fractions import Fraction
from math import ceil, floor

import numpy as np
import pytest
from oracles.models import compiled_text

TICKS = """
model Ticks "A level that is reached at some ticks of a clock"
  parameter Real a = 1, length = 0.25;
  Real x(start = 0, fixed = true);
  Integer n(start = 0, fixed = true), k(start = 0, fixed = true), c;
equation
  der(x) = a;
  c = integer(4*x);
  when sample(length, length) then n = pre(n) + 1; end when;
  when change(c) then k = pre(k) + n; end when;
end Ticks;
"""


def counted(a, length, stop):
    """Ticks, and the sum of their number at each change of level, counted in whole numbers."""
    changes = [Fraction(m) / (4 * a) for m in range(1, floor(4 * a * stop) + 1)]
    return floor(stop / length), sum(floor(t / length) for t in changes)


def test_levels_at_ticks():
    dae, draw = compiled_text(TICKS), np.random.default_rng(1)
    cases = [(Fraction(2), Fraction(1, 4)), (Fraction(7, 10), Fraction(1, 4)), (Fraction(-3, 5), Fraction(1, 10))]
    cases += [(Fraction(int(draw.integers(1, 40)), 10), Fraction(int(draw.integers(1, 30)), 100)) for _ in range(6)]
    for a, length in cases:
        values = {"a": float(a), "length": float(length)}
        stop = 7 * length + Fraction(1, 1000)
        run = dae.simulate(parameters=values, stop=float(stop))
        if a < 0:  # the level falls at once, and then just after each whole number
            times = [Fraction(m) / (-4 * a) for m in range(1, ceil(-4 * a * stop))]
            expected = floor(stop / length), sum(floor(t / length) for t in times)
        else:
            expected = counted(a, length, stop)
        assert (run["n"][-1], run["k"][-1]) == expected, (a, length)


TWO = """
model Two
  parameter Real s = 1, level = 0.6, moment = 0.6;
  Real x(start = 0, fixed = true), y(start = 0, fixed = true);
  Integer n(start = 0, fixed = true), m(start = 0, fixed = true), j(start = 0, fixed = true);
equation
  der(x) = s;
  der(y) = 3*s;
  when {x > level, time > moment} then n = pre(n) + 1; end when;
  when {x >= level, 3*level < y} then m = pre(m) + 1; end when;
  when {x >= level, sample(moment, 100)} then j = pre(j) + 1; end when;
end Two;
"""


@pytest.mark.parametrize("solver", ["dop853", "cvode", "radau", "gauss", "rk4"])
def test_two_conditions_at_one_instant_fire_once(solver):
    dae = compiled_text(TWO)
    for moment, s in ((0.3, 0.7), (0.1 + 0.2, 0.1), (5.1, 1 / 7)):
        run = dae.simulate(parameters={"s": s, "level": s * moment, "moment": moment}, stop=1.2 * moment, solver=solver)
        assert [run[name][-1] for name in ("n", "m", "j")] == [1, 1, 1], (moment, s)
        assert {e.time for e in run.events} == {run.events[0].time}


def test_events_farther_apart_are_two():
    dae = compiled_text(TWO)
    for apart in (1e-9, -1e-9):
        run = dae.simulate(parameters={"level": 0.6 + apart}, stop=1.0)
        assert [run[name][-1] for name in ("n", "m", "j")] == [2, 1, 2]


def test_an_impact_at_a_tick():
    """A ball meets the floor at a tick to the last digits, for many heights; both happen at the tick."""
    text = """
    model Ball
      parameter Real length = 0.5;
      Mass m(m = 1, g = -10, q(start = 5*length^2, fixed = true), v(start = 0, fixed = true));
      Fixed w; Stop s(L = 0, e = 0.5);
      Integer n(start = 0, fixed = true);
    equation
      connect(w.flange, s.a); connect(s.b, m.flange);
      when sample(length, length) then n = pre(n) + 1; end when;
    end Ball;
    """
    dae = compiled_text(text)
    for length in np.linspace(0.3, 0.9, 7):
        run = dae.simulate(parameters={"length": length}, stop=1.5 * length)
        assert [(e.name, e.time) for e in run.events] == [("s", length), ("Ball", length)]


PLAY = """
model Play "What is exactly zero between its flanks passes through zero with them, and stays there"
  parameter Real a = 1, k = 30, play = 0.25;
  Real x(start = 0, fixed = true), v(start = 1, fixed = true);
  Real s, push = k*s;
  Boolean pulls = push < 0, pushes = push > 0, apart = not (push >= 0 and push <= 0);
  Real y(start = 0, fixed = true) "grows where the play is taken up";
equation
  der(x) = v;
  der(v) = -x;
  s = if x > play then x - play else if x < -play then x + play else 0;
  der(y) = if push < 0 or push > 0 then a else 0;
end Play;
"""


@pytest.mark.parametrize("solver", ["dop853", "cvode"])
def test_what_stays_exactly_zero_does_not_cross_it(solver):
    dae, draw = compiled_text(PLAY), np.random.default_rng(3)
    for play in [0.25, *draw.uniform(0.01, 0.9, 2)]:
        run = dae.simulate(parameters={"play": play}, stop=6 * np.pi, points=301, solver=solver, rtol=1e-10)
        inside = np.abs(np.abs(run["x"]) - play) > 1e-7
        for name, truth in (("pulls", run["x"] < -play), ("pushes", run["x"] > play), ("apart", abs(run["x"]) > play)):
            assert np.array_equal(run[name][inside] > 0.5, truth[inside]), (name, play)
        assert run["y"][-1] == pytest.approx(6 * np.pi - 12 * np.arcsin(play), abs=1e-6)
        turns = [(e.name, e.before, e.after) for e in run.events if e.name == "push < 0"]
        assert turns == 3 * [("push < 0", "false", "true"), ("push < 0", "true", "false")], play
