"""Pages as text: what they hold, what they leave out, and that nothing in a model gets out of its place."""

import json
import re
from base64 import b64decode
from html.parser import HTMLParser
from pathlib import Path
from zlib import decompress

import numpy as np
import pytest
from oracles.browser import needs_browser, open_page
from oracles.in_javascript import in_engine
from oracles.models import compiled
from oracles.node import needs_node, run_script

import lmoc
from lmoc.view.page.contents import contents
from lmoc.view.page.equations import page_equations
from lmoc.view.page.join import joined
from lmoc.view.page.page import Page

MODELS = Path(__file__).parents[2] / "models"
LIMIT = 1_500_000  # bytes

EVIL = "<img src=x onerror=alert(1)></script><script>alert(2)</script><!--{{script}}"
HOSTILE = f"""
model Hostile "{EVIL}"
  parameter Real k(unit = "N/m") = 8 "{EVIL}";
  output Real x = body.q "{EVIL}";
  output Real '<b onmouseover=alert(3)>&amp;' = 2*body.q;
  Mass body(m = 2, q(start = 0.5, fixed = true)) "{EVIL}";
  Spring '</title><script>alert(4)</script>'(k = k);
  Fixed wall;
equation
  connect(wall.flange, '</title><script>alert(4)</script>'.a);
  connect('</title><script>alert(4)</script>'.b, body.flange);
end Hostile;
"""


class Elements(HTMLParser):
    """Names of the elements of a page, and the attributes that could act."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: list[str] = []
        self.acting: list[tuple] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.names.append(tag)
        self.acting += [a for a in attrs if a[0].startswith("on") or a[0] in ("src", "href", "srcset", "action")]


def data_of(html: str) -> dict:
    return json.loads(decompress(b64decode(re.search(r'<script type="text/plain" id="data">(.*?)</script>', html)[1])))


def view_of(text: str, **options) -> Page:
    return lmoc.compile_text(text).simulate(**{"stop": 2, "points": 51} | options).view()


def test_it_is_one_file_that_loads_nothing():
    html = view_of(HOSTILE.replace(EVIL, "harmless")).html
    found = Elements(html)
    assert found.acting == [] and "link" not in found.names and "iframe" not in found.names
    assert re.findall(r"@import|url\((?!#)", html) == []
    assert "default-src 'none'" in html
    assert "Copyright (c) 2022 Leon Sorokin" in html


def test_hostile_names_and_texts_stay_texts():
    harmless, hostile = view_of(HOSTILE.replace(EVIL, "harmless")).html, view_of(HOSTILE).html
    assert Elements(hostile).names == Elements(harmless).names and Elements(hostile).acting == []
    assert data_of(hostile)["variables"][0]["name"] == "x"
    assert "<img" not in hostile.split('<script type="module">')[0].split("<script>")[0]


@needs_browser
def test_hostile_names_and_texts_do_nothing_in_a_browser():
    page = view_of(HOSTILE)
    seen = open_page(page.html, """
      globalThis.alert = (n) => { globalThis.hit = n; };
      const entry = document.querySelector("#chooser input");
      entry.value = "<b onmouseover=alert(3)>&amp;"; entry.dispatchEvent(new Event("change"));
      location.hash = "#show=" + encodeURIComponent("<img src=x onerror=alert(5)>") + "&set=%3Cb%3E:1";
      await frames(5);
      const bold = document.querySelectorAll("main b").length;
      return { hit: globalThis.hit ?? null, images: document.querySelectorAll("img:not(.still)").length, bold };
    """)  # fmt: skip
    assert seen.console == [] and seen.answer["hit"] is None
    assert seen.answer["images"] == seen.answer["bold"] == 0


def test_values_that_are_none_leave_gaps_and_are_told():
    text = "model M Real x(start=-1, fixed=true); Real y; equation der(x) = 1; y = sqrt(x); end M;"
    page = view_of(text)
    found = contents(page.run, "M")
    assert any("no value" in sentence for sentence in found.missing)
    json.dumps(found.data, allow_nan=False)


def test_a_run_that_broke_off_shows_what_there_is():
    dae = lmoc.compile_text("model M Real x(start=1, fixed=true); equation der(x) = x^2; end M;")
    with pytest.raises(lmoc.SimulationError) as failure:
        dae.simulate(stop=3)
    html = failure.value.partial.view().html
    assert "The run broke off at t = " in html
    data = data_of(html)
    assert not data["complete"] and data["script"]["end"] < 1.01


def test_large_scenes_make_small_pages_that_say_what_is_left_out():
    text = """
    model Chain
      parameter Integer n = 10000;
      Mass m[n](each m = 1); Spring s[n](each k = 100); Fixed wall;
      output Real x = m[n].q;
    initial equation
      m[1].v = 1;
    equation
      connect(wall.flange, s[1].a);
      for i in 1:n loop connect(s[i].b, m[i].flange); end for;
      for i in 2:n loop connect(m[i-1].flange, s[i].a); end for;
    end Chain;
    """
    run = lmoc.compile_text(text).simulate(stop=0.5, points=21, rtol=1e-4)
    html = run.view().html
    assert len(html.encode()) < LIMIT
    assert "too large to be simulated in a page" in data_of(html)["script"]["reason"] and "left out" in html


@pytest.mark.parametrize("file", ["lattice", "gear_tree"])
def test_irregular_large_scenes_stay_below_the_limit(file):
    dae = compiled(MODELS / "bench" / f"{file}.lmo")
    assert len(dae.simulate(stop=0.01, points=5).view().html.encode()) < LIMIT


def test_many_output_times_are_thinned_but_events_keep_theirs():
    dae = compiled(MODELS / "laws" / "h19_bouncing_ball.lmo")
    run = dae.simulate(points=200_001)
    page = run.view()
    assert len(page.html.encode()) < LIMIT and "output times are shown" in page.html
    data = contents(run, "ball").data
    time = np.frombuffer(b64decode(data["time"]))
    first = data["events"][0]["time"]
    assert np.abs(time - first).min() <= 2 * (run.time[1] - run.time[0])


def test_every_scene_of_the_notes_has_a_page_below_the_limit():
    for file in (MODELS / "notes" / "ex05_suspension.lmo", MODELS / "notes" / "s9_lever_large_angles.lmo"):
        html = lmoc.compile(file).view().html
        assert len(html.encode()) < LIMIT / 3 and "<math" in html


def test_the_page_says_by_which_method_it_simulates():
    """Of a run by another method it is as right at a tolerance ten times finer; where it has none, it says nothing."""
    dae = compiled(MODELS / "notes" / "ex05_suspension.lmo")
    for solver, rtol in (("dop853", "1e-06"), ("taylor", "1e-07")):
        html = dae.simulate(solver=solver).view().html
        assert f"<td>{solver} (requested), rtol 1e-06</td>" in html
        said = re.search(r'<th scope="row">in this page</th><td>(.*?)</td>', html)[1]
        assert said == f"DOP853, and Radau IIA where stability limits its steps, rtol {rtol}"
        assert data_of(html)["script"]["rtol"] == float(rtol)
    dae = lmoc.compile_text("model M input Real u; Real x(start = 1, fixed = true); equation der(x) = u; end M;")
    assert '<th scope="row">in this page' not in dae.simulate(stop=1, inputs={"u": lambda t: t}).view().html


def test_laws_events_and_modes():
    run = compiled(MODELS / "laws" / "h06_bungee.lmo").simulate()
    data = contents(run, "bungee").data
    assert data["script"]["reason"] == "" and [e["kind"] for e in data["events"]] == [e.kind for e in run.events]
    assert data["modes"] == [[0.0, {"string": "slack"}], *([e.time, {"string": e.after}] for e in run.events)]


def test_the_equations_of_each_mode_that_is_met():
    run = compiled(MODELS / "laws" / "h16_stick_slip.lmo").simulate()
    html = page_equations(run).html
    assert html.count("<h2>friction") == 2 and "friction stick, from t = 0 s" in html and html.count("<math") >= 4
    assert "sign" in html  # of the law, behind the equations


def test_what_rounding_leaves_is_not_compared():
    run = compiled(MODELS / "laws" / "elastic_string.lmo").simulate()
    assert abs(run["string.loss"]).max() < 1e-9
    checked = {name for name, _ in contents(run, "string").data["check"]}
    assert "string.loss" not in checked and {"mass.q", "string.f"} <= checked


def test_columns_are_held_once_and_constants_as_numbers():
    run = compiled(MODELS / "notes" / "ex02_spring_mass_damper.lmo").simulate(points=11)
    data = contents(run, "one").data
    changing = [v for v in data["variables"] if "column" in v]
    assert len({v["column"] for v in changing}) < len(changing)
    packed = np.frombuffer(b64decode(data["values"]), "<f4").reshape(-1, len(run.time))
    for v in changing:
        assert np.allclose(packed[v["column"]], run[v["name"]], rtol=1e-6, equal_nan=True)


def test_kept_variables_alone_make_a_page():
    run = compiled(MODELS / "notes" / "ex05_suspension.lmo").simulate(points=21, keep=["q2"])
    names = {v["name"] for v in data_of(run.view().html)["variables"]}
    assert "q2" in names and "wheel.a" not in names


def test_the_command(tmp_path, capsys):
    from lmoc.cli.main import main

    scene = str(MODELS / "notes" / "ex02_spring_mass_damper.lmo")
    page, failed, blow = tmp_path / "page.html", tmp_path / "failed.html", tmp_path / "blow.lmo"
    assert main(["view", scene, "-o", str(page), "--stop", "1", "--points", "11"]) == 0
    assert f"page written to {page}" in capsys.readouterr().out
    assert data_of(page.read_text())["complete"]
    assert main(["view", scene, "-o", str(tmp_path / "page.png")]) == 2
    assert "E0624" in capsys.readouterr().err
    blow.write_text("model M Real x(start=1, fixed=true); equation der(x) = x^2; end M;")
    assert main(["view", str(blow), "-o", str(failed), "--stop", "3"]) == 3
    assert "shows the run until then" in capsys.readouterr().err
    assert not data_of(failed.read_text())["complete"]


def test_sliders_do_not_depend_on_earlier_commands(tmp_path, monkeypatch):
    """A run keeps its reduction without the assumptions that tell which sliders can move."""
    from lmoc.cli.main import main

    monkeypatch.setenv("LMOC_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("LMOC_CHECK", raising=False)
    scene, page = str(MODELS / "notes" / "ex02_spring_mass_damper.lmo"), tmp_path / "page.html"
    for command in (["run", scene, "--stop", "1"], ["run", scene, "--stop", "1"], ["view", scene, "-o", str(page)]):
        assert main([*command, "--quiet"]) == 0
    fixed = {p["name"]: p["fixed"] for p in data_of(page.read_text())["script"]["parameters"]}
    assert fixed["m"] == fixed["k"] == fixed["c"] == ""


def test_a_notebook_gets_a_frame():
    page = view_of(HOSTILE)
    assert page._repr_html_().startswith("<iframe srcdoc=") and Elements(page._repr_html_()).names == ["iframe"]
    assert "Page of" in repr(page)


def test_the_page_of_a_closed_loop_has_its_equations_whatever_it_was_solved_in():
    dae = compiled("planar/slider_crank")
    run = dae.simulate(stop=0.05, formulation="projected")
    found = page_equations(run).html
    assert "Closures of the loops" in found and found == page_equations(dae.simulate(stop=0.05)).html


@pytest.mark.parametrize(("file", "derived"), [("classic/andrews", False), ("planar/slider_crank", True)])
def test_equations_of_many_closed_loops_are_not_derived_for_a_page(file, derived):
    """Those of Andrews' mechanism take longer than a page may: it says so, and has everything else."""
    run = compiled(MODELS / f"{file}.lmo").simulate(points=20)
    text = page_equations(run).html
    assert ("<math" in text) is ("Closures of the loops" in text) is derived
    assert ("6 variables follow from the closing of loops" in text) is not derived


@needs_node
@pytest.mark.parametrize("file", ["notes/ex05_suspension", "planar/slider_crank", "laws/h06_bungee"])
def test_the_terms_that_are_shaded_add_up_at_every_instant(file):
    """Inputs with their rates, velocities by other names, closures whose multiplier is what the others leave, modes."""
    run = compiled(MODELS / f"{file}.lmo").simulate(points=41)
    found = contents(run, "M")
    body = f"""
    const data = {json.dumps(found.data)}, terms = {found.terms}, names = data.jets.map((j) => j.name);
    const variables = [...data.variables, ...data.jets], given = givenAnswer(data);
    const own = new Repeater(data.script, engine, {{ variables }}, () => 0).run(given.time, {{}});
    const shades = new Shades({{ querySelectorAll: () => [] }}, {{}}, terms, data.terms, names);
    const sum = (side) => side.reduce((all, v) => all + v, 0);
    console.log(JSON.stringify([given, own].map((answer) => {{
      shades.put(answer);
      const read = answer.reader(names);
      return shades.equations.map((e) => {{
        const times = [...answer.time].filter((t) => shades.holds(e, t));
        const left = times.map((t) => sum(termValues(e.sides, read(t))[0]) - sum(termValues(e.sides, read(t))[1]));
        const missing = e.sides.flat().filter((f) => f === null).length;
        return [Math.max(...left.map(Math.abs)), e.largest, times.length, missing];
      }});
    }})));
    """
    sources = in_engine("worker.js") + joined("shades.js")
    given, own = run_script(sources + body)
    marked = found.equations.count("class='term'")
    assert marked == found.terms.count("(v)=>") + found.terms.count("null") > 0
    for equations, share in ((given, 1e-6), (own, 1e-9)):  # what Python has given is of 32 bits
        assert all(largest > 0 and left <= share * largest for left, largest, _, _ in equations)
    counts = [times for _, _, times, _ in own]
    if file.startswith("laws"):  # two masses on a slack string, one where it is taut
        assert counts[0] == counts[1] and counts[0] + counts[2] == 41
    else:
        assert set(counts) == {41}
    assert [missing for *_, missing in own] == ([1, 1] if "crank" in file else [0] * len(own))


def test_what_does_not_change_takes_no_room_among_the_terms():
    """Half a car has 26 names in its terms, fourteen of them parameters; as columns they would be too many."""
    run = compiled("textbook/half_car").simulate(points=1501)
    found = contents(run, "M")
    jets = {jet["name"]: jet for jet in found.data["jets"]}
    assert jets["m1"]["value"] == 40 and "column" not in jets["m1"]
    assert "column" in jets["der(body.q)"] and found.terms != "[]"
