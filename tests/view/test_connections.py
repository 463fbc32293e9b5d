"""No connection of a random scene is missing in its picture: what is joined touches, or carries the same number."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
from oracles.connections import lost, numbers_mean_one_thing, overlapping
from oracles.random_scenes import graph, lattice, plane

from lmoc.interface import DAE
from lmoc.ir.flat import FlatDAE
from lmoc.pipeline import Clock, Scene, flatten, open_scene
from lmoc.view.scene.block import corners_of
from lmoc.view.scene.compose import picture_of
from lmoc.view.scene.picture import Picture


def opened(path: Path) -> tuple[FlatDAE, Picture]:
    scene = open_scene(path, Scene(), Clock())
    flat = flatten(scene, Clock())
    return flat, picture_of(flat, flat.parameter_values(), lambda: DAE(scene, flat).at_start())


RANDOM = {
    **{f"graph-{k}": graph(k, 8 + (k * 7) % 52) for k in range(0, 24, 4)},
    **{f"graph-{k}": graph(k, 8 + (k * 5) % 40) for k in range(1, 24, 8)},
    **{f"wheels-{k}": graph(k, 5 + (k * 11) % 20, 1 + k % 4) for k in range(3)},
    **{f"machines-{k}": graph(k, 6 + (k * 11) % 24, machines=3) for k in range(3)},
    "lattice": lattice(5, 2),
    "lattice of three rows": lattice(4, 3),
    "lattice of shafts": lattice(3, 3, "shaft"),
    "a rope over its own axle": graph(143, 8 + (143 * 7) % 53),
    "pulleys that hang from each other's ropes": graph(820275, 38, machines=3),
    "an unbalance on a shaft with a chain": """model M
  Fixed wall; FixedShaft held; TorsionSpring spring(k = 1); Inertia driving(J = 1), driven(J = 1);
  Chain chain(z1 = 20, z2 = 40, pitch = 0.01); Unbalance unbalance(m = 1, r = 0.1);
equation
  connect(held.shaft, spring.a); connect(spring.b, driving.shaft); connect(spring.b, chain.a);
  connect(chain.b, driven.shaft); connect(unbalance.shaft, spring.b); connect(unbalance.flange, wall.flange);
end M;""",
    **{f"plane-{k}": plane(k, 2 + k % 4) for k in range(2)},
}


@pytest.mark.parametrize("name", RANDOM)
def test_no_connection_of_a_random_scene_is_missing(name, tmp_path):
    path = tmp_path / "scene.lmo"
    path.write_text(RANDOM[name])
    flat, picture = opened(path)
    assert lost(flat, picture) == []
    assert numbers_mean_one_thing(picture)
    assert overlapping(picture) == []


@pytest.mark.parametrize("size", [(5, 2), (6, 3)], ids=str)
def test_coordinates_of_a_lattice_stand_beside_its_columns_or_within_their_own_bodies(size, tmp_path):
    path = tmp_path / "scene.lmo"
    path.write_text(lattice(*size))
    items = opened(path)[1].items
    bodies = {i.part: corners_of([i]) for i in items if i.symbol == "mass" and i.shapes}
    arrows = {i.variables["coordinate"].partition(".")[0]: corners_of([i]) for i in items if i.symbol == "coordinate"}
    within = 0
    for (part, a), (body, b) in product(arrows.items(), bodies.items()):
        apart = min(a[2], b[2]) <= max(a[0], b[0]) or min(a[3], b[3]) <= max(a[1], b[1])
        inside = b[0] <= a[0] and a[2] <= b[2] and b[1] <= a[1] and a[3] <= b[3] + 2
        assert apart or (part == body and inside)
        within += not apart
    assert within == (5 if size == (6, 3) else 0)


def test_the_test_notices_a_piece_that_is_taken_away(tmp_path):
    path = tmp_path / "scene.lmo"
    path.write_text(lattice(2, 2))
    flat, picture = opened(path)
    for item in picture.items:
        if item.symbol in ("mass", "spring"):
            assert lost(flat, replace(picture, items=tuple(i for i in picture.items if i is not item))) != []


def test_a_part_with_both_ends_at_one_place_is_drawn(tmp_path):
    path = tmp_path / "scene.lmo"
    path.write_text("""model M
  Fixed wall; Spring spring(k = 1), ring(k = 2); Mass mass(m = 1);
equation
  connect(wall.flange, spring.a); connect(spring.b, mass.flange);
  connect(ring.a, mass.flange); connect(ring.b, mass.flange);
end M;
""")
    flat, picture = opened(path)
    assert lost(flat, picture) == []
    assert sum(i.part == "ring" and i.symbol == "spring" for i in picture.items) == 1
