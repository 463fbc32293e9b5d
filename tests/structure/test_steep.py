"""Of two positions in a ratio far from 1 the larger one is the coordinate; forces are compared with forces alone."""

from pathlib import Path

import numpy as np
import pytest

import lmoc

SPRUNG = """
model Sprung Fixed wall; Spring spring(k = 1e3); Mass body(m = 1, q(start = 1e-3, fixed = true));
equation connect(wall.flange, spring.a); connect(spring.b, body.flange); end Sprung;
"""
LINE = """
model Line parameter Real nx = cos(1.5707963267948966); parameter Real ny = 1; Real x, y, s;
equation x = nx*s; y = ny*s; der(der(y)) = -4*y; initial equation y = 1; der(y) = 0; end Line;
"""


@pytest.mark.parametrize("k", [1e-12, 1.0, 1e9, 1e15])
def test_a_stiff_spring_is_no_reason_for_its_force_to_be_a_coordinate(k):
    scene = lmoc.compile_text(SPRUNG)
    omega = np.sqrt(k)
    run = scene.simulate(stop=3 / omega, rtol=1e-9, parameters={"spring.k": k})
    assert scene.states == run.states == ["body.q", "body.v"]
    assert [str(note) for note in run.notes if note.code.startswith("N06")] == []
    np.testing.assert_allclose(run["body.q"], 1e-3 * np.cos(omega * run.time), atol=1e-10)


def test_a_line_that_is_vertical_up_to_rounding():
    run = lmoc.compile_text(LINE).simulate(stop=3, rtol=1e-9)
    np.testing.assert_allclose(run["y"], np.cos(2 * run.time), atol=1e-7)
    np.testing.assert_allclose(run["x"], 6.123234e-17 * run["y"], rtol=1e-6)


def test_ratios_of_a_scene_with_laws_are_judged_for_other_parameters():
    """The guards of the free scene know more variables than the form with switches, which the values are given for."""
    dae = lmoc.compile(Path(__file__).parents[2] / "models" / "laws" / "h34_slack_string.lmo")
    run = dae.simulate(parameters={"spring.k": 10.0}, times=[0.0, 0.2], rtol=1e-9)
    free = lmoc.compile_text(
        """model Free Fixed wall; Mass mass(m = 2, q(start = 0.1, fixed = true)); SpringDamper mount(k = 50, c = 3);
        equation connect(wall.flange, mount.a); connect(mount.b, mass.flange); end Free;"""
    )
    other = free.simulate(times=[0.0, 0.2], rtol=1e-9)
    assert run.modes == [(0.0, {"pulley": "slack"})] and run["q"] == pytest.approx(other["mass.q"], abs=1e-8)


FLOOR = """
model Floor import Planar.*; inner World world;
  Contact floor(nx = cos(1.5707963267948966), ny = 1, d = -9); PointOf corner(rx = -0.4, ry = 0.27);
  Bar bar(l = 0.9, m = 0.7, x(start = 0.5), y(start = -0.9), theta(start = 1.4));
equation connect(bar.a, corner.frame); connect(corner.point, floor.point); end Floor;
"""


def test_a_floor_that_is_level_up_to_rounding():
    """The horizontal force of the floor is the vertical one, times 6e-17: that is not the other one by a quotient."""
    run = lmoc.compile_text(FLOOR).simulate(stop=1, points=11, rtol=1e-9)
    np.testing.assert_allclose(run["bar.y"], -0.9 - 9.81 * run.time**2 / 2, atol=1e-9)
    np.testing.assert_allclose(run["bar.theta"], 1.4, atol=1e-9)
