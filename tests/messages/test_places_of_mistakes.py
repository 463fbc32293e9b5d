"""What the caller has given is not blamed on the model; what is wrong in one round of a loop is told with the round."""

import pytest
from conftest import SPRING

import lmoc
from lmoc.messages.diagnostics import Diagnostic

ROAD = """\
model Road
  input Real u(unit = "m") = {};
  Motion base(q = u);
  Spring spring(k = 10);
  Mass mass(m = 1);
equation
  connect(base.flange, spring.a);
  connect(spring.b, mass.flange);
end Road;
"""

HANGING = """\
model Hanging
  parameter Real b = 0;
  parameter Real a = {};
  Fixed wall;
  Spring spring(k = {});
  Mass mass(m = 1);
equation
  connect(wall.flange, spring.a);
  connect(spring.b, mass.flange);
end Hanging;
"""


def diagnostics(text: str, **options) -> tuple[Diagnostic, ...]:
    with pytest.raises(lmoc.ModelError) as wrong:
        lmoc.compile_text(text).simulate(**options)
    return wrong.value.diagnostics


def test_values_given_for_a_run_have_no_place_in_the_model():
    (found,) = diagnostics(SPRING, initial={"spring.f": 7, "body.q": 3})
    assert found.code == "E0531" and found.span is None
    assert "--init, initial=): spring.f = 7 and body.q = 3" in found.hint


def test_a_value_of_the_model_that_one_given_contradicts_is_marked():
    text = ROAD.format(0).replace("m = 1", "m = 1, q(start = 0.5, fixed = true)")
    (found,) = diagnostics(text, initial={"spring.f": 7})
    assert found.code == "E0531" and (found.span.line, found.span.text) == (5, "0.5")
    assert "spring.f = 7" in found.hint and "mass.q" not in found.hint


@pytest.mark.parametrize("signal", ["1/time", "sqrt(-1 - time)", lambda t: float("inf")])
def test_a_signal_given_for_a_run_is_blamed_itself(signal):
    (found,) = (d for d in diagnostics(ROAD.format(0), inputs={"u": signal}) if d.severity == "error")
    assert found.code == "E0535" and found.span is None
    assert "the signal given for the input u has no finite value" in found.message


def test_a_signal_of_the_model_is_marked_where_it_is_declared():
    (found,) = diagnostics(ROAD.format("1/time"))
    assert found.code == "E0535" and found.span.line == 2 and found.span.text.startswith("input Real u")


@pytest.mark.parametrize("loop", ["1:3", "1:20"])  # unrolled, and all rounds at once
def test_the_round_of_a_loop_is_named(loop):
    text = f"""\
model Loop
  Mass m[20](each m = 1);
equation
  for i in {loop} loop
    connect(m[2].flange, m[i].flange);
  end for;
end Loop;
"""
    (found,) = (d for d in lmoc.compile_text(text).simulate(stop=0.1).notes if d.code == "W0314")
    assert (found.span.line, found.found) == (5, "i = 2")


@pytest.mark.parametrize(("value", "shown"), [("1/0", "inf"), ("1/b", "inf"), ("sqrt(b - 1)", "nan"), ("b/0", "nan")])
def test_a_parameter_that_loses_its_value_is_warned_of(value, shown):
    dae = lmoc.compile_text(HANGING.format(value, 2))
    (found,) = dae.check()
    assert dae.notes == (found,)
    assert found.code == "W0537" and found.message == f"a has no finite value ({shown})"
    assert found.span.line == 3 and found.span.text == value


@pytest.mark.parametrize("value", ["1/b", "b/0"])
def test_where_a_lost_parameter_spoils_the_equations_it_is_told_too(value):
    found = diagnostics(HANGING.format(value, "a"))
    assert found[0].code == "W0537" and found[-1].severity == "error"


def test_a_parameter_that_a_run_spoils_or_mends_is_told_of_in_that_run_only():
    dae = lmoc.compile_text(HANGING.format("1/b", 2))
    assert [n.code for n in dae.simulate(stop=1).notes if n.severity == "warning"] == ["W0537"]
    assert not [n for n in dae.simulate(stop=1, parameters={"b": 4}).notes if n.severity == "warning"]
    assert not [n for n in dae.simulate(stop=1, parameters={"a": 4}).notes if n.severity == "warning"]


def test_a_run_tells_where_it_broke_off():
    """x = 1/(1 − t): the run ends at 1 s, whatever times were asked for."""
    dae = lmoc.compile_text("model M Real x(start = 1, fixed = true); equation der(x) = x^2; end M;")
    with pytest.raises(lmoc.SimulationError) as caught:
        dae.simulate(stop=10, points=2)
    partial = caught.value.partial
    assert partial.broke_off == caught.value.time == pytest.approx(1, abs=1e-5)
    assert not partial.complete and partial.time[-1] <= partial.broke_off
    assert "broke off at 1 s" in repr(partial)
    from lmoc.report.summary import as_data, summary

    assert "at t = 1 s, where the run broke off" in summary(partial)
    assert as_data(partial)["broke_off"] == partial.broke_off
