"""Events and laws in JavaScript: the same as Python's, with the model's parameters and with others."""

from pathlib import Path

import numpy as np
import pytest
from oracles.between_springs import AMONG, IWAN, JENKINS, PEAK, ROW
from oracles.in_javascript import difference, repeat
from oracles.models import compiled
from oracles.node import needs_node

import lmoc
from lmoc.view.javascript.script import write_script
from lmoc.view.javascript.sliders import sliders

MODELS = Path(__file__).parents[2] / "models"
LEFT_OUT = {"bungee_jump", "wagons"}  # looked at on its own; takes long
WITH_LAWS = [f for f in sorted((MODELS / "laws").glob("*.lmo")) if f.stem not in LEFT_OUT]
WITH_LAWS += [MODELS / "notes" / f"{name}.lmo" for name in ("ex08_slack_cable", "fig6_slack_string")]

pytestmark = needs_node


def repeated(scenes, **options):
    """[(name, run, its repetition)] with the model's values, and with one other value each."""
    cases, names = [], []
    for dae, changed in scenes:
        run = dae.simulate(**options)
        script = write_script(run.trajectory)
        found = {s.name: s for s in sliders(run.trajectory.observer, script.slots) if not s.fixed and s.value}
        cases.append((run, script, []))
        names.append(dae.name)
        for name, factor in changed.items() or [(next(iter(found)), 1.15)]:
            value = factor * found[name].value
            cases.append((dae.simulate(parameters={name: value}, **options), script, [[found[name].slot, value]]))
            names.append(f"{dae.name}: {name}")
    return [(name, case[0], again) for name, case, again in zip(names, cases, repeat(cases), strict=True)]


def judge(found, least=1e-6):
    for name, run, again in found:
        assert again.complete, (name, again.reason)
        ours = [(e["name"], e["kind"], e["before"], e["after"]) for e in again.events]
        assert ours == [(e.name, e.kind, e.before, e.after) for e in run.events], name
        assert np.allclose([e["time"] for e in again.events], [e.time for e in run.events], rtol=1e-8, atol=1e-9), name
        impulses = np.array([e.impulse for e in run.events])
        missed = np.abs(impulses - [e["impulse"] for e in again.events])
        assert (missed <= 1e-6 * impulses.max(initial=1)).all(), name
        assert difference(run, again) < least, name


def test_every_scene_with_laws():
    judge(repeated([(compiled(file), {}) for file in WITH_LAWS], points=60, solver="dop853", rtol=1e-9), 1e-7)


BELT = """
model Belt "a block on a belt that is switched on"
  parameter Real F(unit = "N") = 2;
  Boolean on = time > 1;
  Real x(start = 0, fixed = true, unit = "m");
  Mass m(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Motion belt(q = x);
  DryFriction f(F = F);
equation
  der(x) = if on then 1 else 0;
  connect(belt.flange, f.a); connect(f.b, m.flange);
  annotation(experiment(StopTime = 2));
end Belt;
"""


def test_what_an_event_moves_on_is_not_thrown():
    """The belt jumps to its speed: the block slips on it, until both are as fast."""
    found = repeated([(lmoc.compile_text(BELT), {"F": 1.15})], points=21, solver="dop853", rtol=1e-9)
    judge(found)
    assert [e.kind for e in found[0][1].events] == ["change", "slip", "stick"]


def test_a_small_tolerance_where_rounding_decides_about_the_steps():
    judge(repeated([(compiled(MODELS / "laws" / "bungee_jump.lmo"), {})], rtol=1e-9, points=60))


def test_friction_between_springs():
    """One on a prescribed motion, some side by side and in a row, a force that drops, and beside other laws."""
    scenes = [(lmoc.compile_text(text), {}) for text in (JENKINS, IWAN, ROW, PEAK, AMONG)]
    found = repeated(scenes, points=40, stop=2, solver="dop853", rtol=1e-9)
    judge(found, 1e-8)
    assert {e.kind for _, run, _ in found for e in run.events} >= {"slip", "stick", "impact"}


STEPS = """
model Steps "the road steps by a clock, and by a table: what is closed passes it on, strikes, slips"
  parameter Real h(unit = "m") = 0.03, F(unit = "N") = 0.4;
  input Real u(unit = "m");
  discrete Real z(start = 0, fixed = true, unit = "m");
  Real age(start = 0, fixed = true);
  discrete Real last(start = 0, fixed = true);
  Motion road(q = u + z);
  SpringDamper d(k = 200, c = 20);
  Mass m(m = 2, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Stop s(L = -0.05, e = 0.5);
  Fixed wall(q0 = 0.05), left;
  DryFriction f(F = F);
equation
  der(age) = 1;
  when sample(0.3, 0.5) then z = pre(z) + h; end when;
  when terminal() then last = age; end when;
  connect(road.flange, d.a); connect(d.b, m.flange);
  connect(wall.flange, s.a); connect(s.b, m.flange);
  connect(left.flange, f.a); connect(f.b, m.flange);
  annotation(experiment(StopTime = 2));
end Steps;
"""


def test_steps_of_what_is_prescribed():
    """By a formula at the start, by a clock, by a table, also where the run ends."""
    inputs = {"u": ([0, 0.5, 0.5, 1.1, 1.1, 2, 2], [0, 0.01, -0.05, -0.05, 0.04, 0, 0.1])}
    options = {"points": 41, "solver": "dop853", "rtol": 1e-9}
    found = repeated([(lmoc.compile_text(STEPS), {"F": 2.0})], inputs=inputs, **options)
    found += repeated([(compiled(MODELS / "laws" / "h20_road_step.lmo"), {"U": 1.5})], **options)
    judge(found, 1e-8)
    kinds = [e.kind for e in found[0][1].events]
    assert kinds.count("step") > 4 and {"impact", "reversal", "when"} <= set(kinds)
    assert found[0][1]["last"][-1] == pytest.approx(2, rel=1e-12)


OVER_THE_TOP = """
model Over "a particle on a rod, thrown up against friction, which meets a wall: neither x nor y serves all the way"
  parameter Real g(unit = "m/s2") = 9.81;
  Real x(start = 0, fixed = true), y(start = -1), vx(start = -9, fixed = true), vy, T, fn, gap, tau, w;
  discrete Integer turns(start = 0, fixed = true);
equation
  der(x) = vx;
  der(y) = vy;
  x^2 + y^2 = 1;
  w = x*vy - y*vx;
  der(vx) = -T*x - fn - y*(tau + 9);
  der(vy) = -T*y - g + x*(tau + 9);
  gap = 0.6 - x;
  Law.unilateral(fn, gap);
  Law.dryFriction(tau, w, 2, 2.5);
  when x > 0.1 then turns = pre(turns) + 1; end when;
  annotation(experiment(StopTime = 1.5));
end Over;
"""
TURNING = """
model Turning "a rod whose end is led back and forth, with a kink in between; the particle is braked as it passes"
  input Real u(unit = "m") = if time < 0.9 then 0.2*time else 0.18 - 0.5*(time - 0.9);
  parameter Real g(unit = "m/s2") = 9.81;
  Real x(start = 0, fixed = true), y(start = -1), vx(start = 7.1, fixed = true), vy, T;
  discrete Real drag(start = 0, fixed = true);
equation
  der(x) = vx;
  der(y) = vy;
  der(vx) = -T*x - drag*vx;
  der(vy) = -T*(y - u) - g - drag*vy;
  x^2 + (y - u)^2 = 1;
  when sample(0.2, 0.4) then drag = 0.3 - pre(drag); end when;
  annotation(experiment(StopTime = 1.5));
end Turning;
"""


def test_laws_and_events_go_on_in_other_coordinates():
    scenes = [(lmoc.compile_text(text), {"g": 1.02}) for text in (OVER_THE_TOP, TURNING)]
    found = repeated(scenes, points=40, solver="dop853", rtol=1e-9)
    judge(found, 1e-8)
    for _, run, again in found:
        assert len(run.coordinates) > 1 and len(again.changes) == len(run.coordinates) - 1
    kinds = {e.kind for _, run, _ in found for e in run.events}
    assert {"step", "when", "time", "contact"} <= kinds


def test_a_step_without_a_finite_effect_ends_a_run():
    text = """model S parameter Real T(unit = "s") = 3; Motion r(q = if time < T then 0 else 1); Mass m(m = 1);
      Spring s(k = 1); Mass n(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true));
      equation connect(r.flange, m.flange); connect(m.flange, s.a); connect(s.b, n.flange);
      annotation(experiment(StopTime = 2)); end S;"""
    run = lmoc.compile_text(text).simulate(points=3)
    script = write_script(run.trajectory)
    slot = next(s.slot for s in sliders(run.trajectory.observer, script.slots) if s.name == "T")
    again = repeat([(run, script, [[slot, 1.0]])])[0]
    assert again.reason.startswith("'r.q' jumps from 0 to 1 at t = 1.00000 s, and the motion needs its second")


BOUNCE = """
model Bounce
  parameter Real e = 0.7, g = 9.81;
  Real h(start = 1, fixed = true), v(start = 0, fixed = true);
  Integer n(start = 0, fixed = true);
  discrete Real last(start = 0);
equation
  der(h) = v;
  der(v) = -g;
  when h <= 0 then
    reinit(v, -e*pre(v));
    n = pre(n) + 1;
    last = time;
  end when;
  annotation(experiment(StopTime = 1.5));
end Bounce;
"""
SAMPLED = """
model Sampled
  parameter Real Ts = 0.1, K = 3, m = 2;
  Real x(start = 1, fixed = true), v(start = 0, fixed = true);
  discrete Real u(start = 0), I(start = 0);
  Boolean on(start = false);
equation
  der(x) = v;
  m*der(v) = u - 0.3*v + (if on then 1 else 0);
  when sample(0.05, Ts) then
    I = pre(I) + Ts*x;
    u = -K*x - 0.5*I;
  end when;
  on = time > 0.777 and x > -0.2;
  annotation(experiment(StopTime = 3));
end Sampled;
"""
THERMOSTAT = """
model Thermostat
  parameter Real low = 19, high = 21, P = 8;
  Real T(start = 18, fixed = true);
  Boolean heat(start = true, fixed = true);
  Integer steps;
  output Real y = floor(2*T)/2;
equation
  der(T) = (if heat then P else 0) - 0.3*(T - 5);
  heat = not (T > high) and (pre(heat) or T < low);
  steps = integer(time/0.7);
  annotation(experiment(StopTime = 8));
end Thermostat;
"""
ENDED = """
model Ended
  parameter Real k = 10, stopAt = 2.2;
  Mass m(m = 1, q(start = 0, fixed = true), v(start = 2, fixed = true));
  Spring s(k = k);
  Fixed w;
  Real u = if time < 0.3 then 0 elseif time < 0.9 then sin(5*time) else 2;
  Force f(f = u);
equation
  connect(w.flange, s.a);
  connect(s.b, m.flange);
  connect(f.flange, m.flange);
  when m.q > 0.4 then
    reinit(m.v, 0.5*m.v);
  elsewhen m.q < -0.3 then
    reinit(m.v, 0.9*m.v);
  end when;
  when time >= stopAt and m.v < 0 then
    terminate("enough");
  end when;
  annotation(experiment(StopTime = 5));
end Ended;
"""
SIGNALS = """
model Signals
  parameter Real a = 1.3;
  Real x(start = 0, fixed = true);
  Real y = if sin(a*time^2) > 0.3 then 1 else -0.5;
  Real z = mod(time, 0.4) + integer(3*sin(time)) + div(time, 0.7);
  Integer k;
initial equation
  k = 4 + integer(y);
equation
  der(x) = y - 0.1*x + z + k;
  when sample(0, 0.3) then
    k = if pre(k) > 5 then 0 else pre(k) + 1;
  end when;
  annotation(experiment(StopTime = 4));
end Signals;
"""
PUSHED = """
model Pushed "A law and events that change what it is pressed by"
  parameter Real e = 0.6;
  Mass ball(m = 1, g = 9.81, q(start = -1, fixed = true), v(start = 0, fixed = true));
  Fixed ground;
  Stop floor(e = e, L = 0);
  discrete Real push(start = 0);
  Force f(f = push);
equation
  connect(ball.flange, floor.a);
  connect(floor.b, ground.flange);
  connect(f.flange, ball.flange);
  when sample(0.5, 0.5) then
    push = if pre(push) > 0 then -3 else 4;
  end when;
  annotation(experiment(StopTime = 4));
end Pushed;
"""

KICKED = """
model Kicked "What rests on the ground, and what sticks to it, is kicked"
  parameter Real kick = 2;
  Mass ball(m = 1, g = 9.81, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Stop floor(e = 0.5, L = 0);
  Mass box(m = 2, q(start = 0, fixed = true), v(start = 0, fixed = true));
  DryFriction friction(F = 6);
  Fixed ground;
equation
  connect(ball.flange, floor.a);
  connect(floor.b, ground.flange);
  connect(box.flange, friction.a);
  connect(friction.b, ground.flange);
  when time > 0.5 then
    reinit(ball.v, -kick);
    reinit(box.v, kick);
  end when;
  annotation(experiment(StopTime = 2));
end Kicked;
"""

TOGETHER = """
model Together "A state event at each tick of a clock"
  parameter Real a = 1;
  Real x(start = 0, fixed = true);
  Integer n(start = 0, fixed = true), k(start = 0, fixed = true), c;
equation
  der(x) = a;
  c = integer(4*x);
  when sample(0.25, 0.25) then n = pre(n) + 1; end when;
  when change(c) then k = pre(k) + n; end when;
  annotation(experiment(StopTime = 1.1));
end Together;
"""


def test_events_of_all_kinds():
    changes = {BOUNCE: {"e": 0.8}, SAMPLED: {"Ts": 1.15}, THERMOSTAT: {"P": 1.2}, ENDED: {"stopAt": 1.3}}
    changes |= {SIGNALS: {"a": 1.15}, PUSHED: {"e": 1.15}, KICKED: {"kick": 1.3}, TOGETHER: {"a": 2}}
    judge(repeated([(lmoc.compile_text(text), changed) for text, changed in changes.items()]), 1e-7)


def test_assertions_and_contradictions_end_a_run_with_their_reason():
    asserted = BOUNCE.replace("    n = pre(n) + 1;", '    n = pre(n) + 1;\n    assert(n < 2, "one is enough");')
    overlapping = PUSHED.replace("L = 0)", "L = deep)").replace("Real e = 0.6", "Real e = 0.6, deep = 0.1")
    scenes = [(asserted, "one is enough", {"g": 60.0}), (overlapping, "gap of 'floor' is negative", {"deep": 1.5})]
    scenes += [(BOUNCE, "switches back and forth", {"e": 0.05})]
    cases = []
    for text, reason, changed in scenes:
        dae = lmoc.compile_text(text)
        with pytest.raises(lmoc.SimulationError if "reinit" in text else lmoc.ModelError, match=reason):
            dae.simulate(stop=0.6, parameters=changed)
        run = dae.simulate(stop=0.6, points=7)
        script = write_script(run.trajectory)
        slots = {s.name: s.slot for s in sliders(run.trajectory.observer, script.slots)}
        cases.append((run, script, [[slots[name], value] for name, value in changed.items()]))
    for again, (_, reason, _) in zip(repeat(cases), scenes, strict=True):
        assert not again.complete and reason in again.reason


@pytest.mark.parametrize("name, stop", [("engine", 0.5), ("valve_train", 0.05)])
def test_textbook_scenes(name, stop):
    """An engine's relation needs no position of its rod: looked at, it put the last solution at another place."""
    run = compiled(MODELS / "textbook" / f"{name}.lmo").simulate(stop=stop)
    (again,) = repeat([(run, write_script(run.trajectory), [])])
    assert again.complete, again.reason
    assert [e["kind"] for e in again.events] == [e.kind for e in run.events]
    assert [e["time"] for e in again.events] == pytest.approx([e.time for e in run.events], abs=1e-6)
    assert difference(run, again) < 1e-4


def test_what_a_step_leaves_open_of_a_stiff_state_is_no_crossing():
    """Where a stiff method has solved the equations at few places of a step, its way between them is off by more."""
    cases = []
    for rate, drive, stop, crossings in (
        (1e4, "0.3*time", 10, 1), (1e5, "0.3*time", 10, 1), (1e6, "0.3*time", 10, 1),
        (1e7, "1.5 + 1e-6*(time - 5)", 10, 1), (1e6, "1.5 + 0.1*sin(62831.853071795865*time)", 1e-3, 10),
    ):  # fmt: skip
        dae = lmoc.compile_text(
            f"""model M Real v; Integer n(start = 0, fixed = true); initial equation v = {drive} - 1e-9;
            equation der(v) = {rate}*(({drive}) - v); when v > 1.5 then n = pre(n) + 1; end when; end M;"""
        )
        run = dae.simulate(stop=stop, points=2, rtol=1e-6, solver="radau" if rate > 1e5 else "auto")
        cases.append((crossings, run, write_script(run.trajectory, float(stop))))
    for (crossings, run, _), again in zip(cases, repeat([(run, s, []) for _, run, s in cases]), strict=True):
        assert run["n"][-1] == again.values[-1, again.names.index("n")] == crossings, run.flat.name
