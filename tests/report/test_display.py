"""Units in which results are printed and drawn."""

import numpy as np
import pytest

import lmoc
from lmoc.expression.units import parse_unit
from lmoc.report.display import UNITS, display
from lmoc.report.summary import summary

SCENE = """model M Inertia i(J = 2, theta(start = 0.5, fixed = true), omega(start = 3, fixed = true));
    Mass m(m = 1, q(start = 0.25, fixed = true)); output Real a(unit = "rad") = i.theta;
    output Real x(unit = "m") = m.q;
    output Real w(unit = "rad/s") = i.omega; end M;"""


def test_a_picture_and_a_summary_in_other_units():
    run = lmoc.compile_text(SCENE).simulate(stop=1)
    axes = run.plot(["a", "x", "w"], units="mm,deg,rpm").axes
    assert [axis.get_ylabel() for axis in axes] == ["angle in deg", "position in mm", "speed of rotation in rpm"]
    drawn = [axis.lines[0].get_ydata() for axis in axes]
    assert drawn[0] == pytest.approx(np.degrees(run["a"])) and drawn[1] == pytest.approx(1e3 * run["x"])
    assert drawn[2] == pytest.approx(run["w"] * 30 / np.pi)
    lines = {line.split()[0]: line.split()[1:3] for line in summary(run, ["mm", "rpm"]).splitlines() if line.strip()}
    assert lines["x"] == ["250", "mm"] and lines["w"] == ["28.6479", "rpm"] and lines["a"][1] == "rad"
    assert run["x"][0] == 0.25 and "250" not in summary(run)


def test_the_energy_is_drawn_in_other_units():
    run = lmoc.compile_text(SCENE).simulate(stop=1)
    assert run.plot(units=["kJ"]).axes[-1].get_ylabel() == "energy in kJ"


@pytest.mark.parametrize("units", ["inch", ["mm", "cm"], "mm,", "rad"])
def test_units_that_cannot_be_shown(units):
    with pytest.raises(lmoc.ModelError) as wrong:
        display(units)
    assert wrong.value.diagnostics[0].code == "E0629"


def test_units_may_stand_in_one_text_or_be_left_out():
    assert display("  mm , deg ").unit("m") == "mm" and display(None).unit("m") == "m"


@pytest.mark.parametrize("name", UNITS)
def test_every_unit_stands_for_one_that_the_language_knows(name):
    unit, size = UNITS[name]
    assert parse_unit(unit) is not None and size > 0
