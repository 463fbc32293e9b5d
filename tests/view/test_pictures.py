"""Pictures of the scenes in models/: everything is shown, nothing overlaps, and what is drawn agrees with the model."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from pathlib import Path

import pytest

import lmoc
from lmoc.view.scene.abbreviate import shown
from lmoc.view.scene.block import shape_corners
from lmoc.view.scene.picture import Label, Picture
from lmoc.view.scene.text import plain

MODELS = Path(__file__).parents[2] / "models"
FOLDERS = ("notes", "hard", "laws", "planar")
LONG = ("h14_plucked_string", "wagons")
SCENES = sorted(p for folder in FOLDERS for p in (MODELS / folder).glob("*.lmo"))


@cache
def compiled(path: Path) -> lmoc.DAE:
    return lmoc.compile(path)


@cache
def picture(path: Path) -> Picture:
    return compiled(path).draw().picture


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
    p, dae = picture(path), compiled(path)
    elements = shown(dae.flat, dae.values).graph.elements
    drawn = {item.part for item in p.items}
    silent = {e.name for e in elements if e.symbol in ("wall", "fixed-shaft")}  # told by the hatching
    assert {e.name for e in elements} - silent - drawn == set()
