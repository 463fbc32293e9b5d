"""The modules of the page by themselves, run by node against closed forms."""

import json
from base64 import b64encode
from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest
from oracles.in_javascript import in_engine
from oracles.node import needs_node, run_script

import lmoc
from lmoc.numerics.signals.curves import fit
from lmoc.view.javascript.programs import packed_programs
from lmoc.view.javascript.script import write_script
from lmoc.view.page import join
from lmoc.view.page.join import joined
from lmoc.view.scene import symbols
from lmoc.view.scene.picture import Anchor

pytestmark = needs_node


MOVES = "model M Real a(start=1,fixed=true), b(start=0,fixed=true), c(start=1,fixed=true);\n"
MOVES += "equation der(a) = b; der(b) = -4*a; der(c) = -c; end M;"


@cache
def moving() -> str:
    """A swing and a decay, on the engine."""
    script = write_script(lmoc.compile_text(MOVES).simulate(stop=20, points=5, solver="dop853").trajectory)
    order = [script.data["names"].index(n) for n in "abc"]
    made = f"const scene = new Scene({json.dumps(script.data)}, engine), order = {order};"
    return f"{in_engine('repeat.js')}\n{made}\nscene.put([]);\n"


@pytest.mark.parametrize("stiffen", ["", "run.stiffen({ rtol, atol });"])
def test_methods_keep_their_order_in_steps_and_between(stiffen):
    """Over 20 s the errors fall with the tolerance, at the steps and within them."""
    body = """
    const worst = [1e-4, 1e-7, 1e-10].map((rtol) => {
      const { x } = scene.data, place = Float64Array.from(x), atol = x.map(() => rtol/1e3);
      const run = new Steps(scene, 0, x, 20, { rtol, atol });
      STIFFEN
      let most = 0;
      while (run.t < 20) {
        run.step();
        for (const theta of [0, 0.3, 0.77, 1]) {
          const t = run.before + theta*(run.t - run.before);
          run.interpolate(t, place);
          const error = Math.max(Math.abs(place[order[0]] - Math.cos(2*t)), Math.abs(place[order[2]] - Math.exp(-t)));
          most = Math.max(most, error);
        }
      }
      return most;
    });
    console.log(JSON.stringify(worst));
    """
    worst = run_script(moving() + body.replace("STIFFEN", stiffen))
    assert worst[0] < 1e-2 and worst[1] < 1e-5 and worst[2] < 1e-8


@pytest.mark.parametrize("stiffen", ["", "run.stiffen({ rtol: 1e-9, atol: start.map(() => 1e-12) });"])
def test_methods_go_on_from_another_state(stiffen):
    """A decay that is raised by 1 at the end of the step that passes t = 1."""
    body = """
    const { x: start } = scene.data, k = order[2];
    const run = new Steps(scene, 0, start, 3, { rtol: 1e-9, atol: start.map(() => 1e-12), firstStep: 1e-3 });
    STIFFEN
    while (run.t < 1) run.step();
    const [at, x] = [run.t, run.x[k]];
    run.jump(run.x.map((v, j) => v + Number(j === k)));
    run.step();
    const inside = Float64Array.from(start);
    run.interpolate(at, inside);
    while (run.t < 3) run.step();
    console.log(JSON.stringify([at, x, inside[k], run.x[k]]));
    """
    at, before, behind, last = run_script(moving() + body.replace("STIFFEN", stiffen))
    assert at < 3 and abs(before - np.exp(-at)) < 1e-8 and behind == pytest.approx(before + 1, rel=1e-12)
    assert last == pytest.approx((np.exp(-at) + 1) * np.exp(-(3 - at)), rel=1e-7)


@pytest.mark.parametrize("smoothness", [0, 1, 2])
def test_curves_are_those_of_the_run(smoothness):
    knots = np.array([0.0, 0.4, 1.0, 1.0, 1.7, 2.0])
    curve = fit(knots, np.array([1.0, 3.0, 2.5, -1.0, 0.0, 4.0]), smoothness)
    times = np.sort(np.concatenate([np.linspace(-0.5, 2.5, 41), knots]))
    plan = lmoc.compile_text(MOVES).simulate(stop=1, points=2).trajectory.observer.plan
    for order in range(smoothness + 1):
        code, _ = packed_programs(plan, {"rhs": plan.program}, plan.count + 1, [(plan.count, order, curve)])
        body = f"""
        const programs = new Programs(engine, "{b64encode(code).decode()}", 3);
        const value = (t) => (programs.sample(t), programs.w[{plan.count}]);
        console.log(JSON.stringify({times.tolist()}.map(value)));
        """
        assert np.allclose(run_script(in_engine("programs.js") + body), curve(times, order), atol=1e-12)


def test_names_of_joined_modules_are_told_apart(monkeypatch):
    texts = {"a.js": 'import { f } from "./b.js";\nexport const x = f();\n'}
    texts["b.js"] = "export function f() {}\nconst x = 1;\n"
    monkeypatch.setattr(join, "asset", texts.__getitem__)
    with pytest.raises(ValueError, match=r"x is a name of b\.js and of a\.js"):
        join.joined.__wrapped__("a.js")


def test_the_rim_of_a_turning_disk():
    """Lines in front of the disk, where they are by its angle; each comes back after a whole turn."""
    found = run_script(joined("rim.js") + "console.log(JSON.stringify([0, 0.3, 2 * Math.PI, Math.PI].map(linesAt)));")
    still, turned, whole, half = (dict(lines) for lines in found)
    assert still[0] == 0 and turned[0] == pytest.approx(np.sin(0.3)) and 0 not in half
    assert set(whole) == set(still) and all(-1 <= share <= 1 for share in turned.values())


@pytest.mark.parametrize(
    ("marks", "step", "texts"),
    [
        ([0, 0.25, 1.5], 0.25, ["0", "0.25", "1.50"]),
        ([-0.2, 0.4], 0.2, ["-0.2", "0.4"]),
        ([500, 4000], 500, ["500", "4000"]),
        ([2e-7, -1e-6], 2e-7, ["2e-7", "-1.0e-6"]),
        ([0.002, 0.0025], 5e-4, ["0.0020", "0.0025"]),
        ([2e8], 1e8, ["2e+8"]),
        ([1.000003, 1.000004], 1e-6, ["1.000003", "1.000004"]),
    ],
)
def test_marks_of_an_axis_have_the_digits_that_tell_them_apart(marks, step, texts):
    body = f"console.log(JSON.stringify({marks}.map((v) => tickText(v, {step}))));"
    assert run_script(joined("plots.js") + body) == texts


def test_an_axis_of_what_hardly_changes_has_a_width():
    """uPlot's own range of 1 … 1 + 1e-9 has none, and it looks for its marks without end."""
    ends = [[0, 0], [1, 1], [1, 1 + 1e-9], [-1 - 1e-5, -1], [0, 1e-9]]
    body = f"""const uPlot = {{ rangeNum: (low, high) => [low, high, "its own"] }};
    console.log(JSON.stringify({ends}.map((own) => rangeAround(null, ...own))));"""
    told = run_script(joined("plots.js") + body)
    narrow = [pytest.approx(-1 - 1.1e-5, abs=1e-12), pytest.approx(-1 + 1e-6, abs=1e-12)]
    assert told == [[-1, 1], [1, 1, "its own"], [1, 1, "its own"], narrow, [0, 1e-9, "its own"]]


def test_an_event_says_what_has_changed():
    """Between which modes, where these are two."""
    rows = [("reversal", "unlocked", "unlocked"), ("unlock", "locked", "unlocked"), ("impact", "open", "open")]
    events = [{"time": 1.5, "name": "c", "kind": kind, "before": a, "after": b} for kind, a, b in rows]
    told = run_script(joined("events.js") + f"console.log(JSON.stringify({json.dumps(events)}.map(eventText)));")
    what = ["reversal (unlocked)", "unlock (locked → unlocked)", "impact (open)"]
    assert told == [f"t = 1.5 s, c: {one}" for one in what]


def test_a_slack_string_is_as_long_as_it_is():
    """The length of the curve between two points at a distance of 80 px with 5 px of slack."""
    body = """
    const frame = { x: 10, y: 20, length: 80, cos: 1, sin: 0 };
    const [, x0, y0, cx, cy, x1, y1] = sagging(frame, 5).match(/M(.+) (.+)Q(.+) (.+) (.+) (.+)/).map(Number);
    let length = 0, before = [x0, y0];
    for (let k = 1; k <= 1000; k++) {
      const s = k / 1000;
      const at = (a, c, b) => (1 - s) ** 2 * a + 2 * s * (1 - s) * c + s * s * b;
      const now = [at(x0, cx, x1), at(y0, cy, y1)];
      length += Math.hypot(now[0] - before[0], now[1] - before[1]);
      before = now;
    }
    console.log(JSON.stringify([length, cy, sagging(frame, 0), sagging({ ...frame, cos: 0, sin: 1 }, 5)]));
    """
    length, down, taut, upright = run_script(joined("sag.js") + body)
    assert length == pytest.approx(85, abs=0.5) and down > 20 and taut == ""
    assert float(upright.split("Q")[1].split()[0]) < 10  # to the left


@pytest.mark.parametrize("x, y", [(80, 0), (60, 40), (0, 70), (-50, -30), (-20, 90)])
def test_the_page_hangs_a_slack_string_where_the_still_picture_does(x, y):
    item = replace(symbols.string("string", Anchor(10, 20), Anchor(10 + x, 20 + y)), slack=15.0)
    frame, (shape,) = item.frame(), item.drawn
    text = run_script(joined("sag.js") + f"console.log(JSON.stringify(sagging({json.dumps(asdict(frame))}, 15)));")
    control = [float(v) for v in text.split("Q")[1].split()[:2]]
    ends = [(e.x, e.y) for e in item.ends]
    half = [(a + 2 * c + b) / 4 for a, c, b in zip(ends[0], control, ends[1])]
    assert frame.place(shape.vertices[len(shape.vertices) // 2]) == pytest.approx(half, abs=0.02)


def test_areas_of_stored_energy_add_up_to_what_is_stored():
    """Those that change most by themselves, the rest together: above their least they make the whole."""
    rng = np.random.default_rng(2)
    energies = {f"p{k}.energy": (k + 1) * rng.normal(size=20) for k in range(8)}
    small = {"a.energy": rng.normal(size=20), "b.energy": np.full(20, 3.0)}
    told = []
    for parts in (energies, small, {}):
        total = sum(parts.values()) if parts else rng.normal(size=20)
        columns = {name: values.tolist() for name, values in parts.items()}
        body = f"""
        const columns = {json.dumps(columns)}, total = {json.dumps(total.tolist())};
        const areas = areasOf({{ of: (name) => columns[name] }}, total, Object.keys(columns));
        const heights = total.map((_, k) => areas.reduce((sum, a) => sum + a.values[k] - a.least, 0));
        const least = areas.map((a) => Math.min(...a.values.map((v) => v - a.least)));
        const low = areas.reduce((sum, a) => sum + a.least, 0);
        console.log(JSON.stringify([areas.map((a) => a.name), heights, least, low]));
        """
        names, heights, least, low = run_script(joined("plots.js") + body)
        told.append(names)
        assert np.allclose(np.array(heights) + low, total) and np.allclose(least, 0, atol=1e-9)
    assert len(told[0]) == 6 and told[0][-1] == "stored in other parts" and "p7.energy" in told[0]
    assert told[1] == ["a.energy"] and len(told[2]) == 1
