"""Ropes whose ends move unevenly lift loads from a floor and set them down again."""

import math

import numpy as np
import pytest
from oracles import winches
from oracles.lifting import WINDLASS, draw, lifted
from oracles.models import compiled_text

ROPE = """
model RopeLiftsLoad
  Motion hand(q = 0.5*cos(time));
  Cable rope(L = 0);
  Mass load(m = 20, g = 9.81, q(start = 0.4, fixed = true), v(start = 0, fixed = true));
  Fixed bottom(q0 = 0.4);
  Stop ground(L = 0, e = 0);
equation
  connect(hand.flange, rope.a);
  connect(rope.b, load.flange);
  connect(load.flange, ground.a);
  connect(ground.b, bottom.flange);
end RopeLiftsLoad;
"""
SOLVERS = ["auto", "dop853", "taylor", "cvode", "adams", "ida", "radau", "gauss", "rk4", "midpoint"]


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_load_follows_the_hand(solver):
    dae = compiled_text(ROPE)
    assert dae.states == ["load.q", "load.v"]
    run = dae.simulate(stop=3.0, solver=solver, rtol=1e-7)
    taut = next(e for e in run.events if e.kind == "taut")
    assert taut.time == pytest.approx(math.acos(0.8), abs=1e-9) and taut.impulse == pytest.approx(6.0)
    after = run.time > taut.time
    assert np.abs(run["load.q"] - 0.5 * np.cos(run.time))[after].max() < 1e-13
    assert np.allclose(run["load.v"][after], -0.5 * np.sin(run.time)[after], atol=1e-4)


@pytest.mark.parametrize("solver", ["dop853", "cvode", "radau"])
def test_a_windlass_sets_a_load_down_and_lifts_it(solver):
    run = compiled_text(WINDLASS).simulate(solver=solver)
    down, up = math.pi - math.asin(2 / 3), 2 * math.pi + math.asin(2 / 3)
    found = {e.kind: e.time for e in run.events if e.name == "drum"}
    assert found["slack"] == pytest.approx((2 * math.pi + math.asin(2 / 3)) / 0.8, abs=1e-5)
    assert found["taut"] == pytest.approx(down / 0.8, abs=1e-5) and up > down
    assert run.energy.balance < 1e-4


def test_random_lifting_scenes():
    """`python tests/many_lifts.py` draws more of them."""
    for seed in range(6):
        compare(np.random.default_rng(seed))


def test_random_winches():
    for seed in range(6):
        compare_winch(np.random.default_rng(seed))


def compare(rng, rtol=1e-8):
    """Compare a scene's events, without its bounces, with those found by hand; the number of events."""
    scene = draw(rng)
    lift = scene.lift
    expected = [e for e in lifted(lift, scene.first, 0.0, scene.stop) if e[1] in ("taut", "slack")]
    run = compiled_text(scene.text).simulate(stop=scene.stop, rtol=rtol, inputs=scene.inputs)
    place = scene.sense * run[scene.place]
    assert (place <= lift.floor + 1e-9).all() and (place <= lift.hand(run.time) + 1e-9).all(), scene.text
    return _same_events(run, expected, np.inf, scene.text)


def compare_winch(rng, rtol=1e-8):
    """Compare the events of a load on an accelerated drum with those in closed form; the number of events."""
    winch = winches.draw(rng)
    expected, end, place = winch.events()
    run = compiled_text(winch.text()).simulate(stop=end, points=51, rtol=rtol)
    assert run["load.q"][-1] == pytest.approx(place, abs=1e-6), winch.text()
    assert (run["load.q"] <= winch.floor + 1e-9).all() and (run["rope.gap"] >= -1e-9).all(), winch.text()
    return _same_events(run, expected, end, winch.text())


def _same_events(run, expected, end, text):
    found = [(e.time, e.kind) for e in run.events if e.name == "rope" and e.kind in ("taut", "slack")]
    found = [(t, kind) for t, kind in found if t < end + 1e-6][: len(expected) if end < np.inf else None]
    assert [kind for _, kind in found] == [kind for _, kind in expected], text
    assert np.allclose([t for t, _ in found], [t for t, _ in expected], atol=1e-6, rtol=0), text
    return len(found)
