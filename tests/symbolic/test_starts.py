"""Runs that start at rest: initial="equilibrium", an equilibrium that was found, and expressions of one."""

import numpy as np
import pytest

import lmoc
from lmoc.cli.main import main
from lmoc.messages.diagnostics import ModelError

HANGING = """
model Hanging
  input Real u(unit = "N") = 2 + sin(time);
  Mass m(m = 2, g = 9.81, q(start = 1, fixed = true), v(start = 3, fixed = true));
  Spring s(k = 50, L = 1, d0 = 1); Fixed w; Force f(f = u);
equation
  connect(w.flange, s.a); connect(s.b, m.flange); connect(f.flange, m.flange);
end Hanging;
"""
PENDULUM = """
model Pendulum
  parameter Real l = 0.5;
  Real phi(start = 0.3, fixed = true), w(start = 0, fixed = true);
equation
  w = der(phi);
  l*der(w) = -9.81*sin(phi);
end Pendulum;
"""
FREE = """
model Free
  Mass a(m = 1, q(start = 0.7, fixed = true)), b(m = 2);
  SpringDamper s(k = 3, c = 1, L = 0.4, d0 = 0.4);
equation
  connect(a.flange, s.a); connect(s.b, b.flange);
end Free;
"""


def test_at_rest_with_the_inputs_as_they_are_at_the_start():
    dae = lmoc.compile_text(HANGING)
    rest = (2 * 9.81 + 2) / 50
    ways = ["equilibrium", dae.equilibria()[0], dae.equilibria(inputs={"u": 2})[0], dict(dae.equilibria()[0])]
    for initial in ways:
        run = dae.simulate(initial=initial, inputs={"u": 2}, stop=2, points=5)
        assert run["m.q"] == pytest.approx(np.full(5, rest), abs=1e-9)
    assert dae.simulate(initial="equilibrium", stop=1)["m.q"][0] == pytest.approx(rest)
    later = dae.simulate(initial="equilibrium", start=0.5, stop=1)["m.q"][0]
    assert later == pytest.approx((2 * 9.81 + 2 + np.sin(0.5)) / 50)
    table = dae.simulate(initial="equilibrium", inputs={"u": ([0, 5], [4, 6])}, start=1.0, stop=2)["m.q"][0]
    assert table == pytest.approx((2 * 9.81 + 4.4) / 50)


def test_with_other_parameters():
    run = lmoc.compile_text(HANGING).simulate(initial="equilibrium", parameters={"s.k": 100}, inputs={"u": 0}, stop=1)
    assert run["m.q"] == pytest.approx(np.full(len(run.time), 2 * 9.81 / 100))


def test_of_several_one_must_be_chosen():
    dae = lmoc.compile_text(PENDULUM)
    with pytest.raises(ModelError, match="not one equilibrium to start from but 2") as caught:
        dae.simulate(initial="equilibrium")
    assert "phi = pi" in str(caught.value) and "all states 0" in str(caught.value)
    upright = dae.simulate(initial=dae.equilibria()[1], stop=0.5)
    assert upright["phi"] == pytest.approx(np.full(len(upright.time), np.pi), abs=1e-6)


def test_of_a_family_the_member_that_the_start_values_say():
    """The spring is at its length, and both masses stand where the model puts the first."""
    dae = lmoc.compile_text(FREE)
    for initial in ("equilibrium", dae.equilibria()[0]):
        run = dae.simulate(initial=initial, stop=3)
        assert np.ptp(run["a.q"]) < 1e-9 and np.ptp(run["b.q"]) < 1e-9
        assert run["s.f"] == pytest.approx(np.zeros(len(run.time)), abs=1e-9)


def test_what_is_no_start():
    with pytest.raises(ModelError, match="the start is not understood"):
        lmoc.compile_text(HANGING).simulate(initial="rest")


def test_on_the_command_line(tmp_path, capsys):
    (tmp_path / "hanging.lmo").write_text(HANGING)
    (tmp_path / "pendulum.lmo").write_text(PENDULUM)
    out = tmp_path / "out.csv"
    start = ["run", "--quiet", "--init", "equilibrium", "--points", "2", "--stop", "1"]
    assert main([*start, str(tmp_path / "hanging.lmo"), "-o", str(out)]) == 0
    names, first, _ = (line.split(",") for line in out.read_text().splitlines())
    found = dict(zip((n.strip('"').split(" ")[0] for n in names), first, strict=True))
    assert float(found["m.q"]) == pytest.approx((2 * 9.81 + 2) / 50) and float(found["m.v"]) == 0
    assert main([*start, str(tmp_path / "pendulum.lmo")]) == 2
    assert "(2) phi = pi" in capsys.readouterr().err
    assert main([*start, str(tmp_path / "hanging.lmo"), "--init", "m.q=1"]) == 2
