"""States of rest of constraints written as equations, also where the coordinate of the scene turns back."""

import numpy as np
import pytest
import sympy as sp
from conftest import ROOT
from oracles.models import compiled

import lmoc

G = 9.81

TWO = """
model Two "particles at (0, -L) and (0, -L - l) when they hang"
  parameter Real m1 = 1, m2 = 1, L = 1, l = 1, g = 9.81;
  Real x1(start = 0.6, fixed = true), y1(start = -0.8), x2(start = 0.8, fixed = true), y2(start = -1.7);
  Real vx1(start = 0, fixed = true), vy1, vx2(start = 0, fixed = true), vy2, T, S;
equation
  der(x1) = vx1; der(y1) = vy1; der(x2) = vx2; der(y2) = vy2;
  m1*der(vx1) = -T*x1 + S*(x2 - x1);
  m1*der(vy1) = -T*y1 + S*(y2 - y1) - m1*g;
  m2*der(vx2) = -S*(x2 - x1);
  m2*der(vy2) = -S*(y2 - y1) - m2*g;
  x1^2 + y1^2 = L^2;
  (x2 - x1)^2 + (y2 - y1)^2 = l^2;
end Two;
"""

DUMBBELL = """
model Dumbbell "two particles on a rod, one of them on a level rail"
  parameter Real m = 1, L = 0.5, g = 9.81;
  Real x1(start = 0, fixed = true), x2(start = 0.3, fixed = true), y2(start = -0.4);
  Real vx1(start = 0, fixed = true), vx2(start = 0, fixed = true), vy2, S;
equation
  der(x1) = vx1; der(x2) = vx2; der(y2) = vy2;
  m*der(vx1) = S*(x2 - x1);
  m*der(vx2) = -S*(x2 - x1);
  m*der(vy2) = -S*y2 - m*g;
  (x2 - x1)^2 + y2^2 = L^2;
end Dumbbell;
"""

BEAD = """
model Bead "on a small circle in a slanted field"
  parameter Real m = 0.2, L = 0.003, gx = 0, gy = -9.81;
  Real x(start = L, fixed = true), y(start = 0), vx, vy(start = 1e-4, fixed = true), N;
equation
  der(x) = vx; der(y) = vy;
  m*der(vx) = N*x + m*gx;
  m*der(vy) = N*y + m*gy;
  x^2 + y^2 = L^2;
end Bead;
"""

PARALLELOGRAM = """
model Parallelogram "rods from (0, 0) and (a, 0) to a rod with a particle at each end"
  parameter Real m = 1, L = 0.4, a = 1, g = 9.81;
  Real x1(start = 0.24, fixed = true), y1(start = -0.32), x2(start = 1.24), y2(start = -0.32);
  Real vx1(start = 0, fixed = true), vy1, vx2, vy2, T, U, S;
equation
  der(x1) = vx1; der(y1) = vy1; der(x2) = vx2; der(y2) = vy2;
  m*der(vx1) = -T*x1 + S*(x2 - x1);
  m*der(vy1) = -T*y1 + S*(y2 - y1) - m*g;
  m*der(vx2) = -U*(x2 - a) - S*(x2 - x1);
  m*der(vy2) = -U*y2 - S*(y2 - y1) - m*g;
  x1^2 + y1^2 = L^2;
  (x2 - a)^2 + y2^2 = L^2;
  (x2 - x1)^2 + (y2 - y1)^2 = a^2;
end Parallelogram;
"""


def place(e, *names: str) -> list[float]:
    return [float(e[name]) for name in names]


def squares(e) -> np.ndarray:
    """Squares of the eigenvalues, each once: −ω² of a motion that swings."""
    found = np.sort(np.real(np.asarray(e.model.eigenvalues, complex) ** 2))
    return found[::2]


@pytest.mark.parametrize("name", ["hard/h01_cartesian_pendulum", "planar/pendulum_cartesian"])
def test_a_cartesian_pendulum_hangs_and_stands(name):
    """In x, and in y, which turns back at both."""
    dae = lmoc.compile(ROOT / f"models/{name}.lmo", parameters={"L": 0.7})
    low, high = sorted(dae.equilibria(), key=lambda e: float(e["y"]))
    assert place(low, "x", "y") == pytest.approx([0, -0.7], abs=1e-9)
    assert place(high, "x", "y") == pytest.approx([0, 0.7], abs=1e-9)
    assert squares(low) == pytest.approx([-G / 0.7]) and squares(high) == pytest.approx([G / 0.7])
    assert high.stability == "unstable" and low.stability != "unstable"
    for e in (low, high):
        assert dae.linearize(at=e).eigenvalues == pytest.approx(e.model.eigenvalues)
        if e is high or name.startswith("hard"):  # a body of the planar scene takes long to find its place again
            assert np.ptp(dae.simulate(initial=e, stop=0.1, points=5)["y"]) < 1e-9
    with pytest.raises(lmoc.ModelError, match="not one equilibrium to linearize about but 2"):
        dae.linearize()


def test_two_cartesian_pendulums_in_a_row():
    """Equal masses and lengths: ω² = (2 ± √2)·g/L hanging; the signs of the two heights give four states."""
    found = lmoc.compile_text(TWO).equilibria()
    heights = sorted(tuple(np.round(place(e, "y1", "y2"), 9)) for e in found)
    assert heights == [(-1, -2), (-1, 0), (1, 0), (1, 2)]
    for e in found:
        assert place(e, "x1", "x2") == pytest.approx([0, 0], abs=1e-9)
        assert "there may be others" in e.how
        if place(e, "y2") == pytest.approx([-2]):
            assert squares(e) == pytest.approx([-(2 + np.sqrt(2)) * G, -(2 - np.sqrt(2)) * G])
        else:
            assert e.stability == "unstable"


def test_a_dumbbell_on_a_rail_hangs_and_stands_anywhere():
    low, high = sorted(lmoc.compile_text(DUMBBELL).equilibria(), key=lambda e: float(e["y2"]))
    for e, height, stability in ((low, -0.5, "marginal"), (high, 0.5, "unstable")):
        assert len(e.free) == 1 and sp.simplify(e["x1"] - e["x2"]) == 0
        assert float(e["y2"]) == pytest.approx(height) and e.stability == stability
    assert np.abs(low.model.eigenvalues.imag).max() == pytest.approx(np.sqrt(2 * G / 0.5))


@pytest.mark.parametrize(("gx", "gy"), [(0.0, -9.81), (3.0, -4.0), (-5.0, 0.0)])
def test_a_bead_on_a_small_circle_rests_along_the_field(gx, gy):
    """Also where it starts at rest."""
    found = lmoc.compile_text(BEAD, parameters={"gx": gx, "gy": gy}).equilibria()
    strength, along = np.hypot(gx, gy), np.array([gx, gy]) / np.hypot(gx, gy)
    assert len(found) == 2 and all("closed curve" in e.how for e in found)
    for e in found:
        side = np.sign(np.dot(place(e, "x", "y"), along))
        assert place(e, "x", "y") == pytest.approx(0.003 * side * along, abs=1e-11)
        assert squares(e) == pytest.approx([-side * strength / 0.003])


def test_a_parallelogram_of_rods_hangs_and_stands():
    """The walk goes straight on where the crossed one branches off, and says so."""
    low, high = sorted(lmoc.compile_text(PARALLELOGRAM).equilibria(), key=lambda e: float(e["y1"]))
    assert place(low, "x1", "y1", "x2", "y2") == pytest.approx([0, -0.4, 1, -0.4], abs=1e-9)
    assert place(high, "x1", "y1", "x2", "y2") == pytest.approx([0, 0.4, 1, 0.4], abs=1e-9)
    assert squares(low) == pytest.approx([-G / 0.4]) and squares(high) == pytest.approx([G / 0.4])
    assert "other branches cross" in low.how and "other branches are not searched" in low.how


def test_a_platform_on_three_cranks_hangs_and_stands():
    """With a redundant closure: states that it forbids are none."""
    found = compiled("planar/three_cranks").equilibria()
    assert [e["foot1.phi"] for e in found] == [-sp.pi / 2, sp.pi / 2]
    assert [squares(e)[0] for e in found] == pytest.approx([-G / 0.4, G / 0.4])
