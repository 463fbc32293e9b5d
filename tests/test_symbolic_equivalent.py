"""Equivalent constants of networks (sections 7 and 8 of the notes)."""

import pytest
import sympy as sp
from symbolic_truth import ROOT, equal

import lmoc
from lmoc.diagnostics import ModelError
from lmoc.symbolic.equivalent import equivalent

k1, k2, c1, c2, c, m, J, J1, J2, N, r, s = sp.symbols("k1 k2 c1 c2 c m J J1 J2 N r s")


def flat_model(text: str):
    from lmoc.pipeline import Clock, Scene, flatten, parse
    from lmoc.source import Source

    return flatten(Scene(parse([Source("model.lmo", text)], Clock())), Clock())


def of_notes(file: str):
    return flat_model((ROOT / "models/notes" / file).read_text())


def found(flat, *ports):
    return equivalent(flat, flat.parameter_values(), *ports)


@pytest.mark.parametrize(
    ("file", "port", "constant", "expected"),
    [
        ("s7_1_springs_in_parallel.lmo", "mass.flange", "stiffness", k1 + k2),
        ("s7_1_springs_in_series.lmo", "mass.flange", "stiffness", k1 * k2 / (k1 + k2)),
        ("s7_2_dampers_in_parallel.lmo", "mass.flange", "damping", c1 + c2),
        ("s7_2_dampers_in_series.lmo", "mass.flange", "damping", c1 * c2 / (c1 + c2)),
        ("s7_3_torsional_springs_in_series.lmo", "rotor.shaft", "stiffness", k1 * k2 / (k1 + k2)),
        ("s7_3_torsional_springs_in_parallel.lmo", "rotor.shaft", "stiffness", k1 + k2),
        ("s8_gears.lmo", "gear2.shaft", "inertia", J1 * N**2 + J2),
        ("s8_gears.lmo", "gear1.shaft", "inertia", J1 + J2 / N**2),
        ("ex08_cable_around_cylinder.lmo", "mass.flange", "inertia", m + J / r**2),
    ],
)
def test_constants_of_the_notes(file, port, constant, expected):
    assert equal(getattr(found(of_notes(file), port), constant), expected)


NETWORK = """
model Network
  parameter Real k1 = 1, k2 = 2, c = 3;
  Fixed wall;
  Spring s1(k = k1), s2(k = k2);
  Damper d(c = c);
equation
  connect(wall.flange, s1.a);
  connect(s1.b, s2.a);
  connect(s2.a, d.a);
  connect(s2.b, d.b);
end Network;
"""


def test_between_two_ports():
    result = found(flat_model(NETWORK), "s2.a", "s2.b")
    assert equal(result.dynamic_stiffness, k2 + c * s)
    assert (result.stiffness, result.damping, result.inertia) == (k2, c, 0)
    assert str(result) == "k_eq = k2\nc_eq = c"


def test_no_single_spring_and_damper():
    result = found(flat_model(NETWORK), "d.b")
    assert result.stiffness is None
    assert equal(result.dynamic_stiffness, 1 / (1 / k1 + 1 / (k2 + c * s)))
    assert str(result) == "force/displacement = (c·k1·s + k1·k2)/(c·s + k1 + k2)"


def test_rotational_constant_is_named_so():
    assert str(found(of_notes("s8_gears.lmo"), "gear2.shaft")) == "J_eq = J1·N² + J2"


def test_a_wall_is_held():
    with pytest.raises(ModelError, match="is held"):
        found(flat_model(NETWORK), "wall.flange")


def test_unknown_port():
    with pytest.raises(ModelError, match="no port 's2.c'"):
        found(flat_model(NETWORK), "s2.c")


def test_method_of_the_compiled_scene():
    dae = lmoc.compile(ROOT / "models/notes/s7_1_springs_in_series.lmo")
    assert equal(dae.equivalent("mass.flange").stiffness, k1 * k2 / (k1 + k2))
