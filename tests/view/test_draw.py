"""What `lmoc draw` makes of scenes of a user's own: looks, large scenes, hostile names, files."""

from __future__ import annotations

from math import hypot
from pathlib import Path
from xml.dom import minidom

import numpy as np
import pytest
from oracles.models import compiled

import lmoc
from lmoc.cli.main import main
from lmoc.messages.diagnostics import ModelError
from lmoc.view.scene.compose import picture_of
from lmoc.view.scene.picture import Circle, Item, Label, Move, Picture
from lmoc.view.scene.text import plain, runs, width

MODELS = Path(__file__).parents[2] / "models"


def drawn(text: str, **options) -> Picture:
    return lmoc.compile_text(text, **options).draw().picture


def of(picture: Picture, part: str) -> Item:
    """The item that shows a part, its labels aside."""
    return next(i for i in picture.items if i.part == part and i.symbol != "label")


def all_of(picture: Picture, symbol: str) -> list[Item]:
    return [i for i in picture.items if i.symbol == symbol]


def texts(picture: Picture) -> list[str]:
    return [plain(s.text) for _, s, _ in picture.placed() if isinstance(s, Label)]


# ----------------------------------------------------------------------------- looks

CHAIN = """
model Scene
  Fixed wall;
  Own own;
  Mass mass(m = 1);
equation
  connect(wall.flange, own.a);
  connect(own.b, mass.flange);
end Scene;
"""


def test_a_part_inherits_its_look():
    found = drawn("model Own extends Spring(k = 2); end Own;" + CHAIN, model="Scene")
    assert of(found, "own").symbol == "spring"


def test_a_part_without_a_look_is_a_box_with_its_name():
    law = "model Own extends TwoFlanges; equation f = 3*(b.q - a.q); end Own;"
    found = drawn(law + CHAIN, model="Scene")
    assert of(found, "own").symbol == "box" and "own" in texts(found)


def test_a_part_may_name_a_symbol_of_the_library():
    law = 'model Own extends TwoFlanges; equation f = 3*(b.q - a.q); annotation(__lmoc(symbol = "damper")); end Own;'
    assert of(drawn(law + CHAIN, model="Scene"), "own").symbol == "damper"


def test_an_icon_is_drawn_between_the_ports_and_replaces_a_symbol():
    law = """model Own extends Spring(k = 1);
      annotation(Icon(graphics = {Polygon(points = {{-100, -50}, {100, -50}, {0, 50}}),
        Ellipse(extent = {{-20, -20}, {20, 20}}), Text(extent = {{-80, 60}, {80, 90}}, textString = "%name!")}));
      end Own;"""
    found = drawn(law + CHAIN, model="Scene")
    assert of(found, "own").symbol == "icon" and "own!" in texts(found)
    triangle = next(s for s in of(found, "own").shapes if getattr(s, "closed", False))
    (_, x0, y0), (_, x1, y1), (_, x2, y2) = triangle.vertices[:3]
    assert (y0, x2) == (y1, 0) and x1 == -x0 and y2 == -y0 < 0


def test_the_texts_of_an_icon_say_values():
    """``%par`` is a parameter's value with its unit (18.6.5.5); what is none stays a name, ``%%`` is a sign."""
    law = """model Own extends Spring(k = 1500);
      parameter Boolean on = true; parameter Integer n[2] = {1, 2};
      annotation(Icon(graphics = {Text(extent = {{-80, 60}, {80, 90}}, textString = "k=%k, %{on}, %n 5%% %class"),
        Text(extent = {{-80, 30}, {80, 60}}, textString = "of %name")}));
      end Own;"""
    model = lmoc.compile_text(law + CHAIN, model="Scene")
    assert {"k=1500 N/m, true, {1, 2} 5% Own", "of own"} <= set(texts(model.draw().picture))
    kept = texts(picture_of(model.flat, model.flat.parameter_values(), numbers=False))  # of a page: sliders
    assert "of own" in kept and not [text for text in kept if "1500" in text]


def test_what_an_icon_shows_where_a_parameter_says_so():
    law = """model Own extends Spring(k = 1);
      parameter Boolean on = true, off = false;
      annotation(Icon(graphics = {Text(visible = on, extent = {{-80, 60}, {80, 90}}, textString = "one"),
        Text(visible = not on, extent = {{-80, 60}, {80, 90}}, textString = "two"),
        Text(visible = on and off, extent = {{-80, 60}, {80, 90}}, textString = "three"),
        Text(visible = on or off, extent = {{-80, 30}, {80, 60}}, textString = "four")}));
      end Own;"""
    assert {"one", "two", "three", "four"} & set(texts(drawn(law + CHAIN, model="Scene"))) == {"one", "four"}


def test_a_place_in_space_is_one_port():
    space = """connector Place Real r[3](each unit = "m"); flow Real f[3](each unit = "N"); end Place;
      model Held Place p; equation p.r = {1, 0, 0}; end Held;
      model Spring3 Place a, b; equation a.f = 3*(a.r - b.r); a.f + b.f = {0, 0, 0}; end Spring3;
      model Ball Place p; Real v[3](each start = 0, each fixed = true);
      equation der(p.r) = v; 2*der(v) = p.f; end Ball;
      model Scene Held held; Spring3 spring; Ball ball;
      equation connect(held.p, spring.a); connect(spring.b, ball.p); end Scene;"""
    found = drawn(space, model="Scene")
    assert sorted(i.part for i in found.items if i.symbol == "box") == ["ball", "held", "spring"]


def test_an_icon_keeps_its_colours_in_every_kind_of_picture(tmp_path):
    law = """model Own extends Spring(k = 1);
      annotation(Icon(graphics = {
        Rectangle(extent = {{-90, 50}, {90, -50}}, lineColor = {200, 0, 0}, fillColor = {255, 255, 0},
          fillPattern = FillPattern.Solid),
        Line(points = {{-90, 0}, {90, 0}}, color = {0, 0, 255}, pattern = LinePattern.Dash),
        Ellipse(extent = {{-30, -30}, {30, 30}}, pattern = LinePattern.None, fillPattern = FillPattern.Sphere),
        Polygon(points = {{0, 40}, {20, 0}, {-20, 0}}, lineColor = {0, 0, 0}, fillColor = {255, 255, 255},
          fillPattern = FillPattern.Solid),
        Text(extent = {{-80, 60}, {80, 90}}, textString = "%name!", textColor = {0, 128, 0})}));
      end Own;"""
    drawing = lmoc.compile_text(law + CHAIN, model="Scene").draw()
    shapes = [s for s in of(drawing.picture, "own").shapes if isinstance(s, Label) or s.dash or s.fill]
    assert [(s.colour, getattr(s, "fill", "")) for s in shapes] == [
        ("#c80000", "#ffff00"), ("#0000ff", ""), ("none", "body"), ("ink", "paper"), ("#008000", "")
    ]  # fmt: skip
    assert 'style="stroke:#c80000;fill:#ffff00"' in drawing.svg
    drawing.save(tmp_path / "own.png")
    from matplotlib.image import imread

    pixels = imread(tmp_path / "own.png")[..., :3]
    assert (abs(pixels - (1.0, 1.0, 0.0)).max(axis=2) < 0.01).sum() > 500


def test_a_colour_that_is_none_is_told():
    law = """model Own extends Spring(k = 1);
      annotation(Icon(graphics = {Line(points = {{0, 0}, {1, 1}}, color = {0, 300, 0})}));
      end Own;"""
    notes = lmoc.compile_text(law + CHAIN, model="Scene").notes
    assert [n.code for n in notes] == ["W0247"] and "a colour {red, green, blue}" in notes[0].message


def test_an_assembly_with_a_look_hides_what_is_inside():
    inside = """model Own Flange a; Flange b; Spring s(k = 1);
      equation connect(a, s.a); connect(s.b, b); {} end Own;"""
    plainly = drawn(inside.format("") + CHAIN, model="Scene")
    hidden = drawn(inside.format('annotation(__lmoc(symbol = "spring"));') + CHAIN, model="Scene")
    assert of(plainly, "own.s").symbol == "spring"
    assert of(hidden, "own").symbol == "spring" and not any(i.part == "own.s" for i in hidden.items)


# ------------------------------------------------------------------ lengths, ratios, places


@pytest.mark.parametrize(("file", "ratio"), [("ex09_gear_pair_with_load", 2.0), ("s8_gears", 5.0)])
def test_gears_touch_and_their_radii_are_in_the_ratio(file, ratio):
    found = compiled(MODELS / "notes" / f"{file}.lmo").draw().picture
    one, two = (i for i in found.items if i.symbol == "wheel")
    small, large = (next(s.radius for s in i.shapes if isinstance(s, Circle)) for i in (one, two))
    assert large / small == pytest.approx(ratio)
    assert two.ends[0].x - one.ends[0].x == pytest.approx(small + large)


def test_gears_whose_angles_count_in_opposite_senses_are_drawn_so():
    found = compiled(MODELS / "notes" / "s8_gears.lmo").draw().picture
    assert [i.turn.factor for i in found.items if i.symbol == "wheel"] == [1, -1]


def test_what_counts_upwards_is_above():
    found = compiled(MODELS / "notes" / "ex05_suspension.lmo").draw().picture
    assert of(found, "body").ends[0].y < of(found, "wheel").ends[0].y < of(found, "road").ends[0].y
    (move,) = of(found, "body").ends[0].moves
    assert (move.dx, move.dy, move.group) == (0.0, -1.0, "line") and move.variable == "body.flange.q"


def test_mechanisms_of_the_plane_are_to_scale_and_move_with_their_variables():
    dae = compiled(MODELS / "planar" / "slider_crank.lmo")
    found = dae.draw().picture
    rod = of(found, "rod")
    (a, b), run = rod.ends, dae.simulate(points=7)
    scale = hypot(b.x - a.x, b.y - a.y) / 1.0
    assert scale == pytest.approx(a.moves[0].dx)
    for k in range(7):

        def change(move: Move, k: int = k) -> float:
            return run[move.variable][k] - move.reference

        frame = rod.frame(change)
        assert frame.length / scale == pytest.approx(1.0, rel=1e-6)
        assert -frame.sin == pytest.approx((run["rod.b.y"] - run["rod.a.y"])[k], abs=1e-6)


SLACK = """
model Slack
  import Planar.*;
  inner World world;
  Anchor hook, other(x = 1);
  PointMass ball(m = 1, x(start = {x}, fixed = true), y(start = {y}, fixed = true), vx(fixed = true), vy(fixed = true));
  {string}
equation
  connect(hook.point, string.a);
  connect(string.b, ball.point);
end Slack;
"""


@pytest.mark.parametrize("x, y", [(0.8, 0), (0.7, 0.5), (0, -0.9), (-0.6, -0.3)])
@pytest.mark.parametrize("string", ["Cable string(L = 1);", "ElasticCable string(d0 = 1, k = 50);"])
def test_a_slack_string_of_the_plane_hangs(x, y, string):
    item = of(drawn(SLACK.format(x=x, y=y, string=string)), "string")
    straight, frame = item.frame().length, item.frame()
    scale = straight / hypot(x, y)
    assert item.slack == pytest.approx(scale * (1 - hypot(x, y)))
    places = [frame.place(v) for v in item.drawn[0].vertices]
    ends = [(e.x, e.y) for e in item.ends]
    assert [places[0], places[-1]] == [pytest.approx(e) for e in ends]
    length = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in zip(places, places[1:]))
    assert length == pytest.approx(scale, rel=0.12)  # a parabola: nearly as long as the string
    if x:
        chord = [ends[0][1] + k / 24 * (ends[1][1] - ends[0][1]) for k in range(25)]
        assert all(below[1] > y for below, y in zip(places[1:-1], chord[1:-1]))


@pytest.mark.parametrize("string", ["Cable string(L = 0.8);", "ElasticCable string(d0 = 0.8, k = 50);"])
def test_a_taut_string_of_the_plane_is_straight(string):
    item = of(drawn(SLACK.format(x=0.8, y=0, string=string)), "string")
    assert item.drawn == item.shapes and len(item.shapes[0].vertices) in (2, 15)


def test_a_pulley_hangs_from_the_rope_of_another():
    found = drawn("""model M
      Fixed ceiling; Pulley upper, lower; Mass m1(m = 3, g = 9.81), m2(m = 1, g = 9.81), m3(m = 1, g = 9.81);
    equation
      connect(ceiling.flange, upper.axle); connect(m1.flange, upper.a); connect(upper.b, lower.axle);
      connect(lower.a, m2.flange); connect(lower.b, m3.flange);
    end M;""")
    pulleys = {i.part: i.ends[0] for i in found.items if i.symbol == "pulley"}
    assert pulleys["lower"].y > pulleys["upper"].y
    assert sum(i.symbol == "bearing" and len(i.shapes) > 2 for i in found.items) == 1  # one ceiling


# --------------------------------------------------------------------------- large, empty, open


def test_of_a_long_chain_the_ends_are_drawn_and_dots_count_the_rest():
    dae = lmoc.compile(MODELS / "bench" / "chain.lmo", parameters={"N": 10_000})
    found = dae.draw().picture
    assert any("9998 × Spring" in t and "9997 × Mass" in t for t in texts(found))
    assert len(found.items) < 60 and "11 of" in found.notes[0]
    assert of(found, "mass[10000]").symbol == "mass"


def chain(n: int, gravity: float = 0.0, grounded: bool = False) -> str:
    """Different masses in a row on springs, each with a damper to the ground where they are `grounded`."""
    lines = ["model Chain", "  Fixed wall;"]
    lines += [f"  Mass body{i}(m = {i}, g = {gravity}); Spring s{i}(k = {i});" for i in range(1, n + 1)]
    lines += [f"  Damper d{i}(c = 1);" for i in range(1, n + 1) if grounded]
    lines.append("equation")
    for i in range(1, n + 1):
        before = f"body{i - 1}" if i > 1 else "wall"
        lines.append(f"  connect({before}.flange, s{i}.a); connect(s{i}.b, body{i}.flange);")
        if grounded:
            lines.append(f"  connect(wall.flange, d{i}.a); connect(d{i}.b, body{i}.flange);")
    return "\n".join([*lines, "end Chain;"])


@pytest.mark.parametrize(("n", "gravity", "grounded"), [(30, 0.0, False), (20, 0.0, True), (12, 9.81, False)])
def test_a_long_row_goes_on_where_a_number_says(n, gravity, grounded):
    picture = drawn(chain(n, gravity, grounded))
    assert picture.width < 720 and (picture.height < 720 or not gravity)
    marks = [i for i in picture.items if i.symbol == "continuation" and len(i.ends) == 1]
    numbers = [s.text for i in marks for s in i.shapes if isinstance(s, Label)]
    assert sorted(numbers) == sorted(2 * [str(k + 1) for k in range(len(marks) // 2)]) and marks
    masses = [i.part for i in picture.items if i.symbol == "mass"]
    assert sorted(masses) == sorted(f"body{i}" for i in range(1, n + 1))
    for number in numbers:  # both marks of a break move with the body that it is behind
        own = [i for i in marks if any(isinstance(s, Label) and s.text == number for s in i.shapes)]
        assert len({i.ends[0].moves[0].variable for i in own}) == 1


def test_many_parts_by_name_give_a_table_of_their_kinds():
    n = 120
    parts = "".join(f"Mass m{i}(m = 1); Spring s{i}(k = 1);" for i in range(n))
    joins = "".join(f"connect(s{i}.b, m{i}.flange); connect(w.flange, s{i}.a);" for i in range(n))
    found = drawn(f"model M Fixed w; {parts} equation {joins} end M;")
    assert {"120 × Mass", "120 × Spring", "1 × Fixed"} <= set(texts(found))
    assert "too many" in found.notes[0]


def test_parts_of_a_circuit_are_named_in_a_note():
    found = drawn("""
      connector Pin Real v(unit = "V"); flow Real i(unit = "A"); end Pin;
      model Resistor Pin p; equation p.v = 2*p.i; end Resistor;
      model Scene Resistor r1, r2; Mass m(m = 1); equation connect(r1.p, r2.p); end Scene;""", model="Scene")
    assert found.notes == ("not drawn, for their ports neither move nor turn: r1, r2",)
    assert of(found, "m").symbol == "mass"


def test_a_model_without_parts_says_so():
    found = drawn("model M Real x(start = 1); equation der(x) = -x; end M;")
    assert "no parts" in texts(found)[0] and found.notes
    circuit = """
      connector Pin Real v(unit = "V"); flow Real i(unit = "A"); end Pin;
      model Resistor Pin p; equation p.v = 2*p.i; end Resistor;
      model Scene Resistor r1, r2; equation connect(r1.p, r2.p); end Scene;"""
    assert "no parts" in texts(drawn(circuit, model="Scene"))[0]


def test_parts_that_are_connected_to_nothing_are_drawn(tmp_path):
    """The scene cannot be solved; its picture helps to see why."""
    file = tmp_path / "open.lmo"
    file.write_text("model M Spring loose(k = 1); Damper other(c = 1); Mass m(m = 1); end M;")
    assert main(["draw", str(file), "-o", str(tmp_path / "open.svg"), "--quiet"]) == 0
    assert 'data-part="loose"' in (tmp_path / "open.svg").read_text()


# ----------------------------------------------------------------------------- files


HOSTILE = """
model M "<script>alert(1)</script> & \\"q\\" ]]>"
  parameter Real 'k</text><script>'(unit = "N/m") = 3;
  Fixed 'w"on';
  Spring '<img src=x onerror=alert(1)>'(k = 'k</text><script>');
  Mass 'a&b_{x}$\\\\frac'(m = 1);
equation
  connect('w"on'.flange, '<img src=x onerror=alert(1)>'.a);
  connect('<img src=x onerror=alert(1)>'.b, 'a&b_{x}$\\\\frac'.flange);
end M;
"""


@pytest.mark.parametrize("free_body", [False, True])
def test_names_cannot_become_markup(tmp_path, free_body):
    drawing = lmoc.compile_text(HOSTILE).draw(free_body=free_body)
    parsed = minidom.parseString(drawing.svg)
    assert {e.tagName for e in parsed.getElementsByTagName("*")} <= {
        "svg", "title", "style", "g", "path", "circle", "text", "tspan"
    }  # fmt: skip
    assert "<script" not in drawing.svg and "<img" not in drawing.svg
    drawing.save(tmp_path / "hostile.png")  # matplotlib takes nothing for a formula


@pytest.mark.parametrize(("ending", "start"), [("svg", b"<svg"), ("png", b"\x89PNG"), ("pdf", b"%PDF")])
def test_files(tmp_path, ending, start):
    path = tmp_path / f"scene.{ending}"
    assert main(["draw", str(MODELS / "notes" / "ex02_spring_mass_damper.lmo"), "-o", str(path), "--quiet"]) == 0
    assert path.read_bytes().startswith(start)


def test_free_bodies_from_the_command_line(tmp_path, capsys):
    path = tmp_path / "bodies.svg"
    file = str(MODELS / "notes" / "ex03_two_masses.lmo")
    assert main(["draw", file, "--free-body", "-o", str(path)]) == 0
    assert "picture written to" in capsys.readouterr().out and 'class="balance"' in path.read_text()


def test_an_unknown_ending_is_refused_before_any_work(tmp_path, capsys):
    assert main(["draw", "no_such_file.lmo", "-o", str(tmp_path / "scene.bmp")]) == 2
    assert "E0624" in capsys.readouterr().err
    with pytest.raises(ModelError, match="no folder"):
        compiled(MODELS / "notes" / "s2_2_rotor.lmo").draw(tmp_path / "nowhere" / "scene.svg")


def test_notebooks_show_the_picture():
    drawing = compiled(MODELS / "notes" / "s2_2_rotor.lmo").draw()
    assert drawing._repr_svg_().startswith("<svg") and "items" in repr(drawing)


# ----------------------------------------------------------------------------- texts


def test_marks_of_a_text():
    assert list(runs("q_{1} = x^{2}·k")) == [("q", 0), ("1", -1), (" = x", 0), ("2", 1), ("·k", 0)]


@pytest.mark.parametrize("text", ["spring", "k_{1}", "m·g", "WWW", "θ_{wheel}", "illicit", "c_{2}·(q_{2} − q_{1})"])
def test_texts_are_not_wider_than_they_are_taken_for(text):
    from lmoc.view.scene.figure import _wide

    assert _wide(text, 13.0) <= width(text, 13.0) + 1.0


# ----------------------------------------------------------------------------- belts, and what is between two points

PICTURES = Path(__file__).parents[1] / "data" / "pictures"


def test_a_belt_is_drawn_about_two_wheels():
    found = lmoc.compile(PICTURES / "belt_drive.lmo").draw().picture
    motor, driven = of(found, "motor"), of(found, "driven")
    (one, *_), (other, *_) = ([s for s in i.shapes if isinstance(s, Circle)] for i in (motor, driven))
    assert other.radius / one.radius == pytest.approx(0.15 / 0.05, rel=0.1)
    assert not [i for i in found.items if i.symbol == "continuation"]
    wheels = [(i.ends[0], c.radius) for i, c in ((motor, one), (driven, other))]
    strands = [i for i in found.items if i.symbol == "string" and len(i.ends) == 2]
    assert len(strands) == 4  # two at each cable
    for strand in strands:
        (x, y), (x2, y2) = ((e.x, e.y) for e in strand.ends)
        away = [abs((x2 - x) * (y - e.y) - (x - e.x) * (y2 - y)) / hypot(x2 - x, y2 - y) - r for e, r in wheels]
        assert away == pytest.approx([0, 0], abs=1.0)  # each is tangent to both wheels


def test_a_spring_and_a_damper_between_the_same_points_stand_beside_each_other():
    found = lmoc.compile(PICTURES / "bell_crank.lmo").draw().picture
    spring, damper = of(found, "spring"), of(found, "damper")
    assert {(e.x, e.y) for e in spring.ends} == {(e.x, e.y) for e in damper.ends}
    heights = [[y for s in item.shapes[2:] for _, _, y in s.vertices] for item in (spring, damper)]
    assert max(heights[0]) < min(heights[1]) or max(heights[1]) < min(heights[0])


def test_one_shaft_is_one_wheel():
    found = lmoc.compile(PICTURES / "windlass.lmo").draw().picture
    assert [i.part for i in found.items if i.symbol in ("wheel", "disk")] == ["drumInertia"]
    assert sum(i.symbol in ("rotation", "coordinate") and i.part != "" for i in found.items) == 1


def test_a_building_is_upright_and_its_equal_floors_are_left_out():
    found = lmoc.compile(PICTURES / "tower20.lmo").draw().picture
    floors = {i.part: i.ends[0] for i in found.items if i.symbol == "mass"}
    assert list(floors) == ["floor[1]", "floor[2]", "floor[19]", "floor[20]", "tuned"]
    heights = [end.y for end in floors.values()]
    assert heights == sorted(heights, reverse=True) and len({round(end.x) for end in floors.values()}) == 1
    assert "… 17 × SpringDamper, 16 × Mass" in texts(found)


def test_a_car_stands_on_the_road_and_its_shafts_go_on_at_a_number():
    found = lmoc.compile(PICTURES / "clutch_start.lmo").draw().picture
    (road,) = all_of(found, "road")
    car, tyre = of(found, "car"), of(found, "tyre")
    assert car.ends[0].y < tyre.ends[0].y < road.ends[0].y and car.ends[0].x == pytest.approx(tyre.ends[0].x)
    assert not all_of(found, "string") and not all_of(found, "bearing")
    marks = [i.nodes for i in all_of(found, "continuation")]
    assert any(marks.count(nodes) == 2 and nodes[0] in tyre.nodes for nodes in marks)


def test_wheels_stand_on_one_road_below_their_bodies():
    found = lmoc.compile_text("""model Cars "A car and its trailer"
      Mass car(m = 1), trailer(m = 1); Spring hook(k = 1); Wheel front(r = 0.3), rear(r = 0.4), third(r = 0.3);
      Inertia f(J = 1), r(J = 1); TorsionDamper bearing(c = 1); FixedShaft housing;
    equation
      connect(trailer.flange, hook.a); connect(hook.b, car.flange);
      connect(front.flange, car.flange); connect(rear.flange, car.flange); connect(third.flange, trailer.flange);
      connect(front.shaft, f.shaft); connect(rear.shaft, r.shaft); connect(third.shaft, bearing.a);
      connect(bearing.b, housing.shaft);
    end Cars;""").draw().picture
    (road,) = all_of(found, "road")
    wheels = {i.part: i for i in all_of(found, "wheel") if i.part}
    disks = [i for i in all_of(found, "wheel") if any(getattr(s, "fill", "") == "body" for s in i.shapes)]
    assert len(disks) == 3 and set(wheels) == {"front", "rear", "third", "f", "r"}
    assert {round(i.ends[0].y + i.shapes[0].radius, 6) for i in disks} == {round(road.ends[0].y, 6)}
    bottom = max(i.frame().place(v)[1] for i in all_of(found, "mass") for v in i.shapes[0].vertices)
    assert all(i.ends[0].y - i.shapes[0].radius > bottom for i in disks)
    assert wheels["f"].shapes[0].radius / wheels["r"].shapes[0].radius == pytest.approx(0.75)
    assert wheels["f"].ends[0].moves == of(found, "car").ends[0].moves != () and wheels["f"].turn.factor == -1
    assert wheels["third"].ends[0].x < wheels["front"].ends[0].x < wheels["rear"].ends[0].x


ON_CURVES = """model Bowl "A disk rolls in a bowl, a disk slides down a wedge, and one is in a ring"
  import Planar.*;
  inner World world;
  Body d(m = 2, J = 0.04);
  DiskTrack bowl(points = {{1.5*sin(a), -1.5*cos(a)} for a in linspace(-1.2, 1.2, 13)}, r = 0.2,
    s(start = 0.6, fixed = true), v(start = 0, fixed = true));
  Body ball(m = 1, J = 0.02, x(start = 3, fixed = true), y(start = 1, fixed = true), theta(start = 0, fixed = true));
  Body wedge(m = 3, J = 1, x(start = 3, fixed = true), y(start = 0, fixed = true), theta(start = 0.4, fixed = true));
  EdgeContact edge(r = 0.3, nx = -0.1, ny = 1, d = 0.2, mu = 0.3);
  Body a(m = 1, J = 0.01, x(start = 6.5, fixed = true), y(start = 0, fixed = true), theta(start = 0, fixed = true));
  Body b(m = 1, J = 0.01, x(start = 6, fixed = true), y(start = 0, fixed = true), theta(start = 0, fixed = true));
  DiskContact c(r1 = 0.25, r2 = 1, inside = true);
equation
  connect(bowl.disk, d.frame);
  connect(edge.frame, wedge.frame);
  connect(edge.disk, ball.frame);
  connect(c.a, a.frame);
  connect(c.b, b.frame);
end Bowl;"""


def test_disks_are_on_their_curves_edges_and_in_their_rings():
    dae = lmoc.compile_text(ON_CURVES)
    picture, run = dae.draw().picture, dae.simulate(stop=0.01)
    placed = {(item.part, item.symbol): (item, frame) for item, _, frame in picture.placed() if item.part}

    def round_(part, symbol):
        item, frame = placed[part, symbol]
        return np.array(frame.place((0, 0, 0))), next(s.radius for s in item.shapes if isinstance(s, Circle))

    def line(part, symbol):
        item, frame = placed[part, symbol]
        return np.array([frame.place(v) for v in item.shapes[0].vertices])

    centre, radius = round_("bowl", "disk-track")
    scale = radius / 0.2
    curve = line("bowl", "track")
    assert np.hypot(*(curve - centre).T).min() == pytest.approx(radius, rel=0.03)
    assert np.ptp(curve, axis=0) / scale == pytest.approx([2 * 1.5 * np.sin(1.2), 1.5 * (1 - np.cos(1.2))], rel=1e-3)
    ball, radius = round_("edge", "edge-contact")
    p, q = line("edge", "contact")
    assert radius == pytest.approx(0.3 * scale)
    along, away = q - p, ball - p
    across = abs(along[0] * away[1] - along[1] * away[0]) / np.hypot(*along)
    assert across / scale == pytest.approx(0.3 + run["edge.gap"][0], abs=1e-9)
    (rim, ring), (inner, small) = round_("c", "ring"), round_("c", "disk-contact")
    assert [ring, small] == pytest.approx([scale, 0.25 * scale])
    assert np.hypot(*(rim - inner)) == pytest.approx(0.5 * scale)
