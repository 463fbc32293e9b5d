"""A scene stepped from a loop does what a run does."""

import numpy as np
import pytest
from conftest import ROOT

import lmoc
from lmoc.ir.names import UnknownNameError
from lmoc.numerics.steps import dop853, onward

CART = ROOT / "models/planar/cart_pole.lmo"
BOUNCING = """model Ball
  Real h(start = 1, fixed = true), v(start = 0, fixed = true);
equation
  der(h) = v;
  der(v) = -9.81;
  when h < 0 then
    reinit(v, -0.7*pre(v));
  end when;
end Ball;"""


@pytest.fixture(scope="module")
def cart() -> lmoc.DAE:
    return lmoc.compile(CART)


def test_small_steps_lead_where_a_run_ends(cart):
    live = cart.live(rtol=1e-9)
    for dt in (0.1, 0.25, 1e-3, 0.649):
        live.advance(dt)
    run = cart.simulate(times=[0, 1.0], rtol=1e-9)
    assert live.time == pytest.approx(1.0, abs=1e-15)
    for name in ("phi", "rail.v", "pole.theta", "pole.a.fx"):
        assert live[name] == pytest.approx(run[name][-1], abs=1e-7), name


def test_an_input_holds_from_the_time_at_which_it_is_set(cart):
    """Horizontal momentum is the impulse of the force."""
    live = cart.live(inputs={"F": 0.0}, rtol=1e-9)
    for k in range(20):
        live.inputs["F"] = 1.0 if k % 2 else -3.0
        live.advance(0.01)
    speed = live["rail.v"] - 0.5 * np.sin(live["pole.theta"]) * live["pole.omega"]
    assert 1.0 * live["rail.v"] + 0.1 * speed == pytest.approx((1.0 - 3.0) * 0.1, abs=1e-8)
    assert dict(live.inputs) == {"F": 1.0}


@pytest.mark.parametrize("rtol", [1e-4, 1e-9])
def test_steps_kept_in_c_have_the_bits_of_those_in_python(cart, monkeypatch, rtol):
    """The latter are those of a scene whose inputs ask Python."""
    ends = []
    for begin in (onward.begin, dop853.begin):
        monkeypatch.setattr(onward, "begin", begin)
        live = cart.live(inputs={"F": 0.0}, rtol=rtol)
        for k, dt in enumerate((0.02, 0.02, 1.5, 0.3, 1e-4)):
            live.inputs["F"] = (-1.0) ** k * k
            live.advance(dt)
            if k == 3:
                live.set("pin.omega", 0.2)
        ends.append([live.time, *(live[name] for name in cart.states)])
    assert ends[0] == ends[1]


def test_an_input_with_a_signal_of_its_own_takes_a_number(cart):
    live = cart.live(rtol=1e-9)  # F = 0 is the model's own
    live.advance(0.1)
    before = live["phi"]
    live.inputs["F"] = 2.0
    assert live["phi"] == before and live.inputs["F"] == 2.0
    speed = live["rail.v"]
    live.advance(1e-3)
    assert live["rail.v"] > speed


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "sin(time)", None])
def test_what_is_no_finite_number_is_refused_and_changes_nothing(cart, value):
    live = cart.live(inputs={"F": 1.0})
    for change in (lambda: live.inputs.update(F=value), lambda: live.set("rail.v", value)):
        with pytest.raises(lmoc.ModelError, match="E0621.*cannot be set to this value"):
            change()
    assert dict(live.inputs) == {"F": 1.0} and live["rail.v"] == 0
    with pytest.raises(UnknownNameError, match="derivatives are not available here"):
        live["der(rail.v)"]


def test_a_state_is_set_directly_or_through_what_follows_it(cart):
    live = cart.live()
    live.advance(0.2)
    live.set("rail.v", 1.0)
    assert live["cart.vx"] == pytest.approx(1.0)
    live.set("cart.vx", -0.5)
    assert live["rail.v"] == pytest.approx(-0.5)
    with pytest.raises(lmoc.ModelError, match=r"E0621.*rail\.s, pin\.phi"):
        live.set("pole.b.x", 1.0)


def test_a_copy_goes_its_own_way(cart):
    live = cart.live(inputs={"F": 0.0})
    live.advance(0.1)
    other = live.copy()
    live.inputs["F"] = 5.0
    live.advance(0.1)
    assert other.time == pytest.approx(0.1) and other.inputs["F"] == 0.0
    other.advance(0.1)
    assert live["rail.v"] > other["rail.v"] + 0.1


def test_a_closed_loop_is_stepped_too():
    dae = lmoc.compile(ROOT / "models/planar/four_bar.lmo")
    live = dae.live(rtol=1e-8)
    for _ in range(3):
        live.advance(0.05)
    assert live["psi"] == pytest.approx(dae.simulate(times=[0, 0.15], rtol=1e-8)["psi"][-1], abs=1e-6)


def test_events_are_kept():
    live = lmoc.compile_text(BOUNCING).live(rtol=1e-9)
    for _ in range(12):
        live.advance(0.1)
    times = [event.time for event in live.events]
    first = np.sqrt(2 / 9.81)
    assert times[:2] == pytest.approx([first, 2.4 * first], abs=1e-7)
    assert live["v"] == pytest.approx(0.49 * 9.81 * first - 9.81 * (1.2 - 2.4 * first), abs=1e-6)


def test_what_is_wrong_is_told(cart):
    live = cart.live()
    with pytest.raises(lmoc.ModelError, match="E0541"):
        live.advance(0.0)
    with pytest.raises(lmoc.ModelError, match="E0541"):
        live.advance("soon")
    with pytest.raises(lmoc.ModelError, match="E0622"):
        live.inputs["G"] = 1.0
    with pytest.raises(UnknownNameError, match="did you mean 'phi'"):
        live["phii"]
    with pytest.raises(lmoc.ModelError, match="E0622"):
        cart.live(initial={"nowhere": 1.0})


def test_laws_switch_while_stepping() -> None:
    """A belt that takes a mass along: what a loop sees is what a whole run gives."""
    scene = lmoc.compile(ROOT / "models" / "laws" / "h16_stick_slip.lmo")
    live, whole = scene.live(rtol=1e-9), scene.simulate(stop=5, rtol=1e-9)
    for _ in range(50):
        live.advance(0.1)
    assert live["mass.q"] == pytest.approx(whole["mass.q"][-1], abs=1e-8)
    assert [(e.kind, e.name) for e in live.events] == [(e.kind, e.name) for e in whole.events]
    assert [e.time for e in live.events] == pytest.approx([e.time for e in whole.events], abs=1e-8)


def test_inputs_and_states_change_under_laws() -> None:
    """A clutch is engaged, locks, is torn loose by a load, and is stopped by hand."""
    live = lmoc.compile_text(
        """model Drive input Real load = 0, grip = 0;
          Torque t(tau = load); Clutch c(tau = 5, engagement = grip);
          Inertia a(J = 1, theta(fixed = true), omega(start = 10, fixed = true));
          Inertia b(J = 2, theta(fixed = true), omega(fixed = true));
        equation connect(t.shaft, a.shaft); connect(a.shaft, c.a); connect(c.b, b.shaft); end Drive;"""
    ).live(rtol=1e-9)
    live.advance(1.0)
    assert [live["a.omega"], live["b.omega"]] == [10, 0]
    live.inputs["grip"] = 1.0
    live.advance(2.0)
    assert [live["a.omega"], live["b.omega"]] == pytest.approx([10 / 3, 10 / 3], rel=1e-12)
    live.inputs["load"] = 30.0
    live.advance(1.0)
    assert [live["a.omega"], live["b.omega"]] == pytest.approx([10 / 3 + 25, 10 / 3 + 2.5])
    live.set("a.omega", 0.0)
    live.advance(0.1)
    assert [live["a.omega"], live["b.omega"]] == pytest.approx([3.5, 10 / 3 + 2.5 - 0.25])
    assert [(e.kind, e.time) for e in live.events] == [("lock", pytest.approx(1 + 4 / 3)), ("unlock", 3.0)]


DRAGGED = """
model Dragged
  input Real u(unit = "m") = 0;
  Motion hand(q = u);
  {part} link({value});
  Mass m(m = 2, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Stop buffer(L = 0.05, e = 0.5); Fixed wall(q0 = {wall});
equation
  connect(hand.flange, link.a); connect(link.b, m.flange); connect(m.flange, buffer.a); connect(buffer.b, wall.flange);
end Dragged;
"""


@pytest.mark.parametrize("wall", [0.12, 9.0])
@pytest.mark.parametrize("part, value", [("Damper", "c = 3"), ("Spring", "k = 50"), ("Cable", "L = 0.3")])
def test_a_position_that_is_set_by_hand_steps(part, value, wall):
    """Through a damper the mass gets a velocity at once, as where the same signal is known before."""
    scene = lmoc.compile_text(DRAGGED.format(part=part, value=value, wall=wall))
    live = scene.live(inputs={"u": 0.0}, rtol=1e-9)
    live.advance(0.5)
    live.inputs["u"] = 0.7
    live.inputs["u"] = 0.2
    back = live.copy()
    back.inputs["u"] = 0.0
    for _ in range(5):
        live.advance(0.1)
    whole = scene.simulate(stop=1.0, inputs={"u": "if time < 0.5 then 0 else 0.2"}, rtol=1e-9)
    assert [live["m.q"], live["m.v"]] == pytest.approx([whole["m.q"][-1], whole["m.v"][-1]], abs=1e-7)
    assert [(e.kind, e.name) for e in live.events] == [(e.kind, e.name) for e in whole.events]
    assert [e.time for e in live.events] == pytest.approx([e.time for e in whole.events], abs=1e-7)
    back.advance(0.5)
    assert back["m.q"] == back["m.v"] == 0.0 and not back.events
    if part == "Damper" and wall > 1:
        assert live["m.q"] == pytest.approx(0.2 * (1 - np.exp(-1.5 * 0.5)), abs=1e-8)


def test_a_smooth_scene_keeps_its_integrator_after_a_step():
    smooth = DRAGGED.replace("Stop buffer(L = 0.05, e = 0.5); Fixed wall(q0 = {wall});", "")
    smooth = smooth[: smooth.index(" connect(m.flange, buffer.a)")] + "\nend Dragged;"
    live = lmoc.compile_text(smooth.format(part="Damper", value="c = 3")).live(inputs={"u": 0.0}, rtol=1e-10)
    for k in range(3):  # x' = −1.5·x towards each place
        live.advance(0.1)
        live.inputs["u"] = 0.1 * (k + 1)
    live.advance(0.1)
    after = [0.1 * (1 - np.exp(-1.5 * t)) for t in (0.1, 0.2, 0.3)]
    assert live["m.q"] == pytest.approx(sum(after), abs=1e-9)
    assert [e.time for e in live.events] == pytest.approx([0.1, 0.2, 0.3])
    sprung = smooth.replace("{part} link({value});", "{part} link({value}); Mass servo(m = 1);")
    direct, behind = "connect(hand.flange, link.a);", "connect(servo.flange, link.a);"
    sprung = sprung.replace(direct, f"connect(hand.flange, servo.flange); {behind}")
    moved = lmoc.compile_text(sprung.format(part="Spring", value="k = 8")).live(inputs={"u": 0.0}, rtol=1e-10)
    moved.inputs["u"] = 0.3
    moved.advance(1.0)
    assert moved["m.q"] == pytest.approx(0.3 * (1 - np.cos(2.0)), abs=1e-8) and not moved.events


PUSHED = """
model Pushed
  input Real u(unit = "N") = 0;
  Force push(f = u);
  Mass body(m = 2, q(start = 0, fixed = true), v(start = 0, fixed = true));
equation
  connect(push.flange, body.flange);
end Pushed;
"""


@pytest.mark.parametrize("dt", [10, 0.7, 1 / 3])
@pytest.mark.parametrize(
    "signal, momentum",
    [
        ("100*exp(-((time - 5)/0.01)^2)", np.sqrt(np.pi)),
        (lambda t: 100 * np.exp(-(((t - 5) / 0.01) ** 2)), np.sqrt(np.pi)),
        (([0, 5, 5, 5.001, 5.001, 9], [0, 0, 1000, 1000, 0, 0]), 1.0),
        ("abs(sin(time))", 7 + np.cos(10)),
    ],
    ids=["formula", "callable", "table", "kinks"],
)
def test_no_pulse_is_stepped_over(signal, momentum, dt):
    live = lmoc.compile_text(PUSHED).live(inputs={"u": signal}, rtol=1e-8)
    while live.time + dt < 10:
        live.advance(dt)
    live.advance(10 - live.time)
    assert 2 * live["body.v"] == pytest.approx(momentum, rel=1e-7)


def test_a_stiff_scene_goes_on_with_another_method():
    scene = lmoc.compile_text("model S Real x(start = 2, fixed = true); equation der(x) = -1e9*(x - cos(time)); end S;")
    live = scene.live()
    for _ in range(5):
        live.advance(2)
    assert live["x"] == pytest.approx(np.cos(10), abs=1e-5)
