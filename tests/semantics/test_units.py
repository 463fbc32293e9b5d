"""Units: the grammar of unit strings, what mixes and what does not."""

from fractions import Fraction

import pytest
from oracles.flattening import codes, equations, flat, mistakes

from lmoc.expression.units import BASE, UnitError, parse_unit, unit_text


def exponents(text: str) -> dict[str, Fraction]:
    return {name: e for name, e in zip(BASE, parse_unit(text).exponents, strict=True) if e}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("m", {"m": 1}),
        ("m/s2", {"m": 1, "s": -2}),
        ("N", {"kg": 1, "m": 1, "s": -2}),
        ("N.m/rad", {"kg": 1, "m": 2, "s": -2}),
        ("kg.m2", {"kg": 1, "m": 2}),
        ("N.s/m", {"kg": 1, "s": -1}),
        ("1", {}),
        ("rad", {}),
        ("1/s", {"s": -1}),
        ("kg/(m.s)", {"kg": 1, "m": -1, "s": -1}),
        ("m3.kg-1.s-2", {"m": 3, "kg": -1, "s": -2}),
        ("kN", {"kg": 1, "m": 1, "s": -2}),
        ("mm", {"m": 1}),
        ("V.A", {"kg": 1, "m": 2, "s": -3}),
        ("m(1/2)", {"m": Fraction(1, 2)}),
    ],
)
def test_unit_strings(text: str, expected: dict) -> None:
    assert exponents(text) == expected


def test_factors() -> None:
    assert parse_unit("km").factor == 1000
    assert parse_unit("g").factor == pytest.approx(1e-3)
    assert parse_unit("kg").factor == 1
    assert parse_unit("km/h").factor == pytest.approx(1 / 3.6)
    assert parse_unit("") is None


@pytest.mark.parametrize(
    ("text", "hint"), [("Nm", "'N.m'"), ("newton", ""), ("n", "'N'"), ("N*m", "joined by dots"), ("m/s/s", "one '/'")]
)
def test_strings_that_mean_nothing(text: str, hint: str) -> None:
    with pytest.raises(UnitError) as error:
        parse_unit(text)
    assert hint in error.value.hint


def test_text_of_units() -> None:
    assert unit_text(parse_unit("kg.m/s2")) == "N"
    assert unit_text(parse_unit("m/s2")) == "m/s2"
    assert unit_text(parse_unit("Hz")) == "1/s"  # an angular frequency is no number of turns
    assert unit_text(parse_unit("kg/(m.s3)")) == "kg/(m.s3)"


DECLARED = """
  parameter Real k(unit = "N/m") = 1; parameter Real c(unit = "N.s/m") = 1; parameter Real J(unit = "kg.m2") = 1;
  parameter Real n = 2; parameter Real d(unit = "mm") = 1;
  Real x(unit = "m"); Real v(unit = "m/s"); Real f(unit = "N"); Real phi(unit = "rad"); Real E(unit = "J"); Real y;
"""


@pytest.mark.parametrize(
    "equation",
    [
        "f = k*x + c*v",
        "f = k*x + c*der(x)",
        "v = der(x)",
        "E = k*x^2/2",
        "E = 2*f*x",
        "f = n*x",
        "f = 3",
        "y = x + f*n",
        "phi = sin(phi) + atan2(x, x)",
        "x = sqrt(E/k)",
        "x = if v > 0 then x else 2",
        "J*der(der(phi)) = E*phi",
        "x = noEvent(max(x, 1))",
        "x = time*v*2",
        "E = 0.5*c*x",
        "x = v*sin(time)",
    ],
)
def test_what_is_right_or_unknown(equation: str) -> None:
    assert "E0303" not in _codes(equation)


@pytest.mark.parametrize(
    ("equation", "left", "right"),
    [
        ("f = k*x + c*x", "k*x is in N", "c*x is in kg.m/s"),
        ("v = x", "v is in m/s", "x is in m"),
        ("f = der(v)", "f is in N", "der(v) is in m/s2"),
        ("x = d", "x is in m", "d is in mm"),
        ("y = sin(x)", "unit 1", "x is in m"),
        ("y = if x > v then 1 else 2", "x is in m", "v is in m/s"),
        ("y = x^v", "unit 1", "v is in m/s"),
        ("y = max(x, f)", "x is in m", "f is in N"),
    ],
)
def test_what_does_not_fit(equation: str, left: str, right: str) -> None:
    errors = [d for d in _mistakes(equation) if d.code == "E0303"]
    assert [(e.expected, e.found) for e in errors] == [(left, right)]


def _model(equation: str) -> str:
    return f"model A {DECLARED} equation {equation}; end A;"


def _mistakes(equation: str):
    return mistakes(_model(equation))  # with one equation for six variables there always are some


def _codes(equation: str) -> list[str]:
    return [d.code for d in _mistakes(equation)]


def test_values_and_start_values() -> None:
    assert codes('model A parameter Real l(unit = "m") = 1; Mass m(m = l); end A;') == ["E0303"]
    assert codes('model A parameter Real l(unit = "m") = 1; Mass m(m = 1, v(start = l)); end A;') == ["E0303"]
    flat("model A parameter Real w = 1; Mass m(m = w); end A;")


def test_an_array_is_checked_once() -> None:
    errors = mistakes("""model A parameter Real l(unit = "m") = 1; Mass m[40](each m = 1); Real x[40](each unit = "N");
        equation for i in 1:40 loop x[i] = m[i].q; end for; end A;""")
    assert [e.code for e in errors] == ["E0303"]
    assert "m.q is in m" in errors[0].found


def test_the_library_is_consistent() -> None:
    """Every equation of the library's parts, checked as if a user had written it."""
    from lmoc.messages.diagnostics import ModelError, Report
    from lmoc.messages.source import Source
    from lmoc.semantics.flatten import flatten
    from lmoc.sources.library import load
    from lmoc.syntax.parse import parse

    for definition in [c for f in load() for c in f.classes if c.kind == "model" and not c.partial]:
        report = Report()
        scene = parse(Source("t", f"model A {definition.name} part; end A;"), report)
        try:
            flatten([*load(), scene], (), "A", {}, report)
        except ModelError as error:
            assert {d.code for d in error.diagnostics if d.severity == "error"} <= {"E0310", "E0212"}, definition.name


def test_connected_variables_have_one_unit() -> None:
    (error,) = mistakes("""
        connector Own Real q(unit = "mm"); flow Real f(unit = "N"); end Own;
        model Part Own own; equation own.q = 0; end Part;
        model A Part p; Mass m(m = 1); equation connect(p.own, m.flange); end A;""")
    assert error.code == "E0303"
    assert (error.expected, error.found) == ("mm", "m")


def test_inputs_of_functions_without_unit_take_any() -> None:
    text = """
        function cubic input Real x; output Real y; algorithm y := x + x^2 + x^3; end cubic;
        function length input Real x(unit = "m"); output Real y; algorithm y := x + x^2; end length;
        model M Real s(unit = "m") = 2*time; Real a = cubic(s); Real b = {}; end M;"""
    assert "a = s + s^2 + s^3" in equations(flat(text.format("2")))
    assert codes(text.format("length(s)")) == ["E0303"]
