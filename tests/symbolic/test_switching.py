"""Derivations of scenes with Integer and Boolean variables that switch: branches are followed, or it is refused."""

import pytest
import sympy

import lmoc
from lmoc.messages.diagnostics import ModelError

CONTACT = """model Contact parameter Real m = 1;
  Real s(start = 0.5, fixed = true); Real v(start = 0, fixed = true); Boolean contact = s < 0;
  equation der(s) = v; m*der(v) = -9.81 + (if contact then -1000*s else 0); end Contact;"""
GAIN = """model Gain Real x(start = 0, fixed = true); Integer n; input Real u = 1; output Real y = x;
  equation n = if x > 2 then 5 else 1; der(x) = n*u - x; end Gain;"""
THERMOSTAT = """model Thermostat Real T(start = 20, fixed = true); Boolean on(start = true, fixed = true);
  equation on = if pre(on) then T < 22 else T < 18; der(T) = (if on then 10 else 0) - 0.5*(T - 10); end Thermostat;"""
SIGN = """model Sign Real x(start = 1, fixed = true); Real v(start = 0, fixed = true); input Real u = 0;
  output Real y = x; equation der(x) = v; der(v) = u - x - sign(v); end Sign;"""


def code(call, *arguments, **more) -> str:
    with pytest.raises(ModelError) as raised:
        call(*arguments, **more)
    return raised.value.diagnostics[0].code


def test_a_boolean_that_follows_from_the_position_stands_in_the_equations() -> None:
    model = lmoc.compile_text(CONTACT)
    assert "s < 0" in str(model.equations()) and "s < 0" in str(model.equations(explicit=True))
    ode, s = model.symbolic_ode(), sympy.Symbol("s")
    assert ode["v"].subs({s: -1}) - ode["v"].subs({s: 1}) == 1000 / sympy.Symbol("m")
    (rest,) = model.equilibria()
    assert float(rest["s"]) == pytest.approx(-0.00981)
    assert model.linearize().A[1, 0] == pytest.approx(-1000)
    assert model.linearize(at={"s": 1, "v": 0}).A[1, 0] == 0


def test_an_integer_of_an_array_of_parts_stands_in_the_equations() -> None:
    model = lmoc.compile_text("""model Part input Real u; Real x(start = 0, fixed = true); Integer n;
      parameter Real limit = 2; equation n = if x > limit then 5 else 1; der(x) = n*u - x; end Part;
      model A input Real u = 1; Part p[2](limit = {2, 3}); equation for i in 1:2 loop p[i].u = u; end for; end A;""")
    ode = model.symbolic_ode()
    x, u = sympy.Symbol("p[2].x"), sympy.Symbol("u")
    p = {sympy.Symbol("p[1].limit"): 2, sympy.Symbol("p[2].limit"): 3}
    assert sympy.simplify(ode["p[2].x"].subs(p).subs({x: 2.5}) - (u - 2.5)) == 0
    assert sympy.simplify(ode["p[2].x"].subs(p).subs({x: 4}) - (5 * u - 4)) == 0


def test_an_integer_that_multiplies_an_input() -> None:
    model = lmoc.compile_text(GAIN)
    assert sorted(float(e["x"]) for e in model.equilibria({"u": 1})) == pytest.approx([1, 5])
    assert [float(e["x"]) for e in model.equilibria({"u": 0.3})] == pytest.approx([0.3])
    s = sympy.Symbol("s")
    assert sympy.simplify(model.transfer_function("u", "y", at={"x": 0, "u": 0}) - 1 / (s + 1)) == 0
    assert sympy.simplify(model.transfer_function("u", "y", at={"x": 3, "u": 0}) - 5 / (s + 1)) == 0
    assert model.linearize(at={"x": 3}).B[0, 0] == 5


def test_what_depends_on_the_past_has_no_rest() -> None:
    model = lmoc.compile_text(THERMOSTAT)
    for call in (model.equilibria, model.linearize):
        assert code(call) == "E0660"
    with pytest.raises(ModelError):
        model.simulate(stop=1, initial="equilibrium")
    assert "on = 1" in str(model.equations())  # and says so
    assert model.linearize(at=0.5).A[0, 0] == pytest.approx(-0.5)


def test_a_sign_is_in_the_explicit_equations_and_has_no_linear_model_where_it_jumps() -> None:
    model = lmoc.compile_text(SIGN)
    v = sympy.Symbol("v")
    assert model.symbolic_ode()["v"].has(sympy.sign(v)) and "sign" in str(model.equations(explicit=True))
    assert code(model.linearize) == "E0663" == code(model.transfer_function, "u", "y")
    assert model.linearize(at={"x": 0, "v": 1}).A.tolist() == [[0, 1], [-1, 0]]


def test_a_jump_that_is_added_stays_in_the_right_hand_side() -> None:
    ode = lmoc.compile_text("""model A Real x(start = 0, fixed = true); equation
      der(x) = -x + floor(3*x) + (if x > 1 then 7 else 0); end A;""").symbolic_ode()
    x = sympy.Symbol("x")
    assert ode["x"].subs({x: 2}) == -2 + 6 + 7 and ode["x"].subs({x: 0.5}) == 0.5
