"""Assertions say since when they do not hold, whatever output times were asked for."""

from math import acos, asin

import pytest

import lmoc

SWING = """model Swing
  Mass m(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Spring s(k = 4);
  Fixed wall;
  Force f(f = 1);
equation
  connect(wall.flange, s.a);
  connect(s.b, m.flange);
  connect(f.flange, m.flange);
  assert(m.v < 0.3, "too fast", AssertionLevel.warning);
  assert(m.q < 0.45, "too far");
end Swing;"""

PULLED = """model Pulled "a force that pushes one end of a string into its pulley"
  Fixed wall;
  Pulley p(sense = 1);
  Mass a(m = 1, g = 9.81), b(m = 2, g = 9.81);
  Force f(f = -40*time);
equation
  connect(p.a, a.flange);
  connect(p.b, b.flange);
  connect(p.axle, wall.flange);
  connect(f.flange, b.flange);
end Pulled;"""


def told(run: lmoc.Run) -> float:
    (note,) = [n for n in run.notes if n.code == "W0551"]
    return float(note.message.split("from t = ")[1].split()[0])


@pytest.mark.parametrize("points", [3, 14, 501])
@pytest.mark.parametrize("keep", [None, ["m.q"]])
def test_a_warning_has_the_time_at_which_it_begins(points, keep):
    run = lmoc.compile_text(SWING).simulate(stop=0.8, points=points, rtol=1e-10, keep=keep)
    assert told(run) == pytest.approx(asin(0.6) / 2, abs=1e-8)


def test_an_error_has_the_time_at_which_it_begins():
    with pytest.raises(lmoc.SimulationError, match="too far") as failed:
        lmoc.compile_text(SWING).simulate(stop=5, points=11, rtol=1e-10)
    assert failed.value.time == pytest.approx(acos(1 - 0.45 * 4) / 2, abs=1e-9)


def test_a_string_that_would_have_to_push():
    """T = m_a·m_b·(2·g - F/m_b)/(m_a + m_b) of an Atwood machine that F pushes up on b."""
    run = lmoc.compile_text(PULLED).simulate(stop=2, points=5, rtol=1e-10)
    assert told(run) == pytest.approx(4 * 9.81 / 40, abs=1e-9)
