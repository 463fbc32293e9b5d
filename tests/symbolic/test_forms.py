"""Linear models, transfer functions, equilibria and printed equations, from the reference equations of the notes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp
from oracles.symbolic_truth import TRUTH, by_hand, equal, matrix, names_of, proportional, read

import lmoc
from lmoc.cli.main import main
from lmoc.messages.diagnostics import ModelError
from lmoc.symbolic.equilibria import equilibria
from lmoc.symbolic.linearize import LinearModel, linearize
from lmoc.symbolic.motion import explicit
from lmoc.symbolic.system import SymbolicSystem, jet_symbol
from lmoc.symbolic.transfer import characteristic_polynomial, transfer_function

LINEAR = [name for name, truth in TRUTH.items() if "linear" in truth]
every_linear = pytest.mark.parametrize("name", LINEAR)
x, v, m, k, c, u, s = sp.symbols("x v m k c u s")


def oscillator(**values) -> SymbolicSystem:
    """m x'' + c x' + k x = u."""
    return SymbolicSystem(
        "oscillator",
        (x, v),
        (v, (u - c * v - k * x) / m),
        (u,),
        outputs={"x": x, "v": v},
        values={p: values.get(p.name, np.nan) for p in (m, k, c)},
    )


@cache
def in_symbols(name: str) -> LinearModel:
    return linearize(by_hand(name), symbolic=True)


@every_linear
def test_matrices(name):
    model, linear = in_symbols(name), TRUTH[name]["linear"]
    for found, key in ((model.A, "A"), (model.B, "B"), (model.C, "C"), (model.D, "D")):
        assert equal(found, matrix(name, linear[key])), key


@every_linear
def test_characteristic_polynomial_and_transfer_functions(name):
    truth, model = TRUTH[name], in_symbols(name)
    assert proportional(characteristic_polynomial(model), read(name, truth["characteristic"]))
    for key, text in truth["transfer"].items():
        y, _, u = key.partition("/")
        assert equal(transfer_function(model, u, y).expression, read(name, text))


@every_linear
def test_input_output_equations(name):
    model = in_symbols(name)
    for key, text in TRUTH[name]["input_output"].items():
        y, _, u = key.partition("/")
        left, right = (side.rsplit(") ", 1)[0] + ")" for side in text.split(" = "))
        found = transfer_function(model, u, y).input_output_equation
        assert equal(found.left * read(name, right), found.right * read(name, left))


def test_input_output_equation_reads_as_in_the_notes():
    found = transfer_function(linearize(by_hand("Ex7"), symbolic=True), "tau2", "y").input_output_equation
    assert str(found) == "(J²·p⁴ + 3·J·k·p² + k²) y = -(J·p² + k) τ2"


@every_linear
def test_equilibria(name):
    expected, found = TRUTH[name]["equilibrium"], equilibria(by_hand(name))
    assert len(found) == 1
    if isinstance(expected, str) or len(expected[0]) < len(TRUTH[name]["states"]):
        assert found[0].free and found[0].conditions
    else:
        assert found[0].isolated and not found[0].conditions
        assert all(equal(found[0][state], read(name, text)) for state, text in expected[0].items())


def test_input_derivative_is_removed_by_a_change_of_state():
    model = linearize(by_hand("Ex5"), symbolic=True)
    plain = model.realization()
    assert model.Bd is not None and plain.Bd is None
    for y in ("q1", "tire_force"):
        assert equal(transfer_function(plain, "u", y).expression, transfer_function(model, "u", y).expression)


def test_improper_output_has_no_proper_form():
    with pytest.raises(ModelError, match="derivative of an input"):
        linearize(by_hand("Ex5")).matrices()


def test_modes_of_a_damped_oscillator():
    model = linearize(oscillator(m=2.0, k=50.0, c=3.0))
    assert np.allclose(model.frequencies, 5.0)
    assert np.allclose(model.dampings, 3 / (2 * np.sqrt(100)))
    assert np.allclose(model.A @ model.modes, model.modes * model.eigenvalues)
    assert model.stability == "asymptotically stable"


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"m": 1, "k": 4, "c": 0}, "stable"),
        ({"m": 1, "k": 0, "c": 1}, "neutral"),
        ({"m": 1, "k": 0, "c": 0}, "marginal"),
        ({"m": 1, "k": -4, "c": 1}, "unstable"),
        ({"m": 1, "k": 4, "c": -0.1}, "unstable"),
    ],
)
def test_stability(values, expected):
    assert linearize(oscillator(**values)).stability == expected


def test_poles_zeros_and_gain():
    tf = transfer_function(linearize(oscillator(), symbolic=True), "u", "x", {m: 2.0, k: 50.0, c: 3.0})
    assert np.allclose(sorted(tf.poles, key=np.imag), np.roots([2, 3, 50])[::-1])
    assert len(tf.zeros) == 0 and tf.gain == pytest.approx(1 / 50)
    assert tf.response(np.array([5.0]))[0] == pytest.approx(1 / (15j))


def test_cancelled_modes_are_named():
    tf = transfer_function(linearize(by_hand("S8-ideal"), symbolic=True), "tau1", "tau_load")
    names = names_of("S8-ideal")
    assert set(tf.cancelled) == {s, names["J2"] * s + names["c"]} and tf.expression == sp.Symbol("N")


def test_missing_value_is_named():
    with pytest.raises(ModelError, match="no value for c, k, m"):
        linearize(oscillator())


def test_a_value_that_is_not_a_number_is_no_value():
    text = """model M parameter Real k = sqrt(-1); Real x(start = 1), v;
      equation der(x) = v; der(v) = -k*x; end M;"""
    with pytest.raises(ModelError, match="no value for k\n.*what is not a number"):
        lmoc.compile_text(text).linearize(at={"x": 0, "v": 0})


def test_unknown_output_is_named():
    with pytest.raises(ModelError, match="there is no output 'y'"):
        transfer_function(linearize(oscillator(), symbolic=True), "u", "y")


def test_cubic_spring_rests_at_its_free_length():
    L, d0 = sp.symbols("L d0")
    system = SymbolicSystem("cubic", (x, v), (v, (u - k * (x + L - d0) ** 3) / m), (u,), values={m: 1.0, k: 2.0})
    (found,) = equilibria(system, {"u": 0})
    assert equal(found["x"], d0 - L) and found.how == "exact"
    (loaded,) = equilibria(replace(system, values={m: 1.0, k: 2.0, L: 0.0, d0: 0.0}), {"u": 16})
    assert float(loaded["x"].subs({k: 2, L: 0, d0: 0})) == pytest.approx(2.0)


def test_pendulum_rests_hanging_and_standing():
    pendulum = SymbolicSystem("pendulum", (x, v), (v, -k * sp.sin(x)), values={k: 9.81})
    found = {e["x"]: e.stability for e in equilibria(pendulum)}
    assert found == {0: "undecided", sp.pi: "unstable"}  # undamped: the linear model cannot tell


def test_two_nonlinear_unknowns_are_searched_and_it_is_said_so():
    y, w = sp.symbols("y w")
    system = SymbolicSystem("pair", (x, y, v, w), (v, w, sp.sin(x) + y**3 - y - v, y**3 - y + x * 0 - w))
    found = equilibria(system)
    assert {round(float(e["y"])) for e in found} == {-1, 0, 1}
    assert all("starts" in e.how for e in found if e.how != "exact")


def test_nothing_rests_under_an_uncarried_load():
    assert equilibria(SymbolicSystem("falling", (x, v), (v, k), values={k: 9.81})) == []


def test_double_pendulum_prints_compactly():
    from lmoc.symbolic.notation import Notation
    from lmoc.symbolic.sorting import sorted_equation
    from lmoc.symbolic.styles import ASCII

    a, b, l = sp.symbols("a b l")
    accelerations = [jet_symbol(n, 2) for n in "ab"]
    residual = m * l**2 * (sp.cos(a) * (sp.cos(a) * accelerations[0] + sp.cos(b) * accelerations[1])) + m * l**2 * (
        sp.sin(a) * (sp.sin(a) * accelerations[0] + sp.sin(b) * accelerations[1])
    )
    equation = sorted_equation(residual, a, 2, [a, b], ["a", "b"])
    text = equation.write(Notation.of(residual, late=["a", "b"]), ASCII)
    assert text == "a'' + cos(a - b)*b'' = 0"


def test_explicit_form_of_the_oscillator():
    motion = explicit(oscillator())
    assert motion.coordinates == (x,) and motion.orders == (2,)
    assert equal(motion.residuals[0], jet_symbol("x", 2) - (u - c * jet_symbol("x", 1) - k * x) / m)


def test_derivative_of_an_absolute_value_in_plain_symbols():
    from lmoc.symbolic.slope import slope

    assert slope(sp.Abs(v) * v, v).subs(v, -3) == 6
    assert slope(sp.sign(v) * v, v).subs(v, -3) == -1
    assert slope(sp.Abs(v), x) == 0


def test_quadratic_drag_leaves_stability_undecided():
    system = SymbolicSystem("drag", (x, v), (v, (-k * x - c * sp.Abs(v) * v) / m), values={m: 1.0, k: 4.0, c: 0.5})
    (found,) = equilibria(system)
    assert found["x"] == 0 and found.stability == "undecided"


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["mass.q"], ["q"]),
        (["mass1.q", "mass2.q"], ["q1", "q2"]),
        (["left.q", "right.q"], ["q_left", "q_right"]),
        (["m[1].q", "m[2].q"], ["q1", "q2"]),
        (["n[1,2].q", "n[2,1].q"], ["q1_2", "q2_1"]),
        (["left.flange.f", "right.flange.f"], ["f_left", "f_right"]),
        (["gear.a.tau", "gear.b.tau"], ["tau_a", "tau_b"]),
        (["motor.theta", "s[1].theta", "s[2].theta"], ["theta_motor", "theta1", "theta2"]),
        (["q", "mass.q"], ["q", "q_mass"]),
        (["k1", "spring.k1"], ["k1", "k1_spring"]),
        (["lever[1].l1", "lever[1].l2", "lever[2].l1"], ["l1_1", "l2", "l1_2"]),
        (["lever1.l1", "lever2.l1"], ["l1_lever1", "l1_lever2"]),
    ],
)
def test_short_names(names, expected):
    from lmoc.symbolic.names import short_names

    assert list(short_names(names).values()) == expected


LEVER = """
model Balance
  parameter Real m1 = 2, m2 = 1, l1 = 0.5, l2 = 1, g = 9.81, J = 0.1;
  Lever lever(l1 = l1, l2 = -l2);
  Inertia body(J = J);
  Mass a(m = m1, g = -g), b(m = m2, g = -g);
equation
  connect(lever.pivot, body.shaft);
  connect(lever.a, a.flange);
  connect(lever.b, b.flange);
end Balance;
"""


def test_a_balanced_lever_rests_in_every_position():
    import lmoc

    dae = lmoc.compile_text(LEVER)
    (found,) = dae.equilibria()
    l1, l2, m1, m2 = sp.symbols("l1 l2 m1 m2")
    assert found.free == (sp.Symbol("body.theta"),)
    (condition,) = found.conditions
    assert equal(condition / (l1 * m1 - l2 * m2), 1)
    tilted = dae.equilibria(parameters={"m1": 3.0})
    assert {e["body.theta"] for e in tilted} == {sp.pi / 2, -sp.pi / 2} and all(e.isolated for e in tilted)


@pytest.mark.parametrize(
    "text", ["a/b + b/a", "1/(1/a + 1/b)", "(a**2 - b**2)/(a - b)", "sin(a)/(a + a*b) + 1/a", "(a + b)/(a + b)**2"]
)
def test_lowest_terms_by_field_arithmetic(text):
    from lmoc.symbolic.rational import cancelled

    value = sp.sympify(text)
    assert equal(cancelled(value), value)
    assert cancelled(value).count_ops() <= sp.cancel(value).count_ops()


def test_members_of_a_family_follow_its_free_state():
    y, w = sp.symbols("y w")
    coupled = SymbolicSystem("pair", (x, y, v, w), (v, w, k * (y - 2 * x) - v, k * (2 * x - y) - w), values={k: 3.0})
    (found,) = equilibria(coupled)
    (free,) = found.free
    other = ({x, y} - {free}).pop()
    assert equal(found.values[other], 2 * x if other == y else y / 2)
    assert found.stability == "neutral"


def test_a_rest_that_depends_on_an_input_says_how_to_give_it(scene):
    dae = lmoc.compile(str(scene))
    with pytest.raises(lmoc.ModelError) as error:
        dae.linearize(at=dae.equilibria()[0])
    assert "equilibria(inputs={'f': 0})" in error.value.diagnostics[0].hint
    assert dae.linearize(at=dae.equilibria(inputs={"f": 4})[0]).eigenvalues == pytest.approx([2j, -2j])


def test_implicit_blocks_that_are_alike_are_solved_side_by_side():
    """The residuals of all of them are one program; with an unknown of the other one missing it was thrown."""
    part = """model A parameter Real k = 2; Real x(start = 1, fixed = true), a, b, c; equation der(x) = a;
      a + k*b + c = -x; a*k - b + c = 2*x; c = a*b/k - b^3 + a; end A; """
    dae = lmoc.compile_text(part + "model M A a[2](k = {2, 3}); end M;", model="M")
    assert any(len(getattr(step, "unknowns", ())) == 2 for step in dae.reduced.rhs)
    with pytest.raises(ModelError, match="a.1..a, a.1..b have no solution in closed form"):
        dae.symbolic_ode()


def test_a_derivative_without_a_value_in_symbols_is_refused():
    text = "model M parameter Real n = 3; Real x(start = 1, fixed = true), v(start = 0, fixed = true); "
    dae = lmoc.compile_text(text + "equation der(x) = v; der(v) = -x - v*x^n; end M;")
    with pytest.raises(lmoc.ModelError, match="E0663.*no value in symbols"):
        dae.linearize(symbolic=True)
    assert dae.linearize().A == pytest.approx(np.array([[0, 1], [-1, 0]]))


def test_matrices_are_written_where_eigenvalues_are_lost_in_rounding(tmp_path, capsys):
    text = "model M Real x(start = 1, fixed = true), v(start = 0, fixed = true); "
    (tmp_path / "m.lmo").write_text(text + "equation der(x) = v; der(v) = -x - v*(2 + x)^1000; end M;")
    assert main(["linearize", str(tmp_path / "m.lmo"), "-o", str(tmp_path / "m.npz")]) == 2
    assert "eigenvalues are lost" in capsys.readouterr().err
    assert np.load(tmp_path / "m.npz")["A"].shape == (2, 2)
