"""Events against closed forms: bounces, samples, edges, roots that start at zero, terminations, starts."""

from math import pi, sqrt

import numpy as np
import pytest
from oracles.models import compiled_text

import lmoc

G = 9.81
BALL = """model Ball "a ball that bounces, with restitution"
  parameter Real e = 0.7;
  Real h(start = 1, fixed = true), v(start = 0, fixed = true);
  Integer n(start = 0, fixed = true) "bounces";
  discrete Real fastest(start = 0, fixed = true);
equation
  der(h) = v;
  der(v) = -9.81;
  when h <= 0 then
    reinit(v, -e*pre(v));
    n = pre(n) + 1;
    fastest = max(pre(fastest), -pre(v));
  end when;
end Ball;"""


def run(text: str, **options) -> lmoc.Run:
    return compiled_text(text).simulate(**{"rtol": 1e-10, "points": 11} | options)


def times_of(result, kind: str = "when") -> list[float]:
    return [e.time for e in result.events if e.kind == kind]


def test_a_ball_bounces_until_near_the_end_of_all_bounces() -> None:
    result = run(BALL, stop=2.5, points=26)
    first, e = sqrt(2 / G), 0.7
    exact = [first]
    while exact[-1] + 2 * first * e ** len(exact) < 2.5:
        exact.append(exact[-1] + 2 * first * e ** len(exact))
    found = times_of(result)
    assert len(found) == len(exact) == 11 == result["n"][-1]
    assert np.abs(np.array(found) - exact).max() < 1e-10
    # between bounces k and k + 1 the height is a parabola
    k = np.searchsorted(exact, result.time, "right")
    since = result.time - np.append(exact, 0.0)[k - 1]
    height = np.where(k == 0, 1 - G * result.time**2 / 2, sqrt(2 * G) * e**k * since - G * since**2 / 2)
    assert np.abs(result["h"] - height).max() < 1e-9
    assert result["fastest"][-1] == pytest.approx(sqrt(2 * G), abs=1e-9)


def test_a_bounce_is_one_event() -> None:
    """The condition has become false again right behind the impact: that needs no event of its own."""
    result = run(BALL, stop=2)
    assert len(result.trajectory.segments) == 1 + result["n"][-1]


@pytest.mark.parametrize("solver", ["auto", "dop853", "taylor"])
def test_bounces_without_end_are_recognized(solver: str) -> None:
    """Also along a series, whose first step would be all that is left of the run, however low the ball bounces."""
    with pytest.raises(lmoc.SimulationError, match=r"'h <= 0' .*line 9.* switches back and forth") as failed:
        run(BALL, stop=5, solver=solver)
    assert failed.value.time == pytest.approx(sqrt(2 / G) * 1.7 / 0.3, abs=1e-6)  # Zeno's time


@pytest.mark.parametrize("solver", ["auto", "dop853", "taylor", "cvode", "adams", "radau", "ida"])
def test_no_ball_falls_through_its_floor(solver: str) -> None:
    """Hops that become too low to be seen end a run: however fast they do, wherever the floor is, with every method."""
    ball = BALL.replace("start = 1,", "start = floor + 1,").replace("h <= 0", "h <= floor")
    ball = ball.replace("e = 0.7", "e = 0.7, floor = 0")
    dae = compiled_text(ball)
    for e, floor in ((0.05, 0.0), (0.5, 5.0)):
        zeno = sqrt(2 / G) * (1 + e) / (1 - e)
        with pytest.raises(lmoc.SimulationError, match="switches back and forth") as failed:
            dae.simulate(stop=2 * zeno, parameters={"e": e, "floor": floor}, rtol=1e-6, solver=solver)
        assert failed.value.time == pytest.approx(zeno, rel=1e-2)


def test_what_a_jump_stops_goes_on() -> None:
    """A body that is stopped is no hop: what follows is what the equations say."""
    text = """model M Real x(start = 1, fixed = true), v(start = -1, fixed = true);
    Boolean held(start = false, fixed = true);
    equation der(x) = v; der(v) = if held then 0 else -1;
    when x <= 0.5 then reinit(v, 0); held = true; end when; end M;"""
    result = run(text, stop=2)
    assert result["x"][-1] == pytest.approx(0.5, abs=1e-12)
    assert len(times_of(result)) == 1
    falls = run(text.replace("if held then 0 else -1", "-1"), stop=2)  # nothing holds it: it falls on from rest
    since = 2 - (sqrt(2) - 1)
    assert falls["x"][-1] == pytest.approx(0.5 - since**2 / 2, abs=1e-9)


def test_a_chattering_condition_is_named_with_its_line() -> None:
    text = "model M Real x(start = 1, fixed = true);\nequation\n  der(x) = -1e9*(if x > 0.5 then 1 else -1);\nend M;"
    with pytest.raises(lmoc.SimulationError, match=r"'x > 0.5' \(.*, line 3\) switches back and forth"):
        run(text)


# ------------------------------------------------------------------------- time events


def test_samples_come_at_their_instants() -> None:
    result = run(
        """model S parameter Real T = 0.3; Real x(start = 0, fixed = true); discrete Real held(start = -1);
          Integer n(start = 0);
        equation
          der(x) = 2;
          when sample(0.1, T) then held = x; n = pre(n) + 1; end when;
        end S;""",
        stop=1,
    )
    assert times_of(result, "time") == [0.1 + k * 0.3 for k in range(3)] + [0.1 + 3 * 0.3]
    assert result["n"].tolist() == [0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4]  # at an event, the value behind it
    held = [-1] + [2 * (0.1 + k * 0.3) for k in (0, 0, 0, 1, 1, 1, 2, 2, 2, 3)]
    assert result["held"] == pytest.approx(held, abs=1e-12)


@pytest.mark.parametrize("solver", ["dop853", "cvode", "gauss"])
def test_a_sample_is_not_lost_where_a_state_event_comes_at_the_same_instant(solver: str) -> None:
    """Roots at the ticks themselves, to the last bit or next to it; an impact among them."""
    result = run(
        """model S Real x(start = 0, fixed = true); Integer n(start = 0), c, b(start = 0), k(start = 0);
          Mass m(m = 1, q(start = 1, fixed = true), v(start = -2, fixed = true)); Fixed wall; Stop stop(L = 0, e = 0.5);
        equation
          der(x) = 1;
          c = integer(4*x);
          connect(wall.flange, stop.a);
          connect(stop.b, m.flange);
          when sample(0.25, 0.25) then n = pre(n) + 1; end when;
          when change(c) then b = pre(b) + 1; end when;
          when m.v > 0 then k = pre(k) + 1; end when;
        end S;""",
        stop=1.1,
        solver=solver,
    )
    assert [result[v][-1] for v in "nbk"] == [4, 4, 1]
    assert result["m.q"][-1] == pytest.approx(0.6, abs=1e-9)


def test_every_rise_of_a_fast_sine_of_time_is_an_event() -> None:
    result = run(
        """model S Real x(start = 0, fixed = true); Integer n(start = 0, fixed = true);
        equation
          der(x) = 1;
          when sin(1e6*time) > 0.5 then n = pre(n) + 1; end when;
        end S;""",
        stop=2e-4,
    )
    assert times_of(result, "when") == pytest.approx([(2 * pi * k + pi / 6) / 1e6 for k in range(32)], rel=1e-12)


def test_conditions_in_time_alone_are_exact() -> None:
    result = run(
        """model T parameter Real d = 0.1;
          Real x(start = 0, fixed = true); discrete Real next(start = 0.25, fixed = true);
        equation
          der(x) = if time < 3*d then 1 else if time > 0.7 then -1 else 0;
          when time >= pre(next) then next = pre(next)*2; end when;
        end T;""",
        stop=1,
        points=21,
    )
    t = result.time
    exact = np.where(t < 0.3, t, np.where(t < 0.7, 0.3, 1.0 - t))
    assert np.abs(result["x"] - exact).max() < 1e-14
    assert times_of(result, "time") == [0.25, 0.5, 1.0]
    assert result["next"].tolist() == [0.25] * 5 + [0.5] * 5 + [1.0] * 10 + [2.0]


def test_whole_numbers_of_time_change_at_their_instants() -> None:
    text = """model F Real x(start = 0, fixed = true); Integer n = integer(10*time);
      equation der(x) = n + mod(time, 0.25); end F;"""
    result = run(text, stop=0.5, points=6)
    assert result["n"].tolist() == [0, 1, 2, 3, 4, 5]
    assert result["x"][-1] == pytest.approx(0.1 * (1 + 2 + 3 + 4) + 2 * 0.25**2 / 2, abs=1e-13)


def test_formulas_of_time_that_are_not_linear_are_found() -> None:
    text = "model W Integer n(start = 0); equation when sin(40*time) > 0.99 then n = pre(n) + 1; end when; end W;"
    result = run(text, stop=3)
    first = np.arcsin(0.99) / 40
    assert times_of(result) == pytest.approx(np.arange(first, 3, 2 * pi / 40), abs=1e-12)


# ------------------------------------------------------------------------- roots at zero

FALLING = "model Z Real x(start = 0, fixed = true); Integer n(start = 0); equation der(x) = {}; {} end Z;"


@pytest.mark.parametrize(
    ("rate", "condition", "times"),
    [
        ("-1", "x < 0", [0.0]),  # leaves zero for the side where it is true: at once
        ("1", "x < 0", []),  # … for the other side: never
        ("-1", "x <= 0", []),  # true from the start on: it does not become true
        ("1", "x <= 0", []),
        ("1", "x > 0", [0.0]),
        ("cos(time)", "x > 0", [0.0, 2 * pi]),
        ("3*time^2", "x > 0", [0.0]),  # a triple zero
        ("-3*time^2", "x < 0", [0.0]),
        ("3*time^2 - 2*time", "x > 0", [1.0]),  # leaves zero downwards with no slope, and comes back
        ("3*time^2 - 2*time", "x < 0", [0.0]),
        ("3*(time - 1)^2", "x > 1", [1.0]),  # a triple zero on the way
        ("2*time - 2", "x > 0", [2.0]),
    ],
)
def test_roots_at_the_start(rate: str, condition: str, times: list[float]) -> None:
    body = f"when {condition} then n = pre(n) + 1; end when;"
    result = run(FALLING.format(rate, body), stop=7, rtol=1e-10)
    assert times_of(result) == pytest.approx(times, abs=2e-4 if "^2" in rate else 1e-9)
    assert result["n"][-1] == len(times)


def test_several_roots_of_one_step_come_in_order() -> None:
    result = run(
        """model O Real x(start = 0, fixed = true); Integer order[3](each start = 0, each fixed = true);
        equation
          der(x) = 1;
          when x > 1/3 then order[1] = max(pre(order)) + 1; end when;
          when x > 0.3 then order[2] = max(pre(order)) + 1; end when;
          when x > 1/3 + 1e-9 then order[3] = max(pre(order)) + 1; end when;
        end O;""",
        stop=1,
    )
    assert times_of(result) == pytest.approx([0.3, 1 / 3, 1 / 3 + 1e-9], abs=1e-12)
    assert [result[f"order[{k}]"][-1] for k in (1, 2, 3)] == [2, 1, 3]


# ------------------------------------------------------------------------ the iteration


def test_events_follow_each_other_at_one_instant() -> None:
    result = run(
        """model C Real x(start = 1, fixed = true);
          Integer a(start = 0), b(start = 0), c(start = 0); Boolean late = a > 1;
        equation
          der(x) = -1;
          when x < 0.5 then a = pre(a) + 2; end when;
          when {late, change(b)} then c = pre(c) + 1; end when;
          when edge(late) then b = 7; end when;
        end C;""",
        stop=1,
    )
    assert [result[name][-1] for name in "abc"] == [2, 7, 1]  # late and b change together
    assert times_of(result) == pytest.approx([0.5] * 3, abs=1e-12)


def test_what_is_true_from_the_start_does_not_rise() -> None:
    result = run(
        """model I Real x(start = 1, fixed = true);
          Integer n(start = 3), k(start = 0), m(start = 0); Boolean begun = initial();
        equation
          der(x) = -1;
          when x > 0.5 then k = 1; end when;
          when {initial(), x < 0.5} then n = pre(n) + 1; end when;
          when initial() then m = 5; end when;
        end I;""",
        stop=1,
    )
    assert result["k"].tolist() == [0.0] * 11
    assert result["m"].tolist() == [5.0] * 11
    assert result["n"][:5].tolist() == [4.0] * 5 and result["n"][6:].tolist() == [5.0] * 5  # the sixth is the instant
    assert not result["begun"].any()


def test_the_end_is_an_event_of_its_own() -> None:
    result = run(
        """model E Real x(start = 1, fixed = true); discrete Real last(start = 0);
        equation der(x) = -x; when terminal() then last = x; end when; end E;""",
        stop=2,
    )
    assert result["last"][:-1].tolist() == [0.0] * 10
    assert result["last"][-1] == pytest.approx(np.exp(-2), rel=1e-9)


def test_the_end_is_not_where_an_input_steps_nor_does_a_table_that_ends_there_break_the_run() -> None:
    text = """model E input Real u(unit = "m"); Motion road(q = u); Damper d(c = 1);
      Mass m(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true));
      Real age(start = 0, fixed = true); discrete Real last(start = 0, fixed = true);
      equation connect(road.flange, d.a); connect(d.b, m.flange); der(age) = 1;
      when terminal() then last = age; end when; end E;"""
    found = lmoc.compile_text(text).simulate(stop=3, points=4, inputs={"u": ([0, 1, 1, 2, 3], [0, 0.1, 0.3, 0.2, 0])})
    assert found["last"] == pytest.approx([0, 0, 0, 3], rel=1e-12, abs=0)
    assert [(e.time, e.kind) for e in found.events] == [(1, "step"), (3, "when")]


def test_terminate_ends_a_run() -> None:
    result = run(
        """model T Real x(start = 1, fixed = true); equation der(x) = -x;
          when x < 0.5 then terminate("half"); end when; end T;""",
        stop=2,
        points=21,
    )
    assert result.time[-1] <= np.log(2) < result.time[-1] + 0.1
    assert any("half" in note.message for note in result.notes)


def test_elsewhen_comes_second() -> None:
    result = run(
        """model P Real x(start = 1, fixed = true); Integer n(start = 0);
        equation der(x) = -1;
          when x < 0.5 then n = 1; elsewhen x < 0.5 then n = 2; elsewhen x < 0.25 then n = 3; end when; end P;""",
        stop=1,
    )
    assert result["n"][:5].tolist() == [0] * 5  # until x = 0.5, the sixth output time
    assert result["n"][6:].tolist() == [1, 1, 3, 3, 3]


def test_an_assertion_in_a_when_belongs_to_its_instant() -> None:
    text = """model Q Real x(start = 1, fixed = true); equation der(x) = -1;
      when x < 0.5 then assert(time > {}, "too early"); end when; end Q;"""
    run(text.format(0.4), stop=1)
    with pytest.raises(lmoc.SimulationError, match="too early") as failed:
        run(text.format(0.6), stop=1)
    assert failed.value.time == pytest.approx(0.5, abs=1e-9)


def test_reinit_of_a_variable_that_follows_from_a_state() -> None:
    text = """model R Inertia J(J = 1, theta(fixed = true), omega(start = 1, fixed = true));
      Gear g(N = 4); Inertia K(J = 16);
      equation connect(J.shaft, g.a); connect(g.b, K.shaft);
      when time > 0.5 then reinit(K.omega, -pre(K.omega)); end when;
      end R;"""
    result = run(text, stop=1)
    assert result["J.theta"] == pytest.approx(np.where(result.time <= 0.5, result.time, 1 - result.time), abs=1e-12)


def test_an_iteration_without_end_is_an_error() -> None:
    text = """model U Real x(start = 1, fixed = true), y; Boolean b = y > 0; equation der(x) = -1;
      y = if b then x - 1.5 else 2 - x; end U;"""
    with pytest.raises((lmoc.SimulationError, lmoc.ModelError), match="no values satisfy all equations"):
        run(text, stop=3)


def test_a_run_goes_on_from_where_another_has_ended() -> None:
    model = compiled_text(BALL)
    whole = model.simulate(stop=2, rtol=1e-10, points=5)
    half = model.simulate(stop=1, rtol=1e-10, points=3)
    rest = model.simulate(initial=half.trajectory.end, stop=2, rtol=1e-10, points=3)
    assert rest["n"][-1] == whole["n"][-1] == 4
    assert rest["h"][-1] == pytest.approx(whole["h"][-1], abs=1e-9)


@pytest.mark.parametrize("solver", ["ida", "cvode", "adams", "radau", "cvodes"])
def test_every_solver_stops_at_events(solver: str) -> None:
    result = run(BALL, stop=1.2, solver=solver, rtol=1e-8)
    assert times_of(result) == pytest.approx([0.4515236409857309, 1.0836567383657541], abs=1e-6)
    assert result["n"][-1] == 2


def test_signals_from_outside_that_jump() -> None:
    text = """model B input Boolean on = time > 0.5; input Integer n = if time < 0.25 then 1 else 3; input Real u;
        Real x(start = 0, fixed = true); Integer k(start = 0), up(start = 0);
      equation der(x) = if on then n else 0; when on then k = n; end when; when u > 0.5 then up = pre(up) + 1; end when;
      end B;"""
    result = run(text, stop=1, inputs={"u": ([0, 0.2, 0.4, 0.8, 1], [0, 1, 0, 1, 0])})
    assert result["x"][-1] == pytest.approx(1.5, abs=1e-9)
    assert (result["k"][-1], result["up"][-1]) == (3, 2)
    assert times_of(result) == pytest.approx([0.1, 0.5, 0.6], abs=1e-9)


def test_discrete_variables_start_where_they_are_told_to() -> None:
    text = """model D Integer k(start = 2); Real x(start = 1, fixed = true); discrete Real level;
      initial equation level = 5;
      equation der(x) = -k; when x < 0.1 then k = pre(k) + 1; level = 2*pre(level); end when; end D;"""
    model = compiled_text(text)
    assert model.simulate(stop=1)["k"][-1] == 3
    result = model.simulate(stop=1, initial={"k": 7})
    assert (result["k"][0], result["k"][-1], result["level"][0], result["level"][-1]) == (7, 8, 5, 10)


def test_a_sample_needs_a_positive_interval() -> None:
    with pytest.raises(lmoc.ModelError, match="interval of 'sample"):
        run("model A parameter Real T = 0; Integer n; equation when sample(0, T) then n = 1; end when; end A;")


@pytest.mark.parametrize(("body", "line"), [
    ("when time > 0.2 then n = 1; end when;\nwhen time > 0.4 then n = 2; end when;", 5),
    ("n = 1; when x > 0.5 then reinit(x, 0); end when;\nwhen x > 0.7 then reinit(x, 0.1); end when;", 5),
])  # fmt: skip
def test_a_variable_changes_in_one_when_only(body: str, line: int) -> None:
    text = f"model M\nReal x(start = 0, fixed = true); Integer n(start = 0);\nequation der(x) = 1;\n{body}\nend M;"
    with pytest.raises(lmoc.ModelError) as caught:
        compiled_text(text)
    assert [(d.code, d.span.line) for d in caught.value.diagnostics] == [("E0254", line)]


def test_energy_that_reinit_adds_is_supplied_and_energy_that_it_takes_is_lost() -> None:
    result = run(
        """model Kicked
  Mass m(m = 2, q(start = 0, fixed = true), v(start = 1, fixed = true));
equation
  when time > 1 then
    reinit(m.v, 3);
  elsewhen time > 2 then
    reinit(m.v, 2);
  end when;
end Kicked;""",
        stop=3,
        points=4,
    )
    assert result.energy.supplied == pytest.approx([0, 8, 8, 8], abs=1e-12)
    assert result.energy.lost == pytest.approx([0, 0, 5, 5], abs=1e-12)
    assert [e.energy_lost for e in result.events] == pytest.approx([0, 5], abs=1e-12)
    assert result.energy.balance < 1e-12


@pytest.mark.parametrize("solver", ["auto", "radau", "dop853", "cvode"])
def test_a_jump_without_events_that_holds_the_motion_is_named(solver: str) -> None:
    text = """model Slides
  Mass m(m = 2, q(start = 0, fixed = true), v(start = 1, fixed = true));
  Force f(f = 0.4 - 4*noEvent(sign(m.v)));
equation
  connect(f.flange, m.flange);
end Slides;"""
    told = r"0.4 - 4\*noEvent\(sign\(m.v\)\)' \(model.lmo, line 3\).*DryFriction"
    with pytest.raises(lmoc.SimulationError, match=told):
        run(text, stop=3, solver=solver)


def test_jumps_without_events_that_the_motion_crosses_do_not_end_a_run() -> None:
    text = """model Relay
  Real x(start = 1, fixed = true), v(start = 0, fixed = true);
equation
  der(x) = v;
  der(v) = -noEvent(if x > 0 then 1 else -1);
end Relay;"""
    result = run(text, stop=4 * sqrt(2), rtol=1e-8, points=3)
    assert result["x"][-1] == pytest.approx(1, abs=1e-5)
