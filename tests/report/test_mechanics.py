"""Remarks that speak of the mechanics: what cannot move, springs far from relaxed, negative coefficients, rest."""

import pytest
from conftest import ROOT
from oracles.models import compiled

import lmoc

OSCILLATOR = """model M
  Fixed wall;
  Spring spring({spring});
  Mass mass(m = 2{mass});
equation
  connect(wall.flange, spring.a);
  connect(spring.b, mass.flange);
{more}end M;
"""


def oscillator(spring: str = "k = 50", mass: str = "", more: str = "") -> lmoc.DAE:
    return lmoc.compile_text(OSCILLATOR.format(spring=spring, mass=mass, more=more))


def said(notes, code: str) -> list[str]:
    return [d.message for d in notes if d.code == code]


def test_what_holds_a_mass_is_named():
    dae = oscillator(more="  connect(mass.flange, wall.flange);\n")
    (message,) = said(dae.check(), "N0424")
    assert message == "mass cannot move: connect(mass.flange, wall.flange) in line 8 ties it to wall"
    assert said(dae.simulate(stop=1).notes, "N0424") == [message] and not said(dae.simulate(stop=1).notes, "N0562")
    with pytest.raises(lmoc.ModelError) as error:
        oscillator(mass=", v(start = 1, fixed = true)", more="  connect(mass.flange, wall.flange);\n").check()
    (only,) = error.value.diagnostics
    assert only.code == "E0531" and only.hint == "connect(mass.flange, wall.flange) in line 8 ties it to wall"


@pytest.mark.parametrize(
    ("text", "held"),
    [
        ("Fixed wall; Rod rod(L = 2); Mass a(m = 1); Mass b(m = 1); Spring s(k = 3); equation connect(s.a, a.flange);"
         "connect(wall.flange, rod.a); connect(rod.b, a.flange); connect(s.b, b.flange);",
         ["a cannot move: connect(wall.flange, rod.a) in line 1 ties it to wall through rod"]),
        ("FixedShaft wall; Gear gear(N = 2); Inertia rotor(J = 1); Mass free(m = 1); equation"
         " connect(rotor.shaft, gear.a); connect(gear.b, wall.shaft);",
         ["rotor cannot move: connect(rotor.shaft, gear.a) in line 1 ties it to wall through gear"]),
        ("import Planar.*; inner World world; Ground ground; Weld weld; Body body(m = 1, J = 1); equation"
         " connect(ground.frame, weld.a); connect(weld.b, body.frame);",
         ["body cannot move: connect(weld.b, body.frame) in line 1 ties it to ground through weld"]),
        ("import Planar.*; inner World world; Ground ground; Revolute pin; Bar bar(l = 1, m = 1); equation"
         " connect(ground.frame, pin.a); connect(pin.b, bar.a);", []),
        ("Motion hand(q = sin(time)); Mass mass(m = 1); equation connect(hand.flange, mass.flange);", []),
        ("Fixed wall(q0 = 1); Mass m[2](each m = 1); Spring s(k = 1); equation connect(m[2].flange, wall.flange);"
         "connect(wall.flange, s.a); connect(s.b, m[1].flange);",
         ["m[2] cannot move: connect(m[2].flange, wall.flange) in line 1 ties it to wall"]),
    ],
)  # fmt: skip
def test_what_cannot_move_and_only_that(text, held):
    assert said(lmoc.compile_text(f"model M {text} end M;").check(), "N0424") == held


def test_a_spring_far_from_relaxed_is_told_with_its_length_and_force():
    (message,) = said(oscillator("k = 50, d0 = 5").check(), "N0561")
    assert message == "spring is compressed by 5 m at the start: it is relaxed at 5 m, its ends are 0 m apart"
    (d,) = [d for d in oscillator("k = 50, d0 = 5").simulate(stop=1).notes if d.code == "N0561"]
    assert "that gives 250 N" in d.hint
    (message,) = said(oscillator(mass=", q(start = 3, fixed = true)").check(), "N0561")
    assert message.startswith("spring is stretched by 3 m") and "its ends are 3 m apart" in message
    for spring, mass in (("k = 50, d0 = 0.9", ""), ("k = 50, L = 5", ""), ("k = 50, L = 5, d0 = 4.5", "")):
        assert not said(oscillator(spring, mass).check(), "N0561")


def test_springs_of_the_plane_and_of_shafts():
    twisted = """model M FixedShaft wall; TorsionSpring s(k = 2); Inertia rotor(J = 1, theta(start = 7, fixed = true));
    equation connect(wall.shaft, s.a); connect(s.b, rotor.shaft); end M;"""
    (message,) = said(lmoc.compile_text(twisted).check(), "N0561")
    assert message == "s is twisted by 7 rad at the start"
    plane = """model M import Planar.*; inner World world; Anchor a; Spring s(k = 2, d0 = {d0});
    PointMass p(m = 1, x(start = 3, fixed = true), y(start = 0, fixed = true)); equation
    connect(a.point, s.a); connect(s.b, p.point); end M;"""
    (message,) = said(lmoc.compile_text(plane.format(d0=1)).check(), "N0561")
    assert message == "s is stretched by 2 m at the start: it is relaxed at 1 m, its ends are 3 m apart"
    assert not said(lmoc.compile_text(plane.format(d0=0)).check(), "N0561")


def test_negative_coefficients_are_told_and_allowed():
    assert said(oscillator("k = -50").check(), "W0560") == [
        "spring.k = -50 N/m is a negative stiffness: it pushes away from its relaxed length"
    ]
    assert not said(oscillator().check(), "W0560")
    assert len(said(oscillator().simulate(stop=1, parameters={"spring.k": -1}).notes, "W0560")) == 1
    damped = """model Shock "a user's own" extends Damper; end Shock;
    model M Fixed wall; Shock d[2](c = {1, -2}); Mass m(m = 1); TorsionDamper t(c = -1); Inertia i(J = 1); FixedShaft f;
    equation connect(wall.flange, d[1].a); connect(wall.flange, d[2].a); connect(d[1].b, m.flange);
    connect(d[2].b, m.flange); connect(f.shaft, t.a); connect(t.b, i.shaft); end M;"""
    found = said(lmoc.compile_text(damped).check(), "W0560")
    assert [m.split(" is")[0] for m in found] == ["d[2].c = -2 N.s/m", "t.c = -1 N.m.s/rad"]
    for wrong in ("Mass m(m = -1);", "Inertia m(J = -1);", "Disk m(m = 1, r = -1);"):
        with pytest.raises(lmoc.ModelError, match="E0551"):
            lmoc.compile_text(f"model M {wrong} end M;").check()


def test_a_scene_at_rest_is_told():
    dae = oscillator()
    assert len(said(dae.simulate(stop=1).notes, "N0562")) == 1
    assert not said(dae.simulate(stop=1, initial={"mass.v": 0.1}).notes, "N0562")
    moved = "model M Motion hand(q = sin(time)); Mass mass(m = 1); equation connect(hand.flange, mass.flange); end M;"
    assert not said(lmoc.compile_text(moved).simulate(stop=1).notes, "N0562")
    late = "model M Mass m(m = 1); Force f(f = if time > 0.5 then 1 else 0); equation connect(f.flange, m.flange); "
    late += "end M;"
    assert not said(lmoc.compile_text(late).simulate(stop=1).notes, "N0562")


@pytest.mark.parametrize("folder", ["notes", "laws", "planar"])
def test_sound_scenes_have_no_such_remarks(folder):
    for path in sorted((ROOT / "models" / folder).glob("*.lmo")):
        dae = compiled(path)
        notes = dae.simulate(points=20).notes if folder == "notes" else dae.check()
        assert not [d for d in notes if d.code in ("W0560", "N0561", "N0562", "N0424")], path.name
