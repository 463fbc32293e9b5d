"""Events that lie within the accuracy of their location are one instant in the page, too."""

import numpy as np
import pytest
from oracles.bouncing import STACKED
from oracles.in_javascript import difference, repeat
from oracles.lifting import WINDLASS
from oracles.node import needs_node

import lmoc
from lmoc.view.javascript.script import write_script
from lmoc.view.javascript.sliders import sliders

pytestmark = needs_node

SCENE = """
model Scene
  parameter Real s = 1, level = 0.6, moment = 0.6;
  Real x(start = 0, fixed = true);
  Integer n(start = 0, fixed = true), j(start = 0, fixed = true), k(start = 0, fixed = true), c;
equation
  der(x) = s;
  c = integer(4*x/level);
  when {x > level, time > moment} then n = pre(n) + 1; end when;
  when sample(moment/4, moment/4) then j = pre(j) + 1; end when;
  when change(c) then k = pre(k) + j; end when;
  annotation(experiment(StopTime = 1));
end Scene;
"""


def test_levels_and_ticks_meet():
    """c steps at each tick of j, and x passes its level with time at the fourth, whatever rounding says."""
    dae, draw = lmoc.compile_text(SCENE), np.random.default_rng(3)
    run = dae.simulate(points=5)
    script = write_script(run.trajectory)
    slots = {s.name: s.slot for s in sliders(run.trajectory.observer, script.slots)}
    cases = []
    for moment, s in zip(draw.uniform(0.5, 0.95, 12), draw.uniform(0.1, 5.0, 12), strict=True):
        values = {"s": s, "level": s * moment, "moment": moment}
        cases.append((dae.simulate(parameters=values, points=5), script, [[slots[n], v] for n, v in values.items()]))
    for (ours, _, changed), again in zip(cases, repeat(cases), strict=True):
        moment = changed[-1][1]
        assert again.complete, again.reason
        own = [(e.time, e.kind, e.after) for e in ours.events]
        page = [(e["time"], e["kind"], e["after"]) for e in again.events]
        for events in (own, page):
            assert {kind for _, kind, _ in events} == {"time"}
            assert len({t for t, _, _ in events}) == int(4 / moment + 1e-9)
            assert [after for _, _, after in events].count("{x > level, time > moment}") == 1
        assert ours["n"][-1] == 1 and ours["k"][-1] == sum(range(1, int(4 / moment + 1e-9) + 1))


def test_restitution_that_follows_from_a_slider():
    text = """
    model Ball
      parameter Real loss = 0.25;
      Mass m(m = 1, g = -10, q(start = 5, fixed = true), v(start = 0, fixed = true));
      Fixed w; Stop s(L = 0, e = 1 - loss);
    equation
      connect(w.flange, s.a); connect(s.b, m.flange);
      annotation(experiment(StopTime = 1.1));
    end Ball;
    """
    run = lmoc.compile_text(text).simulate(points=5)
    script = write_script(run.trajectory)
    (slot,) = [s.slot for s in sliders(run.trajectory.observer, script.slots) if s.name == "loss"]
    (again,) = repeat([(run, script, [[slot, 0.5]])])
    assert again.events[0]["energy_lost"] == pytest.approx(50 * (1 - 0.5**2), rel=1e-9)


@pytest.mark.parametrize("restitution", ["1", "0.9999999999999999", "0.999999999"])
def test_bounces_without_loss_end_with_those_of_others(restitution):
    text = STACKED.replace("e = 1)", f"e = {restitution})")
    run = lmoc.compile_text(text).simulate(stop=2.0, points=5)
    (again,) = repeat([(run, write_script(run.trajectory), [])])
    assert again.complete, again.reason
    assert [e["kind"] for e in again.events[-2:]] == ["accumulation", "contact"]
    assert abs(len(again.events) - len(run.events)) < 20
    assert max(e["time"] for e in again.events) == pytest.approx(1.81050526, abs=1e-6)


def test_a_windlass_lowers_and_lifts_a_load():
    """The rope's gap is a function of time and of the load, that of the floor one of the load alone."""
    run = lmoc.compile_text(WINDLASS).simulate(points=40)
    (again,) = repeat([(run, write_script(run.trajectory), [])])
    assert again.complete, again.reason
    kinds = [(e.name, e.kind) for e in run.events]
    assert ("drum", "slack") in kinds and ("ground", "release") in kinds
    page = [(e["name"], e["kind"]) for e in again.events]
    assert [k for k in page if k[1] != "impact"] == [k for k in kinds if k[1] != "impact"]
    assert difference(run, again) < 1e-5
