"""Constraints that follow from others only where all of them hold."""

import numpy as np
import pytest
from conftest import ROOT
from scipy.integrate import solve_ivp

import lmoc
from lmoc.messages.diagnostics import ModelError, SimulationError

RODS = """\
model Rods
  import Planar.*;
  parameter Real L = 0.5;
  parameter Real L2 = L;
  inner World world;
  Anchor anchor;
  PointMass mass(m = 1, x(start = 0, fixed = true), y(start = -0.5), vx(start = 1.5, fixed = true));
  Rod rod1(L = L), rod2(L = L2);
  Real total = rod1.f + rod2.f;
equation
  connect(anchor.point, rod1.a);
  connect(anchor.point, rod2.a);
  connect(rod1.b, mass.point);
  connect(rod2.b, mass.point);
end Rods;
"""


def pendulum(length: float, angle: float, rate: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle against the horizontal and its rate, of a point that hangs on a rod."""
    found = solve_ivp(
        lambda _, y: (y[1], -9.81 * np.cos(y[0]) / length), (0, times[-1]), (angle, rate), "DOP853", times, rtol=1e-12,
        atol=1e-13,
    )  # fmt: skip
    return found.y


def codes(run) -> list[str]:
    return [d.code for d in run.notes]


def test_the_same_rod_twice():
    run = lmoc.compile_text(RODS).simulate(stop=1, points=11, rtol=1e-9)
    angle, rate = pendulum(0.5, -np.pi / 2, 3.0, run.time)
    assert run["mass.x"] == pytest.approx(0.5 * np.cos(angle), abs=1e-7)
    assert run["mass.y"] == pytest.approx(0.5 * np.sin(angle), abs=1e-7)
    assert np.isnan(run["rod1.f"]).all() and np.isnan(run["rod2.f"]).all()
    assert run["total"] == pytest.approx(0.5 * rate**2 - 9.81 * np.sin(angle), rel=1e-6)
    assert codes(run).count("N0415") == 1


def test_a_platform_on_three_parallel_cranks():
    run = lmoc.compile(ROOT / "models/planar/three_cranks.lmo").simulate(stop=1, points=11, rtol=1e-9)
    angle, _ = pendulum(0.4, -1.2, 0.0, run.time)
    for crank in ("foot1.phi", "foot2.phi", "foot3.phi"):
        assert run[crank] == pytest.approx(angle, abs=1e-7)
    assert run["platform.theta"] == pytest.approx(np.zeros(11), abs=1e-10)
    assert len(run.coordinates[0][1]) == 2 and codes(run).count("N0415") == 1
    assert np.isnan(run["crank2.a.fx"]).all()


def test_another_length_is_no_repetition():
    dae = lmoc.compile_text(RODS)
    with pytest.raises((ModelError, SimulationError)):
        dae.simulate(stop=0.1, parameters={"L2": 0.7})
    assert dae.simulate(stop=0.1, parameters={"L": 0.7}, initial={"mass.y": -0.7})["mass.y"][0] == pytest.approx(-0.7)


PARALLELOGRAM = """\
model Parallelogram
  Real a(start = {start}, fixed = true), b(start = {start}), c(start = 0), w(start = 0, fixed = true);
equation
  w = der(a);
  der(w) = -9.81*cos(a);
  cos(a) + 2*cos(c) = 2 + cos(b);
  sin(a) + 2*sin(c) = sin(b);
end Parallelogram;
"""


@pytest.mark.parametrize("start", [0.0, 0.7])
def test_a_stretched_parallelogram_has_no_constraint_too_many(start):
    """At a = 0 the Jacobian loses its rank, beside it it has it."""
    dae = lmoc.compile_text(PARALLELOGRAM.format(start=start))
    assert "N0415" not in [d.code for d in dae.notes] and len(dae.reduced.undetermined) == 0


def test_a_constraint_without_rank_that_says_something_stays():
    text = """\
model Square
  Real x(start = 1, fixed = true), y(start = 1), z(start = 1), v(start = 0, fixed = true);
equation
  v = der(x);
  der(v) = -x;
  (x - y)^2 + (sin(x) - sin(y))^2 = 0;
  z^3 = y;
end Square;
"""
    dae = lmoc.compile_text(text)
    assert "N0415" not in [d.code for d in dae.notes]
    run = dae.simulate(stop=1, points=5)
    assert run["x"] == pytest.approx(np.cos(run.time), abs=1e-5)
    assert run["y"] == pytest.approx(run["x"], abs=1e-4)


def test_dropped_constraints_are_watched():
    dae = lmoc.compile_text(RODS)
    assert any("no longer follows" in check.message for check in dae.reduced.flat.checks)
