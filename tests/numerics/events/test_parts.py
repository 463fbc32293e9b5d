"""Hybrid parts as people write them: the friction state machine of the Modelica library, switches, arrays, laws."""

from math import cos, pi, sin, sqrt

import numpy as np
import pytest

import lmoc

FRICTION = """
model Friction "Coulomb friction with a peak, as in the Modelica library: a state machine over mode"
  Flange flange;
  parameter Real Fc = 2 "while sliding";
  parameter Real Fs = 4 "before";
  parameter Real small = 1e-10;
  parameter Real vb = 0.2 "velocity of the belt";
  constant Integer Unknown = 3, Free = 2, Forward = 1, Stuck = 0, Backward = -1;
  Integer mode(start = 3, fixed = true);
  Boolean startForward(start = false, fixed = true);
  Boolean startBackward(start = false, fixed = true);
  Boolean locked(start = false, fixed = true);
  Real sa "path parameter", v, a, f;
equation
  v = der(flange.q) - vb;
  a = der(v);
  f = flange.f;
  startForward = pre(mode) == Stuck and (sa > Fs or pre(startForward) and sa > Fc)
    or pre(mode) == Backward and v > small or initial() and v > 0;
  startBackward = pre(mode) == Stuck and (sa < -Fs or pre(startBackward) and sa < -Fc)
    or pre(mode) == Forward and v < -small or initial() and v < 0;
  locked = not (pre(mode) == Forward or startForward or pre(mode) == Backward or startBackward);
  a = if locked then 0 else if startForward then sa - Fs else if startBackward then sa + Fs
    else if pre(mode) == Forward then sa - Fs else sa + Fs;
  f = if locked then sa else if startForward or pre(mode) == Forward then Fc else -Fc;
  mode = if (pre(mode) == Forward or pre(mode) == Unknown or startForward) and v > 0 then Forward
    else if (pre(mode) == Backward or pre(mode) == Unknown or startBackward) and v < 0 then Backward else Stuck;
end Friction;
model Belt
  Fixed wall;
  Spring spring(k = 50);
  Mass mass(m = 1, q(start = 0, fixed = true), v(start = 0.2, fixed = true));
  Friction friction;
equation
  connect(wall.flange, spring.a);
  connect(spring.b, mass.flange);
  connect(mass.flange, friction.flange);
end Belt;
"""


def test_the_friction_of_the_modelica_library_runs_as_written() -> None:
    run = lmoc.compile_text(FRICTION, model="Belt").simulate(stop=2, rtol=1e-10, points=201)
    w, stick = sqrt(50), 4 / 50
    period = 1.018372244089  # stuck for 0.4 s, sliding until the velocity is that of the belt again
    changes = [e.time for e in run.events if e.name == "friction.locked"]
    assert changes == pytest.approx([0.4, period, 0.4 + period], abs=1e-9)
    t = run.time % period
    slide = 2 / 50 + (stick - 2 / 50) * np.cos(w * (t - 0.4)) + 0.2 / w * np.sin(w * (t - 0.4))
    exact = np.where(t <= 0.4, 0.2 * t, slide)
    exact[run.time >= period] = np.where(
        t[run.time >= period] <= 0.4, 0.2 * t[run.time >= period] + 0.0, exact[run.time >= period]
    )
    inside = run.time < period
    assert np.abs(run["mass.q"] - exact)[inside].max() < 1e-8
    assert np.abs(run["mass.v"][t < 0.39] - 0.2).max() < 1e-9
    assert set(run["friction.mode"]) == {0.0, -1.0}


def test_if_equations_with_the_same_unknowns() -> None:
    """A spring with two stiffnesses, its force and its energy switched together, in different orders."""
    run = lmoc.compile_text(
        """model Two Real q(start = 0, fixed = true), v(start = 1, fixed = true), f, e;
        equation
          der(q) = v; der(v) = -f;
          if q > 0 then
            f = 4*q; e = 2*q^2;
          else
            e = q^2/2; f = q;
          end if;
        end Two;"""
    ).simulate(stop=1.5 * pi + 1, rtol=1e-10, points=101)
    t = run.time
    up = pi / 2  # half a period with rate 2, then half a period with rate 1
    exact = np.where(t < up, np.sin(2 * t) / 2, np.where(t < up + pi, -np.sin(t - up), np.sin(2 * (t - up - pi)) / 2))
    assert np.abs(run["q"] - exact).max() < 1e-9
    assert np.abs(run["e"] + run["v"] ** 2 / 2 - 0.5).max() < 1e-9
    assert [e.time for e in run.events] == pytest.approx([0, up, up + pi], abs=1e-10)  # q = 0 is not q > 0


def test_if_equations_with_different_unknowns() -> None:
    """A switch: closed it has no voltage, open no current."""
    run = lmoc.compile_text(
        """model Switch Real u, i, x(start = 0, fixed = true); Boolean closed = time < 1;
        equation
          if closed then u = 0; else i = 0; end if;
          1 = 2*i + x + u;
          der(x) = i;
        end Switch;"""
    ).simulate(stop=2, rtol=1e-10, points=21)
    t = run.time
    exact = np.where(t <= 1, 1 - np.exp(-t / 2), 1 - np.exp(-0.5))
    assert np.abs(run["x"] - exact).max() < 1e-9
    assert np.abs(run["i"][t >= 1]).max() < 1e-15 and np.abs(run["u"][t < 1]).max() < 1e-15


def test_whens_in_arrays_of_parts_go_their_own_ways() -> None:
    run = lmoc.compile_text(
        """model Ball parameter Real h0 = 1;
          Real h(start = h0, fixed = true), v(start = 0, fixed = true); Integer n(start = 0);
        equation der(h) = v; der(v) = -9.81;
          when h <= 0 then reinit(v, -0.9*pre(v)); n = pre(n) + 1; end when; end Ball;
        model Many Ball ball[3](h0 = {1, 2, 3}); end Many;""",
        model="Many",
    ).simulate(stop=3, rtol=1e-10, points=4)
    for k, height in enumerate((1, 2, 3), 1):
        first = sqrt(2 * height / 9.81)
        exact = [first]
        while exact[-1] + 2 * first * 0.9 ** len(exact) < 3:
            exact.append(exact[-1] + 2 * first * 0.9 ** len(exact))
        assert run[f"ball[{k}].n"][-1] == len(exact)
        own = [e.time for e in run.events if e.kind == "when" and e.after.endswith(f"[{k}]")]
        assert own == pytest.approx(exact, abs=1e-10)


def test_whens_in_loops_and_over_arrays() -> None:
    run = lmoc.compile_text(
        """model Loop Real x(start = 0, fixed = true); Integer n[4](each start = 0); discrete Real seen[4];
        equation der(x) = 1;
          when x > 0.25 then
            for i in 1:3 loop n[i] = i; end for;
            n[4] = 9;
            seen = {x, 2*x, 3*x, time};
          end when;
        end Loop;"""
    ).simulate(stop=1, points=2)
    assert run["n"][-1].tolist() == [1, 2, 3, 9]
    assert run["seen"][-1] == pytest.approx([0.25, 0.5, 0.75, 0.25], abs=1e-9)


def test_boolean_signals_between_blocks() -> None:
    run = lmoc.compile_text(
        """connector In = input Boolean; connector Out = output Boolean;
        block Above input Real u; Out y; equation y = u > 0.5; end Above;
        block Latch In set; Out y(start = false); equation y = pre(y) or set; end Latch;
        model Blocks Above above(u = sin(3*time)); Latch latch; Real x(start = 0, fixed = true);
        equation connect(above.y, latch.set); der(x) = if latch.y then 1 else 0; end Blocks;"""
    ).simulate(stop=2, rtol=1e-10, points=41)
    since = np.arcsin(0.5) / 3
    assert run["x"] == pytest.approx(np.maximum(run.time - since, 0), abs=1e-9)
    assert set(run["above.y"]) == {0.0, 1.0}


def test_an_enumeration_as_a_state_machine() -> None:
    run = lmoc.compile_text(
        """type Phase = enumeration(rise, hold, fall);
        model Machine Phase phase(start = Phase.rise, fixed = true); Real x(start = 0, fixed = true);
        equation
          der(x) = if phase == Phase.rise then 1 elseif phase == Phase.hold then 0 else -1;
          when x > 1 then phase = Phase.hold;
          elsewhen time > 2 then phase = Phase.fall;
          elsewhen x < 0.5 then phase = pre(phase);
          end when;
        end Machine;"""
    ).simulate(stop=3, rtol=1e-10, points=31)
    t = run.time
    assert run["x"] == pytest.approx(np.where(t < 1, t, np.where(t < 2, 1, 3 - t)), abs=1e-9)


def test_a_clutch_that_a_when_engages() -> None:
    """Laws and events in one scene: two flywheels slip and lock when the clutch is pressed at t = 1."""
    run = lmoc.compile_text(
        """model Drive
          Inertia J1(J = 1, theta(fixed = true), omega(start = 10, fixed = true));
          Inertia J2(J = 2, theta(fixed = true), omega(start = 0, fixed = true));
          discrete Real press(start = 0, fixed = true); Clutch clutch(tau = 5, engagement = press);
        equation connect(J1.shaft, clutch.a); connect(clutch.b, J2.shaft);
          when time >= 1 then press = 1; end when; end Drive;"""
    ).simulate(stop=3, rtol=1e-10, points=31)
    lock = 1 + 4 / 3  # truth: slips for 4/3 s
    t = run.time
    exact = np.where(t < 1, 10, np.where(t < lock, 10 - 5 * (t - 1), 10 / 3))
    assert np.abs(run["J1.omega"] - exact).max() < 1e-8
    assert [e.time for e in run.events if e.kind == "lock"] == pytest.approx([lock], abs=1e-9)


def test_a_plane_pendulum_with_a_pin() -> None:
    """The length changes where the string meets the pin; the velocity along the circle is kept."""
    text = """model Pin parameter Real L = 1, c = 0.5; Real phi(start = 0.5, fixed = true), w(start = 0, fixed = true);
        Boolean short = phi < 0; discrete Real l(start = 1, fixed = true);
      equation der(phi) = w; der(w) = -9.81/l*sin(phi);
        when short then l = L - c; reinit(w, pre(w)*L/(L - c));
        elsewhen not short then l = L; reinit(w, pre(w)*(L - c)/L); end when;
      end Pin;"""
    run = lmoc.compile_text(text).simulate(stop=5, rtol=1e-10, points=101)
    energy = run["l"] ** 2 * run["w"] ** 2 / 2 - 9.81 * run["l"] * np.cos(run["phi"])
    long = run["l"] == 1
    assert np.abs(energy[long] + 9.81 * cos(0.5)).max() < 1e-8
    assert np.abs(energy[~long] - (9.81 * 0.5 - 9.81 * cos(0.5))).max() < 1e-8
    assert len([e for e in run.events if e.kind == "when"]) >= 4
    assert sin(run["phi"].min()) < -0.4


DRY = """model Dry Fixed w; Mass m(m = 1, q(fixed = true), v(fixed = true)); DryFriction d(F = 1, Fstick = 2);
    Force f(f = if time > 1 then 3 else 1.5);
  equation connect(w.flange, d.a); connect(d.b, m.flange); connect(f.flange, m.flange); end Dry;"""


def test_a_force_that_jumps_tears_friction_loose() -> None:
    run = lmoc.compile_text(DRY).simulate(stop=2, rtol=1e-10, points=21)
    since = np.maximum(run.time - 1, 0)
    assert np.abs(run["m.q"] - since**2).max() < 1e-12
    assert [(e.time, e.kind) for e in run.events if e.kind == "slip"] == [(1.0, "slip")]


def test_a_cable_goes_slack_when_a_switch_lifts_its_load() -> None:
    run = lmoc.compile_text(
        """model Lift Fixed w; Mass m(m = 1, g = 9.81, q(fixed = true), v(fixed = true)); Cable c(L = 0.5);
          Boolean up(start = false, fixed = true); Force f(f = if up then -30 else 0);
        equation connect(w.flange, c.a); connect(c.b, m.flange); connect(f.flange, m.flange);
          when time > 1 then up = true; end when; end Lift;"""
    ).simulate(stop=1.5, rtol=1e-10, points=16)
    assert [e.kind for e in run.events] == ["taut", "time", "slack"]
    late = run.time >= 1
    exact = 0.5 - (30 - 9.81) * (run.time[late] - 1) ** 2 / 2
    assert np.abs(run["m.q"][late] - exact).max() < 1e-12


def test_impacts_of_a_law_are_seen_by_whens() -> None:
    run = lmoc.compile_text(
        """model Count Fixed w; Mass m(m = 1, g = -9.81, q(start = 1, fixed = true), v(fixed = true));
          Stop s(L = 0, e = 0.5); Integer n(start = 0, fixed = true);
        equation connect(w.flange, s.a); connect(s.b, m.flange);
          when m.v > 0 then n = pre(n) + 1; end when; end Count;"""
    ).simulate(stop=1.2, rtol=1e-10, points=3)
    assert run["n"][-1] == 3 == len([e for e in run.events if e.kind == "impact"])


@pytest.mark.parametrize(
    ("force", "condition"),
    [("2*sign(0.2 - m.v)", "0.2 - m.v"), ("if m.v > 0.2 then -4 else 4", "m.v > 0.2")],
)
def test_friction_by_sign_is_recognized(force: str, condition: str) -> None:
    text = f"""model S Fixed w; Spring s(k = 50); Mass m(m = 1, v(start = 0.1, fixed = true), q(fixed = true));
      Force f(f = {force});
      equation connect(w.flange, s.a); connect(s.b, m.flange); connect(f.flange, m.flange); end S;"""
    with pytest.raises(lmoc.SimulationError, match="switch(es)? back and forth.*DryFriction") as failed:
        lmoc.compile_text(text).simulate(stop=5)
    assert condition in str(failed.value) and "line 2" in str(failed.value)
    assert failed.value.partial["m.v"][-1] == pytest.approx(0.2, abs=0.02)
