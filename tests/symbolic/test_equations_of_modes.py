"""Equations of scenes with laws: each mode that a run meets has its own, and the laws stand between them."""

import json
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from oracles.models import compiled
from oracles.symbolic_truth import proportional
from oracles.two_bobs import TWO_BOBS

import lmoc
from lmoc.cli.main import main

MODELS = Path(__file__).parents[2] / "models" / "laws"


def residuals(found, k: int) -> list[sp.Expr]:
    return [e.residual for e in found.modes[k].equations.equations]


def same(a: sp.Expr, text: str) -> bool:
    """Return whether two residuals are the same up to a factor, symbols with dots written with underscores."""
    names = {s: sp.Symbol(s.name.replace(".", "_").replace("(", "").replace(")", "")) for s in a.free_symbols}
    return proportional(a.xreplace(names), text)


def test_a_string_between_two_masses():
    found = compiled(MODELS / "h06_bungee.lmo").equations()
    assert [dict(m.mode) for m in found.modes] == [{"string": "slack"}, {"string": "taut"}]
    assert found.modes[0].since == 0.0 and found.modes[1].since == pytest.approx(0.319275428407, rel=1e-9)
    upper, lower = residuals(found, 0)
    assert same(upper, "upper_m*derderupper_q + spring_k*upper_q - upper_m*upper_g")
    assert same(lower, "derderlower_q - lower_g")
    (both,) = residuals(found, 1)
    loads = "lower_g*lower_m + upper_g*upper_m"
    assert same(both, f"(lower_m + upper_m)*derderupper_q + spring_k*upper_q - ({loads})")
    assert found.law_lines() == ["string: 0 ≤ f ⟂ q1 + L - q2 ≥ 0"]


def test_friction_sticks_and_slips():
    found = compiled(MODELS / "h16_stick_slip.lmo").equations()
    assert [m.title for m in found.modes] == ["friction stick, from t = 0 s", "friction slip, from t = 0.4 s"]
    assert same(residuals(found, 0)[0], "dermass_q - Rational(1, 5)")
    slip = "mass_m*derdermass_q + friction_F*sign(dermass_q - Rational(1, 5)) + spring_k*mass_q"
    assert same(residuals(found, 1)[0], slip)
    (law,) = found.law_lines()
    assert law == "friction: stick: q̇ - 0.2 = 0, |force| ≤ Fstick; slip: force = -sign(q̇ - 0.2)·F"


def test_without_values_all_modes_of_few_laws():
    text = """model M Fixed w; Mass m; Stop s(L = 0); equation connect(w.flange, s.a); connect(s.b, m.flange); end M;"""
    found = lmoc.compile_text(text).equations()
    assert [dict(m.mode) for m in found.modes] == [{"s": "open"}, {"s": "contact"}]
    assert all(m.since is None for m in found.modes) and found.modes[1].equations.equations == ()


def test_a_block_slides_on_a_rough_edge():
    """The normal force is eliminated; nothing is divided by the sign of the sliding velocity."""
    found = lmoc.compile_text("""model Slide import Planar.*; inner World world(g = 10);
      PointMass b(m = 2, x(start = 0, fixed = true), y(start = 0, fixed = true)); Contact c(mu = 0.5);
      Force f(fx = 12, fy = 0);
    equation connect(b.point, c.point); connect(f.point, b.point); end Slide;""").equations()
    (slide,) = residuals(found, 0)
    assert dict(found.modes[0].mode) == {"c.fn": "contact", "c.ft": "slip"}
    assert same(slide, "2*b_m*derderb_x - 24 + b_m*world_g*sign(derb_x)")


def test_many_modes_are_counted():
    found = lmoc.compile(MODELS / "wagons.lmo", parameters={"N": 9}).equations()
    assert len(found.modes) == 6 and found.more == 3
    assert "and 3 more modes" in found.text()


def test_deviations_from_the_equilibrium_in_its_mode():
    dae = compiled(MODELS / "h06_bungee.lmo")
    about = dae.equations().about(dae.equilibria()[0])
    assert about.lines() == ["(m_lower + m_upper)·δq̈1 + k·δq1 = 0"]


@pytest.mark.parametrize("form", ["--latex", "--json", "--html", "--ascii"])
def test_every_form_is_printed(form, capsys):
    assert main(["equations", str(MODELS / "h16_stick_slip.lmo"), form]) == 0
    out = capsys.readouterr().out
    if form == "--json":
        data = json.loads(out)
        assert [m["laws"] for m in data["modes"]] == [{"friction": "stick"}, {"friction": "slip"}]
        assert data["laws"][0]["slip"] == "friction.F"
    assert ("paragraph{Laws}" if form == "--latex" else "aws") in out
    assert form != "--ascii" or out.isascii()


def test_taut_strings_in_the_plane_read_as_in_a_textbook():
    found = compiled("laws/slack_pendulum").equations()
    taut, slack = (m.equations for m in found.modes)
    assert taut.lines() == ["L·m·ẍ + f·x = 0", "L·m·ÿ + f·y = -L·g·m"]
    assert taut.closure_lines() == ["x² + y² - L² = 0"]
    assert slack.lines() == ["ẍ = 0", "ÿ = -g"] and slack.closures == ()
    assert found.law_lines() == ["string: 0 ≤ f ⟂ (L² - x² - y²)/(2·L) ≥ 0"]


def test_equations_of_two_strings_hold_along_the_motion_with_their_tensions():
    """In each mode, at positions, accelerations and tensions of a run."""
    dae = lmoc.compile_text(TWO_BOBS)
    found = dae.equations()
    run = dae.simulate(stop=0.6, points=13, rtol=1e-10)
    parameters = {sp.Symbol(n): v for n, v in dae.parameters.items()}
    checked = 0
    for mode, after in zip(found.modes, [*(m.since for m in found.modes[1:]), 0.6], strict=True):
        assert [w for w in mode.mode.values()].count("taut") == len(mode.equations.closures)
        for k in np.flatnonzero((run.time > mode.since + 1e-6) & (run.time < after - 1e-6)).tolist():
            numbers = parameters | {sp.Symbol(f"{s}.f"): run[f"{s}.f"][k] for s in ("upper", "lower")}
            places = {f"{b}.{c}": (run[f"{b}.{c}"][k], run[f"der({b}.v{c})"][k]) for b in "ab" for c in "xy"}
            places |= {f"lower.d{c}": tuple(np.subtract(places[f"b.{c}"], places[f"a.{c}"])) for c in "xy"}
            for name, (value, acceleration) in places.items():
                numbers |= {sp.Symbol(name): value, sp.Symbol(f"der(der({name}))"): acceleration}
            for e in (*(e.residual for e in mode.equations.equations), *mode.equations.closures):
                terms = [abs(float(t.subs(numbers))) for t in sp.Add.make_args(e)]
                assert abs(float(e.subs(numbers))) <= 1e-7 * max(1.0, *terms)
            checked += 1
    assert checked > 5


def test_elastic_strings_read_in_the_coordinate_of_the_mass():
    found = compiled("laws/elastic_string").equations()
    assert found.coordinates == ("mass.q",)
    assert "if q - d0 > 0 and k·q - d0·k > 0; 0 otherwise}" in found.lines()[0]


def test_equal_rates_of_a_locked_clutch_are_written_as_a_difference():
    (_, locked) = compiled("laws/clutch_lock").equations().modes
    assert locked.equations.lines()[1] == "θ̇_load - θ̇_driver = 0"
