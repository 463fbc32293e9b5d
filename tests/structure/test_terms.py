"""Nonlinear constraints that repeat others: recognized as combinations of the same terms, and only then."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.flat_builder import flat_model

import lmoc
from lmoc.expression.dag import function, slot
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.structure.linear.coefficients import KNOWN, UNKNOWN
from lmoc.structure.linear.substitution import Rows
from lmoc.structure.linear.terms import entries, terms_of
from lmoc.structure.normalize import normalize
from lmoc.structure.reduce import reduce

X, Y, P = slot(0), slot(1), slot(2)
KINDS = (UNKNOWN, UNKNOWN, KNOWN)


def sin(x):
    return function("sin", x)


@pytest.mark.parametrize(
    ("shape", "terms", "rest"),
    [
        (P * sin(X) - Y, {sin(X), Y}, False),
        (2 * (X - P * sin(Y)) / P + P, {X, sin(Y)}, True),
        (-(sin(X) * (P * Y)), {sin(X) * Y}, False),
        ((X + 1) * Y, {(X + 1) * Y}, False),  # not multiplied out
        (sin(P), set(), True),
        (X - X * P / P, {X}, False),  # P/P is no constant known to be 1
    ],
)
def test_terms(shape, terms, rest):
    found, constant = terms_of(shape, KINDS)
    assert set(found) == terms
    assert (constant.op != "const" or constant.value != 0) == rest


def matrix(*shapes, known=0.7) -> np.ndarray:
    """Rows of coefficients for equations over two unknowns and a parameter, one column a term."""
    row = np.array([[0, 1, 2]])
    groups = tuple(Rows(shape, KINDS, row, np.array([i])) for i, shape in enumerate(shapes))
    r, c, v = entries(groups, np.array([np.nan, np.nan, known]))
    columns = np.unique(c, return_inverse=True)[1]
    result = np.zeros((len(shapes), columns.max() + 1))
    np.add.at(result, (r, columns), v)
    return result


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((X - Y) ** 2, (Y - X) ** 2),
        (sin(X - Y), sin(Y - X)),
        (P * sin(2 * X), sin(X) * function("cos", X)),
        (sin(X + P), sin(P + X)),
        (function("sqrt", X * X * P), function("abs", X)),
    ],
)
def test_the_same_term_in_other_words(one, other):
    assert np.linalg.matrix_rank(matrix(one, other, one - other), tol=1e-9) == 1
    assert np.linalg.matrix_rank(matrix(one + P * Y, P * Y - one), tol=1e-9) == 2


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (sin(X), sin(Y)),
        (sin(X), sin(X * 1.000001)),
        (sin(X), sin(X + 0.7 * P)),
        (X * Y, X * Y * Y),
        (function("sqrt", X - 5), function("sqrt", X - 5)),  # without a value at the points: not told
    ],
)
def test_different_terms(one, other):
    assert np.linalg.matrix_rank(np.nan_to_num(matrix(one, other))) == 2


# ------------------------------------------------------------------------------ scenes


def scene(parts: str, joined: str) -> str:
    return f"""
        model M
          Inertia rotor(J = 0.4, theta(start = 0.3, fixed = true), omega(start = 9, fixed = true));
          Mass load(m = 2, g = 9.81);
          Fixed wall; Spring spring(k = 6, d0 = 1, L = 1);
          {parts}
        equation
          connect(wall.flange, spring.a); connect(spring.b, load.flange);
          {joined}
        end M;"""


ONE_ARM = "connect(rotor.shaft, a.shaft); connect(a.flange, load.flange);"
TWO_ARMS = ONE_ARM + "connect(rotor.shaft, b.shaft); connect(b.flange, load.flange);"
GEARED = ONE_ARM + "connect(rotor.shaft, g.a); connect(g.b, b.shaft); connect(b.flange, load.flange);"
BOTH_ENDS = "connect(l.pivot, rotor.shaft); connect(l.b, load.flange); connect(l.a, s.a); connect(l.b, s.b);"


@pytest.mark.parametrize(
    ("parts", "joined", "lost"),
    [
        ("Arm a(l = 1.5), b(l = 1.5);", TWO_ARMS, {"a.flange.f", "b.flange.f", "a.shaft.tau", "b.shaft.tau"}),
        (
            "Arm a(l = 1.5), b(l = -1.5); Gear g(N = -1);",  # sin(-theta) = -sin(theta)
            GEARED,
            {"a.flange.f", "b.flange.f", "a.shaft.tau", "b.shaft.tau", "g.a.tau", "g.b.tau"},
        ),
        (
            "Lever l(l1 = 1, l2 = 1.5), s(l1 = 2, l2 = 3, smallAngle = true);",  # s keeps the ratio of the ends of l
            BOTH_ENDS,
            {"l.a.f", "l.b.f", "s.a.f", "s.b.f"},
        ),
    ],
)
def test_what_is_held_twice_moves_as_if_held_once(parts, joined, lost):
    """Through the dead centre too, where an arm has no leverage."""
    options = {"times": np.linspace(0, 3, 7), "rtol": 1e-10}
    once = lmoc.compile_text(scene("Arm a(l = 1.5);", ONE_ARM)).simulate(**options)
    dae = lmoc.compile_text(scene(parts, joined))
    assert len(dae.states) == 2
    assert {dae.flat.variable_name(int(v)) for v in dae.reduced.undetermined} == lost
    twice = dae.simulate(**options)
    assert np.abs(once["rotor.theta"]).max() > np.pi / 2
    for name in ("rotor.theta", "load.q", "load.v", "spring.f"):
        np.testing.assert_allclose(twice[name], once[name], rtol=1e-6, atol=1e-6)
    assert twice.energy.balance < 1e-6


def test_arms_of_different_length_are_not_the_same():
    dae = lmoc.compile_text(scene("Arm a(l = 1.5), b(l = 1.6);", TWO_ARMS).replace("fixed = true", "fixed = false"))
    assert dae.states == []
    (warning,) = [d for d in dae.reduced.notes if d.code == "W0417"]
    assert all(name in warning.message for name in ("a and b", "rotor.theta", "load.q"))


@pytest.mark.parametrize(
    ("law", "warned"),
    [
        ("x**2 + y**2 = 2\nx - sin(y) = 0", True),
        ("x**2 + y**2 = 2\nx - sin(y) = time", False),
        ("x**2 + y**2 = 2\nx - sin(y) = u", False),
        ("x**2 + y**2 = z\nx - sin(y) = 0\nder(z) = -z", False),  # it is led by a state
    ],
)
def test_what_constraints_hold_is_told(law, warned):
    unknowns = "x y s t z" if "z" in law else "x y s t"
    motion = "der(der(x)) = 2*x*s + t\nder(der(y)) = 2*y*s - t*cos(y)"
    reduced = reduce(flat_model(f"input u\nvar {unknowns}\nstart x = 0.8\nstart y = 1.1\n{law}\n{motion}"))
    assert any(d.code == "W0417" for d in reduced.notes) == warned


HELD = """
model Held
  connector Place
    Real x(start = 0.8), y(start = 1.1);
    flow Real fx, fy;
  end Place;
  model Crossing "two curves that cross"
    Place place;
    Real round, along;
  equation
    place.x^2 + place.y^2 = 2;
    place.x - sin(place.y) = 0;
    place.fx = 2*place.x*round + along;
    place.fy = 2*place.y*round - along*cos(place.y);
  end Crossing;
  model Plate
    Place place;
    Real vx, vy;
    Real w(start = 3);
  equation
    vx = der(place.x);
    vy = der(place.y);
    {der(vx), der(vy)} = {place.fx, place.fy};
    TURN;
  end Plate;
  Crossing crossing;
  Plate plate;
equation
  connect(crossing.place, plate.place);
end Held;
"""


@pytest.mark.parametrize(("turn", "warned"), [("2*der(w) = -w", False), ("w = 0", True)])
def test_a_body_that_is_held_in_a_point_and_turns_is_not_at_rest(turn, warned):
    dae = lmoc.compile_text(HELD.replace("TURN", turn))
    assert any(d.code == "W0417" for d in dae.reduced.notes) == warned


def test_arms_at_different_places_contradict_each_other():
    parts, joined = (
        "Arm a(l = 1.5), b(l = 1.5); Rod r(L = 0.1);",
        TWO_ARMS.replace("connect(b.flange, load.flange)", "connect(b.flange, r.a); connect(r.b, load.flange)"),
    )
    with pytest.raises(ModelError) as wrong:
        lmoc.compile_text(scene(parts, joined))
    (found,) = wrong.value.diagnostics
    assert found.code == "E0411" and "b" in found.message and "a" in found.message


def test_other_lengths_are_another_structure():
    dae = lmoc.compile_text(scene("Arm a(l = 1.5), b(l = 1.5);", TWO_ARMS).replace("fixed = true", "fixed = false"))
    assert dae.reduced.broken_guard(dae.flat.parameter_values()) is None
    at = int(dae.flat.find("b.l")[0])
    assert "are redundant" in dae.reduced.broken_guard(dae.flat.parameter_values({at: 1.6}))


def test_many_pairs_are_one_shape():
    n = 300
    pairs = "\n".join(f"var x{i} y{i}\nx{i}**2 + sin(y{i}) = time\n2*sin(y{i}) + 2*x{i}**2 = 2*time" for i in range(n))
    flat = flat_model(pairs)
    found = normalize(flat, flat.parameter_values(), None, Report())
    assert found.counts["after elimination"] == n
    assert f"{n - 3} more" in found.notes[-1].hint
