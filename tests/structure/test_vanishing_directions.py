"""A slider in any direction: sines of its angle that vanish, exactly or but for the rounding of pi, are no divisors."""

import numpy as np
import pytest
from oracles.models import CONNECTED_SLIDER_CRANK, compiled_text

import lmoc

SLIDER_CRANK = """
model Turned "a slider crank whose ground is turned"
  import Planar.*;
  parameter Real angle(unit = "rad") = 0;
  inner World world(g = 0);
  Ground ground(theta = angle);
  Revolute main(phi(start = 0.3, fixed = true), omega(start = 5, fixed = true)), pin, gudgeon;
  Bar crank(l = 0.5, m = 1), rod(l = 1, m = 1);
  Prismatic line(s(start = 1.4));
  Body slider(m = 1, J = 1);
equation
""" + CONNECTED_SLIDER_CRANK + """
end Turned;
"""
TURNS = [0.4, np.pi, 100 * np.pi]


@pytest.mark.parametrize("angle", TURNS)
def test_a_turned_mechanism_moves_as_the_other(angle):
    straight = compiled_text(SLIDER_CRANK).simulate(stop=1, points=5, rtol=1e-9)
    turned = lmoc.compile_text(SLIDER_CRANK, parameters={"angle": float(angle)}).simulate(stop=1, points=5, rtol=1e-9)
    for name in ("main.phi", "line.s", "pin.phi"):
        assert np.allclose(turned[name], straight[name], rtol=0, atol=1e-7), name
    assert turned.energy.balance < 1e-6


def test_a_direction_given_to_a_run_is_looked_at_anew():
    """Compiled for a slanted slider, run with a level one: what was divided by is zero now."""
    dae = lmoc.compile_text(SLIDER_CRANK, parameters={"angle": 0.4})
    slanted, level = (dae.simulate(stop=1, points=5, rtol=1e-9, parameters={"angle": a}) for a in (0.4, np.pi))
    assert np.allclose(slanted["main.phi"], level["main.phi"], rtol=0, atol=1e-7)
