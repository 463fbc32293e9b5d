"""What is printed means what was derived: formulas in ASCII are read back and compared; LaTeX and MathML are whole."""

import re
from functools import cache
from xml.etree import ElementTree

import pytest
import sympy as sp
from conftest import ROOT
from oracles.models import compiled
from oracles.symbolic_truth import IMPLICIT, equal

import lmoc
from lmoc.expression.to_sympy import exact
from lmoc.messages.diagnostics import ModelError
from lmoc.symbolic.elimination import eliminate
from lmoc.symbolic.notation import Notation, plain_text
from lmoc.symbolic.styles import ASCII, LATEX, MATHML, UNICODE, unit_text
from lmoc.symbolic.system import jet_symbol

TOO_LONG = {"h14_plucked_string", "h27_car_axis"}
WITH_LAWS = {"fig6_slack_string", "ex08_slack_cable"}  # their equations are those of modes: test_equations_of_modes.py
SCENES = [path for path in sorted((ROOT / "models/notes").glob("*.lmo")) if path.stem not in WITH_LAWS] + [
    path for path in sorted((ROOT / "models/hard").glob("*.lmo")) if path.stem not in {*TOO_LONG, *IMPLICIT}
]
WITHOUT_INPUT = {"ex10_lever_and_mass", "fig5_rods", "fig6_pretension", "fig6_string_over_pulley"} | {
    *("s3_2_spring_left_of_mass", "s3_2_spring_right_of_mass", "h02_double_pendulum", "h05_atwood"),
    *("h08_turning_lever", "h13_stiffness_ratio", "h15_cubic_spring", "h22_block_and_tackle"),
    "h32_inconsistent_start",
}
with_input = pytest.mark.parametrize("path", [p for p in SCENES if p.stem not in WITHOUT_INPUT], ids=lambda p: p.stem)
every_scene = pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)


@cache
def derived(path):
    return compiled(path).equations(forces=True)


def read(text: str, notation: Notation) -> sp.Expr:
    """A formula in the short names of a notation as an expression in the full ones."""
    full = {short: name for name, short in notation.short.items()}
    text = re.sub(r"(sin|cos)\^(\d)\(([^()]*)\)", r"\1(\3)^\2", text).replace("^", "**")
    names, places = {}, {}
    for word, primes in sorted(set(re.findall(r"([A-Za-zδ_]\w*)('*)", text)), key=lambda f: -len(f[1])):
        if word in full:
            place = f"x{len(places)}_{len(primes)}"
            places[place] = (word, primes)
            names[place] = jet_symbol(full[word], len(primes))
    for place, (word, primes) in places.items():
        text = re.sub(rf"(?<![\w'.]){word}{primes}(?![\w'])", place, text)
    return sp.sympify(text, locals=names)


@every_scene
def test_equations_are_printed_as_derived(path):
    found = derived(path)
    for e, line in zip(found.equations, found.lines(ASCII), strict=True):
        left, right = line.split(" = ")
        assert equal(read(left, found.notation) - read(right, found.notation), e.residual)
    for (name, value), line in zip(found.forces.items(), found.force_lines(ASCII), strict=True):
        left, right = line.split(" = ")
        assert read(left, found.notation) == sp.Symbol(name) and equal(read(right, found.notation), value)


@every_scene
def test_pages_and_latex_are_whole(path):
    found = derived(path)
    page = found.html()
    ElementTree.fromstring(f"<div>{page}</div>")
    assert "<math" in page or not found.equations
    latex = found.latex()
    assert latex.count("{") == latex.count("}") and latex.count(r"\left(") == latex.count(r"\right)")


@with_input
def test_transfer_functions_are_printed_as_derived(path):
    dae = compiled(path)
    several = path.stem == "s9_lever_large_angles"
    at = dae.equilibria(inputs={u: 0 for u in dae.inputs})[0] if several else None
    pairs = [(u, y) for u in dae.inputs for y in dae.outputs]
    assert pairs
    for u, y in pairs:
        tf = dae.transfer_function(u, y, at=at)
        notation = Notation.of(tf.numerator, tf.denominator, names=(u, y))
        assert equal(read(notation.quotient(tf.numerator, tf.denominator, "s", ASCII), notation), tf.expression)
        ElementTree.fromstring(f"<div>{notation.quotient(tf.numerator, tf.denominator, 's', MATHML)}</div>")
        assert tf._repr_latex_().startswith("$") and tf._repr_latex_().count("{") == tf._repr_latex_().count("}")
        equation = tf.input_output_equation
        for side, operator in zip(equation.write(notation, ASCII).split(" = "), equation, strict=True):
            body, _, _ = side.rpartition(" ")
            assert equal(read(body, notation), operator) if body else operator in (0, 1, -1)


@pytest.mark.parametrize(
    ("top", "bottom", "expected"),
    [
        ("1", "m*s**2", "1/(m*s^2)"),
        ("k1 + k2", "m*s**2 + k", "(k1 + k2)/(m*s^2 + k)"),
        ("-J*s**2 - k", "s", "-(J*s^2 + k)/s"),
        ("s*c1*(k2 + k3)", "1", "c1*(k2 + k3)*s"),
        ("0", "1", "0"),
    ],
)
def test_quotients(top, bottom, expected):
    top, bottom = sp.sympify(top), sp.sympify(bottom)
    assert Notation.of(top, bottom).quotient(top, bottom, "s", ASCII) == expected


def test_real_cube_root():
    f, k = sp.symbols("f k")
    value = sp.sign(f / k) * sp.Abs(f / k) ** sp.Rational(1, 3)
    notation = Notation.of(value)
    assert notation.text(value) == "∛(f/k)" and notation.text(value, LATEX) == r"\sqrt[3]{\frac{f}{k}}"
    assert notation.text(value, ASCII) == "cbrt(f/k)"


@pytest.mark.parametrize(
    ("name", "unicode", "latex"),
    [
        ("v_theta1", "v_θ1", r"v_{\theta_{1}}"),
        ("theta2", "θ2", r"\theta_{2}"),
        ("q_left", "q_left", r"q_{\mathrm{left}}"),
        ("T_pi", "T_π", r"T_{\pi}"),
    ],
)
def test_names_of_symbols(name, unicode, latex):
    assert UNICODE.symbol(name, 0) == unicode and LATEX.symbol(name, 0) == latex


def test_sums_are_sorted_alike_in_every_style():
    m, M = sp.symbols("m M")
    notation = Notation.of(m, M)
    assert notation.text(16 * m + M) == "M + 16·m" and notation.text(16 * m + M, LATEX) == r"M + 16 \, m"


def test_units_for_people():
    assert unit_text("N.m/rad") == "N·m/rad" and unit_text("m/s2") == "m/s²"


OSCILLATOR = """
model Oscillator
  constant Real pi = 3.14159265358979;
  parameter Real f0(unit = "Hz") = 1;
  input Real u(unit = "N") = 0;
  Spring s(k = (2*pi*f0)^2); Mass m(m = 1); Fixed w; Force f(f = u);
equation
  connect(w.flange, s.a); connect(s.b, m.flange); connect(f.flange, m.flange);
end Oscillator;
"""


def test_pi_is_written_as_such():
    dae = lmoc.compile_text(OSCILLATOR)
    tf = dae.transfer_function("u", "m.q")
    s, m, f0 = sp.symbols("s m.m f0")
    assert tf.expression == 1 / (m * s**2 + 4 * sp.pi**2 * f0**2)
    assert tf.poles.imag == pytest.approx([2 * sp.pi.evalf(), -2 * sp.pi.evalf()])
    notation = Notation.of(tf.numerator, tf.denominator)
    assert notation.quotient(tf.numerator, tf.denominator, "s") == "1/(m·s² + 4·π²·f0²)"
    (line,) = dae.equations().lines()
    assert line == "m·q̈ + 4·π²·f0²·q = u"


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (3.14159265358979, "pi"),
        (6.283185307179586, "2*pi"),
        (-0.5235987755982988, "-pi/6"),
        (3.1416, "3927/1250"),
        (3.14159, "314159/100000"),
        (9.81, "981/100"),
        (1 / 12, "1/12"),
        (0.0, "0"),
    ],
)
def test_the_number_a_person_meant(value, expected):
    assert exact(value) == sp.sympify(expected)


def test_residuals_are_sympys_text_with_decimal_numbers():
    """They are read back as the same expression; fractions that nobody writes as decimals stay fractions."""
    x, y = sp.symbols("x y")
    expression = sp.Rational(981, 100) * sp.sin(x) - sp.Rational(3, 10) * y - sp.sqrt(x) / 3 + sp.Rational(1, 10**7)
    text = plain_text(expression)
    assert "9.81*sin(x)" in text and "0.3*y" in text and "sqrt(x)/3" in text
    assert sp.nsimplify(sp.sympify(text), rational=True) == expression


def test_numbers_stay_as_written():
    text = "model P Real phi(start = 1), w; equation w = der(phi); 0.35*der(w) = -9.81*sin(phi) - 0.07*w; end P;"
    (line,) = lmoc.compile_text(text).equations().lines()
    assert line == "0.35·φ̈ + 0.07·φ̇ + 9.81·sin(φ) = 0"


def test_what_has_no_readable_equations_is_refused():
    """The particle is written as equations: in no part is a mass that Lagrange's equations could be made of."""
    with pytest.raises(ModelError, match="no solution in closed form"):
        compiled(ROOT / "models/hard/h01_cartesian_pendulum.lmo").equations()


def test_equations_that_grow_while_they_are_solved_are_refused():
    with pytest.raises(ModelError, match="too long to be solved in symbols"):
        compiled(ROOT / "models/hard/h27_car_axis.lmo").equations()


def test_an_elimination_of_short_coefficients_has_no_limit():
    n = 40
    k = sp.Symbol("k")
    rows = [{i: 2 * k} | {j: -k for j in (i - 1, i + 1) if 0 <= j < n} for i in range(n)]
    found = eliminate(rows).solution
    assert sp.cancel(found[0][0] - sp.Rational(n, n + 1) / k) == 0
