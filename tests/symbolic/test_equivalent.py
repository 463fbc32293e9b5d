"""Equivalent constants of networks (sections 7 and 8 of the notes)."""

import pytest
import sympy as sp
from oracles.symbolic_truth import ROOT, equal

import lmoc as package
from lmoc.messages.diagnostics import ModelError
from lmoc.symbolic.equivalent import equivalent

k1, k2, c1, c2, c, m, J, J1, J2, N, r, s = sp.symbols("k1 k2 c1 c2 c m J J1 J2 N r s")


def flat_model(text: str):
    from lmoc.messages.source import Source
    from lmoc.pipeline import Clock, Scene, flatten, parse

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
    dae = package.compile(ROOT / "models/notes/s7_1_springs_in_series.lmo")
    assert equal(dae.equivalent("mass.flange").stiffness, k1 * k2 / (k1 + k2))


PARTS = """
model Parts
  parameter Real l1 = 0.5, l2 = 1, k = 3, m = 2, c = 4, r = 0.1, Js = 1, Jc = 2, rho = 2;
  Fixed wall;
  FixedShaft frame;
  Lever lever(l1 = l1, l2 = l2, smallAngle = true);
  Spring levered(k = k), hung(k = k), wound(k = k);
  Damper damper(c = c);
  Mass weight(m = m), load(m = m);
  Inertia beam(J = Js), drumBody(J = Js), sun(J = Js), carrier(J = Jc);
  Pulley pulley;
  Drum drum(r = r);
  PlanetaryGear planets(ratio = rho);
equation
  connect(wall.flange, levered.a);
  connect(levered.b, lever.a);
  connect(lever.b, weight.flange);
  connect(wall.flange, damper.a);
  connect(damper.b, lever.b);
  connect(lever.pivot, beam.shaft);
  connect(wall.flange, pulley.a);
  connect(wall.flange, hung.a);
  connect(hung.b, pulley.b);
  connect(pulley.axle, load.flange);
  connect(wall.flange, wound.a);
  connect(wound.b, drum.flange);
  connect(drum.shaft, drumBody.shaft);
  connect(planets.sun, sun.shaft);
  connect(planets.carrier, carrier.shaft);
  connect(planets.ring, frame.shaft);
end Parts;
"""
l1, l2, k, Js, Jc, rho = sp.symbols("l1 l2 k Js Jc rho")


@pytest.mark.parametrize(
    ("port", "stiffness", "damping", "inertia"),
    [
        ("lever.pivot", k * l1**2, c * l2**2, Js + m * l2**2),
        ("load.flange", 4 * k, 0, m),
        ("drumBody.shaft", k * r**2, 0, Js),
        ("sun.shaft", 0, 0, Js + Jc / (1 + rho) ** 2),
    ],
)
def test_constants_through_transmissions(port, stiffness, damping, inertia):
    result = found(flat_model(PARTS), port)
    assert equal(result.stiffness, stiffness) and equal(result.damping, damping) and equal(result.inertia, inertia)


def test_a_shaft_and_a_flange_are_tied_by_no_one_law():
    with pytest.raises(ModelError, match="moves in rad and 'load.flange' in m"):
        found(flat_model(PARTS), "lever.pivot", "load.flange")


OUTER = """
model Held "a part with a port of its own"
  parameter Real k = 2, m = 3;
  Flange p; Spring s(k = k); Mass mass(m = m); Fixed w;
equation
  connect(s.a, w.flange); connect(s.b, p); connect(mass.flange, p);
end Held;
model Scene
  parameter Real k = 2, k1 = 1, k2 = 1, m = 3, J = 4, c = 5, N = 2;
  Flange p, q; Shaft shaft;
  Held alone(k = k, m = m), wired(k = k, m = m);
  Mass load(m = m);
  Spring s(k = k), s1(k = k1), s2(k = k2);
  Damper d(c = c);
  Gear gear(N = N); Inertia rotor(J = J); Fixed w;
equation
  connect(wired.p, load.flange);
  connect(w.flange, s.a); connect(s.b, p);
  connect(p, s1.a); connect(s1.b, s2.a); connect(s2.b, q); connect(d.a, p); connect(q, d.b);
  connect(shaft, gear.a); connect(gear.b, rotor.shaft);
end Scene;
"""


@pytest.mark.parametrize(
    ("ports", "constants"),
    [
        (("alone.p",), (k, 0, m)),
        (("alone.s.b",), (k, 0, m)),
        (("wired.p",), (k, 0, 2 * m)),
        (("load.flange",), (k, 0, 2 * m)),
        (("p",), (k, 0, 0)),
        (("p", "q"), (k1 * k2 / (k1 + k2), c, 0)),
        (("q", "p"), (k1 * k2 / (k1 + k2), c, 0)),
        (("s1.a", "q"), (k1 * k2 / (k1 + k2), c, 0)),
        (("shaft",), (0, 0, J / N**2)),
    ],
)
def test_ports_that_are_connected_from_inside(ports, constants):
    result = found(flat_model(OUTER), *ports)
    assert all(equal(*pair) for pair in zip((result.stiffness, result.damping, result.inertia), constants, strict=True))


def test_command_for_a_network_that_nothing_holds(lmoc, tmp_path):
    file = tmp_path / "series.lmo"
    file.write_text(
        "model Series parameter Real k1 = 1, k2 = 2; Spring s1(k = k1), s2(k = k2); "
        "equation connect(s1.b, s2.a); end Series;"
    )
    answer = lmoc("equivalent", file, "s1.a", "s2.b")
    assert answer.code == 0 and answer.out == "k_eq = k1·k2/(k1 + k2)\n" and answer.err == ""
    assert '"stiffness": "k1*k2/(k1 + k2)"' in lmoc("equivalent", file, "s1.a", "s2.b", "--json").out
    assert lmoc("equivalent", file, "s1.c").code == 2
    assert "no linear law" in lmoc("equivalent", file, "s1.a").err
