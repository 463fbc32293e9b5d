"""The gallery: its index finds scenes by words and kinds, and everything it links to is in its folder."""

import re
import sys

import pytest
from conftest import ROOT
from oracles.browser import needs_browser, open_page

sys.path.insert(0, str(ROOT / "docs"))
import make_gallery

NOTES, MORE = ["notes/ex02_spring_mass_damper", "notes/ex05_suspension"], ["laws/h19_bouncing_ball", "planar/pendulum"]


@pytest.fixture(scope="module")
def gallery(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gallery")
    return folder, make_gallery.make(folder, NOTES, MORE)


def test_every_scene_has_a_page_a_picture_a_text_and_its_kinds(gallery):
    folder, entries = gallery
    index = (folder / "index.html").read_text()
    linked = re.findall(r'(?:href|src)="([^"]+)"', index)
    assert len(linked) == 8 and all((folder / name).is_file() for name in linked)
    assert not re.search(r'(?:href|src)="(?:https?:|//)', index)
    assert [e.course for e in entries] == [1, 2, 0, 0]
    assert "Example 5" in entries[1].text and entries[1].title == "Quarter car on a road (Example 5)"
    assert "stops and impacts" in entries[2].kinds and "in the plane" in entries[3].kinds
    assert all("<math" in (folder / f"{e.name}.html").read_text() and "<math" in e.equations for e in entries[:2])


def test_the_gallery_holds_some_forty_scenes_that_exist_the_notes_first():
    course = make_gallery.course()
    files = [*course, *make_gallery.MORE]
    assert 40 <= len(files) == len(set(files)) and all((ROOT / f"models/{f}.lmo").is_file() for f in files)
    places = [course.index(f"notes/{name}") for name in ("s2_2_rotor", "ex02_spring_mass_damper", "s8_gears")]
    assert places == sorted(places)


@needs_browser
def test_scenes_are_found_by_words_and_kinds(gallery):
    folder, entries = gallery
    seen = open_page((folder / "index.html").read_text(), """
      const shown = () => [...document.querySelectorAll("li:not([hidden]) strong")].map((s) => s.textContent);
      const search = document.querySelector("input[type=search]"), all = shown();
      const ask = (text) => { search.value = text; search.dispatchEvent(new Event("input", { bubbles: true })); };
      ask("spring ROAD");
      const road = shown();
      ask("strut tire damper");
      const parts = shown();
      ask("");
      const box = document.querySelector('input[value="in the plane"]');
      box.click();
      return { all, road, parts, plane: shown(), wide: document.documentElement.scrollWidth <= innerWidth };
    """, size=(360, 740))  # fmt: skip
    found = seen.answer
    assert len(found["all"]) == 4 and found["wide"]
    assert found["parts"] == found["road"]
    assert [r.partition(". ")[2] for r in found["road"]] == ["Quarter car on a road (Example 5)"]
    assert found["plane"] == [entries[3].title]
