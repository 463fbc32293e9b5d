"""Systems of relations and equations that decide about each other: frictions written as machines of states."""

import numpy as np
import pytest

import lmoc

MACHINE = """  Real a, sa, f; parameter Real fmax = 5;
  Boolean startForward(start = false, fixed = true), startBackward(start = false, fixed = true), locked(start = false);
  Integer mode(start = 3, fixed = true);
equation
  startForward = pre(mode) == 0 and (sa > fmax or pre(startForward) and sa > fmax) or initial() and v > 0;
  startBackward = pre(mode) == 0 and (sa < -fmax or pre(startBackward) and sa < -fmax) or initial() and v < 0;
  locked = not (pre(mode) == 1 or startForward or pre(mode) == -1 or startBackward);
  a = if locked then 0 else if startForward then sa - fmax else if startBackward then sa + fmax
    else if pre(mode) == 1 then sa - fmax else sa + fmax;
  f = if locked then sa else if startForward then fmax else if startBackward then -fmax
    else if pre(mode) == 1 then fmax else -fmax;
  mode = if (pre(mode) == 1 or startForward) and v > 0 then 1
    elseif (pre(mode) == -1 or startBackward) and v < 0 then -1 else 0;"""


def test_a_friction_machine_stops_and_sticks() -> None:
    """It would start forward if it were stuck and slide backward if it started: only `locked` satisfies everything."""
    run = lmoc.compile_text(
        f"""model M Real x(start = 0, fixed = true), v(start = 1, fixed = true);{MACHINE}
        der(x) = v; der(v) = a; 0.1*a = sin(10*time) - f; end M;"""
    ).simulate(stop=1, points=201)
    stop = 0.02041534  # where v = 1 - 50 t + (1 - cos(10 t)) vanishes
    assert 1 - 50 * stop + (1 - np.cos(10 * stop)) == pytest.approx(0, abs=1e-5)
    (locked,) = [e.time for e in run.events if e.name == "locked"]
    assert locked == pytest.approx(stop, abs=1e-6)
    assert np.abs(run["v"][run.time > locked]).max() < 1e-9
    assert run["f"][-1] == pytest.approx(np.sin(10.0), abs=1e-9)


def test_a_friction_machine_starts_where_the_load_exceeds_its_limit() -> None:
    run = lmoc.compile_text(
        f"""model M Real x(start = 0, fixed = true), v(start = 0, fixed = true);{MACHINE}
        der(x) = v; der(v) = a; a = 10*time - f; end M;"""
    ).simulate(stop=1, points=101)
    moving = run.time > 0.5
    assert run["v"][moving] == pytest.approx(5 * (run.time[moving] - 0.5) ** 2, abs=1e-5)
    assert np.abs(run["v"][~moving]).max() < 1e-9


@pytest.mark.parametrize(("inertia", "peak"), [(2.0, 1.1), (0.5, 1.1), (2.0, 1 + 1e-4)])
def test_a_friction_starts_to_slide_against_less_than_what_has_held_it(inertia: float, peak: float) -> None:
    """Of a heavy wheel: held, it would start; started, sa = f0 + der(v) stays below the peak, so that it would be held.

    No values agree with `pre(start)` as it is before the event: once the wheel has begun to slide, some do.
    """
    run = lmoc.compile_text(
        f"""model M Real v(start = 0, fixed = true), sa, f; parameter Real m = {inertia}, f0 = 1, peak = {peak};
          Boolean start(start = false, fixed = true), locked(start = false), stuck(start = true, fixed = true);
        equation start = pre(stuck) and (sa > peak or pre(start) and sa > f0);
          locked = pre(stuck) and not start; stuck = locked or v <= 0;
          der(v) = if locked then 0 else sa - f0; f = if locked then sa else f0; m*der(v) = 2*time - f; end M;"""
    ).simulate(times=[0, 0.5, 0.8, 1.0])
    (starts,) = [e.time for e in run.events if e.name == "locked"]
    assert starts == pytest.approx(peak / 2, abs=1e-9)
    speed = np.where(run.time > starts, (run.time**2 - run.time - (starts**2 - starts)) / inertia, 0.0)
    assert run["v"] == pytest.approx(speed, abs=1e-7)


def test_a_relation_does_not_react_to_rounding() -> None:
    """0.1 + 0.2 - 0.3 is 5.6e-17, and no motion; a hundred times as much is one."""
    text = """model M Real a(start = 0.1, fixed = true), b(start = 0.2, fixed = true), c(start = {}, fixed = true);
      Boolean up; equation der(a) = 0; der(b) = 0; der(c) = 0; up = a + b - c > 0; end M;"""
    for c, up in ((0.3, False), (0.3 - 1e-14, True)):
        run = lmoc.compile_text(text.format(repr(c))).simulate(times=[0, 1])
        assert bool(run["up"][-1]) is up


def test_what_is_zero_starts_as_zero() -> None:
    """The slip of clutches between wheels at rest behind one that turns."""
    run = lmoc.compile_text("""model M
      Real w1(start = 10, fixed = true), w2(start = 0, fixed = true), w3(start = 0, fixed = true);
      Real w4(start = 0, fixed = true);
      Real r1(stateSelect = StateSelect.always), r2(stateSelect = StateSelect.always);
      Real r3(stateSelect = StateSelect.always);
      equation r1 = w2 - w1; r2 = w3 - w2; r3 = w4 - w3;
      der(w1) = -w1; der(w2) = w1; der(w3) = 0; der(w4) = 0; end M;""").simulate(times=[0])
    assert run["r1"][0] == pytest.approx(-10) and run["r2"][0] == run["r3"][0] == 0.0


FRICTION = MACHINE.replace("Real a, sa, f", "Real sa, f")
WHEEL = f"""model Friction input Real v, a;{FRICTION} end Friction;
  model M Friction weak(fmax = 0.5), strong(fmax = 5);
    Real x(start = 0, fixed = true), v(start = 1, fixed = true), load = {{load}};
  equation der(x) = v; weak.v = v; strong.v = v; weak.a = der(v); strong.a = der(v);
    der(v) = load - weak.f - strong.f; end M;"""


def test_of_two_frictions_that_hold_one_wheel_the_stronger_one_takes_what_is_left() -> None:
    """Both held, the equations would not say who bears how much: what an elimination makes of that is rounding."""
    run = lmoc.compile_text(WHEEL.format(load="2 - time"), model="M").simulate(stop=6, points=601)
    at = np.sqrt(3.5**2 + 2) - 3.5  # where v = 1 + 2 t - t²/2 - 5.5 t vanishes
    (stops,) = [e.time for e in run.events if e.name == "strong.locked" and e.after == "true"]
    assert stops == pytest.approx(at, abs=1e-6)
    rest = (run.time > 0.28) & (run.time < 6)
    assert np.abs(run["v"][rest]).max() < 1e-9
    # sa = der(v) + fmax was below -fmax before the wheel stopped: of both directions the one that changes no relation
    assert run["weak.f"][rest] == pytest.approx(-0.5, abs=1e-9)
    assert run["strong.f"][rest] == pytest.approx(2 - run.time[rest] - run["weak.f"][rest], abs=1e-9)


def test_rounding_of_one_function_says_nothing_about_another() -> None:
    """A current of nanoamperes beside a pressure of megapascals that cancels."""
    run = lmoc.compile_text("""model M Real p(start = 1e7, fixed = true), q(start = 2e7, fixed = true);
      Real i(start = -1e-12, fixed = true); Boolean flows = i > 0, pushes = p + q - 3e7 > 0;
      equation der(p) = 1e6*sin(time); der(q) = -1e6*sin(time); der(i) = 1e-12; end M;""").simulate(stop=2, points=201)
    assert [(e.name, e.time) for e in run.events] == [("flows", pytest.approx(1.0, abs=1e-6))]


TYPES = """package Modelica
  package Math package Vectors
    function interpolate input Real x[:]; input Real y[:]; input Real xi; input Integer iLast = 1;
      output Real yi; output Integer iNew; algorithm while xi > x[1] loop yi := 0; end while; end interpolate;
  end Vectors; end Math;
  package Blocks
    package Types
      type Smoothness = enumeration(LinearSegments, ContinuousDerivative, ConstantSegments);
      type Extrapolation = enumeration(HoldLastPoint, LastTwoPoints, Periodic, NoExtrapolation);
      type TimeEvents = enumeration(Always, AtDiscontinuities, NoTimeEvents);
    end Types;
    package Interfaces
      partial block SignalSource output Real y;
        parameter Real offset = 0; parameter Real startTime = 0; end SignalSource;
      partial block MO parameter Integer nout = 1; output Real y[nout]; end MO;
      partial block SIMO parameter Integer nout = 1; input Real u; output Real y[nout]; end SIMO;
      partial block MIMOs parameter Integer n = 1; input Real u[n]; output Real y[n]; end MIMOs;
    end Interfaces;
    package Sources
      block CombiTimeTable Real theirs = 1; end CombiTimeTable; block TimeTable end TimeTable;
    end Sources;
    package Tables block CombiTable1Ds end CombiTable1Ds; block CombiTable1Dv end CombiTable1Dv; end Tables;
  end Blocks;
end Modelica;"""


def signal(declaration: str, stop: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    model = f"model M Modelica.Blocks.Sources.CombiTimeTable t({declaration}); end M;"
    run = lmoc.compile_text(TYPES + model, model="M").simulate(stop=stop, points=1201)
    return run.time, run["t.y[1]"]


def test_tables_over_time() -> None:
    table = "table = [0, 1; 1, 3; 1, 5; 4, 2]"
    x, y = [0, 1, 1, 4], [1, 3, 5, 2]
    types = "Modelica.Blocks.Types"
    t, found = signal(f"{table}, extrapolation = {types}.Extrapolation.HoldLastPoint, startTime = 0.5, offset = {{10}}")
    inside = np.abs(t - 1.5) > 1e-9
    expected = 10 + np.where(t < 0.5, 0, np.interp(np.maximum(t - 0.5, 0), x, y))
    assert found[inside & (t != 0.5)] == pytest.approx(expected[inside & (t != 0.5)], abs=1e-9)
    t, found = signal(table)
    assert found[-1] == pytest.approx(2 - 2, abs=1e-9)  # the last line goes on: slope −1 from (4, 2)
    t, found = signal(f"{table}, extrapolation = {types}.Extrapolation.Periodic")
    away = np.abs((t % 4) - 1) > 1e-6
    away &= np.abs((t + 2) % 4 - 2) > 1e-6
    assert found[away] == pytest.approx(np.interp(t[away] % 4, x, y), abs=1e-9)
    t, found = signal(f"{table}, smoothness = {types}.Smoothness.ConstantSegments")
    assert [float(found[np.searchsorted(t, at)]) for at in (0.5, 2, 5)] == [1, 5, 2]


def test_a_table_of_two_columns_over_time() -> None:
    """Nothing but the offset before the start, a jump, and the last line after the last point."""
    given = "table = [0, 1; 1, 3; 1, 5; 4, 2], offset = 10, startTime = 0.5, timeScale = 0.5"
    model = f"model M Modelica.Blocks.Sources.TimeTable t({given}); end M;"
    run = lmoc.compile_text(TYPES + model, model="M").simulate(stop=4, points=801)
    x = (run.time - 0.5) / 0.5
    expected = 10 + np.where(x < 0, 0, np.where(x < 1, 1 + 2 * x, 6 - x))
    away = (np.abs(x) > 1e-6) & (np.abs(x - 1) > 1e-6)
    assert run["t.y"][away] == pytest.approx(expected[away], abs=1e-9)


def test_tables_over_an_input_and_interpolation() -> None:
    run = lmoc.compile_text(
        TYPES
        + """model M
        Modelica.Blocks.Tables.CombiTable1Ds s(table = [0, 1, 0; 1, 3, 1; 3, 2, 4], u = time);
        Modelica.Blocks.Tables.CombiTable1Dv v(table = [0, 1, 0; 1, 3, 1; 3, 2, 4], u = {time, 2*time},
          extrapolation = Modelica.Blocks.Types.Extrapolation.HoldLastPoint);
        Real y, n; equation (y, n) = Modelica.Math.Vectors.interpolate({0, 1, 3}, {1, 3, 2}, time); end M;""",
        model="M",
    ).simulate(stop=5, points=501)
    t = run.time
    beyond = np.where(t > 3, 2 - 0.5 * (t - 3), np.interp(t, [0, 1, 3], [1, 3, 2]))
    assert run["s.y[1]"] == pytest.approx(beyond, abs=1e-9) and run["y"] == pytest.approx(beyond, abs=1e-9)
    assert run["v.y[1]"] == pytest.approx(np.interp(t, [0, 1, 3], [1, 3, 2]), abs=1e-9)
    assert run["v.y[2]"] == pytest.approx(np.interp(2 * t, [0, 1, 3], [0, 1, 4]), abs=1e-9)
    assert sorted(set(run["n"])) == [1, 2]


def test_a_relation_does_not_react_to_what_newtons_method_leaves():
    """Two ideal diodes at rest in a nonlinear block: s = 1e-53 or -1e-79, as it comes, where it is zero."""
    run = lmoc.compile_text("""model Gates
      Real s[2], v[2], i[2], u[2], w, a;
      Boolean off[2](each start = true, each fixed = true);
      Real x(start = 0, fixed = true);
    equation
      for k in 1:2 loop
        v[k] = s[k]*(if off[k] then 1 else 1e-5);
        i[k] = s[k]*(if off[k] then 1e-5 else 1);
        off[k] = s[k] < 0;
        u[k] = if u[k] < 0.65 then 140*i[k] else 0.65^2/0.7 + 10*i[k];
      end for;
      i[1] + i[2] = 0;
      w = v[1] + u[1] - v[2] - u[2];
      a = w/15000 + 1e-9*w^3;
      2*a - i[2] + x = 0;
      der(x) = 1000*(w - x) + sin(time);
    end Gates;""").simulate(stop=0.1)
    assert run.complete and run["off[1]"][-1] == 1 and run["off[2]"][-1] == 0
    open_one = 1 + 2 * 140e-5 + 1e-10  # w/s[1]: one diode off, the other one on, both in their gates
    slope = 1000 / (2 / 15000 + 1e-5 / open_one) + 1000
    assert run["x"][-1] == pytest.approx(np.sin(0.1) / slope, rel=1e-5)
    assert run["s[1]"][-1] == pytest.approx(run["w"][-1] / open_one, rel=1e-9)


def test_a_velocity_that_jumps_moves_what_stands_before_a_nonlinear_block():
    """``w`` jumps by the step of ``der(x)`` times ``cos(th)``: the integral of its equation over the instant."""
    dae = lmoc.compile_text("""model Cart
      Real th(start = 0.3, fixed = true), w(start = 0, fixed = true), y(start = 0.2), x;
    equation
      x = if time < 1 then 0 else 0.5*(time - 1);
      der(th) = w;
      der(w) = -9.81*sin(th) - der(der(x))*cos(th) - 0.1*y;
      y + 0.3*sin(y) = th;
    end Cart;""")
    before, after = (dae.simulate(stop=1 + side, points=2, rtol=1e-10) for side in (-1e-9, 1e-9))
    jump = after["w"][-1] - before["w"][-1]
    assert jump == pytest.approx(-0.5 * np.cos(before["th"][-1]), rel=1e-6)
