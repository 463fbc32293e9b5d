"""The hand that pulls in a page: what it adds to a scene, against the same spring written in the model."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from oracles.in_javascript import in_engine
from oracles.models import compiled
from oracles.node import needs_node, run_script
from oracles.pulls import pulled_everywhere
from scipy.integrate import solve_ivp

import lmoc
from lmoc.view.page import page
from lmoc.view.page.contents import contents, drawn, movers
from lmoc.view.page.hands import hands_at, run_with_hands, with_hands

MODELS = Path(__file__).parents[2] / "models"
ASSETS = Path(page.__file__).parent / "assets"

LINE = """
model M
  Fixed wall;
  Spring spring(k = 30);
  Damper damper(c = 0.4);
  Mass body(m = 2, q(start = 0.1, fixed = true), v(start = 0, fixed = true));
  HAND
equation
  connect(wall.flange, spring.a); connect(spring.b, body.flange);
  connect(wall.flange, damper.a); connect(damper.b, body.flange);
  CONNECTED
  annotation(experiment(StopTime = 3));
end M;
"""
SHAFT = """
model M
  Inertia body(J = 0.3, theta(start = 0.2, fixed = true), omega(start = 1, fixed = true));
  TorsionSpring spring(k = 2);
  FixedShaft wall;
  HAND
equation
  connect(wall.shaft, spring.a); connect(spring.b, body.shaft);
  CONNECTED
  annotation(experiment(StopTime = 3));
end M;
"""
PLANE = """
model M
  import Planar.*;
  inner World world(g = 9.81);
  Ground ground;
  Revolute pin(phi(start = -0.4, fixed = true), omega(start = 0, fixed = true));
  Body body(m = 1.5, J = 0.2, cx = 0.5);
  HAND
equation
  connect(ground.frame, pin.a); connect(pin.b, body.frame);
  CONNECTED
  annotation(experiment(StopTime = 3));
end M;
"""
CASES = {
    "line": (LINE, "Spring hand(k = 12); Fixed held(q0 = 0.4);",
             "connect(held.flange, hand.b); connect(body.flange, hand.a);", (12, 0.4), "body.q", "body.flange.q"),
    "shaft": (SHAFT, "TorsionSpring hand(k = 1.5); FixedShaft held(theta0 = 0.7);",
              "connect(held.shaft, hand.b); connect(body.shaft, hand.a);",
              (1.5, 0.7), "body.theta", "body.shaft.theta"),
    "frame": (PLANE, "Spring hand(k = 25); Anchor held(x = 0.9, y = 0.3); PointOf at(rx = 0.8, ry = 0.1);",
              "connect(body.frame, at.frame); connect(at.point, hand.a); connect(hand.b, held.point);",
              (25, 0.9, 0.3, 0.8, 0.1), "pin.phi", "body.frame.x"),
}  # fmt: skip


def of(text: str, hand: str = "", connected: str = "") -> str:
    return text.replace("HAND", hand).replace("CONNECTED", connected)


@pytest.mark.parametrize("kind", CASES)
def test_a_hand_is_the_spring_that_a_model_would_have_there(kind):
    text, hand, connected, signals, watched, moving = CASES[kind]
    run = lmoc.compile_text(of(text)).simulate(points=60, rtol=1e-9)
    found, _ = hands_at(run.flat, [moving])
    extended, hands, nothing = with_hands(run.flat, found)
    assert [h.kind for h in hands] == [kind] and not any(nothing.values())
    names = [extended.variable_name(v) for v in hands[0].signals]
    pulled = run.extended(extended, nothing | dict(zip(names, signals, strict=True)))
    truth = lmoc.compile_text(of(text, hand, connected)).simulate(points=60, rtol=1e-9)
    assert np.abs(truth[watched] - run[watched]).max() > 0.05
    assert np.abs(pulled[watched] - truth[watched]).max() < 1e-7
    assert pulled.energy.balance < 1e-7
    work = pulled.energy.supplied - pulled.energy.supplied[0]
    spring = truth["hand.energy"]  # what it has lost, the scene was given
    assert np.abs(work + spring - spring[0]).max() < 1e-6
    still = run.extended(extended, nothing)
    assert np.abs(still[watched] - run[watched]).max() < 1e-8 and still.states == run.states


UNHELD = ["notes/ex05_suspension", "laws/h06_bungee", "planar/slider_crank", "planar/double_pendulum"]
UNHELD += ["hard/h12_rods_and_springs"]  # its start is open, and was guessed anew


@pytest.mark.parametrize("file", UNHELD)
def test_hands_change_nothing_while_they_hold_nothing(file):
    run = compiled(MODELS / f"{file}.lmo").simulate(points=50)
    held, hands, _ = run_with_hands(run, movers(drawn(run, [])))
    assert hands and held.states == run.states and len(held.events) == len(run.events)
    for name in run.states:
        assert np.abs(held[name] - run[name]).max() <= 1e-5 * np.abs(run[name]).max()


@needs_node
def test_what_is_pulled_in_the_page_moves_as_the_equations_say_and_the_ledger_closes():
    """A spring that is taken at 0.5 s, moved at 0.9 s and let go at 1.6 s, against SciPy from piece to piece."""
    run = lmoc.compile_text(of(LINE)).simulate(points=121, rtol=1e-9)
    found = contents(run, "M")
    pulls = [[0.5, "body.flange", [12, 0.4]], [0.9, "body.flange", [12, -0.3]], [1.6, "body.flange", [0, 0]]]
    (hand,) = found.data["script"]["hands"]
    assert hand["kind"] == "line" and hand["name"] == "body.flange"
    body = f"""
    const data = {json.dumps(found.data)}, pulls = {json.dumps(pulls)};
    const repeater = new Repeater(data.script, engine, data, () => 0);
    const times = {json.dumps(run.time.tolist())};
    const answer = repeater.run(times, {{}}, {{}}, pullsOf(data.script.hands, pulls));
    const live = new Pull(repeater, {{ times, values: {{}}, initial: {{}}, pulls }},
      {{ hand: data.script.hands[0], speed: 1, motion: null, item: null, vertex: null, read: (w) => w }}, 2.2);
    const same = live.letGo();
    console.log(JSON.stringify(["body.q", "ledger.stored", "ledger.work", "ledger.heat"].map((n) => [...answer.of(n)])
      .concat([[...same.columns.get("body.q")]])));
    """
    q, stored, work, heat, again = np.array(run_script(in_engine("worker.js") + body))

    def rates(_, x, k, target):
        return [x[1], (-30 * x[0] - 0.4 * x[1] + k * (target - x[0])) / 2]

    truth, state = np.full(len(run.time), np.nan), [0.1, 0.0]
    edges = [0, 0.5, 0.9, 1.6, 3.0]
    for (a, b), (k, target) in zip(zip(edges, edges[1:]), [(0, 0), (12, 0.4), (12, -0.3), (0, 0)], strict=True):
        inside = (run.time >= a) & (run.time <= b)
        at = np.union1d(run.time[inside], [a, b])
        own = solve_ivp(rates, (a, b), state, rtol=1e-11, atol=1e-13, t_eval=at, args=(k, target))
        truth[inside] = own.y[0][np.isin(own.t, run.time[inside])]
        state = own.y[:, -1]
    assert np.abs(q - truth).max() < 1e-7 and np.abs(again - truth).max() < 1e-7
    assert np.abs(truth - run["body.q"]).max() > 0.05 and work.max() > 0.1
    assert np.abs(work - heat - (stored - stored[0])).max() < 1e-6


STRING = """
model M
  Fixed wall;
  Cable string(L = 1);
  Damper damper(c = 0.8);
  Mass body(m = 2, g = 9.81, q(start = 0.7, fixed = true), v(start = 0, fixed = true));
  HAND
equation
  connect(wall.flange, string.a); connect(string.b, body.flange);
  connect(wall.flange, damper.a); connect(damper.b, body.flange);
  CONNECTED
  annotation(experiment(StopTime = 2));
end M;
"""


@needs_node
def test_a_hand_lifts_what_hangs_on_a_string_and_the_string_catches_it_again():
    """From the start against the spring in the model; taken and let go on the way, the ledger closes."""
    _, hand, connected, *_ = CASES["line"]
    run = lmoc.compile_text(of(STRING)).simulate(points=101)
    truth = lmoc.compile_text(of(STRING, hand.replace("k = 12", "k = 40"), connected)).simulate(points=101)
    found = contents(run, "M")
    whole = [[0, "body.flange", [40, 0.4]]]
    later = [[0.5, "body.flange", [90, 0.4]], [1.1, "body.flange", [0, 0]]]
    body = f"""
    const data = {json.dumps(found.data)};
    const repeater = new Repeater(data.script, engine, data, () => 0);
    const told = [{json.dumps(whole)}, {json.dumps(later)}].map((pulls) => {{
      const answer = repeater.run({json.dumps(run.time.tolist())}, {{}}, {{}}, pullsOf(data.script.hands, pulls));
      const names = ["body.q", "ledger.stored", "ledger.work", "ledger.heat"];
      return [names.map((n) => [...answer.of(n)]), answer.events.map((e) => e.time), answer.reason];
    }});
    console.log(JSON.stringify(told));
    """
    (first, times, reason), (second, events, other) = run_script(in_engine("worker.js") + body)
    assert reason == other == ""
    assert np.abs(np.array(first[0]) - truth["body.q"]).max() < 1e-5
    assert np.allclose(times, [e.time for e in truth.events], atol=1e-5) and len(times) == len(truth.events) > 0
    q, stored, work, heat = np.array(second)
    hanging = (run.time > 0.4) & (run.time < 0.5)
    assert np.abs(q[hanging] - 1).max() < 1e-6 and q[(run.time > 0.6) & (run.time < 1.1)].min() < 0.9  # lifted
    assert np.abs(q[-5:] - 1).max() < 1e-6 and any(t > 1.1 for t in events)  # and caught
    assert np.abs(work - heat - (stored - stored[0])).max() < 1e-5 * np.abs(stored).max()


SERIES, GEARS = "notes/s7_1_springs_in_series", "notes/s8_gears"


@cache
def pulled(file):
    run = compiled(MODELS / f"{file}.lmo").simulate(rtol=1e-9, points=31)
    return run, pulled_everywhere(run)


@needs_node
@pytest.mark.parametrize("file", ["notes/ex10_lever_and_mass", "planar/crane", SERIES, GEARS])
def test_whatever_is_pulled_moves_as_in_python_under_the_same_force(file):
    """Levers, massless ends of springs, bodies and points of the plane, shafts; `many_pulls.py` takes all models."""
    _, found = pulled(file)
    assert found and sum(one.moved > 0.01 for one in found) >= len(found) - 1
    for one in found:
        assert not one.reason and one.missed < 1e-6 and one.balance < 1e-6, one
        assert one.accuracy < 1e-6 and one.doubted is None, one
        assert (one.stiffness > 0) == (one.moved > 1e-9), one


@needs_node
def test_parts_are_pulled_where_a_motion_steps():
    found = pulled_everywhere(compiled(MODELS / "laws" / "h20_road_step.lmo").simulate(rtol=1e-9, points=11, stop=1))
    assert any(one.moved > 0.01 for one in found)
    assert all(one.is_right and not one.reason and one.doubted is None for one in found)


def test_a_law_with_states_of_its_own_does_not_keep_hands_away():
    """They are numbered: with hands they have other names."""
    run = lmoc.compile_text("""
        model M import Planar.*; inner World world; PointMass car(m = 5);
        Track track(points = [0, 1; 1, 0.2; 2, 0.4], leaves = true,
          s(start = 0.1, fixed = true), v(start = 0, fixed = true), gap(start = 0, fixed = true));
        equation connect(track.point, car.point); end M;""").simulate(stop=0.2, points=5)
    held, hands, _ = run_with_hands(run, ["car.point.x", "car.point.y"])
    assert [hand.name for hand in hands] == ["car.point"] and held.states != run.states
    assert np.allclose(held["track.s"], run["track.s"], rtol=1e-9, atol=0)


@needs_node
def test_the_hand_is_so_stiff_that_what_it_holds_would_swing_twice_a_second():
    """By the inertia behind it where there is one; a massless end gives way as the springs on its sides say."""
    rate = 4 * np.pi
    run, springs = pulled(SERIES)
    k1, k2, m = (float(run[name][0]) for name in ("k1", "k2", "m"))
    stiffness = {one.hand: one.stiffness for one in springs}
    assert stiffness == pytest.approx({"mass.flange": m * rate**2, "spring1.b": k1 + k2}, rel=1e-5)
    run, gears = pulled(GEARS)
    j1, j2, ratio = (float(run[name][0]) for name in ("J1", "J2", "N"))
    stiffness = {one.hand: one.stiffness for one in gears}
    both = (j1 + j2 / ratio**2) * rate**2
    assert stiffness == pytest.approx({"gear1.shaft": both, "gear2.shaft": both * ratio**2}, rel=1e-5)


@needs_node
def test_a_page_says_how_accurate_its_run_is():
    """Beside a closed form: the error that is told is the one that is there."""
    run = lmoc.compile_text("""
        model M Mass m(m = 2, q(start = 1, fixed = true), v(start = 0, fixed = true)); Spring s(k = 8); Fixed wall;
        equation connect(wall.flange, s.a); connect(s.b, m.flange); end M;""").simulate(rtol=1e-4, stop=30)
    found = contents(run, "M")
    body = f"""
    const data = {json.dumps(found.data)};
    const repeater = new Repeater(data.script, engine, data, () => 0);
    const [own, finer] = [1, 0.1].map((f) => repeater.run({json.dumps(run.time.tolist())}, {{}}, {{}}, [], f));
    const told = [1e-3, 1e-9].map((most) => parting(own, finer, ["m.q"], () => "m", most));
    console.log(JSON.stringify([told, [...own.of("m.q")]]));
    """
    (plain, strict), q = run_script(in_engine("worker.js") + body)
    error = np.abs(q - np.cos(2 * run.time))
    assert 1e-6 < error.max() < 1e-3 and plain["from"] is None
    assert plain["missed"] == pytest.approx(error.max(), rel=0.5)
    assert 0 < strict["from"] < 5


@needs_node
def test_a_page_says_from_when_on_a_chaotic_run_is_not_to_be_relied_on():
    _, found = pulled("planar/double_pendulum")
    one = next(one for one in found if one.hand == "upper.a")
    assert 3 < one.doubted < 5 and one.is_right and 1e-3 < one.accuracy < 0.1


@needs_node
def test_a_slider_at_the_dead_centre_of_its_crank_is_not_pulled():
    """Its derivative by the crank is rounding there: the hand would be 10²⁷ N/m stiff, and the steps would collapse."""
    dae = compiled(MODELS / "planar" / "slider_crank.lmo")
    found = pulled_everywhere(dae.simulate(stop=0.1, points=5, initial={"main.phi": 1e-13}))
    stiffness = {one.hand: one.stiffness for one in found}
    assert stiffness["piston.frame"] == stiffness["cylinder.flange"] == 0 < stiffness["arm.b"] < 1e4
    assert all(one.is_right and not one.reason for one in found)


@needs_node
@pytest.mark.parametrize("rounding", [0, 2e-12])
def test_what_a_force_does_not_accelerate_gives_no_way(rounding):
    """Andrews' mechanism starts at a dead centre: places there differ in their last bits from one call to the next, and
    rates of 14 222 rad/s² by theirs with a force of 1 N. A hand had 7·10¹² N/m, and its run did not end."""
    script = f"""
import {{ compliance }} from {json.dumps((ASSETS / "compliance.js").as_uri())};
let calls = 0, pushed = 0;
const scene = {{ rates: (_, [, v], out) => out.set([v, 14222 + {rounding} * pushed]) }};
const place = ([q]) => [0.02 + 7e-18 * (calls++ % 2), 0.03 + 1e-3 * (q + 0.06)];
console.log(JSON.stringify(compliance(scene, {{ t: 0, x: [-0.06, 0] }}, 2, place, ([fx, fy]) => (pushed = fx + fy))));
"""
    assert run_script(script) == {"order": -1, "value": 0}


@pytest.mark.parametrize(("most", "held"), [(2, {"m.flange", "a.b"}), (1, {"m.flange"})])
def test_large_scenes_are_pulled_where_they_have_inertia(monkeypatch, most, held):
    monkeypatch.setattr("lmoc.view.page.hands.MOST_STATES", most)
    run = lmoc.compile_text("""
    model M
      Fixed wall;
      Spring a(k = 3), b(k = 2);
      Mass m(m = 1, q(start = 0.2, fixed = true), v(start = 0, fixed = true));
    equation
      connect(wall.flange, a.a); connect(a.b, b.a); connect(b.b, m.flange);
    end M;""").simulate(stop=1, points=3)  # fmt: skip
    _, own, _ = run_with_hands(run, ["m.flange.q", "a.b.q"])
    assert {hand.name for hand in own} == held
