"""Linear elimination on small systems whose answer is known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.flat_builder import flat_model

from lmoc.expression.text import to_text
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.structure.linear.derived import derived_values
from lmoc.structure.normalize import normalize


def reduced(text: str, states=None, **changed):
    flat = flat_model(text)
    values = flat.parameter_values({int(flat.find(k)[0]): v for k, v in changed.items()})
    return normalize(flat, values, states, Report())


def way_back(n, name: str) -> tuple[str, int, float, float]:
    """(root, order, factor, offset) of a variable, as numbers; a known variable has root "" and its value as offset."""
    i = int(n.flat.find(name)[0])
    known = n.all_values
    factor = {-1: 1.0, -2: -1.0}.get(int(n.factor[i])) or float(known[n.factor[i]])
    offset = 0.0 if n.offset[i] < 0 else float(known[n.offset[i]])
    root = int(n.root[i])
    if root >= n.flat.count or np.isfinite(n.values[root]):
        assert n.factor[i] == -1 and n.offset[i] == -1 and n.order[i] == 0
        return "", 0, 0.0, float(known[root])
    return n.flat.variable_name(root), int(n.order[i]), factor, offset


def equations(n) -> list[str]:
    """What is left, in names."""
    result = []
    for g in n.groups:
        for row in g.slots.tolist():
            names = [n.flat.variable_name(i) if i < n.flat.count else f"p{i}" for i in row]
            result.append(to_text(g.residual, lambda k, o, names=names: "der(" * o + names[k] + ")" * o))
    return result


def test_chain_of_equalities_has_the_differentiated_variable_as_root():
    n = reduced("var a b c d\na = b\nb = c\nd = c\nder(c) = 0 - c")
    assert [way_back(n, x) for x in "abd"] == [("c", 0, 1.0, 0.0)] * 3
    assert len(equations(n)) == 1


def test_signs_and_offsets():
    n = reduced("parameter L = 3\nvar x y z\ny = x + L\nz = -y\nder(x) = x")
    assert way_back(n, "y") == ("x", 0, 1.0, 3.0)
    assert way_back(n, "z") == ("x", 0, -1.0, -3.0)


def test_gear_train_is_the_product_of_its_ratios():
    ratios = [2.0, -3.0, 0.5, 7.0, 1.25]
    lines = [f"parameter N{i} = {r}" for i, r in enumerate(ratios)]
    lines += [f"var t{i}" for i in range(len(ratios) + 1)]
    lines += [f"t{i} = N{i}*t{i + 1}" for i in range(len(ratios))]
    n = reduced("\n".join([*lines, "der(t5) = t5"]))
    for i in range(len(ratios)):
        assert way_back(n, f"t{i}") == ("t5", 0, pytest.approx(np.prod(ratios[i:])), 0.0)
    assert len(n.groups) == 1 and n.counts["after elimination"] == 1


def test_one_gear_needs_no_derived_parameter():
    n = reduced("parameter N = 2\nvar a b\na = N*b\nder(b) = b")
    assert n.derived == () and way_back(n, "a") == ("b", 0, 2.0, 0.0)


def test_derived_parameters_follow_the_parameters():
    n = reduced("parameter N = 2\nparameter M = 3\nparameter L = 1\nvar a b c\na = N*b + L\nb = M*c - L\nder(c) = c")
    assert way_back(n, "a") == ("c", 0, 6.0, -1.0)
    values = n.flat.parameter_values({0: 5.0})
    i = int(n.flat.find("a")[0])
    new = np.concatenate([values, derived_values(n.derived, values)])
    assert new[n.factor[i]] == 15.0 and new[n.offset[i]] == -4.0
    assert all(g.holds(values) for g in n.guards)


def test_known_values_and_inputs_are_roots():
    n = reduced("parameter q0 = 4\ninput u\nvar x y z w\nx = q0\ny = x + 1\nz = u\nw = 2*z\nder(y) = w - w")
    assert way_back(n, "x") == ("", 0, 0.0, 4.0)
    assert way_back(n, "y") == ("", 0, 0.0, 5.0)
    assert way_back(n, "z") == ("u", 0, 1.0, 0.0)
    assert way_back(n, "w") == ("u", 0, 2.0, 0.0)


def test_prescribed_motion_gives_its_derivatives():
    n = reduced("input u\nparameter m = 2\nvar q v a f\nq = u\nv = der(q)\na = der(v)\nf = m*a")
    assert way_back(n, "v") == ("u", 1, 1.0, 0.0)
    assert way_back(n, "a") == ("u", 2, 1.0, 0.0)
    assert way_back(n, "f") == ("u", 2, 2.0, 0.0)
    assert n.groups == ()


def test_mass_on_a_wall_is_at_rest():
    n = reduced("parameter q0 = 1\nparameter m = 2\nparameter g = 9.81\nvar q v a f\n"
                "q = q0\nv = der(q)\na = der(v)\nm*a = f + m*g")  # fmt: skip
    assert [way_back(n, x)[3] for x in "qva"] == [1.0, 0.0, 0.0]
    assert way_back(n, "f") == ("", 0, 0.0, pytest.approx(-2 * 9.81))


def test_derivative_aliases_leave_the_coordinate():
    n = reduced("parameter m = 2\nparameter k = 8\nvar q v a\nv = der(q)\na = der(v)\nm*a = -k*q")
    assert way_back(n, "v") == ("q", 1, 1.0, 0.0)
    # a is then ± k/m·q by its own equation, or q'' by its definition: one equation stays
    assert n.counts["after elimination"] == 1


def test_equal_velocities_stay_a_constraint():
    n = reduced("var p q v w\nv = der(p)\nw = der(q)\nv = w\nder(v) = -p - q")
    assert n.counts["after elimination"] == 2
    assert any("der(p)" in e and "der(q)" in e for e in equations(n))


def test_circle_of_derivatives_is_cut():
    n = reduced("var x y\ny = der(x)\nx = der(y)")
    assert n.counts["after elimination"] == 1
    assert equations(n)[0].count("der(") == 2


def test_zero_inertia_drops_its_term_and_is_guarded():
    text = "parameter J = 0\nvar th w tau\nw = der(th)\nJ*der(w) = tau\nder(th) = th"
    n = reduced(text)
    assert way_back(n, "tau") == ("", 0, 0.0, 0.0)
    (guard,) = [g for g in n.guards if g.text == "J = 0"]
    assert guard.holds(n.values) and not guard.holds(n.flat.parameter_values({0: 1.0}))
    n = reduced(text, J=0.3)
    assert way_back(n, "tau") == ("th", 2, 0.3, 0.0)
    assert [g.text for g in n.guards] == ["J <> 0"]


def test_parameter_without_value_is_not_zero():
    n = reduced("parameter J\nvar w tau\nJ*der(w) = tau\nder(w) = w")
    assert way_back(n, "tau")[:2] == ("w", 1) and [g.text for g in n.guards] == ["J <> 0"]


def test_zero_terms_turn_sums_into_aliases():
    text = "parameter J = 0\nvar a\npotential t\nflow f g h\nJ*der(t) = f\nsum f + g + h\n"
    n = reduced(text + "der(t) = g\nder(a) = h - t")
    root = way_back(n, "h")[0]
    assert way_back(n, "g")[0] == root
    assert way_back(n, "h")[2] == -way_back(n, "g")[2]


def test_asked_and_preferred_states_become_roots():
    text = "parameter N = 2\nvar a b c\na = N*b\nc = b\nder(a) = c"
    assert way_back(reduced(text), "b") == ("a", 0, 0.5, 0.0)
    assert way_back(reduced(text, states=["b"]), "a") == ("b", 0, 2.0, 0.0)
    assert way_back(reduced(text + "\nprefer c"), "a") == ("c", 0, 2.0, 0.0)
    assert way_back(reduced(text + "\navoid a"), "a") == ("b", 0, 2.0, 0.0)


def test_a_state_that_does_not_exist_is_named():
    with pytest.raises(ModelError, match=r"E0414.*\n.*did you mean 'theta'"):
        reduced("var theta\nder(theta) = theta", states=["theta1"])


def test_a_spring_between_the_same_point_cancels():
    n = reduced("flow a b\nparameter m = 1\nvar x f F\na = f\nb = -f\nf = x**2\nm*der(der(x)) = F\nsum F + a + b")
    # F + f - f = 0
    assert "m*der(der(x))" in equations(n)


def test_long_sums_keep_a_term_with_a_factor_under_its_own_name():
    flows = [f"f{i}" for i in range(12)]
    lines = ["parameter N = 2", "var g total", "flow " + " ".join(flows), "f0 = N*g", "g = sin(total)"]
    lines += [f"f{i} = sin({i}*total)" for i in range(1, 12)]
    n = reduced("\n".join([*lines, "var x\nder(x) = total", "sum " + " + ".join([*flows, "total"])]))
    assert n.sums.rows == 1 and set(n.sums.coefficient.tolist()) == {1.0}
    # total is der(x), which is no variable of its own any more; f0 = 2·g: both keep their names in the sum
    names = {n.flat.variable_name(int(i)) for i in n.sums.index}
    assert {"f0", "total"} <= names
    assert n.counts["after elimination"] == len({int(r) for r in n.root[n.flat.kind == 3]})
