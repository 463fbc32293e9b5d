"""Parts of machines as textbooks draw them: belts about pulleys, cams under followers, racks, screws, unbalances."""

from math import hypot
from pathlib import Path

import numpy as np
import pytest
from oracles.models import compiled

import lmoc
from lmoc.view.scene.mounted import LIFT, PINION
from lmoc.view.scene.moving import Moving
from lmoc.view.scene.picture import Circle, Item, Picture
from lmoc.view.scene.picture import Path as Line

TEXTBOOK = Path(__file__).parents[2] / "models/textbook"
REST = "theta(start = 0, fixed = true), omega(start = 0, fixed = true)"


def drawn(parts: str, equations: str) -> Picture:
    return lmoc.compile_text(f"model Scene\n{parts}\nequation\n{equations}\nend Scene;").draw().picture


def of(picture: Picture, part: str, symbol: str) -> Item:
    return next(i for i in picture.items if (i.part, i.symbol) == (part, symbol))


@pytest.mark.parametrize("crossed", [False, True])
def test_a_belt_touches_both_pulleys_in_the_ratio_of_their_radii(crossed):
    belt = f"Belt belt(r1 = 0.1, r2 = 0.25, crossed = {str(crossed).lower()});"
    found = drawn(
        f"Inertia a(J = 1, {REST}); {belt} Inertia b(J = 2);",
        "connect(a.shaft, belt.a); connect(belt.b, b.shaft);",
    )
    one, other = of(found, "a", "wheel"), of(found, "b", "wheel")
    radii = [next(s.radius for s in i.shapes if isinstance(s, Circle)) for i in (one, other)]
    assert radii[1] / radii[0] == pytest.approx(2.5)
    belt = of(found, "belt", "belt")
    strands = [[belt.frame().place(v) for v in s.vertices] for s in belt.shapes if len(s.vertices) == 2]
    assert len(strands) == 2
    for (x, y), (x2, y2) in strands:
        for wheel, radius in zip((one, other), radii, strict=True):
            centre = wheel.ends[0]
            away = ((x2 - x) * (centre.y - y) - (centre.x - x) * (y2 - y)) / hypot(x2 - x, y2 - y)
            assert abs(away) == pytest.approx(radius)
        assert ((y - one.ends[0].y) * (y2 - other.ends[0].y) < 0) is crossed
    assert one.turn.factor == other.turn.factor  # both angles count alike: a crossed belt turns the other one back


def test_a_follower_is_as_far_from_its_cam_as_the_run_has_it():
    dae = compiled(TEXTBOOK / "valve_train.lmo")
    run, picture = dae.simulate(points=41), dae.draw().picture
    moving, scale = Moving(picture, run), LIFT / 0.008
    for k in range(len(run.time)):
        items = {i.symbol: i for i in moving.at(k) if i.part == "cam"}
        cam, tip = items["cam"], items["follower"].ends[0]
        outline = np.array([cam.frame().place(v) for v in cam.shapes[0].vertices]) - (cam.ends[0].x, cam.ends[0].y)
        angles = np.unwrap(np.arctan2(-outline[:, 1], outline[:, 0]))[::-1]
        radii = np.hypot(*outline.T)[::-1]
        top = angles[0] + (np.pi / 2 - angles[0]) % (2 * np.pi)
        reach = np.interp(top, [*angles, angles[0] + 2 * np.pi], [*radii, radii[0]])
        assert tip.x == cam.ends[0].x
        assert cam.ends[0].y - tip.y - reach == pytest.approx(scale * run["gap"][k], abs=0.02)


def test_a_rack_lies_on_its_pinion_and_moves_as_its_rim():
    found = drawn(
        f"Inertia a(J = 1, {REST}); Rack rack(r = -0.1); Mass m(m = 1);",
        "connect(a.shaft, rack.shaft); connect(rack.flange, m.flange);",
    )
    bar, pinion, wheel = of(found, "rack", "rack"), of(found, "rack", "pinion"), of(found, "a", "wheel")
    top = min(bar.frame().place(v)[1] for v in bar.shapes[0].vertices)
    assert top - pinion.ends[0].y == pytest.approx(PINION) and wheel.ends[0] == pinion.ends[0]
    assert wheel.turn.factor == -1  # clockwise: below it, that is to the left, which a negative radius makes of +q
    assert bar.ends[0].moves == of(found, "m", "mass").ends[0].moves != ()


def test_the_nut_of_a_screw_moves_with_what_it_carries():
    found = drawn(
        f"Inertia a(J = 1, {REST}); Screw screw(lead = 0.01); Mass m(m = 1, g = -9.81);",
        "connect(a.shaft, screw.shaft); connect(screw.flange, m.flange);",
    )
    nut, thread = of(found, "screw", "nut"), of(found, "screw", "screw")
    assert nut.ends[0].moves == of(found, "m", "mass").ends[0].moves != () and not thread.ends[0].moves
    assert nut.ends[0].x == thread.ends[0].x == of(found, "a", "disk").ends[0].x  # upright, as +q is


def test_an_unbalance_moves_along_the_line_first():
    found = drawn(
        f"Inertia a(J = 1, {REST}); Unbalance u(m = 0.1, r = 0.1); Mass m(m = 1); Spring s(k = 1); Fixed wall;",
        "connect(a.shaft, u.shaft); connect(u.flange, m.flange); connect(wall.flange, s.a); connect(s.b, m.flange);",
    )
    item = of(found, "u", "unbalance")
    mass = [s for s in item.shapes if isinstance(s, Circle)][-1].centre
    places = [item.frame(turned=turned).place(mass) for turned in (0.0, 0.1)]
    assert places[0] == pytest.approx((item.ends[0].x, item.ends[0].y + 15.0))  # across the line at theta = 0
    assert places[1][0] > places[0][0] and item.ends[0].moves == of(found, "m", "mass").ends[0].moves


def test_a_body_that_swings_hangs_from_its_pivot():
    found = drawn("GravityLever bob(m = 2, l = 0.5); Torque push(tau = 1);", "connect(push.shaft, bob.shaft);")
    bar = of(found, "bob", "pendulum")
    assert bar.turn.variable == "bob.shaft.theta" and bar.turn.reference == 0.0
    x, y = bar.frame(turned=0.3).place(next(s for s in bar.shapes if isinstance(s, Line)).vertices[-1])
    assert x > bar.ends[0].x and y > bar.ends[0].y


def test_a_differential_has_its_drive_across_and_its_sides_along_the_axle():
    road = "FixedShaft road; TorsionDamper brake(c = 1);"
    found = drawn(
        f"Torque drive(tau = 10); Inertia engine(J = 0.2, {REST}); Differential d(N = 4); Inertia l(J = 1, {REST});"
        f"Inertia r(J = 1); {road}",
        "connect(drive.shaft, engine.shaft); connect(engine.shaft, d.drive); connect(d.left, l.shaft);"
        "connect(d.right, r.shaft); connect(r.shaft, brake.a); connect(brake.b, road.shaft);",
    )
    centre = of(found, "d", "differential").ends[0]
    engine, left, right = (of(found, name, "disk").ends[0] for name in ("engine", "l", "r"))
    assert engine.y == centre.y and engine.x < centre.x
    assert left.x == right.x == centre.x and left.y < centre.y < right.y
    assert not [i for i in found.items if i.symbol in ("box", "continuation")]
    # what leads to two shafts at once is drawn once, and numbers say where the other side goes on
    locked = drawn(
        f"Inertia engine(J = 0.2, {REST}); Differential d; Inertia l(J = 1, {REST}); Inertia r(J = 1);"
        "TorsionDamper lock(c = 3);",
        "connect(engine.shaft, d.drive); connect(d.left, l.shaft); connect(d.right, r.shaft);"
        "connect(lock.a, l.shaft); connect(lock.b, r.shaft);",
    )
    assert len([i for i in locked.items if i.part in ("l", "r") and i.symbol == "disk"]) == 2
    assert len([i for i in locked.items if i.symbol == "continuation"]) >= 2


def test_a_planetary_gear_shows_its_wheels_and_which_shaft_is_which():
    found = drawn(
        f"Inertia s(J = 1, {REST}); Inertia c(J = 2); PlanetaryGear gear(ratio = 3); FixedShaft held;",
        "connect(s.shaft, gear.sun); connect(gear.carrier, c.shaft); connect(gear.ring, held.shaft);",
    )
    ring, *wheels = (s for s in of(found, "gear", "box").shapes if isinstance(s, Circle))
    sun = wheels.pop()
    assert len(wheels) == 3 and 3 * sun.radius == pytest.approx(ring.radius)
    for one in wheels:
        away = hypot(one.centre[1] - sun.centre[1], one.centre[2] - sun.centre[2])
        assert away == pytest.approx(sun.radius + one.radius) == pytest.approx(ring.radius - one.radius)
    letters = {i.shapes[0].text for i in found.items if i.symbol == "label" and i.part == "gear"}
    assert letters == {"s", "c", "r"}


def test_a_rope_ends_on_the_side_of_its_drum_where_it_comes_up():
    found = drawn(
        f"Inertia d(J = 1, {REST}); Drum drum(r = 0.2); Pulley rope; Fixed crane; Mass load(m = 8, g = -9.81);",
        "connect(d.shaft, drum.shaft); connect(drum.flange, rope.a); connect(crane.flange, rope.b);"
        "connect(rope.axle, load.flange);",
    )
    assert not [i for i in found.items if i.symbol == "continuation"]


@pytest.mark.parametrize("ends", ["ab", "ba"])
@pytest.mark.parametrize("g", [-9.81, 9.81, 0])
def test_what_hangs_on_the_rope_of_a_drum_goes_as_the_rope_does_whichever_way_it_is_written(ends, g):
    first, last = ends
    items = lmoc.compile_text(f"""model M
  Inertia disk(J = 1); Drum drum(r = 0.3); Spring rope(k = 40000); Mass load(m = 2, g = {g});
equation
  connect(disk.shaft, drum.shaft); connect(drum.flange, rope.{first}); connect(rope.{last}, load.flange);
end M;
""").draw().picture.items
    ways = {(m.dx, m.dy) for i in items if i.symbol in ("string", "spring", "mass") for e in i.ends for m in e.moves}
    assert ways == {(0, 1 if g > 0 else -1)}
    spring, load = (next(i for i in items if i.symbol == symbol) for symbol in ("spring", "mass"))
    top, bottom = sorted(end.y for end in spring.ends)
    assert top < bottom < load.ends[0].y
    written = (ends == "ab") == (g > 0)  # a tension is positive where b is along +q
    assert spring.variables == {"force" if written else "push": "rope.f"}
