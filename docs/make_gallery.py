"""Writes the gallery: ``python docs/make_gallery.py [FOLDER]`` fills ``docs/gallery/``, to be put on any web space.

Each scene has a page of its own (that of `lmoc view`: picture, plots, sliders, equations), the index finds it by words
and kinds. The scenes of the lecture notes come first, as a course in the order of the notes. Some 31 MB are made, in a
minute or two: the folder is not kept with the sources.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import lmoc
from lmoc.ir.flat import FlatDAE

ROOT = Path(__file__).parents[1]
GALLERY = ROOT / "docs/gallery"
NOTES = json.loads((ROOT / "tests/data/notes.json").read_text())
MORE = """
planar/pendulum planar/double_pendulum planar/cart_pole planar/crane planar/four_bar planar/slider_crank
planar/scissor_lift planar/chain planar/wheel_with_pendulum planar/three_cranks classic/andrews
hard/h05_atwood hard/h08_turning_lever hard/h22_block_and_tackle hard/h23_planetary_gear
laws/h06_bungee laws/h07_ball_on_string laws/h16_stick_slip laws/h17_backlash laws/h18_freewheel laws/h19_bouncing_ball
laws/h34_slack_string laws/clutch_lock laws/elevator laws/wagons laws/gear_shift
textbook/half_car textbook/hoist textbook/belt_drive textbook/valve_train textbook/engine textbook/gearbox
textbook/winch textbook/building textbook/double_wishbone textbook/bicycle textbook/roller_coaster textbook/clutch_start
""".split()
KINDS = {  # what the names of the classes of parts say
    "in the plane": r"^Planar\.",
    "shafts": r"Shaft|Inertia|Torsion|Rotor",
    "gears, belts, screws": r"Gear|Belt|Chain|Rack|Differential|Worm|Screw",
    "levers and pulleys": r"Lever|Pulley|Drum|Arm",
    "strings": r"Cable|String",
    "friction and clutches": r"Friction|Clutch|Brake|Ratchet",
    "stops and impacts": r"Stop|Contact|Backlash|Cam",
    "on a road or a track": r"Wheel|Track",
}


@dataclass(frozen=True)
class Entry:
    """A scene of the gallery.

    Attributes
    ----------
    name : of its files
    title, text : the model's description, and what its file says before it
    kinds : of `KINDS`
    words : in which it is found
    course : its number in the lecture notes; 0 for a scene beside them
    source : the model
    equations : of motion, HTML; "" where none can be read
    """

    name: str
    title: str
    text: str
    kinds: tuple[str, ...]
    words: str
    course: int
    source: str
    equations: str


def course() -> list[str]:
    """Return the files of the lecture notes' scenes in the order of the notes, then the rest of them."""
    files = [f"notes/{Path(entry['file']).stem}" for entry in NOTES.values()]
    rest = sorted(f"notes/{path.stem}" for path in (ROOT / "models/notes").glob("*.lmo"))
    return list(dict.fromkeys([*files, *rest]))


def kinds(flat: FlatDAE) -> tuple[str, ...]:
    """Return the kinds of a scene, by the classes of its parts."""
    classes = {part.class_name for part in flat.parts[1:]}
    return tuple(kind for kind, pattern in KINDS.items() if any(re.search(pattern, c) for c in classes))


def names(flat: FlatDAE) -> set[str]:
    """Return the names of a scene's parts, ports and quantities, and the classes of its parts, in words too."""
    classes = {part.class_name.rpartition(".")[2] for part in flat.parts[1:]}
    spoken = {re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name) for name in classes}
    own = (name for name in flat.names() if not name.startswith("ledger."))
    return classes | spoken | {piece for name in own for piece in re.findall(r"[^\W\d]\w*", name)}


def make_scene(file: str, number: int, folder: Path) -> Entry:
    """Write the page and the picture of a scene."""
    path = ROOT / f"models/{file}.lmo"
    dae = lmoc.compile(path)
    run = dae.simulate()
    name = file.replace("/", "-")
    page = run.view()
    page.save(folder / f"{name}.html")
    dae.draw(folder / f"{name}.svg")
    flat, source = run.flat, path.read_text(encoding="utf-8")
    head = " ".join(line[2:].strip() for line in source.split("model ")[0].splitlines() if line.startswith("//"))
    own = kinds(flat)
    title = flat.description or flat.name
    words = " ".join([flat.name, title, head, *own, *sorted(names(flat))]).lower()
    equations = page.contents.equations
    return Entry(name, title, head, own, words, number, source, equations if "<math" in equations else "")


def make(folder: Path, notes: Sequence[str], more: Sequence[str]) -> list[Entry]:
    """Write a gallery."""
    folder.mkdir(parents=True, exist_ok=True)
    entries = []
    for file, number in [*((f, k + 1) for k, f in enumerate(notes)), *((f, 0) for f in more)]:
        entries.append(make_scene(file, number, folder))
        print(f"{len(entries):3} of {len(notes) + len(more)}  {file}", file=sys.stderr)
    (folder / "index.html").write_text(index(entries), encoding="utf-8")
    return entries


def index(entries: Iterable[Entry]) -> str:
    """Return the page that finds them."""
    entries = list(entries)
    chips = "".join(f'<label><input type="checkbox" value="{escape(k)}"> {escape(k)}</label>' for k in KINDS)
    lists = (("The lecture notes, as a course", True), ("More scenes", False))
    sections = "".join(
        f"<section><h2>{title}</h2><ol>{''.join(card(e) for e in entries if bool(e.course) is noted)}</ol></section>"
        for title, noted in lists if any(bool(e.course) is noted for e in entries)
    )  # fmt: skip
    return PAGE.replace("{{chips}}", chips).replace("{{sections}}", sections).replace("{{count}}", str(len(entries)))


def card(entry: Entry) -> str:
    """Return an entry as an item of a list."""
    number = f"{entry.course}. " if entry.course else ""
    folded = f"<details><summary>equations</summary><div>{entry.equations}</div></details>" if entry.equations else ""
    return (
        f'<li data-words="{escape(entry.words)}" data-kinds="{escape("|".join(entry.kinds))}">'
        f'<a href="{entry.name}.html"><img src="{entry.name}.svg" alt="" loading="lazy">'
        f"<strong>{number}{escape(entry.title)}</strong></a><p>{escape(entry.text)}</p>"
        f"{folded}<details><summary>model</summary><pre>{escape(entry.source)}</pre></details></li>"
    )


PAGE = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Scenes of mechanics that move</title>
<style>
:root { color-scheme: light dark; }
body { font: 16px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 100rem; padding: 0 1rem 2rem; }
body { overflow-wrap: anywhere; }
form { position: sticky; top: 0; z-index: 1; background: Canvas; padding: .6rem 0; }
form { display: flex; flex-wrap: wrap; gap: .3rem 1rem; align-items: center; }
input[type=search] { font: inherit; flex: 1 1 14rem; padding: .3rem .6rem; }
ol { list-style: none; padding: 0; display: grid; gap: 1rem; }
ol { grid-template-columns: repeat(auto-fill, minmax(min(100%, 17rem), 1fr)); }
li { border: 1px solid #8886; border-radius: 8px; padding: .7rem; }
li[hidden] { display: none; }
img { width: 100%; height: 9rem; object-fit: contain; display: block; border-radius: 4px; }
a { color: inherit; text-decoration: none; } a:hover strong { text-decoration: underline; }
p { font-size: .88em; max-height: 4.4em; overflow: auto; margin: .3rem 0; }
pre, details div { font-size: .75em; overflow: auto; max-height: 20rem; } details math { font-size: 1.3em; }
h2 { font-size: 1.1rem; }
</style>
</head>
<body>
<h1>Scenes of mechanics that move</h1>
<form role="search">
<input type="search" placeholder="search {{count}} scenes: spring, gear, stick …" aria-label="search">
{{chips}}<output></output>
</form>
{{sections}}
<script>
const form = document.querySelector("form"), items = [...document.querySelectorAll("li")];
const search = form.querySelector("input[type=search]"), boxes = [...form.querySelectorAll("input[type=checkbox]")];
const show = () => {
  const words = search.value.toLowerCase().split(/\\s+/).filter(Boolean);
  const kinds = boxes.filter((b) => b.checked).map((b) => b.value);
  for (const item of items) {
    const own = item.dataset.kinds.split("|");
    item.hidden = !words.every((w) => item.dataset.words.includes(w)) || !kinds.every((k) => own.includes(k));
  }
  form.querySelector("output").textContent = `${items.filter((i) => !i.hidden).length} of ${items.length}`;
};
form.addEventListener("input", show);
form.addEventListener("submit", (event) => event.preventDefault());
show();
</script>
</body>
</html>
"""


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else GALLERY, course(), MORE)
