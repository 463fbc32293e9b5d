"""Models without a unique solution: what is said about them."""

from __future__ import annotations

import pytest
from oracles.flat_builder import flat_model

import lmoc
from lmoc.messages.diagnostics import ModelError
from lmoc.structure.reduce import reduce


def errors(text: str):
    with pytest.raises(ModelError) as caught:
        reduce(flat_model(text))
    return caught.value.diagnostics


def test_too_many_equations():
    error = errors("var x y z\nsin(x) + y = 1\ncos(x)*y = 2\nx*y = time\ncos(z)*x = y")[0]
    assert error.code == "E0401"
    assert "3 equations for 2 unknowns (x and y)" in error.message
    assert "x*y = time" in error.found
    assert error.span.line == 2


def test_too_few_equations():
    (error,) = errors("var x y z\nsin(x) + y*z = 1\nder(z) = z")
    assert error.code == "E0403"
    assert "1 equation for 2 unknowns (x and y)" in error.message


def test_no_equation_at_all():
    (error,) = errors("var x y\nder(x) = -x")
    assert error.code == "E0403"
    assert "no equation determines y" in error.message


def test_nothing_fixes_a_position():
    """A spring and a damper side by side, pulled at both ends and held nowhere."""
    found = errors("""
        input u
        potential s.a s.b d.a d.b
        flow s.fa s.fb d.fa d.fb
        var s.f d.f
        connect s.a = d.a
        connect s.b = d.b
        s.f = 10*(s.b - s.a)
        s.fb = s.f
        s.fa = -s.f
        d.f = der(d.b) - der(d.a)
        d.fb = d.f
        d.fa = -d.f
        s.fb + d.fb = u
        s.fa + d.fa = -u
    """)
    assert "nothing fixes the absolute position of s and d" in [e.message for e in found]


def test_singular_for_these_values():
    text = """
        parameter a = 2
        var x y z
        x + a*y + z = time
        2*x + 2*a*y + z = 3
        3*x + 3*a*y + z = 3*time
    """
    (error,) = errors(text)
    assert error.code == "E0405"
    assert "x, y and z cannot be determined" in error.message
    well = reduce(flat_model(text.replace("2*a*y", "5*a*y")))
    assert well.broken_guard(well.values) is None


def test_values_for_which_equations_lose_their_solution_break_a_guard():
    rows = "x + a*y + z = time\n2*x + 2*b*y + z = 3\n3*x + 3*a*y + z = 3*time"
    reduced = reduce(flat_model(f"parameter a = 2\nparameter b = 3\nvar x y z\n{rows}"))
    values = reduced.values.copy()
    values[:2] = 4, 4
    assert "one solution" in reduced.broken_guard(values)
    values[:2] = 4, 5
    assert reduced.broken_guard(values) is None


def test_singular_in_a_large_block():
    n = 100
    names = " ".join(f"x{i}" for i in range(n))
    rows = [f"x{i} - 2*x{(i + 1) % n} + x{(i + 2) % n} = sin(time)" for i in range(n)]
    (error,) = errors(f"var {names}\n" + "\n".join(rows))
    assert error.code == "E0405"
    assert "and 95 more cannot be determined" in error.message


CIRCLE = """
    var x y s t
    der(der(x)) = s*x + t*x
    der(der(y)) = s*y - t*y
    x**2 + y**2 = 1
"""


def test_constraints_without_a_direction_of_their_own():
    """Both say that the point is on the circle, but neither is a combination of the other."""
    (error,) = errors(CIRCLE + "(x**2 + y**2)**2 = 1")
    assert error.code == "E0404"
    assert "cannot be solved near the start" in error.message


def test_an_equation_that_repeats_another_determines_nothing():
    (error,) = errors(CIRCLE + "2*y**2 + 2*x**2 = 2")
    assert error.code == "E0403"
    assert "3 equations for 4 unknowns" in error.message
    assert "2*y^2 + 2*x^2" in error.found and "is redundant" in error.found


def test_several_mistakes_in_one_run():
    codes = [e.code for e in errors("var x y z\nsin(x) = 1\ncos(x) = time\ncos(z) = z*y")]
    assert codes == ["E0401", "E0403"]


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("Damper d[30](each c = 1);", "E0402", "nothing fixes the absolute position of d[1:30]"),
        ("Fixed f[30]; Spring s[30](each k = 0); Damper d[30](each c = 0);"
         "equation for i in 1:30 loop connect(f[i].flange, d[i].a); connect(d[i].b, s[i].a); end for;",
         "E0402", "nothing fixes the absolute position of s[1:30] and d[1:30]"),
        ("Fixed f[30]; Rod r[30](each L = 1); Rod s[30](each L = 2); equation for i in 1:30 loop"
         " connect(f[i].flange, r[i].a); connect(f[i].flange, s[i].a); connect(r[i].b, s[i].b); end for;",
         "E0411", "s[1:30] and r[1:30] contradict each other: no position satisfies all of them"),
        ("Force f[30](each f = 1);", "E0416",
         "nothing takes the force of f[1:30]: no mass, spring or support is there to resist it"),
        ("Gear g[30](each N = 2); Gear h[30](each N = 3); equation for i in 1:30 loop"
         " connect(g[i].a, h[i].a); connect(g[i].b, h[i].b); end for;",
         "E0412", "h[1:30] and g[1:30] form a loop whose ratios do not agree: only rest is possible"),
    ],
)  # fmt: skip
def test_the_same_in_every_member_of_an_array_is_said_once(text, code, message):
    with pytest.raises(ModelError) as caught:
        lmoc.compile_text(f"model T {text} end T;")
    assert [(e.code, e.message) for e in caught.value.diagnostics if e.severity == "error"] == [(code, message)]
