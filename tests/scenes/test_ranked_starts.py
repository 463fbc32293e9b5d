"""Which start values are met where not all of them can be: what is nearest to the top of the model counts most, and
guesses of variables that shall not be states count least."""

import numpy as np
import pytest

import lmoc
from lmoc.numerics.start.lexicographic import split

SLIDER_CRANK = """model Engine
  connector Place
    Real x(stateSelect = StateSelect.avoid), y(stateSelect = StateSelect.avoid);
    flow Real fx, fy;
  end Place;
  model Slider "on the line y = 0; its class begins at the right"
    Place place;
    Real s(start = 0.7, stateSelect = StateSelect.prefer), v;
  equation
    place.x = s; place.y = 0; v = der(s); 0.4*der(v) = place.fx;
  end Slider;
  model Crank "its angle is given"
    Place place;
    Real phi(start = 1, fixed = true), w(start = 0, fixed = true);
  equation
    w = der(phi); place.x = 0.5*cos(phi); place.y = 0.5*sin(phi);
    0.2*der(w) = 0.5*cos(phi)*place.fy - 0.5*sin(phi)*place.fx;
  end Crank;
  model Rod "without mass"
    Place a, b;
    Real phi, f;
  equation
    b.x = a.x + 0.8*cos(phi); b.y = a.y + 0.8*sin(phi);
    b.fx = f*cos(phi); b.fy = f*sin(phi); a.fx + b.fx = 0; a.fy + b.fy = 0;
  end Rod;
  model Marker "where something is, which shall be no state"
    Place place;
    Real x(start = X_OF_CLASS, stateSelect = StateSelect.avoid);
    Real y(start = 0, stateSelect = StateSelect.avoid);
  equation
    x = place.x; y = place.y; place.fx = 0; place.fy = 0;
  end Marker;
  Crank crank;
  Rod rod;
  Slider slider SLIDER;
  Marker pin, tip MARKER;
equation
  connect(crank.place, rod.a); connect(rod.b, slider.place);
  connect(pin.place, rod.a); connect(tip.place, rod.b);
end Engine;"""
HALF = np.sqrt(0.8**2 - (0.5 * np.sin(1)) ** 2)
RIGHT, LEFT = 0.5 * np.cos(1) + HALF, 0.5 * np.cos(1) - HALF


def slider_crank(at_top: float | None = None, of_marker: float = 0.0, marker_at_top: float | None = None) -> float:
    text = SLIDER_CRANK.replace("X_OF_CLASS", str(of_marker))
    text = text.replace("SLIDER", "" if at_top is None else f"(s(start = {at_top}))")
    text = text.replace("MARKER", "" if marker_at_top is None else f"(x(start = {marker_at_top}))")
    return float(lmoc.compile_text(text).simulate(times=[0.0])["slider.s"][0])


@pytest.mark.parametrize(
    ("values", "place"),
    [
        ({}, RIGHT),  # as the class of the slider says
        ({"at_top": -0.4}, LEFT),
        ({"at_top": 0.4}, RIGHT),
        ({"of_marker": -0.5}, RIGHT),  # of a variable that is to be avoided, though it is the same as the slider's
        ({"at_top": -0.4, "of_marker": 1.0}, LEFT),
        ({"at_top": -0.4, "marker_at_top": 1.0}, LEFT),
        ({"marker_at_top": -0.5}, RIGHT),
    ],
)
def test_a_loop_closes_nearest_to_the_guesses_that_count_most(values, place):
    assert slider_crank(**values) == pytest.approx(place, abs=1e-9)


def test_a_guess_of_an_avoided_variable_counts_where_there_is_no_other():
    text = SLIDER_CRANK.replace("start = 0.7, ", "").replace("SLIDER", "").replace("MARKER", "")
    for guess, place in ((-0.5, LEFT), (0.6, RIGHT)):
        run = lmoc.compile_text(text.replace("X_OF_CLASS", str(guess))).simulate(times=[0.0])
        assert run["slider.s"][0] == pytest.approx(place, abs=1e-9)


PENDULUM = """model Pendulum
  model Joint
    Real phi(start = 0.3, stateSelect = StateSelect.prefer);
    Real w(start = 2, stateSelect = StateSelect.prefer);
    Real a(start = 0);
  equation
    w = der(phi); a = der(w); a = -6.54*sin(phi);
  end Joint;
  model Body
    input Real phi;
    Real x(start = 0, stateSelect = StateSelect.avoid);
    Real y(start = 0, stateSelect = StateSelect.avoid);
  equation
    x = 1.5*sin(phi); y = -1.5*cos(phi);
  end Body;
  Joint joint JOINT;
  Body body(phi = joint.phi BODY);
end Pendulum;"""


@pytest.mark.parametrize(
    ("joint", "body", "angle"),
    [
        ("", "", 0.3),  # neither the acceleration nor the place of the body, both zero by their classes, move it
        ("(phi(start = -1))", "", -1.0),
        ("(phi(start = -1))", ", x(start = 0.5)", -1.0),
        ("", ", x(start = 0.5, stateSelect = StateSelect.default)", np.arcsin(1 / 3)),  # the top before the class
    ],
)
def test_guesses_of_what_follows_from_the_states_do_not_move_these(joint, body, angle):
    text = PENDULUM.replace("joint JOINT", f"joint{joint}").replace(" BODY", body)
    run = lmoc.compile_text(text).simulate(times=[0.0])
    assert run["joint.phi"][0] == pytest.approx(angle, abs=1e-7)
    assert run["joint.w"][0] == pytest.approx(2.0, abs=1e-9)


def test_of_two_names_of_one_variable_the_upper_guess_counts():
    text = """model Two
      model Piece
        input Real rate;
        Real q(start = 5);
      equation
        der(q) = rate;
      end Piece;
      model Seen
        input Real of;
        Real q(start = 3) = of - 1;
      end Seen;
      model Pair
        Piece a(rate = -b.q, q(start = 4));
        Seen b(of = a.q);
      end Pair;
      Pair pair PAIR;
    end Two;"""
    for given, a in (("", 4.0), ("(b(q(start = 7)))", 8.0)):
        run = lmoc.compile_text(text.replace("pair PAIR", f"pair{given}")).simulate(times=[0.0])
        assert run["pair.a.q"][0] == pytest.approx(a, abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_each_level_has_the_least_squares_that_those_above_it_leave(seed):
    """Against null spaces, level after level, and of what is left the least |x + d|."""
    from scipy.linalg import lstsq, null_space

    random = np.random.default_rng(seed)
    n, level = 7, np.repeat([0, 1, 3, 4], [2, 1, 3, 2])
    matrix, residual, x = random.normal(size=(8, n)), random.normal(size=8), random.normal(size=n)
    matrix[4] = matrix[3] - matrix[2]  # what a level repeats and contradicts
    rows, columns = np.divmod(np.arange(matrix.size), n)
    d = split((rows, columns, matrix.ravel()), level, n).step((rows, columns, matrix.ravel()), residual, x)
    scaled, right = (v / np.linalg.norm(matrix, axis=1, keepdims=True) for v in (matrix, residual[:, None]))
    best, free = np.zeros(n), np.eye(n)
    for k in (0, 1, 3, 4):
        own, wanted = scaled[level == k], -right[level == k, 0]
        if free.shape[1]:
            best = best + free @ lstsq(own @ free, wanted - own @ best, cond=1e-9)[0]
            free = free @ null_space(own @ free, rcond=1e-9)
    best = best - free @ free.T @ (x + best)
    assert d == pytest.approx(best, abs=1e-9)
