"""Tables as inputs: curves that never overshoot, jumps, and what is said about a table that is wrong."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lmoc
from lmoc.numerics.signals import curves

PUSHED = """
model M
  input Real u(unit = "N") = 0;
  Mass m(m = 1, q(fixed = true), v(fixed = true));
  Force f(f = u);
equation
  connect(f.flange, m.flange);
end M;
"""
MOVED = """
model M
  input Real u(unit = "m") = 0;
  Motion w(q = u);
  Mass m(m = 2);
  output Real F = -w.flange.f;
equation
  connect(w.flange, m.flange);
end M;
"""
SHAKEN = MOVED.replace("Mass m(m = 2);", "Damper d(c = 3); Mass m(m = 1, q(fixed = true), v(fixed = true));").replace(
    "connect(w.flange, m.flange)", "connect(w.flange, d.a); connect(d.b, m.flange)"
)

numbers = st.floats(-1e3, 1e3).map(lambda x: round(x, 3))
tables = st.lists(st.tuples(st.floats(0.01, 10), numbers), min_size=2, max_size=12).map(
    lambda rows: (np.cumsum([r[0] for r in rows]), np.array([r[1] for r in rows]))
)


@settings(max_examples=300)
@given(tables, st.sampled_from([0, 1, 2]))
def test_a_curve_stays_between_neighbouring_points_and_is_monotone_there(table, smoothness):
    x, y = table
    curve = curves.fit(x, y, smoothness)
    for k in range(len(x) - 1):
        t = np.linspace(x[k], x[k + 1], 101)[:-1]
        values = curve(t)
        rises = np.diff(values) * np.sign(y[k + 1] - y[k])
        if curve.peaks[k]:  # as far beyond as a parabola through such samples
            room = 0.2 * np.abs(np.diff(y)[max(0, k - 1) : k + 2]).max()
            assert min(y[k], y[k + 1]) - room <= values.min() and values.max() <= max(y[k], y[k + 1]) + room
            continue
        assert min(y[k], y[k + 1]) <= values.min() and values.max() <= max(y[k], y[k + 1])
        assert (rises >= -1e-9 * abs(y[k + 1] - y[k])).all()
        assert values[0] == pytest.approx(y[k], abs=1e-12 * np.abs(y).max())


@settings(max_examples=200)
@given(tables, st.sampled_from([1, 2]))
def test_a_curve_is_as_smooth_as_it_is_said_to_be(table, smoothness):
    x, y = table
    curve = curves.fit(x, y, smoothness)
    for order in range(1, smoothness + 1):
        pieces = curve._derivatives(order) / np.diff(x) ** order
        left, right = pieces.sum(axis=0)[:-1], pieces[0, 1:]
        assert left == pytest.approx(right, rel=1e-9, abs=1e-9 * np.abs(pieces).max())


@settings(max_examples=100)
@given(tables, st.sampled_from([0, 1, 2]), st.integers(0, 2), st.floats(-5, 130))
def test_one_time_and_many_times_are_the_same(table, smoothness, order, t):
    curve = curves.fit(*table, smoothness)
    assert curve.at(t, order) == pytest.approx(float(curve(t, order)), rel=1e-12, abs=1e-12)
    for knot in table[0].tolist():
        assert curve.at(knot, order) == pytest.approx(float(curve(knot, order)), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("smoothness", "degree"), [(0, 1), (1, 2), (2, 3)])
def test_a_monotone_polynomial_comes_out_as_it_is(smoothness, degree):
    knots = np.array([0.0, 0.3, 1.0, 1.2, 2.0, 3.5])
    polynomial = np.polynomial.Polynomial([1.0, 2.0, 0.5, 0.25][: degree + 1])
    t = np.linspace(0, 3.5, 57)[:-1]
    curve = curves.fit(knots, polynomial(knots), smoothness)
    for order in range(smoothness + 1):
        exact = polynomial.deriv(order) if order else polynomial
        assert curve(t, order) == pytest.approx(exact(t), abs=1e-11)
    assert curve([-1.0, 9.0]).tolist() == [polynomial(0.0), polynomial(3.5)]
    assert curve([-1.0, 9.0], 1).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("points", [2, 3])
@pytest.mark.parametrize("smoothness", [0, 1, 2])
def test_few_points_are_enough(points, smoothness):
    curve = curves.fit(np.arange(points) * 1.0, np.arange(points) * 2.0, smoothness)
    assert curve(np.linspace(0, points - 1, 9)) == pytest.approx(np.linspace(0, 2 * points - 2, 9), abs=1e-14)


def test_curves_converge_to_what_they_are_drawn_from():
    def error(n, smoothness, order):
        x, t = np.linspace(0, 1, n), np.linspace(0.1, 0.9, 997)
        return np.abs(curves.fit(x, np.exp(x), smoothness)(t, order) - np.exp(t)).max()

    for smoothness, order, rate in [(0, 0, 4), (1, 0, 8), (1, 1, 4), (2, 0, 16), (2, 1, 8), (2, 2, 4)]:
        assert error(41, smoothness, order) < 1.3 * error(21, smoothness, order) / rate


def test_a_sampled_swing_keeps_its_acceleration_at_the_peaks():
    t = np.linspace(0, 10, 401)
    curve, between = curves.fit(t, np.sin(4 * t + 0.1), 2), np.linspace(0.5, 9.5, 9999)
    assert curve(between, 2) == pytest.approx(-16 * np.sin(4 * between + 0.1), abs=0.02)
    assert curve.peaks.sum() < 3 * 2 * 10 * 4 / math.pi


def test_steps_and_corners_have_no_smooth_peaks():
    x = np.arange(12.0)
    for y in (x == 5, x > 4, np.abs(x - 5), -np.maximum(x - 5, 0), (-1) ** x, np.abs(x - 5.5) < 2, np.sin(2 * x)):
        assert not curves.fit(x, np.asarray(y, float), 2).peaks.any()


def test_a_repeated_time_is_a_jump_and_the_later_value_holds():
    curve = curves.fit([0, 1, 1, 2, 2], [0, 0, 5, 5, 7], 0)
    assert curve([0.5, 1 - 1e-12, 1, 1.5, 2 - 1e-12, 2, 3]).tolist() == [0, 0, 5, 5, 5, 7, 7]
    assert curve.jumps.tolist() == [1, 2] and curve.kinks.tolist() == [0, 1, 2]
    assert curves.fit([0, 0, 1], [3, 1, 1], 0)([-1, 0, 0.5]).tolist() == [3, 1, 1]


def test_a_straight_row_of_points_has_no_kinks():
    x = np.linspace(0, 1, 101)
    assert curves.fit(x, 3 * x, 0).kinks.tolist() == [0, 1]
    assert curves.fit(x, np.abs(x - 0.5), 0).kinks == pytest.approx([0, 0.5, 1])


def test_a_steep_pulse_in_a_wide_table_gives_its_impulse():
    run = lmoc.compile_text(PUSHED).simulate(inputs={"u": ([0, 1, 1.1, 2, 2.1, 10], [0, 0, 1, 1, 0, 0])})
    assert run["m.v"][-1] == pytest.approx(1.0, abs=1e-12) and np.ptp(run["u"]) <= 1.0
    run = lmoc.compile_text(PUSHED).simulate(inputs={"u": ([0, 1, 1, 1.0625, 1.0625, 10], [0, 0, 8, 8, 0, 0])})
    assert run["m.v"][-1] == pytest.approx(0.5, abs=1e-12)


@pytest.mark.parametrize("solver", ["dop853", "cvode", "radau"])
def test_no_solver_steps_over_a_needle(solver):
    table = np.array([[0, 0], [5, 0], [5.001, 1000], [5.002, 0], [10, 0]])
    run = lmoc.compile_text(PUSHED).simulate(inputs={"u": table}, solver=solver, rtol=1e-8)
    assert run["m.v"][-1] == pytest.approx(1.0, rel=1e-6)


def test_a_motion_by_a_table_has_an_acceleration():
    t = np.linspace(0, 1, 201)
    run = lmoc.compile_text(MOVED).simulate(stop=1, inputs={"u": (t, t**3)})
    assert run["F"][1:-1] == pytest.approx(12 * run.time[1:-1], abs=1e-6)
    steps = lmoc.compile_text(MOVED).simulate(stop=5, inputs={"u": ([0, 1, 2, 3, 5], [0, 0, 1, 1, 1])})
    assert np.ptp(steps["m.q"]) == 1 and steps["m.v"].min() >= 0 and steps["F"][steps.time < 1].tolist().count(0) > 0


def test_a_motion_that_jumps_has_no_acceleration():
    with pytest.raises(lmoc.SimulationError, match="'u' jumps from 0 to 1 at t = 1 s, .* second derivative"):
        lmoc.compile_text(MOVED).simulate(inputs={"u": ([0, 1, 1, 10], [0, 0, 1, 1])})


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("time,u\n0,0\n1,x\n", 3, 3, "'x' is not a number"),
        ("time,u\n0,0\n1,\n", 3, 3, "an empty cell is not a number"),
        ("time,u\n0,0\n\n1\n", 4, 1, "this line has 1 column, the header has 2"),
        ("time,u\n0,0\n1,2,3\n", 3, 1, "this line has 3 columns, the header has 2"),
        ("time,u,u\n0,0,1\n1,2,3\n", 1, 1, "'u' occurs twice"),
        ("time,u\n0,0\n1,1_0\n", 3, 3, "'1_0' is not a number"),
        ("time,u\n0,0\n1,nan\n", 3, 3, "nan is not a finite number"),
        ("time,u\ninf,0\n1,1\n", 2, 1, "inf is not a finite number"),
        ("time,u\n0,0\n2,0\n 1, 0\n", 4, 2, "its times decrease: 1 follows 2"),
        ("u,time\n0,0\n0,1\n0,1\n0,1\n", 5, 3, "the time 1 occurs more than twice"),
        ("seconds,u\n0,0\n", 1, 1, "a header line with a column 'time'"),
        ("seconds,v\n0,0\n", 1, 1, "a header line with columns 'time' and 'u'"),
        ("time|u\n0|0\n", 1, 1, "columns are separated by commas, semicolons or tabs"),
        ("time,u\n0,0\n1e-320,1\n", 2, 1, "too close together"),
        ("", None, None, "an empty file"),
        ("time,u\n1,2\n", None, None, "one point, and needs two"),
        ("time,u\n", None, None, "no points, and needs two"),
    ],
)
def test_what_is_wrong_in_a_table_is_shown_where_it_is(tmp_path: Path, text, line, column, words):
    path = tmp_path / "push.csv"
    path.write_text(text)
    with pytest.raises(lmoc.ModelError) as wrong:
        lmoc.compile_text(PUSHED).simulate(inputs={"u": str(path)})
    (said,) = wrong.value.diagnostics
    assert said.code == "E0625" and words in str(said) and "push.csv" in str(said)
    if line is None:
        assert said.span is None
    else:
        assert (said.span.line, said.span.column) == (line, column)


def test_several_mistakes_in_a_table_are_told_at_once(tmp_path: Path):
    (tmp_path / "push.csv").write_text("time,u\n" + "x,y\n" * 100)
    with pytest.raises(lmoc.ModelError) as wrong:
        lmoc.compile_text(PUSHED).simulate(inputs={"u": tmp_path / "push.csv"})
    assert [d.span.line for d in wrong.value.diagnostics] == [2, 3, 4]


def test_a_result_can_be_an_input(tmp_path: Path):
    """Names with commas stand within quotation marks."""
    scene = "model M Real x[1,2](each start = 1, each fixed = true); equation der(x) = -x; end M;"
    lmoc.compile_text(scene).simulate(stop=1).save(tmp_path / "x.csv", ["x"])
    text = (tmp_path / "x.csv").read_text().replace("x[1,1]", "u")
    (tmp_path / "u.csv").write_text(text)
    run = lmoc.compile_text(PUSHED).simulate(stop=1, inputs={"u": tmp_path / "u.csv"})
    assert run["m.v"][-1] == pytest.approx(1 - math.exp(-1), abs=1e-5)


def test_a_table_that_is_missing_is_named_like_one_that_is_there(tmp_path: Path):
    (tmp_path / "road.csv").write_text("time,u\n0,0\n1,1\n")
    with pytest.raises(lmoc.ModelError, match="did you mean 'road.csv'") as wrong:
        lmoc.compile_text(PUSHED).simulate(inputs={"u": tmp_path / "raod.csv"})
    assert wrong.value.diagnostics[0].code == "E0610"


def test_columns_beside_those_of_the_input_may_hold_anything(tmp_path: Path):
    (tmp_path / "push.csv").write_text("place,time,u,day\nhere,0,1,1970-01-01\nthere,4,1,\n")
    run = lmoc.compile_text(PUSHED).simulate(stop=1, inputs={"u": tmp_path / "push.csv"})
    assert run["m.v"][-1] == pytest.approx(1.0, rel=1e-9)
