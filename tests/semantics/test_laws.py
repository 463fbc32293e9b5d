"""Laws: the pairs that each part of the library gives, that they are conjugate, and wrong uses."""

import numpy as np
import pytest
from oracles.flattening import flat, flatten_text, mistakes
from oracles.register_machine import Machine

from lmoc.expression.dag import const, slot
from lmoc.ir.flat import Group, Kind
from lmoc.ir.law import COMPLEMENTARY, LawKind, law_count
from lmoc.ir.mode import with_mode
from lmoc.structure.reduce import reduce

LINE = "model A Mass m1(m = 2), m2(m = 3), m3(m = 5); {} x({}); equation {} end A;"
ROTATION = "model A Inertia m1(J = 2), m2(J = 3); Mass m3(m = 5); {} x({}); equation {} end A;"
TWO = "connect(m1.flange, x.a); connect(x.b, m2.flange);"
SHAFTS = "connect(m1.shaft, x.a); connect(x.b, m2.shaft);"
PULLEY = TWO + "connect(m3.flange, x.axle);"
DRUM = "connect(m1.shaft, x.shaft); connect(x.flange, m3.flange);"
BRAKE = "connect(m1.shaft, x.shaft);"

# part, its modifications, connections: kinds, closing and opening events
PARTS = {
    "cable": (LINE, "Cable", "L = 1, e = 0.5", TWO, [("unilateral", "taut", "slack")]),
    "stop": (LINE, "Stop", "L = 1", TWO, [("unilateral", "contact", "release")]),
    "pulley": (LINE, "StringPulley", "", PULLEY, [("unilateral", "taut", "slack")]),
    "pulley towards": (LINE, "StringPulley", "sense = -1", PULLEY, [("unilateral", "taut", "slack")]),
    "drum": (ROTATION, "StringDrum", "r = 0.3", DRUM, [("unilateral", "taut", "slack")]),
    "drum towards": (ROTATION, "StringDrum", "r = 0.3, sense = -1", DRUM, [("unilateral", "taut", "slack")]),
    "friction": (LINE, "DryFriction", "F = 4", TWO, [("dry friction", "stick", "slip")]),
    "friction of a load": (
        LINE, "DryFriction", "useLoad = true, mu = 0.5, load = 9 + time", TWO, [("dry friction", "stick", "slip")],
    ),
    "bearing": (ROTATION, "BearingFriction", "tau = 4, tauStick = 5", SHAFTS, [("dry friction", "stick", "slip")]),
    "clutch": (ROTATION, "Clutch", "tau = 4, engagement = time", SHAFTS, [("dry friction", "lock", "unlock")]),
    "brake": (ROTATION, "Brake", "tau = 4", BRAKE, [("dry friction", "lock", "unlock")]),
    "ratchet": (ROTATION, "Ratchet", "", SHAFTS, [("one-way", "lock", "unlock")]),
    "backlash": (
        ROTATION, "Backlash", "clearance = 0.1, N = -2", SHAFTS, [("unilateral", "contact", "release")] * 2,
    ),
}  # fmt: skip


def part(name: str):
    frame, cls, modifications, connects, _ = PARTS[name]
    return flat(frame.format(cls, modifications, connects))


@pytest.mark.parametrize("name", PARTS)
def test_the_pairs_of_a_part(name: str) -> None:
    dae = part(name)
    assert [(g.kind.value, g.closing, g.opening) for g in dae.laws] == PARTS[name][-1]
    for g in dae.laws:
        assert g.rows == 1 and dae.parts[g.part].pattern == "x"
        assert dae.kind[g.force].tolist() == dae.kind[g.motion].tolist() == [Kind.UNKNOWN]
        assert (g.restitution is not None) == (g.kind is LawKind.UNILATERAL)
        assert (g.slip is not None) == (g.stick is not None) == (g.kind is LawKind.DRY_FRICTION)
        assert (g.direction is None) == (g.kind in COMPLEMENTARY)
        assert g.direction is None or dae.kind[g.direction].tolist() == [Kind.DISCRETE]
        assert g.span.text.startswith("Law.")


@pytest.mark.parametrize(("name", "own"), [(name, k) for name, p in PARTS.items() for k in range(len(p[-1]))])
def test_force_and_motion_are_conjugate(name: str, own: int) -> None:
    """The kinetic energy grows by force · rate, where the force is a number and the other laws are open."""
    dae = part(name)
    force = [0.0] * law_count(dae.laws)
    force[own] = 3.7
    groups = [Group(slot(0), const(force[k]), g.force[:, None], None, g.part, "law") for k, g in enumerate(dae.laws)]
    closed = with_mode(dae, np.zeros(len(dae.laws), bool))
    fixed = [g for g in closed.groups if g.origin != "law"]
    object.__setattr__(closed, "groups", (*fixed, *groups))
    reduced = reduce(closed)
    machine = Machine(reduced)
    y = np.random.default_rng(3).normal(size=len(reduced.states) + len(reduced.quadratures))
    value = machine.variables(y, 0.7)
    power = 0.0
    for body, inertia in (("m1", "m"), ("m2", "m"), ("m3", "m"), ("m1", "J"), ("m2", "J")):
        names = [f"{body}.{inertia}", *(f"{body}.{v}" for v in (("v", "a") if inertia == "m" else ("omega", "alpha")))]
        found = [dae.find(n) for n in names]
        if all(f is not None for f in found):
            power += np.prod([value[f[0]] for f in found])
    law = dae.laws[own]
    rates = [int(law.motion[0])]
    if law.kind is LawKind.UNILATERAL:  # the rate of the gap: one more equation in the same scene
        h = 1e-6
        slope = machine.derivative(y, 0.7)
        after = Machine(reduced).variables(y + h * slope, 0.7 + h)[rates[0]]
        before = Machine(reduced).variables(y - h * slope, 0.7 - h)[rates[0]]
        rate = (after - before) / (2 * h)
        assert power == pytest.approx(3.7 * rate, rel=1e-6)
    else:
        assert power == pytest.approx(3.7 * value[rates[0]], rel=1e-12)


@pytest.mark.parametrize("name", PARTS)
def test_closed_and_open_modes_reduce(name: str) -> None:
    """Each closed law takes one coordinate (two states) or one velocity away."""
    dae = part(name)
    count = law_count(dae.laws)
    free = reduce(with_mode(dae, np.zeros(count, bool)))
    for k in range(count):
        closed = reduce(with_mode(dae, np.arange(count) == k))
        taken = 2 if dae.laws[k].kind is LawKind.UNILATERAL else 1
        integrated = [len(r.states) + len(r.quadratures) for r in (free, closed)]
        assert integrated[0] - integrated[1] == taken


def test_laws_in_arrays_are_one_group() -> None:
    dae = flat(
        """model A parameter Integer n = 1000; Mass m[n](each m = 1); Cable c[n - 1](each L = 0.1);
        equation
        for i in 1:n - 1 loop connect(m[i].flange, c[i].a); connect(c[i].b, m[i + 1].flange); end for; end A;"""
    )
    (laws,) = dae.laws
    assert laws.rows == 999
    assert [dae.variable_name(int(laws.motion[k])) for k in (0, 998)] == ["c[1].gap", "c[999].gap"]
    assert len(with_mode(dae, np.arange(999) % 2 == 0).groups) == len(dae.groups) + 2


def test_laws_of_ones_own() -> None:
    dae = flatten_text(
        """model M "three hooks on one rail, of which one is a number of its own"
          Real q[3], v[3], f[3]; parameter Real e = 0.3;
        equation
          for i in 1:3 loop
            v[i] = der(q[i]); der(v[i]) = f[i] - 1;
            Law.unilateral(f[i], q[i] - i/10, e, opening = "off");
          end for;
        end M;""",
        None,
        {},
    )
    (laws,) = dae.laws
    assert laws.rows == 3 and laws.opening == "off" and laws.closing == "contact"
    assert [dae.variable_name(int(v)) for v in laws.force] == ["f[1]", "f[2]", "f[3]"]
    assert sum(g.rows for g in dae.groups if g.origin == "argument") == 3
    assert reduce(with_mode(dae, np.array([True, False, True]))).counts["states"] == 2


MODEL = "model A Real x, f; equation der(x) = f; {} end A;"


@pytest.mark.parametrize(
    ("equation", "code", "place"),
    [
        ("Law.unilateral(f, x, e = x);", "E0211", "x"),
        ("Law.unilateral(0, x);", "E0233", "0"),
        ("Law.unilateral(f);", "E0217", "Law.unilateral(f)"),
        ("Law.unilateral(f, x, g = 1);", "E0217", "Law.unilateral(f, x, g = 1)"),
        ("Law.unilateral(f, x, 0, \"a\", \"b\", 1);", "E0217", None),
        ("Law.unilateral(f, x > 0);", "E0301", "x > 0"),
        ("Law.unilateral({f, f}, x);", "E0302", "{f, f}"),
        ("Law.oneWay(f, x, closing = 3);", "E0301", "3"),
        ("Law.unilateral(f, f, f = f);", "E0217", None),
    ],
)  # fmt: skip
def test_wrong_arguments(equation: str, code: str, place: str | None) -> None:
    (found,) = mistakes(MODEL.format(equation))
    assert found.code == code
    if place is not None:
        assert found.span.text.strip(" ;") == place


def test_a_law_whose_units_give_no_energy() -> None:
    text = 'model A Units.Position x; Real f(unit = "N.m"); equation der(x) = time; Law.unilateral(f, x); end A;'
    (found,) = mistakes(text)
    assert found.code == "E0303" and "energy" in found.message


def test_a_law_counts_as_an_equation() -> None:
    (found,) = mistakes("model A Real x, f; equation der(x) = f; f = 2; Law.unilateral(f, x); end A;")
    assert found.code == "E0307"


@pytest.mark.parametrize(
    ("section", "where"),
    [
        ("initial equation Law.unilateral(f, x); equation f = 1;", "an initial equation"),
        ("equation when time > 0.5 then Law.unilateral(f, x); end when; f = 1;", "a 'when'"),
        ("equation if time > 0.5 then Law.unilateral(f, x); else f = 0; end if;", "a branch"),
        ("algorithm Law.unilateral(f, x); equation f = 1;", "an algorithm"),
        ("equation f = 1; algorithm when time > 1 then Law.unilateral(f, x); end when;", "an algorithm"),
    ],
)
def test_where_a_law_cannot_stand(section, where) -> None:
    found = mistakes(f"model A Real x, f; equation der(x) = f; {section} end A;")[0]
    assert found.code == "E0252" and where in found.message and "among the equations" in found.expected
