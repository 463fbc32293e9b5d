"""What happens to laws at an instant: impacts, release, sticking, the end of bouncing."""

from dataclasses import replace

import numpy as np
import pytest
from oracles.lawful import laws_of, state

import lmoc
from lmoc.numerics.laws.contradiction import Contradiction

STRING = """
model String Fixed c; Spring s(k = 100); Mass m1(m = 1, g = 9.81), m2(m = 2, g = 9.81); Cable t(L = 0.5);
equation connect(c.flange, s.a); connect(s.b, m1.flange); connect(m1.flange, t.a); connect(t.b, m2.flange); end String;
"""
BELT = """
model Belt Fixed w; Mass m(m = 1); Spring k(k = 50); DryFriction f(F = 2, Fstick = 4);
equation connect(w.flange, k.a); connect(k.b, m.flange); connect(w.flange, f.a); connect(f.b, m.flange); end Belt;
"""
BALL = """
model Ball Fixed floor; Mass m(m = 1, g = -9.81); Stop s(L = 0, e = 0.8);
equation connect(floor.flange, s.a); connect(s.b, m.flange); end Ball;
"""
CRADLE = """
model Cradle Mass m[5](each m = 1); Stop s[4](each L = 0.1, each e = 1);
equation for i in 1:4 loop connect(m[i].flange, s[i].a); connect(s[i].b, m[i+1].flange); end for; end Cradle;
"""


def at(text, values, vanish=(), lower=(), closed=()):
    """Return the states behind an instant at which root functions vanish (of a force its upper limit, or the `lower`
    one), and what C has left of it."""
    laws = laws_of(text)
    n = laws.run.n
    laws.mode = replace(laws.mode, closed=np.isin(np.arange(n), closed))
    which = np.zeros(2 * n, bool)
    which[list(vanish)] = which[[n + k for k in lower]] = True
    x = state(laws.kinematics, **values)
    status = laws.run.call("lmoc_law_happen", 0.0, x, which, 0)
    assert status == 0
    return dict(zip(laws.kinematics.plan.reduced.state_names, x)), laws.run


def test_a_string_becomes_taut_with_a_plastic_jerk():
    x, found = at(STRING, {"m1_q": 0.1, "m2_q": 0.6, "m2_v": 3.0}, vanish=[0])
    assert x["m1.v"] == pytest.approx(2.0, abs=1e-14) and x["m2.v"] == pytest.approx(2.0, abs=1e-14)
    assert found.impulse == pytest.approx([2.0], rel=1e-13) and found.lost == pytest.approx([3.0], rel=1e-13)
    assert found.mode.closed.all() and found.force[0] == pytest.approx(2 * 100 * 0.1 / 3, rel=1e-12)


def test_a_string_is_set_free_where_its_force_vanishes():
    _, found = at(STRING, {"m1_q": 0.0, "m2_q": 0.5, "m1_v": -1.0, "m2_v": -1.0}, vanish=[0], closed=[0])
    assert not found.mode.closed.any() and not found.impulse.any()


@pytest.mark.parametrize(
    "q, closed, direction", [(0.05, True, 0), (-0.079, True, 0), (0.081, False, -1), (-0.081, False, 1)]
)
def test_friction_sticks_up_to_its_sticking_limit(q, closed, direction):
    """The spring pulls with 50·q; it holds up to 4 N."""
    _, found = at(BELT, {"m_q": q}, vanish=[0])
    assert found.mode.closed[0] == closed and found.mode.direction[0] == direction


def test_sliding_friction_has_its_slipping_limit():
    _, found = at(BELT, {"m_q": 0.08, "m_v": 0.0}, closed=[0], vanish=[0])
    assert found.force[0] == pytest.approx(2.0) and found.level[0] == pytest.approx(-2.0)


def test_a_bounce_and_the_last_one():
    x, found = at(BALL, {"m_v": -2.0}, vanish=[0])
    assert x["m.v"] == pytest.approx(1.6, rel=1e-14) and not found.mode.closed[0] and not found.accumulated[0]
    x, found = at(BALL, {"m_v": -1e-10}, vanish=[0])
    assert x["m.v"] == 0.0 and found.mode.closed[0] and found.accumulated[0]
    assert found.data.until == pytest.approx(2 * 0.8e-10 / (9.81 * 0.2), rel=1e-9)


def test_contacts_that_touch_take_part_in_an_impact():
    """Positions 0.1, 0.2, … leave gaps of some 1e-17."""
    start = {f"m[{i}]_q": 0.1 * i for i in range(1, 6)} | {"m[1]_v": 1.0}
    x, found = at(CRADLE, start, vanish=[0])
    assert [x[f"m[{i}].v"] for i in range(1, 6)] == pytest.approx([-0.6, 0.4, 0.4, 0.4, 0.4], abs=1e-13)
    assert found.lost.sum() == pytest.approx(0.0, abs=1e-14)


def test_a_body_that_is_caught_is_a_contradiction():
    text = """
        model Caught Motion press(q = -time); Fixed floor; Mass m(m = 1); Stop a(L = 0), b(L = 0);
        equation connect(floor.flange, a.a); connect(a.b, m.flange); connect(m.flange, b.a);
          connect(b.b, press.flange); end Caught;"""
    with pytest.raises(Contradiction) as found:
        at(text, {}, vanish=[0, 1])
    assert found.value.laws.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("load", "force"),
    [
        ("0", lambda t: 0.0 * t),
        ("sin(3*time)", lambda t: np.sin(3 * t)),
        ("-sin(3*time)", lambda t: -np.sin(3 * t)),
        ("time^3", lambda t: t**3),
    ],
)
def test_a_load_that_grows_from_zero_is_no_event_of_what_is_closed_at_the_start(load, force):
    text = f"""model Between
  Fixed wall;
  Stop s(L = 0);
  Cable c(L = 0);
  Mass m(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Force f(f = {load});
equation
  connect(wall.flange, s.a);
  connect(wall.flange, c.a);
  connect(s.b, m.flange);
  connect(c.b, m.flange);
  connect(f.flange, m.flange);
end Between;"""
    run = lmoc.compile_text(text).simulate(stop=1, points=11, rtol=1e-9)
    assert run.events == ()
    assert (run["m.q"] == 0.0).all()
    assert run["s.f"] + run["c.f"] == pytest.approx(force(run.time), abs=1e-12)
