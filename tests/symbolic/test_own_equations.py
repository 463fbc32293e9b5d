"""Scenes with equations of the user's own beside the parts: their form, their equilibria, and models about these."""

import numpy as np
import pytest
import sympy as sp
from oracles.symbolic_truth import equal

import lmoc
from lmoc.messages.diagnostics import ModelError

CRANE = """
model Crane "a trolley from the library, the bob by equations"
  parameter Real M(unit="kg") = 10; parameter Real m(unit="kg") = 2;
  parameter Real l(unit="m") = 1.5; parameter Real g(unit="m/s2") = 9.81;
  Mass trolley(m = M);
  input Real F(unit="N") = 0;
  Force drive(f = F), reaction(f = Fx);
  Real phi(start = 0.5, fixed = true, unit = "rad"), w(unit = "rad/s", start = 0, fixed = true);
  Real Fx(unit = "N") "of the bob on the trolley";
  output Real x(unit = "m") = trolley.q;
equation
  w = der(phi);
  m*(trolley.a + l*der(w)*cos(phi) - l*w^2*sin(phi)) = -Fx;
  l*der(w) + trolley.a*cos(phi) + g*sin(phi) = 0;
  connect(drive.flange, trolley.flange); connect(reaction.flange, trolley.flange);
end Crane;
"""
MOTOR = """
model Motor
  Inertia rotor(J = 1);
  Torque motor(tau = 2*i);
  input Real U(unit = "V") = 1;
  Real i(unit = "A");
equation
  3*der(i) + 4*i + 2*rotor.omega = U;
  connect(motor.shaft, rotor.shaft);
end Motor;
"""
CART_BESIDE = """
model CartBeside
  Mass cart(m = 1);
  Real phi, w;
equation
  w = der(phi);
  der(w) = -9.81*sin(phi) - 0.1*der(phi)*cart.v;
end CartBeside;
"""
BOB = """
model Bob "in Cartesian coordinates, with the tension of its rod"
  parameter Real m = 2, l = 0.7, g = 9.81;
  Real x, y, vx, vy, T;
  Real phi(stateSelect = StateSelect.prefer, start = 0.3);
equation
  x = l*sin(phi); y = -l*cos(phi);
  vx = der(x); vy = der(y);
  m*der(vx) = -T*x/l;
  m*der(vy) = -T*y/l - m*g;
end Bob;
"""
TWO_CARTS = """
model TwoCarts "coupled by a nonlinear spring only: where they are together does not matter"
  parameter Real k(unit = "N") = 3, d(unit = "m") = 0.4, L(unit = "m") = 1;
  Mass a(m = 1), b(m = 2);
  Force fa(f = F), fb(f = -F);
  Real F(unit = "N");
equation
  F = k*sinh((b.q - a.q - d)/L) + 5*sin(3*(b.q - a.q - d)/L)^3;
  connect(fa.flange, a.flange); connect(fb.flange, b.flange);
end TwoCarts;
"""


def lines(text: str, **options) -> list[str]:
    return lmoc.compile_text(text).equations(**options).lines()


def test_a_crane_reads_as_in_a_textbook():
    assert lines(CRANE) == ["(M + m)·ẍ + l·m·cos(φ)·φ̈ - l·m·sin(φ)·φ̇² = F", "l·φ̈ + cos(φ)·ẍ + g·sin(φ) = 0"]


def test_the_explicit_form_on_request():
    first, second = lines(CRANE, explicit=True)
    assert first == "ẍ = (F + g·m·cos(φ)·sin(φ) + l·m·sin(φ)·φ̇²)/(M + m·sin²(φ))"
    assert second.startswith("φ̈ = -(") and second.endswith("/(l·(M + m·sin²(φ)))")
    dae = lmoc.compile_text(CRANE)
    found, ode = dae.equations(explicit=True), dae.symbolic_ode()
    for equation, state in zip(found.equations, ("trolley.v", "w"), strict=True):
        (_, value), *_ = [(c, c * f) for c, f in equation.right]
        rate = ode[state].xreplace({sp.Symbol("w"): sp.Symbol("der(phi)")})
        assert equal(value, rate)


def test_a_motor_with_its_circuit():
    assert lines(MOTOR) == ["J·θ̈ = 2·i", "2·θ̇ + 3·i̇ + 4·i = U"]


def test_a_reaction_of_the_users_own_is_eliminated():
    """The two Newton equations leave one in the angle."""
    found = lmoc.compile_text(BOB).equations()
    (equation,) = found.equations
    phi, l, g = sp.symbols("phi l g")
    rate = sp.solve(equation.residual, sp.Symbol("der(der(phi))"))
    assert len(rate) == 1 and equal(rate[0], -g * sp.sin(phi) / l)
    assert not found.forces and len(found.lines()[0]) < 60


@pytest.mark.parametrize(("text", "place"), [(CRANE, "trolley.q"), (CART_BESIDE, "cart.q")])
def test_a_place_that_does_not_matter_is_free(text, place):
    dae = lmoc.compile_text(text)
    rests = dae.equilibria(inputs={u: 0 for u in dae.inputs})
    assert [e["phi"] for e in rests] == [0, sp.pi]
    assert all([s.name for s in e.free] == [place] for e in rests)
    hanging, upright = (dae.linearize(at=e) for e in rests)
    assert hanging.eigenvalues.real.max() <= 1e-12 < upright.eigenvalues.real.max()
    with pytest.raises(ModelError, match="not one equilibrium") as caught:
        dae.linearize()
    assert f"{place} any" in str(caught.value)


def test_a_crane_about_both_equilibria():
    """Against ẋ-free matrices by hand: ẍ = (F + m·g·φ)/M, φ̈ = −(F + (M + m)·g·φ)/(M·l) about the hanging position."""
    dae = lmoc.compile_text(CRANE)
    hanging, upright = dae.equilibria(inputs={"F": 0})
    M, m, l, g = 10.0, 2.0, 1.5, 9.81
    for rest, sign in ((hanging, 1.0), (upright, -1.0)):
        model = dae.linearize(at=rest)
        assert model.states == ["trolley.q", "trolley.v", "phi", "w"]
        expected = np.zeros((4, 4))
        expected[0, 1] = expected[2, 3] = 1.0
        expected[1, 2], expected[3, 2] = m * g / M, -sign * (M + m) * g / (M * l)
        assert model.A == pytest.approx(expected, abs=1e-12)
        assert model.B[:, 0] == pytest.approx([0, 1 / M, 0, -sign / (M * l)], abs=1e-12)
        s = sp.Symbol("s")
        tf = dae.transfer_function("F", "x", at=rest).numeric
        expected = (l * s**2 + sign * g) / (s**2 * (M * l * s**2 + sign * (M + m) * g))
        at = {s: sp.Rational(3, 7)}
        assert float(tf.expression.subs(at)) == pytest.approx(float(expected.subs(at)), rel=1e-12)


def test_a_family_that_no_equation_shows():
    """Only the difference of two places matters: they move together, and each rest of the difference is a family."""
    found = lmoc.compile_text(TWO_CARTS).equilibria()
    assert len(found) >= 1
    differences = []
    for e in found:
        (free,) = e.free
        difference = sp.simplify(e["b.q"] - e["a.q"])
        assert not difference.free_symbols, "the carts keep their distance whatever the free one is"
        differences.append(float(difference))
        x = float(difference) - 0.4
        assert abs(3 * np.sinh(x) + 5 * np.sin(3 * x) ** 3) < 1e-6
    assert min(abs(d - 0.4) for d in differences) < 1e-4


def test_an_output_that_is_nothing_by_nothing():
    """A family of rests is one place to linearize about; a ratio of speeds has no value there."""
    text = """
model Ratio
  Inertia a(J = 1), b(J = 2); TorsionDamper d(c = 3);
  output Real i = a.omega/b.omega;
equation
  connect(a.shaft, d.a); connect(d.b, b.shaft);
end Ratio;
"""
    with pytest.raises(ModelError, match=r"no linear model of 'i': at this point it has no value \(0/0"):
        lmoc.compile_text(text).linearize()
