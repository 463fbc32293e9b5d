"""Equations: branches over parameters, conditional parts, derivatives, checks, initial equations, kinds, attributes."""

import numpy as np
import pytest
from oracles.flattening import attribute, codes, equations, flat, value

from lmoc.expression.text import to_text
from lmoc.ir.flat import Kind, StateSelect
from lmoc.semantics import equations as equation_module
from lmoc.semantics.values import array_builtins, constructors

BRANCH = """
model B parameter Integer kind = 1; Real x;
equation
  if kind == 1 then x = 1; elseif kind == 2 then x = 2*time; else x = 3; end if;
end B;
"""


@pytest.mark.parametrize(("kind", "expected"), [(1, "b.x = 1"), (2, "b.x = 2*time"), (7, "b.x = 3")])
def test_if_equations_take_one_branch(kind: int, expected: str) -> None:
    dae = flat(BRANCH + f"model A B b(kind = {kind}); end A;", library=False)
    assert equations(dae) == [expected]
    assert [b.structural for b in dae.blocks if b.pattern == "b.kind"] == [True]


def test_if_equations_that_differ_within_an_array() -> None:
    dae = flat(BRANCH + "model A B b[4](kind = {2, 1, 3, 2}); end A;", library=False)
    assert sorted(equations(dae)) == ["b[1].x = 2*time", "b[2].x = 1", "b[3].x = 3", "b[4].x = 2*time"]
    assert sorted(g.rows for g in dae.groups if g.origin == "equation") == [1, 1, 2]


def test_if_equations_in_long_loops(monkeypatch) -> None:
    for module in (constructors, equation_module, array_builtins):
        monkeypatch.setattr(module, "WRITTEN_OUT", 0)
    dae = flat(
        """model A parameter Integer n = 6; Real x[n];
        equation
          for i in 1:n loop
            if i == 1 then x[i] = 0; elseif mod(i, 2) == 0 then x[i] = i*time; else x[i] = x[i - 1]; end if;
          end for;
        end A;""",
        library=False,
    )
    assert sorted(equations(dae)) == [
        "x[1] = 0", "x[2] = 2*time", "x[3] = x[2]", "x[4] = 4*time", "x[5] = x[4]", "x[6] = 6*time",
    ]  # fmt: skip


def test_conditional_parts_and_their_connections() -> None:
    text = """model A parameter Boolean damped = true;
        Fixed w; Spring s(k = 1); Mass m(m = 1); Damper d(c = 1) if damped;
      equation
        connect(w.flange, s.a); connect(s.b, m.flange); connect(w.flange, d.a); connect(d.b, m.flange);
      end A;"""
    with_damper, without = flat(text), flat(text, damped=False)
    assert with_damper.find("d.f") is not None and without.find("d.f") is None
    assert "s.b.f + m.flange.f = 0" in [without.sum_text(i) for i in range(without.sums.rows)]
    assert not without.notes


def test_a_conditional_part_that_is_absent_cannot_be_used() -> None:
    assert codes("model A parameter Boolean on = false; Mass m(m = 1) if on; Real x = m.q; end A;") == ["E0218"]


def test_conditions_that_differ_within_an_array_are_refused() -> None:
    found = codes("""
        model B parameter Boolean on = true; Real x = 1 if on; end B;
        model A B b[2](on = {true, false}); end A;""")
    assert found == ["E0220"]


def test_derivatives_of_expressions() -> None:
    dae = flat(
        """model A parameter Real k = 2; input Real u; Real x; Real y; Real z;
        equation der(k*x) = 1; y = der(x*u); z = der(sin(der(x)) + time^2); end A;""",
        library=False,
    )
    assert equations(dae) == [
        "k*der(x) = 1",
        "y = der(x)*u + x*der(u)",
        "z = cos(der(x))*der(der(x)) + 2*time",
    ]


def test_there_is_no_derivative_of_a_parameter() -> None:
    assert codes("model A parameter Real p = 1; Real x = der(p); end A;") == ["E0309"]


def test_initial_equations_and_start_values() -> None:
    dae = flat("""model A parameter Real x0 = 2; Real x(start = x0, fixed = true, nominal = 3); Real y(start = 1);
      initial equation der(y) = 0;
      equation der(x) = -x; der(y) = x - y; end A;""")
    assert [dae.row_text(g, 0) for g in dae.initial_groups] == ["der(y) = 0"]
    assert attribute(dae, dae.starts, "x") == 2
    assert attribute(dae, dae.fixed, "x") == 1
    assert attribute(dae, dae.nominals, "x") == 3
    assert sum(len(a.target) for a in dae.fixed) == 1


def test_checks() -> None:
    dae = flat("""model A parameter Real k = 1; Real x(start = 0);
      equation der(x) = k; assert(x < 3, "x is " + "large"); assert(k > 0, "k", AssertionLevel.warning); end A;""")
    first, second = dae.checks
    assert (first.message, first.error) == ("x is large", True)
    assert (second.message, second.error) == ("k", False)
    assert to_text(first.condition) == "#0 < 3"


def test_inputs_and_outputs() -> None:
    dae = flat("""model A input Real u = 2*time; input Real w; output Real y = u + w; Force f(f = u); Mass m(m = 1);
      equation connect(f.flange, m.flange); end A;""")
    kinds = {b.pattern: b for b in dae.blocks}
    assert kinds["u"].kind == kinds["w"].kind == Kind.INPUT
    assert kinds["y"].output and not kinds["u"].output
    assert kinds["f.f"].kind == Kind.UNKNOWN and "f.f = u" in equations(dae, "binding")
    (default,) = [a for a in dae.bindings if a.target[0] == kinds["u"].offset]
    assert default.values(np.zeros(dae.count), 3.0) == [6]


def test_state_selection_and_enumerations() -> None:
    dae = flat("""model A
      type Mode = enumeration(slow, fast);
      parameter Mode mode = Mode.fast;
      Real x(stateSelect = StateSelect.prefer);
      equation der(x) = if mode == Mode.fast then 2 else 1; end A;""")
    blocks = {b.pattern: b for b in dae.blocks}
    assert blocks["x"].state_select == StateSelect.prefer
    assert value(dae, "mode") == 2


def test_if_expressions_over_parameters_stay_free() -> None:
    dae = flat("model A parameter Boolean b = true; Real x = if b then 1 else time; end A;")
    assert equations(dae) == ["x = if b then 1 else time"]
    assert not dae.notes
    assert not any(b.structural for b in dae.blocks)


def test_kinks_are_warned_of_once_for_each_place() -> None:
    dae = flat("""model B Real x; Real y = abs(x); equation der(x) = if x > 1 then 1 else -1; end B;
        model A B b, c; Real z = noEvent(abs(b.x)) + smooth(0, if b.x > 0 then 1 else 2); Real w = abs(-3); end A;""")
    assert [n.code for n in dae.notes] == ["W0311"]


def test_the_experiment_annotation() -> None:
    dae = flat("model A Real x = 1; annotation(experiment(StopTime = 2.5, Tolerance = 1e-8, Interval = 0.1)); end A;")
    assert (dae.experiment.start, dae.experiment.stop) == (None, 2.5)
    assert (dae.experiment.tolerance, dae.experiment.interval) == (1e-8, 0.1)


def test_types_are_checked() -> None:
    assert codes("model A Real x = true; end A;") == ["E0301"]
    assert codes("model A parameter Integer n = 2.5; end A;") == ["E0301"]
    assert codes("model A Real x = if 1 then 2 else 3; end A;") == ["E0301"]
    assert codes("model A Real x; equation x = 1 and 2; end A;") == ["E0301"]
    assert codes("model A parameter Boolean b = 1 < true; end A;") == ["E0301"]


def test_columns_hold_one_kind_each() -> None:
    dae = flat(
        """model A input Real u; parameter Real p = 1; Real x[3]; Mass m[2](each m = p, g = {1, p});
      equation x = {u, p, m[1].q}; m.flange.f = {0, 0}; end A;""".replace("m.flange.f = {0, 0};", "")
    )
    for group in dae.groups:
        for column in dae.kind[group.slots].T:
            assert len(set(column.tolist())) == 1


def test_limits_of_parameters_are_checks() -> None:
    dae = flat("model A parameter Real k(min = 0, max = top) = 1; parameter Real top = 5; Real x(min = 0) = k; end A;")
    values = dae.parameter_values()
    low, high = dae.checks
    assert low.message == "'k' must be at least 0" and high.message == "'k' must be at most top"
    assert [dae.variable_name(int(v)) for v in high.slots[0]] == ["k", "top"]
    assert values[dae.find("k")] == 1


def test_constants_need_values() -> None:
    assert codes("model A constant Real c; Real x = c; end A;") == ["E0212"]
