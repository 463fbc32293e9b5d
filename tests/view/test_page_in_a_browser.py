"""Pages in a real browser: they load alone, move, and simulate again when a slider is moved."""

import re
from pathlib import Path

import numpy as np
import pytest
from oracles.between_springs import JENKINS
from oracles.browser import needs_browser, open_page
from oracles.models import compiled

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
  const written = (e) => e.getAttribute("d") ?? e.getAttribute("points");
  const paths = () => [...document.querySelectorAll("#stage .line")].map(written).join();
"""


@pytest.fixture(scope="module")
def suspension():
    dae = compiled(MODELS / "notes" / "ex05_suspension.lmo")
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
      const shade = (e) => Number(getComputedStyle(e).backgroundColor.match(/[\\d.]+(?=\\)$)/)?.[0] ?? 0);
      const shades = [...document.querySelectorAll("#equations .term")].map(shade);
      return { shades, difference, requests, playing, moved, scrubbed, home, next: $("now").textContent, canvases,
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
    assert len(found["shades"]) == 14 and max(found["shades"]) > 0.2 > min(found["shades"])


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
      while ($("repeat").textContent === "") await frames(1);
      const accuracy = $("repeat").textContent;
      const range = slider.querySelector("input[type=range]");
      range.value = "-1"; range.dispatchEvent(new Event("input")); range.dispatchEvent(new Event("change"));
      await idle();
      const soft = [entry.value, value("q2")];
      const kept = [...document.querySelectorAll(".legend")].some((l) => l.textContent.includes("kept"));
      $("reset").click(); await idle();
      return { before, after, hash, soft, kept, accuracy, again: value("q2"), trouble: $("trouble").textContent };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == []

    def truth(**given):
        return dae.simulate(parameters=given)["q2"][-1]

    assert found["before"] == pytest.approx(truth(), rel=1e-4) == pytest.approx(found["again"], rel=1e-4)
    assert found["after"] == pytest.approx(truth(k2=40000), rel=1e-4)
    assert found["soft"] == ["3200", pytest.approx(truth(k2=3200), rel=1e-4)]
    assert re.match(r"This run is accurate to \de-\d ", found["accuracy"])
    assert "set=k2:40000" in found["hash"] and found["kept"] and found["trouble"] == ""


def test_the_ledger_is_measured_by_the_energy_that_swings():
    """What a pendulum stores does not change: measured by that, the error of its balance would be about 1."""
    html = compiled(MODELS / "planar" / "pendulum.lmo").simulate().view().html
    seen = open_page(html, FACTS + """
      const entry = document.querySelector(".slider input[type=number]");
      entry.value = String(1.2 * Number(entry.value)); entry.dispatchEvent(new Event("change")); await idle();
      return $("energy").textContent;
    """)  # fmt: skip
    assert 0 < float(re.search(r"error of the balance ([\d.]+e-\d+)", seen.answer)[1]) < 1e-5


def test_an_address_holds_the_state(suspension):
    _, html = suspension
    seen = open_page(html, FACTS + """
      location.hash = "#t=0.5&set=k2:40000,nonsense:1&against=&pulled=0.2,wheel.flange,900,0.1&show=body.v,nothing"
        + "&forces=1&speed=2&mode=1&loop=0";
      await frames(3); await idle();
      const { value: mode } = $("mode"), { hash } = location, svg = document.querySelector("#stage svg");
      $("mode").value = ""; $("mode").dispatchEvent(new Event("change"));
      const all = [...document.querySelectorAll("#stage .arrows path")], top = svg.getBoundingClientRect().top;
      const arrows = all.length, cut = Math.min(...all.map((p) => p.getBoundingClientRect().top)) < top - 1;
      $("keep").focus();
      $("keep").dispatchEvent(new KeyboardEvent("keydown", { key: "f", bubbles: true }));
      return { mode, hash, arrows, cut, loop: $("loop").checked, off: !$("forces").checked, 
               chips: [...document.querySelectorAll(".chips code")].map((c) => c.textContent),
               moved: [...document.querySelectorAll("#sliders .moved")].map((r) => r.dataset.name),
               speed: $("speed").value };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == []
    assert found["chips"] == ["body.v"] and found["moved"] == ["k2"] and found["off"] and found["arrows"] >= 2
    assert found["mode"] == "0" and not found["loop"] and not found["cut"]
    assert "pulled=0.2,wheel.flange,900" in found["hash"]


@pytest.mark.parametrize("size", [(360, 640), (768, 1024), (740, 360), (1920, 1080)], ids=str)
def test_picture_plots_and_sliders_are_on_one_screen(suspension, size):
    """Whatever is scrolled, the picture stays, with a plot and the first slider beside or under it."""
    _, html = suspension
    seen = open_page(html, FACTS + """
      const boxes = () => ["#stage svg", "#play", "#plots canvas", ".slider input"].map((s) => {
        const { left, top, right, bottom, width, height } = document.querySelector(s).getBoundingClientRect();
        return { left, top, right, bottom, width, height };
      });
      const first = boxes();
      for (const details of document.querySelectorAll("details")) details.open = true;
      const targets = [...document.querySelectorAll("button, select, summary, input")];
      const boxOf = (e) => (e.type === "checkbox" ? e.parentElement : e).getBoundingClientRect();
      const sized = targets.map((e) => [e.id || e.textContent || e.type, boxOf(e)]);
      const small = sized.filter(([, b]) => b.width && Math.min(b.width, b.height) < 24);
      $("panel").scrollTop = 1e6; $("curves").scrollTop = 1e6; scrollTo(0, 1e6); await frames(3);
      const { scrollWidth, scrollHeight } = document.documentElement;
      return { first, small, picture: boxes()[0], scrollWidth, scrollHeight, innerWidth, innerHeight };
    """, size=size)  # fmt: skip
    found = seen.answer
    assert seen.console == []
    assert found["small"] == []  # each target of a finger has 24 px (WCAG 2.5.8)
    assert found["innerWidth"] == size[0] == found["scrollWidth"] and found["innerHeight"] == found["scrollHeight"]
    picture, play, plot, slider = found["first"]
    assert found["picture"] == picture and picture["width"] * picture["height"] > 0.12 * size[0] * size[1]
    for box in (picture, play, slider):
        assert box["left"] >= 0 and box["top"] >= 0 and box["right"] <= size[0] + 1 and box["bottom"] <= size[1] + 1
    assert plot["top"] + 60 <= size[1] and plot["right"] <= size[0] + 1


DRAG = """
  const middle = (b) => [b.left + b.width / 2, b.top + b.height / 2];
  const box = (selector) => document.querySelector(selector).getBoundingClientRect();
  const drag = async (selector, dx, dy, at = [0.5, 0.5]) => {
    const svg = document.querySelector("#stage svg"), b = box(selector);
    svg.setPointerCapture = () => {};
    const [x, y] = [b.left + at[0] * b.width, b.top + at[1] * b.height];
    const send = (type, k) => svg.dispatchEvent(new PointerEvent(type, {
      bubbles: true, clientX: x + k * dx, clientY: y + k * dy, button: 0, buttons: 1, pointerId: 1 }));
    send("pointerdown", 0);
    for (let k = 1; k <= 8; k++) { send("pointermove", k / 8); await frames(1); }
    await idle();
    const now = box(selector);
    send("pointerup", 1);
    await idle();
    return [now.left + at[0] * now.width - x, now.top + at[1] * now.height - y];
  };
  const address = () => Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const init = () => Object.fromEntries((address().init ?? "").split(",").filter(Boolean).map((p) => {
    const [name, value] = p.split(":");
    return [name, Number(value)];
  }));
"""


def test_what_is_dragged_is_where_the_run_begins_and_python_gives_the_same(suspension):
    dae, html = suspension
    seen = open_page(html, FACTS + DRAG + """
      const gone = await drag("#stage .mass .line", 0, -24);
      const begun = init();
      $("time").value = "1"; $("time").dispatchEvent(new Event("input"));
      const field = document.querySelector(".starts .moved input").value;
      return { gone, init: begun, values: [value("q1"), value("q2")], field };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == [] and np.allclose(found["gone"], [0, -24], atol=0.5)
    assert list(found["init"]) == ["wheel.q"] and float(found["field"]) == pytest.approx(found["init"]["wheel.q"], 1e-4)
    run = dae.simulate(initial=found["init"], times=[0, 1])
    assert run["wheel.q"][0] == found["init"]["wheel.q"] != dae.simulate(times=[0, 1])["wheel.q"][0]
    assert np.allclose(found["values"], [run["q1"][-1], run["q2"][-1]], rtol=1e-4)


def test_constraints_hold_while_a_mechanism_is_dragged():
    """The crank of a four-bar is taken along: the loop stays closed, and what is pulled out of reach stays in reach."""
    dae = compiled(MODELS / "hard" / "h03_four_bar.lmo")
    seen = open_page(dae.simulate(points=50).view().html, FACTS + DRAG + """
      const gone = await drag("#stage .link .line", 12, 9, [0.9, 0.2]);
      const begun = init();
      await drag("#stage .link .line", 4000, 0, [0.9, 0.2]);
      return { gone, init: begun, far: init(), trouble: $("trouble").textContent };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == [] and found["trouble"] == "" and found["init"]
    assert any(abs(v) > 1 for v in found["gone"])
    for init in (found["init"], found["far"]):
        run = dae.simulate(initial=init, stop=0.5, points=20)
        assert run.complete
        assert all(run[name][0] == pytest.approx(value, abs=1e-9) for name, value in init.items())


def test_the_hand_pulls_while_the_scene_runs_and_the_address_gives_the_same_run(suspension):
    _, html = suspension
    seen = open_page(html, FACTS + DRAG + """
      const svg = document.querySelector("#stage svg"), b = box("#stage .mass .line");
      svg.setPointerCapture = () => {};
      const send = (type, k) => svg.dispatchEvent(new PointerEvent(type, {
        bubbles: true, clientX: b.left + 9, clientY: b.top + 9 - k, button: 0, buttons: 1, pointerId: 1 }));
      $("play").click();
      await frames(4);
      send("pointerdown", 0);
      let drawn = "";
      for (let k = 1; k <= 30; k++) {
        send("pointermove", 8 * Math.min(k, 10));
        await frames(1);
        drawn = drawn || document.querySelector(".hand").getAttribute("d") || "";
      }
      const playing = $("play").getAttribute("aria-pressed"), whose = $("whose").textContent;
      const live = [value("q1"), Number($("now").textContent.match(/[\\d.]+/)[0])];
      send("pointerup", 80);
      $("play").click();
      await idle();
      const energy = [...document.querySelectorAll("figcaption")].at(-1).textContent, hash = location.hash;
      const at = (t) => {
        $("time").value = String(t);
        $("time").dispatchEvent(new Event("input"));
        return value("q1");
      };
      const first = at(1.5), gone = document.querySelector(".hand").getAttribute("d");
      $("reset").click(); await idle();
      const free = at(1.5);
      location.hash = hash; await frames(3); await idle();
      const told = [whose, $("whose").textContent];
      const near = [-0.001, 0.001].map((part) => at(live[1] + part)); // the clock has three digits
      return { live: live[0], near, drawn, playing, energy, hash, first, free, again: at(1.5), gone, told };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == [] and found["playing"] == "true"
    assert found["drawn"].startswith("M") and found["gone"] == ""
    assert "before the pull" in found["told"][0] and found["told"][1] == ""
    assert min(found["near"]) - 1e-4 <= found["live"] <= max(found["near"]) + 1e-4
    assert "pull=" in found["hash"] and ",wheel.flange," in found["hash"]
    assert float(found["energy"].split()[-1]) < 1e-4
    assert found["again"] == pytest.approx(found["first"], rel=1e-4) and found["first"] != found["free"]


def test_a_mass_on_a_string_is_dragged_no_farther_than_the_string_is_long():
    dae = lmoc.compile_text("""
    model M
      Fixed wall;
      Cable string(L = 1);
      Mass body(m = 1, q(start = 0.6, fixed = true), v(start = 0, fixed = true));
      Spring spring(k = 3);
      Fixed other;
    equation
      connect(wall.flange, string.a); connect(string.b, body.flange);
      connect(body.flange, spring.a); connect(spring.b, other.flange);
      annotation(experiment(StopTime = 3));
    end M;""")
    seen = open_page(dae.simulate().view().html, FACTS + DRAG + """
      await drag("#stage .mass .line", 900, 0);
      const far = init();
      await drag("#stage .mass .line", -30, 0);
      const back = init(), trouble = $("trouble").textContent;
      await drag("#stage .wall .line", 9, 9);
      const same = JSON.stringify(init()) === JSON.stringify(back);
      return { far, back, trouble, same, told: $("trouble").textContent };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == [] and found["trouble"] == "" and found["same"]
    assert found["told"] in ("wall does not move in the picture.", "other does not move in the picture.")
    assert 1 - 1e-4 < found["far"]["body.q"] <= 1 + 1e-9  # how near to it depends on when the pointer is heard
    assert found["back"]["body.q"] < 1


def test_a_cam_that_is_turned_lifts_its_follower_and_what_cannot_move_is_told():
    """The follower is pushed along a curve, and stays up where the cam turns back; what is prescribed stays so."""
    dae = compiled(MODELS / "textbook" / "valve_train.lmo")
    seen = open_page(dae.simulate().view().html, FACTS + DRAG + """
      await drag("#stage .cam .line", 40, 12, [0.5, 0.95]);
      const begun = init(), trouble = $("trouble").textContent;
      const svg = document.querySelector("#stage svg"), b = box("#stage .cam .line");
      const send = (type, k) => svg.dispatchEvent(new PointerEvent(type, {
        bubbles: true, clientX: b.left + 9, clientY: b.top + b.height / 2 - k, button: 0, buttons: 1, pointerId: 1 }));
      $("play").click();
      await frames(4);
      send("pointerdown", 0);
      for (let k = 1; k < 9; k++) { send("pointermove", 4 * k); await frames(1); }
      send("pointerup", 36);
      await frames(2); await idle();
      return { init: begun, trouble, told: $("trouble").textContent };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == [] and found["trouble"] == "" and "cam does not give way to a pull" in found["told"]
    run = dae.simulate(initial=found["init"], times=[0, 1e-4])
    assert abs(found["init"]["drive.theta"]) > 0.3 and run["valve.q"][0] > 2e-4
    assert -1e-11 < run["gap"][0] < 1e-4


def test_one_of_many_parts_that_are_drawn_together_is_found():
    text = """
    model M
      inner Planar.World world(g = 9.81);
      Planar.Anchor nail[5](x = {k for k in 1:5});
      Planar.PointMass ball[5](each m = 1, x(start = {k for k in 1:5}, each fixed = true),
        y(each start = -1, each fixed = true));
      Planar.Spring spring[5](each k = 30, each d0 = 1);
    equation
      for k in 1:5 loop connect(nail[k].point, spring[k].a); connect(spring[k].b, ball[k].point); end for;
      annotation(experiment(StopTime = 1));
    end M;
    """
    seen = open_page(lmoc.compile_text(text).simulate(points=20).view().html, FACTS + """
      const svg = document.querySelector("#stage svg"), springs = () => document.querySelectorAll("#stage .spring");
      svg.setPointerCapture = () => {};
      const told = [springs().length];
      for (const k of [2, 4, 4]) {
        const ball = document.querySelectorAll("#stage .particle circle")[k - 1].getBoundingClientRect();
        const place = { clientX: ball.left + ball.width / 2, clientY: ball.top - 20 };
        const press = { bubbles: true, button: 0, pointerId: 1, ...place };
        for (const type of ["pointerdown", "pointerup"]) svg.dispatchEvent(new PointerEvent(type, press));
        const chosen = [...document.querySelectorAll("#stage .spring.chosen title")].map((t) => t.textContent);
        const drawn = [...document.querySelectorAll("#stage .spring .line")].map(written).every(Boolean);
        told.push([$("part").value, chosen, springs().length, drawn]);
      }
      return told;
    """)  # fmt: skip
    assert seen.console == []
    assert seen.answer == [
        1, ["spring[2]", ["spring[2]"], 5, True], ["spring[4]", ["spring[4]"], 5, True], ["", [], 1, True],
    ]  # fmt: skip


def test_events_are_walked_through_and_a_part_shows_its_equation():
    run = compiled(MODELS / "laws" / "h06_bungee.lmo").simulate()
    seen = open_page(run.view().html, FACTS + """
      const told = [];
      for (let k = 0; k < 2; k++) {
        $("after").click();
        told.push([Number($("time").value), $("happened").textContent]);
      }
      $("before").click();
      const back = Number($("time").value);
      const { left, top, width, height } = document.querySelector("#stage .spring .line").getBoundingClientRect();
      const at = { bubbles: true, clientX: left + width / 2, clientY: top + height / 2, button: 0, pointerId: 1 };
      const svg = document.querySelector("#stage svg");
      svg.setPointerCapture = () => {};
      svg.dispatchEvent(new PointerEvent("pointerdown", at)); svg.dispatchEvent(new PointerEvent("pointerup", at));
      await frames(2);
      const rows = [...$("part-values").rows].map((r) => [r.cells[0].textContent, Number(r.cells[1].textContent)]);
      const equations = $("part-equations").textContent;
      return { told, back, part: $("part").value, equations, rows: Object.fromEntries(rows),
               curves: document.querySelectorAll("#part-plots canvas").length, hash: location.hash,
               chosen: document.querySelectorAll("#stage .item.chosen").length };
    """)  # fmt: skip
    found = seen.answer
    first, second = run.events[:2]
    assert seen.console == []
    assert [t for t, _ in found["told"]] == [pytest.approx(e.time, abs=1e-12) for e in (first, second)]
    assert first.name in found["told"][0][1] and "taut" in found["told"][0][1] and found["back"] == found["told"][0][0]
    assert found["part"] == "spring" and "f = k*extension" in found["equations"] and "part=spring" in found["hash"]
    k, f, extension = run["spring.k"], found["rows"]["f"], found["rows"]["extension"]
    assert f == pytest.approx(float(np.ravel(k)[0]) * extension, rel=1e-3)
    assert found["curves"] >= 1 and found["chosen"] >= 1


def test_variables_are_plotted_over_each_other_and_the_energy_part_by_part(suspension):
    dae, html = suspension
    seen = open_page(html, FACTS + """
      const over = $("over"), energy = document.querySelector("#energy .legend").textContent;
      over.value = "q1"; over.dispatchEvent(new Event("change"));
      $("time").value = "0.5"; $("time").dispatchEvent(new Event("input"));
      const svg = document.querySelectorAll("svg.phase")[1];
      const dot = ["cx", "cy"].map((k) => Number(svg.querySelector("circle").getAttribute(k)));
      const points = svg.querySelector("path[stroke]").getAttribute("d").split(/[ML]/).slice(1)
        .map((p) => p.match(/[-\\d.]+/g).map(Number));
      const hash = location.hash, canvases = document.querySelectorAll("#plots canvas").length;
      over.value = "no such name"; over.dispatchEvent(new Event("change"));
      return { energy, dot, points, hash, canvases, back: document.querySelectorAll("#plots canvas").length };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == [] and "over=q1" in found["hash"] and found["canvases"] == 0 < found["back"]
    assert "strut.energy" in found["energy"] and "lost" in found["energy"]
    run = dae.simulate().fine
    x, y = np.array([p[:2] for p in found["points"]]).T
    for shown, values, here in ((x, run["q1"], found["dot"][0]), (y, run["v_q1"], found["dot"][1])):
        assert len(shown) == len(values)
        slope, offset = np.polyfit(values, shown, 1)
        assert np.abs(slope * values + offset - shown).max() < 0.2  # px: the same curve
        assert here == pytest.approx(slope * np.interp(0.5, run.time, values) + offset, abs=0.5)


PUSHED = {
    "line": """
    Fixed wall; Spring spring(k = 20); Mass body(m = 1, q(start = 0.1, fixed = true), v(start = 0, fixed = true));
    Force push(f = 5*cos(3*time));
  equation
    connect(wall.flange, spring.a); connect(spring.b, body.flange); connect(push.flange, body.flange);""",
    "plane": """
    import Planar.*; inner World world(g = 9.81); Anchor nail(x = 0, y = 1); Spring spring(k = 20);
    Force push(fx = 3, fy = 4);
    PointMass body(m = 1, x(start = 0.1, fixed = true), y(start = 0, fixed = true),
      vx(start = 0, fixed = true), vy(start = 0, fixed = true));
  equation
    connect(push.point, body.point); connect(spring.a, nail.point); connect(spring.b, body.point);""",
}


@pytest.mark.parametrize("where", PUSHED)
def test_forces_are_arrows_in_scale(where):
    """Tensions at both ends of a spring, what pushes as it points."""
    run = lmoc.compile_text(f"model M {PUSHED[where]} annotation(experiment(StopTime = 2)); end M;").simulate()
    seen = open_page(run.view().html, FACTS + """
      $("forces").click();
      const line = (p) => p.getAttribute("d").slice(1).split("L").slice(0, 2).map((v) => v.split(" ").map(Number));
      const arrows = [...document.querySelectorAll("#stage .arrows path")].map(line);
      return { arrows: arrows.map(([a, b]) => [b[0] - a[0], a[1] - b[1]]), scale: $("scale").textContent };
    """)  # fmt: skip
    tension, push = float(run["spring.f"][0]), (5, 0) if where == "line" else (3, 4)
    largest = max(np.abs(run.fine["spring.f"]).max(), 5)
    assert seen.console == [] and float(seen.answer["scale"].split()[1]) == pytest.approx(largest, rel=1e-3)
    one, other, pushing = np.array(seen.answer["arrows"]) * largest / 56
    assert np.allclose(one, -other, atol=0.01) and np.hypot(*one) == pytest.approx(abs(tension), rel=1e-2)
    assert np.allclose(pushing, push, atol=0.02)


SLIDERS = """
model M
  parameter Real a = 2 "not asked for";
  parameter Real k(unit = "N/m") = 40 "stiffness" annotation(Slider(min = 10, max = 90, step = 5));
  output Real q = m[3].q;
  Fixed wall;
  Mass m[3](each m = 1.5, q(start = {0.1, 0.2, 0.3}, each fixed = true));
  Spring s[3](each k = k*a);
equation
  connect(wall.flange, s[1].a);
  for i in 1:2 loop connect(m[i].flange, s[i + 1].a); end for;
  for i in 1:3 loop connect(s[i].b, m[i].flange); end for;
  annotation(experiment(StopTime = 1));
end M;
"""


def test_sliders_that_the_model_asks_for_come_first_with_their_range():
    dae = lmoc.compile_text(SLIDERS)
    seen = open_page(dae.simulate().view().html, FACTS + """
      const rows = [...document.querySelectorAll(".slider[data-name]")].map((r) => r.dataset.name);
      const range = document.querySelector(".slider input[type=range]");
      const limits = [range.min, range.max, range.step, range.value].map(Number);
      range.value = "75"; range.dispatchEvent(new Event("input")); await idle();
      $("time").value = "0.7"; $("time").dispatchEvent(new Event("input"));
      const title = (group) => group.querySelector("summary").textContent;
      const groups = [...document.querySelectorAll(".group")].map((g) => [title(g), g.open]);
      const entry = document.querySelector(".slider input[type=number]").value;
      return { rows, limits, q: value("q"), groups, entry };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == [] and found["limits"] == [10, 90, 5, 40] and found["entry"] == "75"
    assert found["rows"][:2] == ["k", "a"] and found["rows"].count("m.m") == 1 and "m[1].m" not in found["rows"]
    assert found["groups"][0] == ["Parameters", True] and found["groups"][1] == ["More parameters", False]
    assert found["q"] == pytest.approx(dae.simulate(parameters={"k": 75}, times=[0, 0.7])["q"][-1], rel=1e-3)


@pytest.mark.parametrize("file", ["planar/slider_crank", "laws/h06_bungee", "notes/s3_1_cubic_spring"])
def test_other_scenes_move_without_a_complaint(file):
    html = compiled(MODELS / f"{file}.lmo").simulate(solver="dop853").view().html  # the page's own method
    seen = open_page(html, FACTS + """
      const still = paths();
      $("time").value = String(0.37 * Number($("time").max)); $("time").dispatchEvent(new Event("input"));
      return { moved: paths() !== still, difference, modes: $("modes").textContent };
    """)  # fmt: skip
    found = seen.answer
    assert seen.console == [] and found["moved"] and found["difference"] < 1e-6
    assert found["modes"].startswith("string: " if file.startswith("laws") else "")


@pytest.mark.parametrize("scene, name", [("h34_slack_string", "mass.m"), (JENKINS, "slider.F")])
def test_a_slider_changes_the_events(scene, name):
    dae = lmoc.compile_text(JENKINS) if scene == JENKINS else compiled(MODELS / "laws" / f"{scene}.lmo")
    seen = open_page(dae.view().html, FACTS + f"const name = '{name}';" + """
      const slider = [...document.querySelectorAll(".slider")].find((r) => r.dataset.name === name);
      const entry = slider.querySelector("input[type=number]");
      const times = () => [...document.querySelectorAll("#events button")].map((b) => Number(b.textContent));
      const before = times();
      entry.value = String(1.4 * Number(entry.value)); entry.dispatchEvent(new Event("change")); await idle();
      document.querySelector("#events button").click();
      const title = document.querySelector("#events summary").textContent, modes = $("modes").textContent;
      return { before, after: times(), value: Number(entry.value), now: $("now").textContent, modes, title };
    """)  # fmt: skip
    found = seen.answer
    runs = [dae.simulate(), dae.simulate(parameters={name: found["value"]})]
    for run, times in zip(runs, (found["before"], found["after"]), strict=True):
        assert np.allclose(times, [e.time for e in run.events], rtol=1e-6)
    assert found["now"] == f"t = {found['after'][0]:.3f} s" and found["modes"]
    lost = sum(e.energy_lost for e in runs[1].events)
    assert f"({len(runs[1].events)})" in found["title"] and (f"{lost:.3g}" in found["title"] or not lost)


def test_shafts_seen_from_the_side_turn():
    html = compiled(MODELS / "notes" / "ex07_two_inertias.lmo").view().html
    seen = open_page(html, FACTS + """
      const marks = () => [...document.querySelectorAll("#stage .disk path.accent")].map((p) => p.getAttribute("d"));
      const before = marks();
      $("time").value = String(0.3 * Number($("time").max)); $("time").dispatchEvent(new Event("input"));
      return [before, marks()];
    """)  # fmt: skip
    before, after = seen.answer
    assert seen.console == [] and len(before) == 2 and all(a != b for a, b in zip(before, after, strict=True))


def test_modes_of_a_linear_scene_move():
    dae = compiled(MODELS / "notes" / "ex03_two_masses.lmo")
    run = dae.simulate()
    html = run.view().html
    seen = open_page(html, FACTS + """
      const seek = (t) => { $("time").value = String(t); $("time").dispatchEvent(new Event("input")); };
      const labels = [...$("mode").options].map((o) => o.textContent), ran = (seek(1), paths());
      $("mode").value = "0"; $("mode").dispatchEvent(new Event("change"));
      const period = 1 / Number(labels[1].match(/([\\d.]+) Hz/)[1]);
      seek(0.1); const swinging = paths(), whose = $("whose").textContent;
      seek(0.1 + period / 3); const later = paths();
      $("mode").value = ""; $("mode").dispatchEvent(new Event("change")); seek(1);
      const told = [whose, $("whose").textContent];
      return { labels, told, moves: swinging !== later, differs: swinging !== ran, again: paths() === ran };
    """)  # fmt: skip
    found = seen.answer
    assert found["told"] == ["The picture swings in a mode; plots and values are of the run.", ""]
    assert seen.console == [] and found["moves"] and found["differs"] and found["again"]
    model = dae.linearize()
    swings = sorted({round(v, 9) for v in model.eigenvalues.imag / (2 * np.pi) if v > 0})
    told = [label.split(" Hz")[0] for label in found["labels"][1:]]
    assert told == [f"mode {k + 1}: {f:.4g}" for k, f in enumerate(swings)]


def test_scenes_that_are_not_linear_have_no_modes():
    for file in ("planar/double_pendulum", "laws/h06_bungee", "notes/s3_1_cubic_spring"):
        run = compiled(MODELS / f"{file}.lmo").simulate(points=20)
        assert contents(run, "scene").data["swinging"]["modes"] == []


def test_the_picture_leaves_room_for_the_motion_and_strings_hang_while_they_are_slack():
    """A ball on a string starts below its pivot, flies above it with a slack string, and is caught again."""
    html = compiled(MODELS / "laws" / "h07_ball_on_string.lmo").simulate().view().html
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
    html = compiled(MODELS / "laws" / "h34_slack_string.lmo").simulate().view().html
    seen = open_page(html, FACTS + """
      const apart = [];
      for (let k = 0; k <= 30; k++) {
        $("time").value = String(k / 10);
        $("time").dispatchEvent(new Event("input"));
        const mass = document.querySelector("#stage .mass .line").getBoundingClientRect();
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


@pytest.mark.parametrize(
    ("more", "width"), [({"PART": "", "CONNECTED": ""}, 1200), (STOP, 390)], ids=["spring", "stop"]
)
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
