"""Numbers at the ends of what floats can hold: an answer, or a diagnostic; never an error of a library."""

import pytest

import lmoc
from lmoc.cli.main import main

DRIFT = """model Drift Real x(start = 1, fixed = true), y(start = 0, fixed = true), vx(start = 0, fixed = true),
  vy(start = 0, fixed = true); Real tension = (vx^2 + vy^2 - 1e-308*y)/(x^2 + y^2);
  equation der(x) = vx; der(y) = vy; der(vx) = -tension*x; der(vy) = -tension*y - 9.81; end Drift;"""
SWING = """model Swing Fixed w; Spring s(k = 10); Damper d(c = 1); Mass m(m = 1, q(start = 1, fixed = true)); Force p;
  input Real u = 1; equation connect(w.flange, s.a); connect(s.b, m.flange); connect(w.flange, d.a);
  connect(d.b, m.flange); connect(p.flange, m.flange); p.f = u; end Swing;"""
TIRE = """model Tire Fixed road; Spring tire(k = 1e5), spring(k = 1e4); Mass wheel(m = 50), body(m = 300); equation
  connect(road.flange, tire.a); connect(tire.b, wheel.flange); connect(wheel.flange, spring.a);
  connect(spring.b, body.flange); end Tire;"""
STUCK = """model Stuck DryFriction f(F = 1); Fixed w; Mass m(m = 1, g = 1); Spring s(k = 1); equation
  connect(w.flange, f.a); connect(f.b, m.flange); connect(w.flange, s.a); connect(s.b, m.flange); end Stuck;"""


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        *((text, "m.m", v) for text in (SWING, STUCK) for v in ("-1e308", "5e-324", "1e155")),
        (SWING, "s.k", "1e308"), (SWING, "d.c", "1e-308"), (STUCK, "f.F", "5e-324"),
    ],
)  # fmt: skip
def test_every_derivation_ends_with_an_answer_or_a_diagnostic(text, name, value, tmp_path, capsys):
    file = tmp_path / "scene.lmo"
    file.write_text(text)
    verbs = [["equations"], ["equilibria"], ["linearize"], ["check"]]
    verbs += [["transfer", "u", "m.q"]] if text is SWING else []
    for verb, *more in verbs:
        assert main([verb, str(file), *more, "--set", f"{name}={value}", "--budget", "5"]) in (0, 1, 2)
        assert "RuntimeWarning" not in capsys.readouterr().err


def test_eigenvalues_that_are_lost_are_not_told():
    """A stiff tire beside a soft spring: right as long as numbers can tell, and then refused, never zero."""
    dae = lmoc.compile_text(TIRE)
    slow = abs(dae.linearize(parameters={"tire.k": 1e9}).eigenvalues).min()
    assert abs(dae.linearize(parameters={"tire.k": 1e18}).eigenvalues).min() == pytest.approx(slow, rel=1e-3)
    for stiff in (1e40, 1e100, 1e308):
        with pytest.raises(lmoc.ModelError, match="orders of magnitude"):
            print(dae.linearize(parameters={"tire.k": stiff}).eigenvalues)
        assert dae.equilibria(parameters={"tire.k": stiff})[0].stability == "undecided"


def test_a_rest_is_sought_with_numbers_that_are_no_fractions_of_floats(tmp_path):
    assert list(lmoc.compile_text(DRIFT).equilibria()) == []
