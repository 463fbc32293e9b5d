"""What happens at the start or the stop time of a run, or a unit of the last digit beside: once, and the run ends."""

import math

import numpy as np
import pytest
from oracles.models import compiled_text

BASE = """
model Base "A mass on a moving base"
  input Real u(unit = "m") = {u};
  Motion base(q = u);
  SpringDamper strut(k = 1000, c = 10);
  Mass body(m = 1, q(start = 0.03, fixed = true), v(start = 0, fixed = true));
equation
  connect(base.flange, strut.a);
  connect(strut.b, body.flange);
end Base;
"""
STEP = "if time {op} {at!r} then 0.02 else 0.03"
BESIDE = [lambda t: t, lambda t: math.nextafter(t, -math.inf), lambda t: math.nextafter(t, math.inf)]
SOLVERS = ["auto", "dop853", "taylor", "cvode", "adams", "radau", "gauss", "rk4", "midpoint", "generalized-alpha"]


def stepped(at, op=">"):
    return compiled_text(BASE.format(u=STEP.format(op=op, at=at)))


@pytest.mark.parametrize("beside", BESIDE)
@pytest.mark.parametrize("op", [">", ">=", "<"])
def test_an_input_steps_at_the_stop_time(beside, op):
    """The damper turns the step into the velocity c·Δ/m, also at the stop."""
    for at in (1.0, 0.3, 0.1 + 0.2):
        run = stepped(beside(at), op).simulate(stop=at)
        assert [e.kind for e in run.events] == ["step"]
        assert run.time[-1] == at and run["body.v"][-1] == pytest.approx(-0.1 if op != "<" else 0.1, abs=0.02)


@pytest.mark.parametrize("solver", SOLVERS)
def test_with_each_solver(solver):
    run = stepped(1.0).simulate(stop=1.0, solver=solver, points=11)
    assert [e.kind for e in run.events] == ["step"] and run["body.v"][-1] == pytest.approx(-0.1, abs=1e-3)


def test_a_step_at_time_zero_of_a_run_that_begins_before():
    run = stepped(0.0).simulate(start=-1.0, stop=1.0)
    assert [(e.kind, e.time) for e in run.events] == [("step", 0.0)] and run.time[-1] == 1.0


def test_steps_at_both_ends():
    dae = compiled_text(BASE.format(u="if time < 0.25 then 0.03 elseif time < 0.75 then 0.02 else 0.01"))
    run = dae.simulate(start=0.25, stop=0.75)
    assert [(e.kind, e.time) for e in run.events] == [("step", 0.25), ("step", 0.75)]


def test_tables_jump_and_formulas_bend_at_the_stop_time():
    dae = compiled_text(BASE.format(u="0.03"))
    for at in (beside(1.0) for beside in BESIDE):
        run = dae.simulate(stop=1.0, inputs={"u": (np.array([0, at, at, 2]), np.array([0.03, 0.03, 0.02, 0.02]))})
        assert [e.kind for e in run.events] == ["step"] and run.time[-1] == 1.0
        bent = compiled_text(BASE.format(u=f"0.03 + 0.2*max(0, time - {at!r})")).simulate(stop=1.0)
        assert bent.time[-1] == 1.0 and bent["body.q"][-1] == pytest.approx(0.03, abs=1e-9)


def test_going_on_behind_a_step_at_the_stop_time_makes_it_once():
    dae = stepped(1.0)
    whole = dae.simulate(stop=1.2)
    for cut in (1.0, math.nextafter(1.0, 0.0), math.nextafter(1.0, 2.0)):
        first = dae.simulate(stop=cut)
        rest = dae.simulate(start=cut, stop=1.2, initial=first.end)
        assert [e.kind for e in (*first.events, *rest.events)] == ["step"]
        assert rest["body.q"][-1] == pytest.approx(whole["body.q"][-1], abs=1e-6)


def test_live_goes_through_a_step_at_the_end_of_its_own_steps():
    live = stepped(1.0).live()
    for _ in range(12):
        live.advance(0.1)  # 0.1 + 0.1 + … is 0.9999999999999999 after ten
    assert [e.kind for e in live.events] == ["step"]
    whole = stepped(1.0).simulate(stop=live.time)
    assert live["body.q"] == pytest.approx(whole["body.q"][-1], abs=1e-6)


EVENTS = """
model Events
  parameter Real at = 1;
  Real x(start = 0, fixed = true);
  Integer n(start = 0, fixed = true), m(start = 0, fixed = true);
  Integer k(start = 0, fixed = true), l(start = 0, fixed = true);
equation
  der(x) = 1;
  when time >= at then n = pre(n) + 1; end when;
  when x >= at then m = pre(m) + 1; end when;
  when sample(at, 10) then k = pre(k) + 1; end when;
  when x > at then l = pre(l) + 1; end when;
end Events;
"""


@pytest.mark.parametrize("beside", BESIDE)
@pytest.mark.parametrize("solver", ["dop853", "cvode", "radau", "rk4"])
def test_conditions_and_samples_at_the_stop_time(beside, solver):
    run = compiled_text(EVENTS).simulate(parameters={"at": beside(0.7)}, stop=0.7, solver=solver)
    assert [run[name][-1] for name in ("n", "m", "k", "l")] == [1, 1, 1, 1]
    assert run.time[-1] == 0.7


@pytest.mark.parametrize("beside", BESIDE)
def test_the_model_ends_the_run_at_the_stop_time(beside):
    text = EVENTS.replace("equation\n", 'equation\n  when time >= at then terminate("enough"); end when;\n')
    run = compiled_text(text).simulate(parameters={"at": beside(0.7)}, stop=0.7)
    assert any(d.code == "N0552" for d in run.notes) and run.end.time == pytest.approx(0.7, abs=1e-15)


BALL = """
model Ball
  parameter Real e = 0.5;
  Mass m(m = 1, g = -10, q(start = 5, fixed = true), v(start = 0, fixed = true));
  Fixed w; Stop s(L = 0, e = e);
equation
  connect(w.flange, s.a); connect(s.b, m.flange);
end Ball;
"""


@pytest.mark.parametrize("solver", ["dop853", "cvode", "radau", "gauss"])
def test_an_impact_or_the_last_bounce_at_the_stop_time(solver):
    """Impact at 1 s; all bounces are over at 1 + 2·(e + e² + …) = 3 s for e = 0.5."""
    dae = compiled_text(BALL)
    for at in (beside(1.0) for beside in BESIDE):
        run = dae.simulate(stop=at, solver=solver)
        assert [e.kind for e in run.events] == ["impact"] and run["m.v"][-1] == pytest.approx(5.0, rel=1e-6)
    for at in (beside(3.0) for beside in BESIDE):
        run = dae.simulate(stop=at, solver=solver)
        assert run.events[-1].kind == "accumulation" and run.time[-1] == at and abs(run["m.v"][-1]) < 1e-6


def test_an_impact_at_the_start():
    text = BALL.replace("q(start = 5, fixed = true), v(start = 0", "q(start = 0, fixed = true), v(start = -10")
    run = compiled_text(text).simulate(start=2.0, stop=2.5)
    assert [(e.kind, e.time) for e in run.events] == [("impact", 2.0)]
    assert run["m.v"][-1] == pytest.approx(0.0, abs=1e-9)
