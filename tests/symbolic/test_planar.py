"""Planar mechanisms of textbook size: equations in joint angles, states of rest, linear models about them."""

import numpy as np
import pytest
import sympy as sp
from conftest import ROOT
from oracles.models import compiled

import lmoc

PLANAR = ROOT / "models/planar"
phi1, phi2 = sp.symbols("shoulder.phi elbow.phi")


def rates(dae, names: list[str], values: np.ndarray) -> np.ndarray:
    """Derivatives of the states at a point, from the numeric system."""
    point = dict(zip(names, values.tolist(), strict=True))
    return np.array(dae.linearize(at=point).drift, float)


def test_a_pendulum():
    text = """
model P
  import Planar.*;
  inner World world; Ground ground; Revolute pin; Bar bar(l = 0.8, m = 3);
equation
  connect(ground.frame, pin.a); connect(pin.b, bar.a);
end P;
"""
    dae = lmoc.compile_text(text)
    assert dae.equations().lines() == ["l·φ̈/3 + 4.905·cos(φ) = 0"]
    down, up = dae.equilibria()
    assert (down["pin.phi"], up["pin.phi"]) == (-sp.pi / 2, sp.pi / 2)
    assert dae.linearize(at=down).frequencies == pytest.approx([np.sqrt(1.5 * 9.81 / 0.8)] * 2)
    assert dae.linearize(at=up).eigenvalues == pytest.approx([-np.sqrt(1.5 * 9.81 / 0.8), np.sqrt(1.5 * 9.81 / 0.8)])


def lagrange(energy, potential, coordinates):
    """Lagrange's equations, as expressions that vanish."""
    rates = [sp.Symbol(f"der({q})") for q in coordinates]
    accelerations = [sp.Symbol(f"der(der({q}))") for q in coordinates]

    def total(e):
        return sum(e.diff(q) * v for q, v in zip(coordinates, rates, strict=True)) + sum(
            e.diff(v) * a for v, a in zip(rates, accelerations, strict=True)
        )

    L = energy - potential
    return [total(L.diff(v)) - L.diff(q) for q, v in zip(coordinates, rates, strict=True)]


def test_a_double_pendulum_against_lagrange():
    """The mass matrix and all forces at random points, from the energies written down by hand."""
    dae = compiled(PLANAR / "double_pendulum.lmo")
    found = dae.equations()
    assert [q for q in found.coordinates] == ["shoulder.phi", "elbow.phi"] and found.closures == ()
    assert all(len(line) < 450 for line in found.lines())
    l1, l2, m1, m2 = (sp.Symbol(name) for name in ("upper.l", "lower.l", "upper.m", "lower.m"))
    w1, w2 = sp.Symbol("der(shoulder.phi)"), sp.Symbol("der(elbow.phi)")
    a, w = phi1 + phi2, w1 + w2
    kinetic = m1 * l1**2 * w1**2 / 6 + m2 * l2**2 * w**2 / 24
    kinetic += m2 * (l1**2 * w1**2 + l2**2 * w**2 / 4 + l1 * l2 * w1 * w * sp.cos(phi2)) / 2
    g = sp.Rational(981, 100)
    potential = m1 * g * l1 * sp.sin(phi1) / 2 + m2 * g * (l1 * sp.sin(phi1) + l2 * sp.sin(a) / 2)
    expected = lagrange(kinetic, potential, (phi1, phi2))
    symbols = sorted(set().union(*(e.free_symbols for e in expected)), key=str)
    generator = np.random.default_rng(4)
    highest = [sp.Symbol(f"der(der({q}))") for q in (phi1, phi2)]
    for _ in range(2):
        point = {s: sp.Float(v, 17) for s, v in zip(symbols, generator.uniform(0.3, 1.2, len(symbols)), strict=True)}
        rest = {s: v for s, v in point.items() if s not in highest}
        ours = sp.solve([e.residual.subs(rest) for e in found.equations], highest)
        theirs = sp.solve([e.subs(rest) for e in expected], highest)
        for x in highest:
            assert float(ours[x]) == pytest.approx(float(theirs[x]), rel=1e-9)
    assert len(dae.equilibria()) == 4


def test_a_cart_and_pole():
    dae = compiled(PLANAR / "cart_pole.lmo")
    assert dae.equations().lines()[0] == "(M + m)·ẍ - l·m·sin(φ)·φ̈/2 - l·m·cos(φ)·φ̇²/2 = F"
    rests = dae.equilibria(inputs={"F": 0})
    assert [e["pin.phi"] for e in rests] == [-sp.pi / 2, sp.pi / 2]
    assert all([s.name for s in e.free] == ["rail.s"] for e in rests)


@pytest.mark.parametrize(
    ("name", "parameters", "count"), [("slider_crank", {}, 4), ("four_bar", {"torque": 0}, 2), ("four_bar", {}, 0)]
)
def test_rest_of_a_loop_is_rest(name, parameters, count):
    """Every state of rest that is found stays at rest, on the branch of the start."""
    dae = lmoc.compile(PLANAR / f"{name}.lmo", parameters=parameters)
    rests = dae.equilibria(inputs={u: 0 for u in dae.inputs})
    assert len(rests) == count
    for e in rests:
        model = dae.linearize(at=e)
        assert model.at_rest and np.abs(model.drift).max() < 1e-7
        unstable = model.eigenvalues.real.max() > 0
        run = dae.simulate(initial=e, inputs={u: 0 for u in dae.inputs}, stop=0.2 if unstable else 3)
        angle = run[dae.states[0]]
        assert np.ptp(angle) < 1e-4 and angle[0] == pytest.approx(float(e[dae.states[0]]))
    assert rests == [] or {e.stability for e in rests} >= {"unstable"}


def test_the_potential_of_a_four_bar_is_stationary_at_rest():
    """Independently: heights of the centres of mass by intersecting circles, their weighted sum stationary."""
    dae = lmoc.compile(PLANAR / "four_bar.lmo", parameters={"torque": 0})
    start = dae.simulate(stop=0.001)

    def potential(theta: float) -> float:
        ax, ay = 0.3 * np.cos(theta), 0.3 * np.sin(theta)
        dx, dy = 1 - ax, -ay
        d = np.hypot(dx, dy)
        along = (0.9**2 - 0.8**2 + d**2) / (2 * d)
        across = np.sqrt(0.9**2 - along**2)
        side = 1.0 if start["coupler.theta"][0] > np.arctan2(dy, dx) else -1.0
        by = ay + along * dy / d + side * across * dx / d
        return 1 * ay / 2 + 2 * (ay + by) / 2 + 1.5 * by / 2

    for e in dae.equilibria():
        theta = float(e["motor.phi"])
        slope = (potential(theta + 1e-5) - potential(theta - 1e-5)) / 2e-5
        assert abs(slope) < 1e-8
        bend = potential(theta + 1e-3) + potential(theta - 1e-3) - 2 * potential(theta)
        assert (bend < 0) == (e.stability == "unstable")


def test_a_platform_on_parallel_cranks_rests_where_all_closures_hold():
    """One closure follows from the others on this branch only: places of rest on other branches are none."""
    dae = compiled(PLANAR / "three_cranks.lmo")
    rests = dae.equilibria()
    assert sp.Integer(-1) * sp.pi / 2 in [e["foot1.phi"] for e in rests]
    for e in rests:
        assert abs(np.cos(float(e["foot1.phi"]))) < 1e-9  # upright or hanging: the platform only translates
        run = dae.simulate(initial=e, stop=0.05)
        assert np.ptp(run["platform.y"]) < 1e-9
        assert e.model.frequencies == pytest.approx([np.sqrt(9.81 / 0.4)] * 2)


def test_a_rolling_wheel_moves_with_its_axle():
    """Lagrange's equations in x and φ with θ̇ = −ẋ/r inserted in the energy: the same mass matrix, symmetric."""
    found = compiled(PLANAR / "wheel_with_pendulum.lmo").equations()
    assert found.coordinates == ("wheel.x", "axle.phi", "wheel.theta") and found.lines()[2] == "ẋ + r·θ̇ = 0"
    assert all(len(line) < 200 for line in found.lines())
    names = "wheel.x axle.phi wheel.theta wheel.m wheel.J bar.m bar.l contact.r"
    x, phi, theta, m, J, mb, length, r = sp.symbols(names)
    v, w = sp.symbols("der(wheel.x) der(axle.phi)")
    angle, rate = phi + theta, w - v / r
    vx, vy = v - length / 2 * sp.sin(angle) * rate, length / 2 * sp.cos(angle) * rate
    kinetic = (m * v**2 + J * v**2 / r**2 + mb * (vx**2 + vy**2) + mb * length**2 / 12 * rate**2) / 2
    highest = sp.symbols("der(der(wheel.x)) der(der(axle.phi))")
    numbers = dict(zip((x, phi, theta, m, J, mb, length, r, v, w), np.linspace(0.3, 1.2, 10).tolist(), strict=True))
    for k, scale in enumerate((r**2, r)):  # what the listing has multiplied with to clear the denominators
        ours = [float(found.equations[k].residual.diff(a).subs(numbers)) for a in highest]
        theirs = [float((scale * kinetic.diff((v, w)[k], b)).subs(numbers)) for b in (v, w)]
        assert ours == pytest.approx(theirs, rel=1e-12)


def test_a_scissor_lift_has_one_state_of_rest_on_its_branch():
    """Beyond the position with both bars upright the search would go on another branch."""
    (rest,) = compiled(PLANAR / "scissor_lift.lmo").equilibria()
    assert float(rest["hinge.phi"]) == pytest.approx(0.48322821, abs=1e-7)
    assert rest.stability == "unstable"  # the constant force of the cylinder gains on the load as it rises


def test_a_mechanism_that_nothing_moves_rests_anywhere():
    (rest,) = compiled("hard/h04_slider_crank").equilibria()
    assert [x.name for x in rest.free] == ["main.phi"]
