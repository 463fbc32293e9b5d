"""Steps and kinks in what is prescribed: velocities jump as they do for ever steeper ramps."""

from math import exp, pi, sqrt

import numpy as np
import pytest
from oracles.models import FLOOR

import lmoc


def run(text: str, **options) -> lmoc.Run:
    return lmoc.compile_text(text).simulate(**{"rtol": 1e-10, "points": 11} | options)


def stepped(part: str, signal: str = "if time < 1 then 0 else 0.1") -> str:
    return f"""model Stepped
  Motion base(q = {signal});
  {part};
  Mass m(m = 2, q(start = 0, fixed = true), v(start = 0, fixed = true));
equation
  connect(base.flange, d.a);
  connect(d.b, m.flange);
end Stepped;"""


def test_a_step_of_the_end_of_a_spring_supplies_what_the_spring_then_holds() -> None:
    result = run(stepped("Spring d(k = 10)"), stop=2, points=21)
    assert result["m.q"][-1] == pytest.approx(0.1 * (1 - np.cos(sqrt(5))), abs=1e-9)
    assert result.energy.supplied[-1] == pytest.approx(0.05, abs=1e-12)
    assert result.energy.balance < 1e-8


def test_a_step_that_a_rigid_body_would_have_to_follow_is_refused() -> None:
    with pytest.raises(lmoc.SimulationError, match=r"jumps from 0 to 0.1 at t = 1 s, .* second derivative"):
        run(stepped("Rod d(L = 0)").replace(", q(start = 0, fixed = true), v(start = 0, fixed = true)", ""), stop=2)


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"u": "if time < 1 then 0 else 0.1"},
        {"u": ([0, 1, 1, 5], [0, 0, 0.1, 0.1])},
    ],
)
def test_a_step_through_a_damper_is_a_jump_of_the_velocity(given) -> None:
    """m·Δv = c·Δu, whether the model, a formula or a table steps; the heat in the damper is infinite."""
    text = stepped("Damper d(c = 5)")
    if given:
        text = stepped("Damper d(c = 5)", "u").replace("Motion base", "input Real u; Motion base")
    result = run(text, stop=2, inputs=given, times=[0, 0.5, 1, 1.5, 2])
    behind = np.maximum(result.time - 1, 0)
    assert result["m.v"] == pytest.approx(np.where(result.time < 1, 0, 0.25 * np.exp(-2.5 * behind)), abs=1e-9)
    assert result["m.q"] == pytest.approx(np.where(result.time < 1, 0, 0.1 * (1 - np.exp(-2.5 * behind))), abs=1e-9)
    (step,) = [e for e in result.events if e.kind == "step"]
    assert step.time == 1 and (step.before, step.after) == ("0", "0.1")
    assert np.isnan(result.energy.supplied[2:]).all() and np.isfinite(result.energy.supplied[:2]).all()
    assert "infinite power" in str(result.energy) and "N0554" in {n.code for n in result.notes}
    assert "W0553" not in {n.code for n in result.notes}


@pytest.mark.parametrize("signal", ["if time < 0 then 0 else 0.1", "if time > 0 then 0.1 else 0"])
def test_a_step_at_the_start_begins_before_it(signal: str) -> None:
    result = run(stepped("Damper d(c = 5)", signal), stop=1)
    assert result["m.v"][0] == pytest.approx(0.25, abs=1e-15)
    assert result["m.q"][-1] == pytest.approx(0.1 * (1 - exp(-2.5)), abs=1e-10)


def test_a_table_that_jumps_at_the_start() -> None:
    text = stepped("Damper d(c = 5)", "u").replace("Motion base", "input Real u; Motion base")
    result = run(text, stop=1, inputs={"u": ([0, 0, 5], [0, 0.1, 0.1])})
    assert result["m.v"][0] == pytest.approx(0.25, abs=1e-12)


def test_ever_steeper_ramps_tend_to_a_step() -> None:
    """Also where the damper depends on the place: c = c0·(1 + u), m·Δv = c0·(Δu + Δu²/2)."""
    text = """model Way
      parameter Real length = 0;
      Real u, v(start = 0, fixed = true);
    equation
      u = if time < 1 then 0 else if time < 1 + length then (time - 1)/max(length, 1e-9) else 1;
      der(v) = -3*(1 + u)*(v - der(u));
    end Way;"""
    step = run(text, stop=1.5, times=[1, 1.5])
    # Δv: dv/ds = 3·(1 + s) while all else stands still
    assert step["v"][0] == pytest.approx(4.5, abs=1e-9)
    error = [abs(run(text, parameters={"length": h}, stop=1.5)["v"][-1] - step["v"][-1]) for h in (0.02, 0.01)]
    assert 1.8 < error[0] / error[1] < 2.2


def test_what_grows_with_a_power_of_the_velocity_is_refused() -> None:
    text = """model Square Real u, v(start = 0, fixed = true);
    equation u = if time < 1 then 0 else 1; der(v) = -(v - der(u))*abs(v - der(u)); end Square;"""
    with pytest.raises(lmoc.SimulationError, match=r"'u' jumps from 0 to 1 at t = 1 s, .* not proportional"):
        run(text, stop=2)


def test_a_kink_passes_through_what_is_rigid() -> None:
    """A pendulum on a cart whose velocity jumps by w: Δω = −w·cos θ/l, and the cart supplies the energy."""
    text = """model Cart
      Real x, th(start = 0.3, fixed = true), w(start = 0, fixed = true);
    equation
      x = if time < 1 then 0 else 0.5*(time - 1);
      der(th) = w;
      der(w) = -9.81*sin(th) - der(der(x))*cos(th);
    end Cart;"""
    before, after = run(text, stop=1.0, times=[0.999999999, 1.0])["w"]
    angle = run(text, stop=1.0)["th"][-1]
    assert after - before == pytest.approx(-0.5 * np.cos(angle), abs=1e-6)
    carried = run(stepped("Rod d(L = 0)", "if time < 1 then 0 else 2*(time - 1)").replace(
        ", q(start = 0, fixed = true), v(start = 0, fixed = true)", ""), stop=2)  # fmt: skip
    assert carried.energy.supplied[-1] == pytest.approx(0.5 * 2 * 2**2, abs=1e-10)
    assert carried.energy.balance < 1e-10


def test_closed_contacts_resist_a_step_and_open_and_friction_gives_way() -> None:
    result = run(FLOOR, stop=2.05, times=[0, 1, 1.5, 2, 2.05])
    assert (result["ball.v"][:3] == 0).all() and (result["ball.q"][:3] == 0).all()
    assert result["ball.v"][3] == pytest.approx(3 * 0.5, abs=1e-12)
    at_two = {(e.name, e.kind) for e in result.events if e.time == 2}
    assert {("floor", "release"), ("friction", "slip"), ("top.q", "step")} <= at_two
    pull = 9.81 + 0.5
    expected = (1.5 + pull / 3) * exp(-3 * 0.05) - pull / 3
    assert result["ball.v"][4] == pytest.approx(expected, abs=1e-9)


def test_a_velocity_that_reinit_gives_tears_friction_loose() -> None:
    text = """model Kick
      Mass m(m = 2, q(start = 0, fixed = true), v(start = 0, fixed = true));
      Fixed wall;
      DryFriction f(F = 4);
    equation
      connect(wall.flange, f.a);
      connect(f.b, m.flange);
      when time > 1 then reinit(m.v, 3); end when;
    end Kick;"""
    result = run(text, stop=3)
    assert result["m.q"][-1] == pytest.approx(9 / 4, abs=1e-10) and result["m.v"][-1] == 0
    assert [e.kind for e in result.events if e.name == "f"] == ["slip", "stick"]
    assert result.energy.supplied[-1] == pytest.approx(9, abs=1e-10) and result.energy.balance < 1e-9


def test_sines_that_begin_with_a_kink_have_none_of_their_value() -> None:
    """A value that is continuous and zero at the kink is no step."""
    result = run(stepped("Damper d(c = 5)", "if time < 1 then 0 else 0.1*sin(time - 1)"), stop=1 + pi, points=3)
    assert np.isfinite(result.energy.supplied).all() and result.energy.balance < 1e-8
    # der(v) = -a·v + a·u', u' = 0.1·cos τ: v = 0.1·a·(a·cos τ + sin τ - a·e^(-a·τ))/(a² + 1)
    a = 2.5
    assert result["m.v"][-1] == pytest.approx(0.1 * a * (-a - a * exp(-a * pi)) / (a * a + 1), abs=1e-9)


@pytest.mark.parametrize("signal", ["noEvent({})", "smooth(0, {})", "if noEvent(time < 1) then 0 else 0.1"])
def test_a_step_inside_of_no_event_is_no_less_of_a_step(signal):
    plain = "if time < 1 then 0 else 0.1"
    expected, found = (run(stepped("Damper d(c = 5)", s)) for s in (plain, signal.format(plain)))
    assert [e.kind for e in found.events] == [e.kind for e in expected.events] == ["step", "relation"]
    for name in ("m.q", "m.v"):
        assert found[name] == pytest.approx(expected[name], abs=1e-14)


@pytest.mark.parametrize(("value", "noted"), [
    ("noEvent(if m.q > 0.05 then 0 else 0.1)", True), ("smooth(0, if m.q > 0.05 then 0 else 0.1)", True),
    ("noEvent(0.1*sign(m.q - 0.05))", True), ("0.1*noEvent(abs(m.q))", False),
    ("noEvent(if time > 0.5 then 0 else 0.1)", False), ("0.1*m.q^2", False),
])  # fmt: skip
def test_a_differentiated_jump_without_an_event_is_noted(value, noted):
    """The same value as a force is not differentiated, and needs no note."""
    parts = "Damper d(c = 5); Spring k(k = 100); Mass m(m = 1, q(fixed = true), v(fixed = true));"
    wires = "connect(d.a, k.a); connect(d.b, m.flange); connect(k.b, m.flange);"
    moved = f"model M Motion r(q = {value}); {parts} equation connect(r.flange, d.a); {wires} end M;"
    assert ("N0418" in [n.code for n in lmoc.compile_text(moved).notes]) == noted
    fixed = f"Force f(f = {value}); Fixed w; {parts} equation connect(w.flange, d.a); connect(f.flange, m.flange);"
    pushed = f"model M {fixed} {wires} end M;"
    assert "N0418" not in [n.code for n in lmoc.compile_text(pushed).notes]


CART = "model M Real x, th(start = 0.3, fixed = true), w(start = 0, fixed = true); equation x = {}; der(th) = w; "
CART += "der(w) = -9.81*sin(th) - der(der(x))*cos(th); end M;"


@pytest.mark.parametrize(("value", "notes"), [
    ("max(0, time - 1)", 1), ("noEvent(abs(time - 1))", 1), ("max(0, 0.5)*time", 0),
    ("if time < 1 then 0 else time - 1", 0), ("noEvent(if th > 0 then 0 else time)", 1),
    ("smooth(1, if th > 0 then 0 else time)", 0), ("smooth(2, noEvent(if th > 0 then 0 else time))", 0),
    ("smooth(0, if th > 0 then 0 else time)", 1), ("smooth(2, time) + noEvent(if th > 0 then 0 else time)", 1),
])  # fmt: skip
def test_impulses_that_are_not_computed_are_noted(value, notes):
    """The last one leaves a block in which nothing has to be solved for together: its second derivative is zero."""
    dae = lmoc.compile_text(CART.format(value))
    assert [n.code for n in dae.notes] == ["N0418"] * notes
    found, still = (d.simulate(stop=0.9, points=2)["w"][-1] for d in (dae, lmoc.compile_text(CART.format("0*time"))))
    assert found == pytest.approx(still, abs=1e-6)


def test_a_motion_of_a_library_does_not_begin_with_a_jump(tmp_path):
    """What a package means by time < 0 at the start is Modelica's: the fixed values hold, whatever was before."""
    (tmp_path / "Lib").mkdir()
    block = "block Sine output Real y; equation y = if time < 0 then 0 else 0.7*sin(2*time); end Sine;"
    (tmp_path / "Lib" / "package.mo").write_text(f"package Lib {block} end Lib;")
    text = """model M Lib.Sine sine; Real x, p(start = 0.3, fixed = true), w(start = 0, fixed = true);
      equation x = sine.y; w = der(p); 2*der(w) + 1.5*der(der(x)) = -p; end M;"""
    result = lmoc.compile_text(text, path=tmp_path).simulate(stop=0.1, points=2)
    assert result["der(x)"][0] == 1.4 and result["w"][0] == 0
    assert not [e for e in result.events if e.kind == "step"]
