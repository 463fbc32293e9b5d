"""`TableSpring`, `TableDamper` and `Beam` against closed forms and curves made by numpy."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import lmoc
from lmoc.numerics.signals.curves import fit

ROWS = np.array([[-0.3, -50], [-0.1, -10], [0, 0], [0.1, 5], [0.2, 40], [0.25, 40], [0.4, 100]])


def text(rows: np.ndarray) -> str:
    return "{" + ", ".join(f"{{{x!r}, {y!r}}}" for x, y in rows.tolist()) + "}"


def pulled(part: str, signal: str) -> lmoc.Run:
    """A part that is stretched by a given motion."""
    scene = f"""model M Fixed wall; Motion hand(q = {signal}); {part};
        equation connect(wall.flange, p.a); connect(p.b, hand.flange); end M;"""
    return lmoc.compile_text(scene).simulate(stop=1, points=1001, rtol=1e-9)


def test_a_table_spring_follows_the_monotone_curve_and_its_energy_is_the_work():
    run = pulled(f"TableSpring p(table = {text(ROWS)}, L = 0.5, d0 = 0.45)", "0.9*time - 0.5")
    extension = run.time * 0.9 - 0.45
    assert run["p.extension"] == pytest.approx(extension, abs=1e-14)
    curve = fit(*ROWS.T, 1)
    slopes = [run[f"p.pieces[{k},3]"][0] for k in (1, len(ROWS) + 1)]
    expected = curve(np.clip(extension, *ROWS[[0, -1], 0]))
    expected += slopes[0] * np.minimum(extension - ROWS[0, 0], 0) + slopes[-1] * np.maximum(extension - ROWS[-1, 0], 0)
    assert run["p.f"] == pytest.approx(expected, abs=1e-10)
    assert run["p.a.f"] == pytest.approx(-expected, abs=1e-10) and run.energy.balance < 1e-6
    work = np.concatenate([[0], np.cumsum(np.diff(extension) * (expected[1:] + expected[:-1]) / 2)])
    rest = int(np.argmin(np.abs(extension)))
    assert run["p.energy"] - run["p.energy"][rest] == pytest.approx(work - work[rest], abs=1e-3)
    assert run["p.energy"][rest] == pytest.approx(0, abs=1e-12) and run["p.energy"].min() > -1e-12


def test_a_table_damper_loses_force_times_rate():
    run = pulled(f"TableDamper p(table = {text(ROWS)})", "0.1*time^2 - 0.05*time")
    rate = 0.2 * run.time - 0.05
    assert run["p.f"] == pytest.approx(fit(*ROWS.T, 1)(rate), abs=1e-10)
    assert run["p.loss"] == pytest.approx(run["p.f"] * rate, abs=1e-12) and run.energy.balance < 1e-8


def test_straight_tables_are_a_spring_and_a_damper():
    scene = """model M Fixed wall; {} s({}); {} d({}); Mass m(m = 2, q(start = 0.4, fixed = true));
        equation connect(wall.flange, s.a); connect(wall.flange, d.a); connect(s.b, m.flange); connect(d.b, m.flange);
        end M;"""
    plain = lmoc.compile_text(scene.format("Spring", "k = 8", "Damper", "c = 0.5"))
    rows = "table = {{{{-1, {0}}}, {{1, {1}}}}}"
    tables = lmoc.compile_text(scene.format("TableSpring", rows.format(-8, 8), "TableDamper", rows.format(-0.5, 0.5)))
    a, b = plain.simulate(rtol=1e-9), tables.simulate(rtol=1e-9)
    assert b["m.q"] == pytest.approx(a["m.q"], abs=1e-8)
    assert b.energy.lost == pytest.approx(a.energy.lost, abs=1e-8)
    assert [str(n.code) for n in b.notes] == []
    changed = {"s.table": [[-1, -32], [1, 32]], "d.table[1,2]": 0, "d.table[2,2]": 0}
    other = tables.simulate(rtol=1e-9, parameters=changed)
    assert other["m.q"] == pytest.approx(0.4 * np.cos(4 * other.time), abs=1e-6)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("{{0, 0}, {0, 1}}", "extensions of a table increase"),
        ("{{1, 0}, {0, 1}}", "extensions of a table increase"),
        ("{{0, 0}}", "at least two rows"),
    ],
)
def test_tables_that_are_none(rows, words):
    scene = f"""model M Fixed w; TableSpring s(table = {rows}); Mass m(m = 1);
        equation connect(w.flange, s.a); connect(s.b, m.flange); end M;"""
    with pytest.raises(lmoc.ModelError, match=f"s: .*{words}") as caught:
        lmoc.compile_text(scene).simulate()
    assert caught.value.diagnostics[-1].span.text.startswith("TableSpring s(")  # in the user's text


HALF_CAR = """
model HalfCar
  Beam body(l1 = -1.2, l2 = 1.5, m = 600, J = 900{more});
  Spring front(k = 2e4), rear(k = 2.2e4);
  Fixed road;
equation
  connect(road.flange, front.a);
  connect(front.b, body.a);
  connect(road.flange, rear.a);
  connect(rear.b, body.b);
end HalfCar;
"""


def test_a_half_car_has_the_modes_of_its_matrices():
    dae = lmoc.compile_text(HALF_CAR.format(more=""))
    assert dae.states == ["body.q", "body.v", "body.theta", "body.omega"] and not dae.notes
    k1, k2, l1, l2 = 2e4, 2.2e4, -1.2, 1.5
    stiffness = np.array([[k1 + k2, k1 * l1 + k2 * l2], [k1 * l1 + k2 * l2, k1 * l1**2 + k2 * l2**2]])
    expected = np.sqrt(np.sort(np.linalg.eigvals(np.diag([1 / 600, 1 / 900]) @ stiffness)))
    found = np.sort([abs(complex(x)) for x in dae.linearize().eigenvalues])
    assert found == pytest.approx(np.repeat(expected, 2), rel=1e-12)
    run = dae.simulate(initial={"body.q": 0.1, "body.theta": 0.05}, rtol=1e-9)
    assert run.energy.balance < 1e-6 and np.ptp(run.energy.stored) < 1e-5 * run.energy.stored[0]


@pytest.mark.parametrize("small", ["true", "false"])
def test_a_beam_keeps_its_ends_on_a_line_and_loses_no_power(small):
    dae = lmoc.compile_text(HALF_CAR.format(more=f", smallAngle = {small}"))
    run = dae.simulate(initial={"body.q": 0.2, "body.theta": 0.7}, rtol=1e-10)
    angle = run["body.theta"] if small == "true" else np.sin(run["body.theta"])
    assert run["body.a.q"] == pytest.approx(run["body.q"] - 1.2 * angle, abs=1e-12)
    assert run["body.b.q"] == pytest.approx(run["body.q"] + 1.5 * angle, abs=1e-12)
    assert np.ptp(run.energy.stored) < 1e-6 * run.energy.stored[0]


def test_a_massless_beam_is_a_balance():
    """Three springs hold it; the displacement of its ends follows from moments about the pivot."""
    scene = """model M Beam b(l1 = -0.5, l2 = 1); Force push(f = 10*sin(time)); Mass m(m = 2); Spring s(k = 100);
        Fixed w; equation connect(w.flange, b.pivot); connect(push.flange, b.a); connect(b.b, m.flange);
        connect(w.flange, s.a); connect(s.b, m.flange); end M;"""
    dae = lmoc.compile_text(scene)
    run = dae.simulate(rtol=1e-9)
    assert len(dae.states) == 2
    w, t = np.sqrt(50), run.time
    exact = -5 / 2 / (w**2 - 1) * (np.sin(t) - np.sin(w * t) / w)  # 2 q'' + 100 q = -0.5·10 sin t
    assert run["m.q"] == pytest.approx(exact, abs=1e-7)
    assert run["b.pivot.f"] == pytest.approx(-run["b.a.f"] - run["b.b.f"], abs=1e-10)


def test_the_rate_of_a_curve_at_its_points():
    """A curve has one slope where two pieces meet: there the derivative used to be that of both together."""
    run = lmoc.compile_text("""
      model Curve
        parameter Real table[4, 2] = {{0, 0}, {1, 2}, {2, 5}, {3, 9}};
        parameter Real pieces[5, 5] = Tables.pieces(table, Tables.slopes(table));
        parameter Real areas[5] = Tables.areas(pieces);
        Real x(start = -0.5, fixed = true);
        Real rates[2] = {der(Tables.value(pieces, x)), der(Tables.integral(pieces, areas, x))};
        Real values[2] = {Tables.slope(pieces, x), Tables.value(pieces, x)};
      equation
        der(x) = 1;
      end Curve;""").simulate(stop=4, points=17)
    assert run["x"][2] == 0.0 and run["rates[1]"][2] == 1.5
    for k in (1, 2):
        assert run[f"rates[{k}]"] == pytest.approx(run[f"values[{k}]"], abs=1e-12)


@pytest.mark.parametrize("count", [2, 3, 7])
@pytest.mark.parametrize("closed", [False, True])
def test_slopes_of_a_cubic_spline(count, closed):
    rng = np.random.default_rng(count)
    x, y = np.cumsum(rng.uniform(0.2, 2, count)), rng.normal(size=count)
    y[-1] = y[0] if closed else y[-1]
    table = text(np.column_stack([x, y]))
    spline = f"Tables.Spline c(table = {table}, closed = {str(closed).lower()})"
    run = lmoc.compile_text(f"model M parameter {spline}; Real z = c.s[1]; end M;").simulate(stop=1)
    truth = CubicSpline(x, y, bc_type="periodic" if closed else "natural")(x, 1)
    assert [run[f"c.s[{k + 1}]"][0] for k in range(count)] == pytest.approx(truth, abs=1e-12)
