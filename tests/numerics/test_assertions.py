"""Assertions are watched while a run goes on: whatever output times, solvers and tolerances are asked for."""

from math import acos, asin, pi, sqrt

import numpy as np
import pytest
from oracles.models import compiled_text

import lmoc

SWING = """model Swing
  Mass m(m = 1, q(start = 0, fixed = true), v(start = 1, fixed = true));
  Spring s(k = 1);
  Fixed wall;
  parameter Real least = -2;
equation
  connect(wall.flange, s.a);
  connect(s.b, m.flange);
  assert(abs(m.q) < 0.999 or m.v < -3, "at an end", AssertionLevel.warning);
  assert(m.q > least, "beyond the least");
end Swing;"""
BALL = """model Ball "passes a mark between two bounces"
  Mass m(m = 1, g = -9.81, q(start = 1, fixed = true), v(fixed = true)); Fixed floor; Stop s(L = 0, e = 0.8);
  Integer n(start = 0, fixed = true);
equation
  connect(floor.flange, s.a); connect(s.b, m.flange);
  when s.gap <= 0 then n = pre(n) + 1; end when;
  assert(m.q < 0.6 or time < 0.5, "high again", LEVEL);
end Ball;"""


def told(run: lmoc.Run) -> tuple[float, float]:
    """When a warning begins, and for how long it lasts."""
    (note,) = [n for n in run.notes if n.code == "W0551"]
    since, length = note.message.split("from t = ")[1].removesuffix(" s)").split(" s, for ")
    return float(since), float(length)


@pytest.mark.parametrize(
    ("solver", "points"),
    [
        *(("auto", points) for points in (2, 3, 50)),
        *((solver, 3) for solver in ("taylor", "cvode", "cvodes", "gauss", "radau")),
        *((solver, 50) for solver in ("cvode", "cvodes")),
    ],
)
def test_what_does_not_hold_between_output_times_is_told(points, solver):
    run = compiled_text(SWING).simulate(stop=2 * pi, points=points, rtol=1e-9, solver=solver)
    since, length = told(run)
    assert since == pytest.approx(asin(0.999), abs=1e-6)
    assert length == pytest.approx(2 * (pi - 2 * asin(0.999)), abs=1e-4)


@pytest.mark.parametrize("points", [2, 7, 1000])
def test_an_error_ends_the_run_where_its_relation_crosses(points):
    with pytest.raises(lmoc.SimulationError, match=r"an assertion does not hold at t = 3\.665\d+ s: beyond") as failed:
        compiled_text(SWING).simulate(stop=20, points=points, rtol=1e-10, parameters={"least": -0.5})
    assert failed.value.time == pytest.approx(pi + asin(0.5), abs=1e-9)
    partial = failed.value.partial
    assert partial.time[-1] == failed.value.time
    assert partial["m.q"][-1] == pytest.approx(-0.5, abs=1e-9)
    assert partial["m.q"] == pytest.approx(np.sin(partial.time), abs=1e-8)


def test_an_error_at_the_start():
    with pytest.raises(lmoc.SimulationError, match="at t = 0 s: beyond") as failed:
        compiled_text(SWING).simulate(stop=1, parameters={"least": 0.5})
    assert failed.value.time == 0


@pytest.mark.parametrize("points", [2, 400])
def test_beside_laws_and_events(points):
    text = BALL.replace("LEVEL", "AssertionLevel.warning")
    run = compiled_text(text).simulate(stop=1.1, points=points, rtol=1e-9)
    fall = sqrt(2 / 9.81)
    rise = 0.8 * 9.81 * fall
    span = sqrt(rise**2 - 2 * 9.81 * 0.6) / 9.81
    assert told(run) == pytest.approx((fall + rise / 9.81 - span, 2 * span), abs=1e-6)
    assert [e.kind for e in run.events if e.name == "s"] == ["impact"]
    plain = compiled_text(text.replace("assert", "// assert")).simulate(stop=1.1, points=points, rtol=1e-9)
    assert [(e.name, e.kind) for e in run.events] == [(e.name, e.kind) for e in plain.events]
    assert run["m.q"] == pytest.approx(plain["m.q"], abs=1e-9)


@pytest.mark.parametrize("solver", ["auto", "dop853", "taylor"])
@pytest.mark.parametrize("stop", [1.1, 3, 30])
def test_an_error_between_two_impacts(solver, stop):
    """Also where a step of a series reaches the end of the run, of which the hop is a small part."""
    text = BALL.replace("LEVEL", "AssertionLevel.error")
    with pytest.raises(lmoc.SimulationError, match="high again") as failed:
        compiled_text(text).simulate(stop=stop, points=2, rtol=1e-10, solver=solver)
    fall = sqrt(2 / 9.81)
    rise = 0.8 * 9.81 * fall
    assert failed.value.time == pytest.approx(fall + (rise - sqrt(rise**2 - 2 * 9.81 * 0.6)) / 9.81, abs=1e-9)


def test_an_assertion_of_a_jump_holds_from_there_on():
    text = """model Jump
  Real x(start = 0, fixed = true); discrete Real d(start = 0, fixed = true);
equation
  der(x) = 1; when x > 0.25 then d = 1; end when; assert(d < 0.5, "jumped", AssertionLevel.warning);
end Jump;"""
    assert told(compiled_text(text).simulate(stop=1, points=2)) == pytest.approx((0.25, 0.75), abs=1e-6)


def test_an_assertion_of_time_alone():
    text = """model Late
  Real x; equation x = 2*time; assert(x < 1, "late", AssertionLevel.warning); end Late;"""
    assert told(compiled_text(text).simulate(stop=2, points=5)) == pytest.approx((0.5, 1.5), abs=1e-9)


def test_of_an_array_the_first_element_is_told():
    text = """model Two
  Real x[2](start = {0, 0.3}, each fixed = true);
equation
  der(x) = {1, 1};
  for i in 1:2 loop assert(x[i] < 0.5, "far", AssertionLevel.warning); end for;
end Two;"""
    notes = [n.message for n in compiled_text(text).simulate(stop=1, points=2).notes if n.code == "W0551"]
    assert any("from t = 0.2 s" in note for note in notes)


def test_a_mechanism_whose_loops_are_solved_on_the_way():
    """A crank and a slider: the piston's place follows from the crank's angle."""
    text = """model Crank
  Real phi(start = 0, fixed = true), x(start = 1.5), y;
equation
  der(phi) = 1;
  y = 0.5*sin(phi);
  (x - 0.5*cos(phi))^2 + y^2 = 1;
  assert(x > 0.6, "near", AssertionLevel.warning);
end Crank;"""
    since, length = told(compiled_text(text).simulate(stop=2 * pi, points=2, rtol=1e-9))
    assert since == pytest.approx(acos((0.6**2 + 0.5**2 - 1) / (2 * 0.6 * 0.5)), abs=1e-8)
    assert length == pytest.approx(2 * (pi - since), abs=1e-5)
