"""Bodies without mass on strings, stops and friction: no verb ends with a mistake of its own."""

from pathlib import Path

import pytest

import lmoc
from lmoc.cli.main import main

PENDULUM = Path(__file__).parents[2] / "models" / "laws" / "slack_pendulum.lmo"
VERBS = {
    "check": (), "run": ("--stop", "0.1"), "equations": ("--latex",), "equilibria": (), "linearize": (),
    "draw": ("-o", "scene.svg"), "view": ("--stop", "0.1", "-o", "page.html"), "show": ("--stage", "reduce"),
    "study": ("--sample", "world.g~uniform(9, 10)", "--runs", "2", "--stop", "0.1"),
}  # fmt: skip


@pytest.mark.parametrize("verb", VERBS)
def test_a_pendulum_without_a_bob(verb, tmp_path, monkeypatch, capsys):
    """Nothing but its string keeps it: where it is, is not determined, and every verb says so by a code."""
    monkeypatch.chdir(tmp_path)
    code = main([verb, str(PENDULUM), *VERBS[verb], "--set", "bob.m=0"])
    said = capsys.readouterr()
    assert code == (0 if verb == "show" else 3 if verb == "study" else 1), said.err
    assert "[E0" in said.out + said.err or verb == "show"
    assert "internal error" not in said.err


SCENES = {  # each is to end without an inertia for its law, and all verbs by the same diagnostic
    "string": "Mass m(m = 0, g = 9.81); Cable law(L = 1); Fixed w;"
    "equation connect(w.flange, law.a); connect(law.b, m.flange);",
    "stop": "Mass m(m = 0, g = -9.81); Stop law(L = 0, e = 0.5); Fixed w;"
    "equation connect(w.flange, law.a); connect(law.b, m.flange);",
    "clutch": "Inertia a(J = 0), b(J = 1); Clutch law(tau = 1); Torque t(tau = 0.5);"
    "equation connect(a.shaft, law.a); connect(law.b, b.shaft); connect(t.shaft, a.shaft);",
    "freewheel": "Inertia a(J = 1), b(J = 0); Ratchet law; equation connect(a.shaft, law.a); connect(law.b, b.shaft);",
    "slipping wheel": "Mass m(m = 0); Inertia j(J = 1); Wheel law(r = 1, slips = true, mu = 0.3, load = 10);"
    "equation connect(law.flange, m.flange); connect(law.shaft, j.shaft);",
    "contact": "import Planar.*; inner World world; PointMass p(m = 0); Contact law(mu = 0.3);"
    "equation connect(law.point, p.point);",
}


@pytest.mark.parametrize("scene", SCENES)
def test_nothing_takes_the_force_of_a_law(scene):
    with pytest.raises(lmoc.ModelError) as found:
        lmoc.compile_text(f"model M {SCENES[scene]} end M;")
    assert [d.code for d in found.value.diagnostics if d.code[0] == "E"] == ["E0416"]


def test_a_massless_shaft_behind_a_clutch_turns_as_its_damper_lets_it():
    """The clutch slips: its torque drives the damper alone."""
    dae = lmoc.compile_text("""model M Inertia a(J = 0), b(J = 1, omega(start = 5, fixed = true)); Clutch law(tau = 1);
      TorsionDamper d(c = 0.5); FixedShaft w;
    equation connect(a.shaft, law.a); connect(law.b, b.shaft); connect(d.a, a.shaft); connect(d.b, w.shaft); end M;""")
    run = dae.simulate(stop=2.0)
    assert run["a.omega"] == pytest.approx(2.0) and run["b.omega"][-1] == pytest.approx(3.0)
