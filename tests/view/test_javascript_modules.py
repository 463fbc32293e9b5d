"""The modules of the page by themselves, run by node against closed forms."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from oracles.lawful import held_velocities
from oracles.node import needs_node, run_script

from lmoc.numerics.signals.curves import fit
from lmoc.view.javascript.script import method
from lmoc.view.page import join
from lmoc.view.page.join import joined
from lmoc.view.scene import symbols
from lmoc.view.scene.picture import Anchor

pytestmark = needs_node


def test_elimination_solves_and_tells_the_sign_of_the_determinant():
    rng = np.random.default_rng(1)
    for size in (1, 2, 5, 9):
        a, b = rng.normal(size=(size, size)), rng.normal(size=size)
        body = f"const a = Float64Array.from({a.ravel().tolist()}), b = Float64Array.from({b.tolist()}), p = [];"
        body += f"const s = factorize(a, {size}, p); substitute(a, {size}, p, b);"
        body += "console.log(JSON.stringify([s, [...b]]));"
        sign, x = run_script(joined("linear.js") + body)
        assert sign == np.sign(np.linalg.det(a))
        assert np.allclose(a @ x, b, atol=1e-10)
    body = "console.log(factorize(Float64Array.from([1, 2, 2, 4]), 2, []));"
    assert run_script(joined("linear.js") + body) == 0


def test_dop853_keeps_its_order_in_steps_and_between():
    """A swing and a decay over 20 s: the errors fall with the tolerance, at the steps and within them."""
    body = """
    const system = { rates(t, x, out) { out[0] = x[1]; out[1] = -4*x[0]; out[2] = -x[2]; }, keep() {}, restore() {} };
    const worst = [1e-4, 1e-7, 1e-10].map((rtol) => {
      const run = new Dop853(METHOD, system, 0, [1, 0, 1], 20, { rtol, atol: [1, 1, 1].map((a) => a*rtol/1e3) });
      const place = new Float64Array(3);
      let most = 0;
      while (run.t < 20) {
        run.step();
        for (const theta of [0, 0.3, 0.77, 1]) {
          const t = run.before + theta*(run.t - run.before);
          run.interpolate(t, place);
          const error = Math.max(Math.abs(place[0] - Math.cos(2*t)), Math.abs(place[2] - Math.exp(-t)));
          most = Math.max(most, error);
        }
      }
      return most;
    });
    console.log(JSON.stringify(worst));
    """
    worst = run_script(joined("dop853.js") + body.replace("METHOD", json.dumps(method())))
    assert worst[0] < 1e-2 and worst[1] < 1e-5 and worst[2] < 1e-8


@pytest.mark.parametrize("method_called", ["dop853", "radau"])
def test_methods_go_on_from_another_state(method_called):
    """A decay that is raised by 1 at the end of the step that passes t = 1."""
    made = {"dop853": "new Dop853(METHOD, ", "radau": "new Radau("}[method_called]
    options = "{ rtol: 1e-9, atol: [1e-12], firstStep: 1e-3 }"
    body = """
    const system = { rates(t, x, out) { out[0] = -2*x[0]; }, keep() {}, restore() {} };
    const run = MADE system, 0, [1], 3, OPTIONS);
    while (run.t < 1) run.step();
    const [at, x] = [run.t, run.x[0]];
    run.jump(Float64Array.from([x + 1]));
    run.step();
    const inside = new Float64Array(1);
    run.interpolate(at, inside);
    while (run.t < 3) run.step();
    console.log(JSON.stringify([at, x, inside[0], run.x[0]]));
    """
    text = body.replace("MADE", made).replace("METHOD", json.dumps(method())).replace("OPTIONS", options)
    at, before, behind, last = run_script(joined(f"{method_called}.js") + text)
    assert at < 3 and abs(before - np.exp(-2 * at)) < 1e-8 and behind == pytest.approx(before + 1, rel=1e-12)
    assert last == pytest.approx((np.exp(-2 * at) + 1) * np.exp(-2 * (3 - at)), rel=1e-7)


def test_velocities_that_closed_laws_hold():
    """Velocities that vanish wherever forms do: as in Python, and as the null space of the forms says."""
    rng = np.random.default_rng(4)
    forms = [rng.integers(-1, 2, size=(rng.integers(1, 5), 5)).astype(float) for _ in range(60)]
    body = f"console.log(JSON.stringify({json.dumps([f.tolist() for f in forms])}.map((f) => heldVelocities(f, 5))));"
    found = run_script(joined("rest.js") + body)
    assert found == [held_velocities(f).tolist() for f in forms]
    for form, held in zip(forms, found, strict=True):
        _, values, rows = np.linalg.svd(form)
        null = rows[np.count_nonzero(values > 1e-9) :]
        assert held == (np.abs(null) < 1e-9).all(axis=0).tolist()
    assert any(any(held) and not all(held) for held in found)


@pytest.mark.parametrize("smoothness", [0, 1, 2])
def test_curves_are_those_of_the_run(smoothness):
    knots = np.array([0.0, 0.4, 1.0, 1.0, 1.7, 2.0])
    curve = fit(knots, np.array([1.0, 3.0, 2.5, -1.0, 0.0, 4.0]), smoothness)
    times = np.sort(np.concatenate([np.linspace(-0.5, 2.5, 41), knots]))
    for order in range(smoothness + 1):
        data = json.dumps({"order": order} | curve.pieces(order))
        body = f"const c = {data}; console.log(JSON.stringify({times.tolist()}.map((t) => curveAt(c, t))));"
        assert np.allclose(run_script(joined("curve.js") + body), curve(times, order), atol=1e-12)


def test_newton_finds_the_near_solution_and_refuses_a_far_one():
    body = """
    const w = Float64Array.from([1.4, 0, 2]);
    const inner = (w) => { w[1] = w[0]*w[0] - w[2]; };
    const blocks = makeBlocks(1);
    const go = () => { solve(blocks, 0, w, 0, [0], [1], 1, false, null, inner); return w[0]; };
    const first = go();
    blocks.patient = false;
    w[2] = 2.2;
    const near = go();
    w[2] = 20;
    const far = go();
    w[2] = -1;
    const none = go();
    w[2] = 2;
    console.log(JSON.stringify([first, near, far, none, go(), blocks.failed, signsOf(blocks)[0][0]]));
    """
    first, near, far, none, again, failed, sign = run_script(joined("blocks.js") + body)
    assert first == pytest.approx(2**0.5, rel=1e-14) and near == pytest.approx(2.2**0.5, rel=1e-14)
    assert far is None and none is None  # NaN
    assert again == pytest.approx(2**0.5, rel=1e-14) and failed is True and sign == 1


def test_linear_blocks_of_ill_scaled_equations():
    """Large terms beside small coefficients: what a matrix from differences loses, the refinement brings back."""
    body = """
    const w = new Float64Array(4);
    const inner = (w) => { w[2] = 1e-3*w[0] + 2e-3*w[1] - 5e5; w[3] = 3e-3*w[0] - 1e-3*w[1] - 1e5; };
    solve(makeBlocks(1), 0, w, 0, [0, 1], [2, 3], 2, true, null, inner);
    console.log(JSON.stringify([w[0], w[1]]));
    """
    truth = np.linalg.solve([[1e-3, 2e-3], [3e-3, -1e-3]], [5e5, 1e5])
    assert np.allclose(run_script(joined("blocks.js") + body), truth, rtol=1e-14)


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
    ],
)
def test_marks_of_an_axis_have_the_digits_that_tell_them_apart(marks, step, texts):
    body = f"console.log(JSON.stringify({marks}.map((v) => tickText(v, {step}))));"
    assert run_script(joined("plots.js") + body) == texts


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
