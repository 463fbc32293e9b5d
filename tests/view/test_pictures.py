"""Pictures of the scenes in models/: everything is shown, nothing overlaps, and what is drawn agrees with the model."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from pathlib import Path

import pytest
from oracles.connections import lost, numbers_mean_one_thing, overlapping

from lmoc.interface import DAE
from lmoc.ir.flat import FlatDAE
from lmoc.pipeline import Clock, Scene, flatten, open_scene
from lmoc.view.scene.abbreviate import shown
from lmoc.view.scene.arrange import strips_of
from lmoc.view.scene.block import shape_corners
from lmoc.view.scene.compose import picture_of
from lmoc.view.scene.names import Names
from lmoc.view.scene.picture import Label, Picture
from lmoc.view.scene.picture import Path as Outline
from lmoc.view.scene.placing import points_of
from lmoc.view.scene.schematic import style_of
from lmoc.view.scene.strips import draw_strip
from lmoc.view.scene.text import plain

MODELS = Path(__file__).parents[2] / "models"
FOLDERS = ("notes", "hard", "laws", "planar", "textbook")
LONG = ("h14_plucked_string", "wagons")
SCENES = sorted(p for folder in FOLDERS for p in (MODELS / folder).glob("*.lmo"))


@cache
def flattened(path: Path) -> tuple[Scene, FlatDAE]:
    """A scene that is not reduced: only mechanisms of the plane need to be."""
    scene = open_scene(path, Scene(), Clock())
    return scene, flatten(scene, Clock())


@cache
def picture(path: Path) -> Picture:
    scene, flat = flattened(path)
    return picture_of(flat, flat.parameter_values(), lambda: DAE(scene, flat).at_start())


def labels(p: Picture) -> list[tuple[str, tuple[float, float, float, float]]]:
    return [(plain(s.text), shape_corners(s, f)) for _, s, f in p.placed() if isinstance(s, Label) and s.text]


def overlap(a, b) -> float:
    wide = min(a[2], b[2]) - max(a[0], b[0])
    high = min(a[3], b[3]) - max(a[1], b[1])
    return min(wide, high)


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_no_label_overlaps_another(path):
    found = [(a, b) for (a, x), (b, y) in combinations(labels(picture(path)), 2) if overlap(x, y) > 0.5]
    assert found == []


BENCH = [MODELS / "bench" / f"{name}.lmo" for name in ("lattice", "chain", "drivetrain")]
IN_THE_PLANE = ("engine", "double_wishbone", "roller_coaster")
ON_LINES = [p for p in SCENES if p.parent.name != "planar" and p.stem not in IN_THE_PLANE]


@pytest.mark.parametrize("path", [*ON_LINES, *BENCH], ids=lambda p: p.stem)
def test_no_box_overlaps_another(path):
    boxes = [
        (item.part, shape_corners(shape, frame))
        for item, shape, frame in picture(path).placed()
        if item.symbol in ("box", "mass") and isinstance(shape, Outline) and shape.closed
    ]
    assert [(a, b) for (a, x), (b, y) in combinations(boxes, 2) if overlap(x, y) > 0.5] == []


def test_boxes_under_points_of_a_line_have_room_beside_each_other(tmp_path):
    path = tmp_path / "scene.lmo"
    path.write_text("""
model Thing
  Flange flange;
equation
  flange.f = 3*flange.q;
end Thing;
model Scene
  Fixed wall;
  Mass mass(m = 1);
  Spring s1(k = 1), s2(k = 1), s3(k = 1);
  Thing aRatherLongNameOfAPart, anotherRatherLongName;
equation
  connect(wall.flange, s1.a);
  connect(s1.b, aRatherLongNameOfAPart.flange);
  connect(s1.b, s2.a);
  connect(s2.b, anotherRatherLongName.flange);
  connect(s2.b, s3.a);
  connect(s3.b, mass.flange);
end Scene;
""")
    test_no_box_overlaps_another(path)
    assert sum(i.symbol == "box" for i in picture(path).items) == 2


def test_what_stands_at_a_part_that_is_shown_is_shown():
    """The mass in the middle of a lattice is pushed: it is drawn, though the array is cut."""
    at = {item.part for item in picture(BENCH[0]).items if item.symbol == "mass"}
    assert at == {"mass[1,1]", "mass[1,2]", "mass[15,15]", "mass[30,30]"}


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_no_line_passes_through_a_label(path):
    p = picture(path)
    points = [(q, item) for item in p.items for q in points_of(item)]
    for item, shape, frame in p.placed():
        if isinstance(shape, Label) and shape.text:
            left, top, right, bottom = shape_corners(shape, frame)
            # the leader of a number in a circle ends below the circle, which is filled
            hidden = "joint" if item.symbol == "continuation" else None
            inside = [
                other.part or other.symbol
                for (x, y), other in points
                if left + 2 < x < right - 2 and top + 3 < y < bottom - 3
                if other is not item and other.symbol != hidden
            ]
            assert (plain(shape.text), inside) == (plain(shape.text), [])


@pytest.mark.parametrize("path", [p for p in SCENES if p.parent.name == "notes"], ids=lambda p: p.stem)
def test_nothing_crosses_in_the_scenes_of_the_notes(path):
    """Elements keep to rows of their own, and no bar or body stands in the way of one."""
    _, flat = flattened(path)
    graph = shown(flat, flat.parameter_values()).graph
    style = style_of(graph, Names(graph))
    for domain in ("line", "shaft"):
        for strip in strips_of(graph.elements, domain):
            strip.shaft = domain == "shaft"
            assert draw_strip(strip, style).conflicts == 0


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_everything_is_within_the_picture(path):
    p = picture(path)
    for _, shape, frame in p.placed():
        left, top, right, bottom = shape_corners(shape, frame)
        assert left >= -0.5 and top >= -0.5 and right <= p.width + 0.5 and bottom <= p.height + 0.5


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_every_part_is_shown(path):
    if path.stem in LONG:
        return  # a summary
    p, flat = picture(path), flattened(path)[1]
    elements = shown(flat, flat.parameter_values()).graph.elements
    drawn = {item.part for item in p.items}
    silent = {e.name for e in elements if e.symbol in ("wall", "fixed-shaft")}  # told by the hatching
    assert {e.name for e in elements} - silent - drawn == set()


OTHERS = [p for folder in ("classic", "bench") for p in (MODELS / folder).glob("*.lmo")]
FOUND = (Path(__file__).parents[1] / "data" / "pictures").glob("*.lmo")


@pytest.mark.parametrize("path", sorted([*SCENES, *OTHERS, *FOUND]), ids=lambda p: p.stem)
def test_no_connection_of_the_model_is_missing(path):
    flat = flattened(path)[1]
    if shown(flat, flat.parameter_values()).graph is None:
        return  # a table of its parts
    assert lost(flat, picture(path)) == []
    assert numbers_mean_one_thing(picture(path))
    assert overlapping(picture(path)) == []
