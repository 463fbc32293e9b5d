"""The list of stages: timings, progress and `show --stage` follow it."""

import re

import pytest

import lmoc as package
from lmoc.pipeline import STAGES, VIEWS, Clock


def test_a_run_times_the_stages_of_the_list(scene):
    assert set(package.compile(scene).simulate().timings) == {stage.name for stage in STAGES}


def test_other_names_are_no_stages():
    with pytest.raises(KeyError, match="no stage 'redcue'"), Clock().stage("redcue"):
        pass


@pytest.mark.parametrize("view", VIEWS)
def test_every_view_is_shown(lmoc, scene, view):
    expected = {
        "parse": "Class kind='model' Oscillator",
        "instantiate": "model Oscillator  A mass on a spring",
        "flatten": "parts (4)",
        "normalize": "eliminated: ",
        "reduce": "states (2)",
        "lower": "evaluated by",
    }
    answer = lmoc("show", "--stage", view, scene)
    assert (answer.code, answer.err) == (0, "") and expected[view] in answer.out


def test_what_elimination_leaves_is_shown_in_the_users_names(lmoc, tmp_path):
    path = tmp_path / "gears.lmo"
    path.write_text(
        "model Gears Inertia a(J = 1), b(J = 2); Gear g(N = 3); Torque t(tau = 1);\n"
        "equation connect(a.shaft, g.a); connect(g.b, b.shaft); connect(t.shaft, a.shaft); end Gears;\n"
    )
    answer = lmoc("show", "--stage", "normalize", path)
    assert answer.code == 0
    assert "    a.theta\n" in answer.out and "b.theta" not in answer.out
    ratio, leverage, inertia = re.search(
        r"(#\d+) := 1/g\.N\n.*(#\d+) := b\.J\*\1\n.*(#\d+) := \1\*\2\n", answer.out, re.DOTALL
    ).groups()
    assert f"(a.J + {inertia})*der(der(a.theta)) - #" in answer.out
    assert f"b.energy - b.J*({ratio}*der(a.theta))^2/2 = 0" in answer.out and leverage != inertia
