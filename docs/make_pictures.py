"""Writes the pictures of all scenes and the gallery: ``python docs/make_pictures.py``.

Everything in ``docs/pictures`` and ``docs/gallery.md`` is made of the models alone.
"""

from __future__ import annotations

from pathlib import Path

import lmoc
from lmoc.interface import DAE
from lmoc.pipeline import Clock, Scene, flatten, open_scene
from lmoc.view.drawing import Drawing
from lmoc.view.scene.compose import picture_of

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs/pictures"
PAGE = ROOT / "docs/gallery.md"
FOLDERS = {
    "notes": "The scenes of the lecture notes, with their equations in [notes.md](notes.md).",
    "laws": "Strings that go slack, stops, dry friction, clutches, freewheels: [laws.md](laws.md).",
    "planar": "Mechanisms of the plane, to scale, where they start: [mechanisms.md](mechanisms.md).",
    "textbook": "Scenes of textbooks: cars, engines, gearboxes, hoists, each with its answer by hand in a test.",
    "hard": "Scenes that are difficult for one reason or another.",
}
BODIES = (
    "ex02_spring_mass_damper", "ex03_two_masses", "ex04_moving_frame", "ex05_suspension", "ex07_two_inertias",
    "ex08_cable_around_cylinder", "ex09_gear_pair_with_load", "ex10_lever_and_mass",
)  # fmt: skip
IN_PLANE = ("crane", "four_bar", "slider_crank")

INTRODUCTION = """\
# Gallery

`lmoc draw MODEL -o scene.svg` draws a scene from its model alone; nobody has placed anything here by hand. How the
pictures are made, and how a part of your own gets its look: [pictures.md](pictures.md).

*This page and its pictures are made by `python docs/make_pictures.py`.*
"""


def main() -> None:
    PICTURES.mkdir(exist_ok=True)
    parts = [INTRODUCTION]
    for folder, words in FOLDERS.items():
        parts.append(f"## `models/{folder}`\n\n{words}")
        parts += [entry(path) for path in sorted((ROOT / "models" / folder).glob("*.lmo"))]
    parts.append("## Free-body diagrams\n\n`lmoc draw MODEL --free-body -o bodies.svg`")
    parts += [bodies(ROOT / "models/notes" / f"{name}.lmo") for name in BODIES]
    parts += [bodies(ROOT / "models/planar" / f"{name}.lmo") for name in IN_PLANE]
    PAGE.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def entry(path: Path) -> str:
    """One scene: its title, its file, its picture. It is not reduced, unless it is a mechanism of the plane."""
    scene = open_scene(path, Scene(), Clock())
    flat = flatten(scene, Clock())
    picture = picture_of(flat, flat.parameter_values(), lambda: DAE(scene, flat).at_start())
    name = f"{path.parent.name}_{path.stem}.svg"
    Drawing(picture).save(PICTURES / name)
    note = "".join(f" {n[0].upper()}{n[1:]}." for n in picture.notes)
    file = f"[`{path.name}`](../models/{path.parent.name}/{path.name})"
    return f"**{picture.title}** ({file}){note}\n\n![](pictures/{name})"


def bodies(path: Path) -> str:
    dae = lmoc.compile(path)
    name = f"{path.parent.name}_{path.stem}_bodies.svg"
    dae.draw(PICTURES / name, free_body=True)
    return f"**{dae.flat.description}**\n\n![](pictures/{name})"


if __name__ == "__main__":
    main()
