"""Laws that hold the same motion: only the sum of their forces is determined, and the motion is."""

import numpy as np
import pytest

import lmoc

SIDE_BY_SIDE = """
model SideBySide "friction next to an end stop, and a force that turns round"
  Real u;
  Fixed wall;
  Mass m(m = 2, v(start = -1));
  Stop stop(L = 0);
  DryFriction first(F = 1);
  Force pull(f = u);
equation
  u = 10*time - 10;
  connect(wall.flange, stop.a);
  connect(stop.b, m.flange);
  connect(wall.flange, first.a);
  connect(first.b, m.flange);
  connect(pull.flange, m.flange);
end SideBySide;
"""


def test_friction_and_a_stop_hold_a_mass_until_the_pull_passes_the_friction():
    """The impact ends the motion at once; from 1.1 s on the pull of 10·t − 10 is larger than 1 N."""
    run = lmoc.compile_text(SIDE_BY_SIDE).simulate(stop=3, rtol=1e-10)
    held, moving = run.time < 1.1, run.time > 1.1
    assert run["m.q"][held] == pytest.approx(0, abs=1e-12) and run["m.v"][held] == pytest.approx(0, abs=1e-12)
    since = run.time[moving] - 1.1
    assert run["m.v"][moving] == pytest.approx(2.5 * since**2, abs=1e-7)
    for name, limit in (("first", 1),):
        assert np.abs(run[f"{name}.f"]).max() <= limit * (1 + 1e-9)
        assert np.abs(run[f"{name}.f"][moving]) == pytest.approx(limit, rel=1e-9)
    assert (-run["stop.f"]).min() > -1e-9 and np.abs(run["stop.f"] * run["stop.gap"]).max() < 1e-9
