"""Pages in a real browser: they load alone, move, and simulate again when a slider is moved."""

from pathlib import Path

import numpy as np
import pytest
from oracles.browser import needs_browser, open_page

import lmoc
from lmoc.view.page.contents import contents

MODELS = Path(__file__).parents[2] / "models"

pytestmark = needs_browser

FACTS = """
  const $ = (id) => document.getElementById(id);
  const row = (name) => [...$("values").rows].find((r) => r.cells[0].textContent === name);
  const value = (name) => Number(row(name).cells[1].textContent);
  const difference = Number($("repeat").dataset.difference);
  const requests = performance.getEntriesByType("resource").map((e) => e.name);
  const paths = () => [...document.querySelectorAll("#stage path")].map((p) => p.getAttribute("d")).join();
"""


@pytest.fixture(scope="module")
def suspension():
    dae = lmoc.compile(MODELS / "notes" / "ex05_suspension.lmo")
    return dae, dae.simulate().view().html


def test_it_loads_alone_plays_and_scrubs(suspension):
    _, html = suspension
    seen = open_page(html, FACTS + """
      const still = paths();
      $("play").click();
      await frames(30);
      const playing = $("play").getAttribute("aria-pressed"), moved = paths() !== still;
      $("play").click();
      const time = $("time");
      time.value = "1.5";
      time.dispatchEvent(new Event("input"));
      const scrubbed = [$("now").textContent, value("q1"), value("q2")];
      document.dispatchEvent(new KeyboardEvent("keydown", { key: "Home", bubbles: true }));
      const home = $("now").textContent;
      document.body.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true }));
      const canvases = document.querySelectorAll("canvas").length;
      return { difference, requests, playing, moved, scrubbed, home, next: $("now").textContent, canvases,
               wide: document.documentElement.scrollWidth <= innerWidth, hash: location.hash };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == []
    assert found["requests"] == []
    assert found["difference"] < 1e-6
    assert found["playing"] == "true" and found["moved"]
    run = suspension[0].simulate(times=[0, 1.5])
    assert found["scrubbed"][0] == "t = 1.500 s"
    assert np.allclose(found["scrubbed"][1:], [run["q1"][-1], run["q2"][-1]], rtol=1e-3)
    assert found["home"] == "t = 0.000 s" and found["next"] == "t = 0.010 s"
    assert found["canvases"] == 3 and found["wide"] and found["hash"]


def test_a_slider_changes_the_curve_to_what_python_gives(suspension):
    dae, html = suspension
    seen = open_page(html, FACTS + """
      const slider = [...document.querySelectorAll(".slider")].find((r) => r.dataset.name === "k2");
      $("time").value = "2"; $("time").dispatchEvent(new Event("input"));
      const before = value("q2");
      $("keep").click();
      const entry = slider.querySelector("input[type=number]");
      entry.value = "40000"; entry.dispatchEvent(new Event("change")); await idle();
      const after = value("q2"), hash = location.hash;
      const range = slider.querySelector("input[type=range]");
      range.value = "-1"; range.dispatchEvent(new Event("input")); range.dispatchEvent(new Event("change")); await idle();
      const soft = [entry.value, value("q2")];
      const kept = [...document.querySelectorAll(".legend")].some((l) => l.textContent.includes("kept"));
      $("reset").click(); await idle();
      return { before, after, hash, soft, kept, again: value("q2"), trouble: $("trouble").textContent };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == []

    def truth(**given):
        return dae.simulate(parameters=given)["q2"][-1]

    assert found["before"] == pytest.approx(truth(), rel=1e-4) == pytest.approx(found["again"], rel=1e-4)
    assert found["after"] == pytest.approx(truth(k2=40000), rel=1e-4)
    assert found["soft"] == ["3200", pytest.approx(truth(k2=3200), rel=1e-4)]
    assert "set=k2:40000" in found["hash"] and found["kept"] and found["trouble"] == ""


def test_an_address_holds_the_state(suspension):
    _, html = suspension
    seen = open_page(html, FACTS + """
      location.hash = "#t=0.5&set=k2:40000,nonsense:1&against=&show=body.v,nothing&forces=1&speed=2";
      await frames(3); await idle();
      const arrows = document.querySelectorAll("#stage .arrows path").length;
      return { chips: [...document.querySelectorAll(".chips code")].map((c) => c.textContent), arrows,
               moved: [...document.querySelectorAll("#sliders .moved")].map((r) => r.dataset.name),
               forces: $("forces").checked, speed: $("speed").value, hash: location.hash };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == []
    assert found["chips"] == ["body.v"] and found["moved"] == ["k2"] and found["forces"] and found["arrows"] >= 2


def test_on_a_phone_nothing_is_wider_than_the_screen(suspension):
    _, html = suspension
    script = FACTS + "return [document.documentElement.scrollWidth, innerWidth, difference];"
    found = open_page(html, script, size=(500, 900)).answer  # chromium has no narrower window
    assert found[0] <= found[1]


@pytest.mark.parametrize("file", ["planar/slider_crank", "laws/h06_bungee", "notes/s3_1_cubic_spring"])
def test_other_scenes_move_without_a_complaint(file):
    html = lmoc.compile(MODELS / f"{file}.lmo").simulate().view().html
    seen = open_page(html, FACTS + """
      const still = paths();
      $("time").value = String(0.37 * Number($("time").max)); $("time").dispatchEvent(new Event("input"));
      return { moved: paths() !== still, difference, modes: $("modes").textContent };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == [] and found["moved"] and found["difference"] < 1e-6
    assert found["modes"].startswith("string: " if file.startswith("laws") else "")


def test_a_slider_changes_the_events():
    dae = lmoc.compile(MODELS / "laws" / "h34_slack_string.lmo")
    seen = open_page(dae.view().html, FACTS + """
      const slider = [...document.querySelectorAll(".slider")].find((r) => r.dataset.name === "mass.m");
      const entry = slider.querySelector("input[type=number]");
      const times = () => [...document.querySelectorAll("#events button")].map((b) => Number(b.textContent));
      const before = times();
      entry.value = String(1.4 * Number(entry.value)); entry.dispatchEvent(new Event("change")); await idle();
      document.querySelector("#events button").click();
      const title = document.querySelector("#events summary").textContent, modes = $("modes").textContent;
      return { before, after: times(), value: Number(entry.value), now: $("now").textContent, modes, title };
    """)  # fmt: skip
    found = seen.answer
    runs = [dae.simulate(), dae.simulate(parameters={"mass.m": found["value"]})]
    for run, times in zip(runs, (found["before"], found["after"]), strict=True):
        assert np.allclose(times, [e.time for e in run.events], rtol=1e-6)
    assert found["now"] == f"t = {found['after'][0]:.3f} s" and found["modes"]
    lost = sum(e.energy_lost for e in runs[1].events)
    assert f"({len(runs[1].events)})" in found["title"] and (f"{lost:.3g}" in found["title"] or not lost)


def test_shafts_seen_from_the_side_turn():
    html = lmoc.compile(MODELS / "notes" / "ex07_two_inertias.lmo").view().html
    seen = open_page(html, FACTS + """
      const marks = () => [...document.querySelectorAll("#stage .disk path.accent")].map((p) => p.getAttribute("d"));
      const before = marks();
      $("time").value = String(0.3 * Number($("time").max)); $("time").dispatchEvent(new Event("input"));
      return [before, marks()];
    """)  # fmt: skip
    before, after = seen.answer
    assert seen.console == [] and len(before) == 2 and all(a != b for a, b in zip(before, after, strict=True))


def test_modes_of_a_linear_scene_move():
    dae = lmoc.compile(MODELS / "notes" / "ex03_two_masses.lmo")
    run = dae.simulate()
    html = run.view().html
    seen = open_page(html, FACTS + """
      const seek = (t) => { $("time").value = String(t); $("time").dispatchEvent(new Event("input")); };
      const labels = [...$("mode").options].map((o) => o.textContent), ran = (seek(1), paths());
      $("mode").value = "0"; $("mode").dispatchEvent(new Event("change"));
      const period = 1 / Number(labels[1].match(/([\\d.]+) Hz/)[1]);
      seek(0.1); const swinging = paths();
      seek(0.1 + period / 3); const later = paths();
      $("mode").value = ""; $("mode").dispatchEvent(new Event("change")); seek(1);
      return { labels, moves: swinging !== later, differs: swinging !== ran, again: paths() === ran };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == [] and found["moves"] and found["differs"] and found["again"]
    model = dae.linearize()
    swings = sorted({round(v, 9) for v in model.eigenvalues.imag / (2 * np.pi) if v > 0})
    told = [label.split(" Hz")[0] for label in found["labels"][1:]]
    assert told == [f"mode {k + 1}: {f:.4g}" for k, f in enumerate(swings)]


def test_scenes_that_are_not_linear_have_no_modes():
    for file in ("planar/double_pendulum", "laws/h06_bungee", "notes/s3_1_cubic_spring"):
        run = lmoc.compile(MODELS / f"{file}.lmo").simulate(points=20)
        assert contents(run, "scene").data["swinging"]["modes"] == []


def test_the_picture_leaves_room_for_the_motion_and_strings_hang_while_they_are_slack():
    """A ball on a string starts below its pivot, flies above it with a slack string, and is caught again."""
    html = lmoc.compile(MODELS / "laws" / "h07_ball_on_string.lmo").simulate().view().html
    seen = open_page(html, FACTS + """
      const svg = document.querySelector("#stage svg"), box = svg.getBoundingClientRect();
      const rope = () => document.querySelector("#stage .string path").getAttribute("d");
      const taut = rope(), outside = [];
      for (let k = 0; k <= 60; k++) {
        $("time").value = String(k / 20);
        $("time").dispatchEvent(new Event("input"));
        const ball = document.querySelector("#stage .particle").getBoundingClientRect();
        if (ball.top < box.top - 1 || ball.bottom > box.bottom + 1 || ball.right > box.right + 1) outside.push(k / 20);
      }
      $("time").value = "0.6";
      $("time").dispatchEvent(new Event("input"));
      return { taut, slack: rope(), outside };
    """)  # fmt: skip
    assert seen.console == [] and seen.answer["outside"] == []
    assert "Q" not in seen.answer["taut"] and "Q" in seen.answer["slack"]


def test_the_end_of_a_rope_stays_on_the_mass_that_it_is_tied_to():
    html = lmoc.compile(MODELS / "laws" / "h34_slack_string.lmo").simulate().view().html
    seen = open_page(html, FACTS + """
      const apart = [];
      for (let k = 0; k <= 30; k++) {
        $("time").value = String(k / 10);
        $("time").dispatchEvent(new Event("input"));
        const mass = document.querySelector("#stage .mass path").getBoundingClientRect();
        const ropes = [...document.querySelectorAll("#stage .string path")].map((p) => p.getBoundingClientRect().left);
        apart.push(Math.min(...ropes) - mass.right);
      }
      return apart;
    """)  # fmt: skip
    assert seen.console == [] and np.ptp(seen.answer) < 0.6


LONG_NAMES = """
model M "scene of NAME"
  parameter Real kNAME(unit = "N/m") = 10;
  output Real qNAME(unit = "m") = massNAME.q;
  Fixed wallNAME;
  Mass massNAME(m = 1, q(start = 0.2, fixed = true), v(start = 0, fixed = true));
  Spring springNAME(k = kNAME);
  PART
equation
  connect(wallNAME.flange, springNAME.a);
  connect(springNAME.b, massNAME.flange);
  CONNECTED
  annotation(experiment(StopTime = 3));
end M;
"""
STOP = {
    "PART": "Stop stopNAME(L = -0.1, e = 0.5);",
    "CONNECTED": "connect(wallNAME.flange, stopNAME.a); connect(stopNAME.b, massNAME.flange);",
}


@pytest.mark.parametrize("more", [{"PART": "", "CONNECTED": ""}, STOP], ids=["spring", "stop"])
@pytest.mark.parametrize("width", [390, 1200])
def test_names_of_300_characters_do_not_make_the_page_wider_than_the_screen(more, width):
    text = LONG_NAMES
    for word, meaning in {**more, "NAME": "x" * 300}.items():
        text = text.replace(word, meaning)
    seen = open_page(lmoc.compile_text(text).simulate().view().html, """
      document.querySelectorAll("details").forEach((d) => { d.open = true; });
      await frames(2);
      return [document.documentElement.scrollWidth <= innerWidth, document.querySelectorAll("math").length > 0];
    """, size=(width, 900))  # fmt: skip
    assert seen.console == []
    assert seen.answer == [True, True]
