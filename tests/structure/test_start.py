"""Dependent coordinates are chosen with the start in view: what vanishes there is not divided by."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from oracles.flat_builder import flat_model

import lmoc
from lmoc.messages.diagnostics import Report
from lmoc.structure.coordinates.closure import start_point
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.normalize import normalize
from lmoc.structure.reduce import reduce

PENDULUM = """
    model Pendulum
      parameter Real L = {L}, g = 9.81;
      Real x({x}), y({y}), vx = der(x), vy = der(y), s;
    equation
      der(vx) = -s*x;
      der(vy) = -s*y - g;
      x^2 + y^2 = L^2;
    end Pendulum;"""

ANGLE = """
    model Angle
      parameter Real L = {L}, g = 9.81;
      Real phi(start = {phi}, fixed = true), omega(start = 0, fixed = true);
    equation
      der(phi) = omega;
      L*der(omega) = -g*cos(phi);
    end Angle;"""

# quarter turns from the right: cosine and sine, exact
RIGHT, UP, LEFT, DOWN = (1, 0), (0, 1), (-1, 0), (0, -1)


@pytest.mark.parametrize(
    ("told", "L", "place"),
    [
        *((*way, place) for way in (("both", 1e-3), ("the longer one", 1.0)) for place in (RIGHT, UP, LEFT, DOWN)),
        *((*way, place) for way in (("both", 50.0), ("the longer one", 1e-3)) for place in (LEFT, DOWN)),
        *(("in the other order", 1.0, place) for place in (RIGHT, UP)),
    ],
)
def test_pendulum_that_starts_where_a_coordinate_is_zero(place, L, told):
    starts = [f"start = {L * p}" for p in place]
    if told == "the longer one":
        starts = [s if p else "nominal = 1" for s, p in zip(starts, place, strict=True)]
    text = PENDULUM.format(L=L, x=starts[0], y=starts[1])
    if told == "in the other order":
        text = text.replace(f"x({starts[0]}), y({starts[1]})", f"y({starts[1]}), x({starts[0]})")
    stop = 0.5 * np.sqrt(L / 9.81)  # less than an eighth of a turn: no singular place
    run = lmoc.compile_text(text).simulate(stop=stop, points=6, rtol=1e-10)
    angle = lmoc.compile_text(ANGLE.format(L=L, phi=np.arctan2(place[1], place[0])))
    phi = angle.simulate(stop=stop, points=6, rtol=1e-10)["phi"]
    assert run["x"] == pytest.approx(L * np.cos(phi), abs=1e-8 * L)
    assert run["y"] == pytest.approx(L * np.sin(phi), abs=1e-8 * L)


DOUBLE = """
    model Double "Two unit masses on unit rods"
      parameter Real g = 9.81;
      Real x1(start = {x1}), y1(start = {y1}), x2(start = {x2}), y2(start = {y2});
      Real vx1 = der(x1), vy1 = der(y1), vx2 = der(x2), vy2 = der(y2), s1, s2;
    equation
      der(vx1) = -s1*x1 + s2*(x2 - x1);
      der(vy1) = -s1*y1 + s2*(y2 - y1) - g;
      der(vx2) = -s2*(x2 - x1);
      der(vy2) = -s2*(y2 - y1) - g;
      x1^2 + y1^2 = 1;
      (x2 - x1)^2 + (y2 - y1)^2 = 1;
    end Double;"""

ANGLES = """
    model Angles
      parameter Real g = 9.81;
      Real a(start = {a}, fixed = true), b(start = {b}, fixed = true);
      Real u(start = 0, fixed = true), w(start = 0, fixed = true);
    equation
      der(a) = u;
      der(b) = w;
      2*der(u) + cos(a - b)*der(w) + sin(a - b)*w^2 = -2*g*cos(a);
      cos(a - b)*der(u) + der(w) - sin(a - b)*u^2 = -g*cos(b);
    end Angles;"""


@pytest.mark.parametrize(("upper", "lower"), list(product([RIGHT, UP, LEFT, DOWN], [UP, LEFT])))
def test_double_pendulum_from_right_angles(upper, lower):
    x2, y2 = upper[0] + lower[0], upper[1] + lower[1]
    run = lmoc.compile_text(DOUBLE.format(x1=upper[0], y1=upper[1], x2=x2, y2=y2)).simulate(
        stop=0.15, points=4, rtol=1e-9
    )
    a, b = np.arctan2(upper[1], upper[0]), np.arctan2(lower[1], lower[0])
    angles = lmoc.compile_text(ANGLES.format(a=a, b=b)).simulate(stop=0.15, points=4, rtol=1e-10)
    a, b = angles["a"], angles["b"]
    assert run["x1"] == pytest.approx(np.cos(a), abs=1e-7)
    assert run["y2"] == pytest.approx(np.sin(a) + np.sin(b), abs=1e-7)


def chain_in_points(lengths, angles, order) -> str:
    """Unit masses on rods; their coordinates are the unknowns, declared in this order."""
    x, y = (np.round(np.cumsum(lengths * f(angles)), 12) for f in (np.cos, np.sin))
    n = len(lengths)
    names = [f"x{i}(start = {x[i]})" for i in range(n)] + [f"y{i}(start = {y[i]})" for i in range(n)]
    equations, pulls = "", ""
    for i in range(n):
        dx, dy = (f"(x{i} - x{i - 1})", f"(y{i} - y{i - 1})") if i else ("x0", "y0")
        equations += f"{dx}^2 + {dy}^2 = {lengths[i] ** 2}; fx{i} = s{i}*{dx}; fy{i} = s{i}*{dy};\n"
        pulls += f", s{i}"
    return f"model Points Real {', '.join(names[k] for k in order)}{pulls}{masses_of(n)} {equations} end Points;"


def chain_in_angles(lengths, angles, order) -> str:
    n, equations, names = len(lengths), "", ""
    for i in range(n):
        x, y = (f"x{i - 1} + ", f"y{i - 1} + ") if i else ("", "")
        equations += f"x{i} = {x}{lengths[i]}*cos(t{i}); y{i} = {y}{lengths[i]}*sin(t{i});\n"
        equations += f"sin(t{i})*fx{i} - cos(t{i})*fy{i} = 0;\n"
        names += f"t{i}(start = {angles[i]}), x{i}, y{i}{',' if i < n - 1 else ''}"
    return f"model Angles Real {names}{masses_of(n)} {equations} end Angles;"


def masses_of(n: int) -> str:
    """What both have in common: forces of the rods, and Newton's law."""
    names = "".join(f", u{i} = der(x{i}), v{i} = der(y{i}), fx{i}, fy{i}" for i in range(n))
    law = ""
    for i in range(n):
        fx, fy = (f" + fx{i + 1}", f" + fy{i + 1}") if i < n - 1 else ("", "")
        law += f"der(u{i}) = -fx{i}{fx}; der(v{i}) = -fy{i}{fy} - 9.81;\n"
    return f"{names}; equation {law}"


@pytest.mark.parametrize("seed", range(5))
def test_chains_of_rods_from_eighths_of_a_turn(seed):
    """Rods of very different lengths, level, upright and askew, whatever is declared first."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 5))
    angles, lengths = random.integers(0, 8, n) * np.pi / 4, random.choice([0.01, 1.0, 3.0], n)
    stop = 0.02 * np.sqrt(lengths.min())
    chains = [f(lengths, angles, random.permutation(2 * n)) for f in (chain_in_points, chain_in_angles)]
    points, turned = (lmoc.compile_text(text).simulate(stop=stop, points=3, rtol=1e-9) for text in chains)
    for name in (f"{axis}{i}" for axis in "xy" for i in range(n)):
        assert points[name] == pytest.approx(turned[name], abs=1e-8)


def test_rods_in_one_line_take_few_steps():
    """What turns by rounding alone is not followed; parts that move alike do not hide that it is rounding."""
    angles, lengths = np.pi / 4 * np.array([0, 1, 1, 1]), np.array([3.0, 3.0, 1.0, 0.01])
    run = lmoc.compile_text(chain_in_angles(lengths, angles, np.arange(8))).simulate(stop=0.002, rtol=1e-9, points=3)
    assert run.stats["steps"] < 1000
    assert np.ptp(run["t3"]) < 1e-12


GUIDE = """
    model Guide "A point on a line that turns; when it starts, the line is level or upright"
      Real x(start = {x}), y(start = {y}), vx = der(x), vy = der(y), s, c, n{declared};
    equation
      c = cos({turned});
      s = sin({turned});
      s*x - c*y = 0;
      der(vx) = s*n;
      der(vy) = -c*n;
      annotation(experiment(StartTime = {start}, StopTime = {stop}));
    end Guide;"""

ON_LEVEL, ON_UPRIGHT = {"x": 1, "y": 0}, {"x": 0, "y": 1}


@pytest.mark.parametrize(
    ("start", "turned", "declared", "where", "states"),
    [
        (0.0, "time", "", ON_LEVEL, ["x", "vx"]),
        (np.pi / 2, "time", "", ON_UPRIGHT, ["y", "vy"]),
        (0.0, "time + 1.5707963267948966", "", ON_UPRIGHT, ["y", "vy"]),
        (0.0, "u", "; input Real u = time", ON_LEVEL, ["x", "vx"]),
        (0.0, "u", "; input Real u = 1.5707963267948966 - time", ON_UPRIGHT, ["y", "vy"]),
    ],
)
def test_coefficients_of_time_are_looked_at_when_it_starts(start, turned, declared, where, states):
    text = GUIDE.format(start=start, stop=start + 0.5, turned=turned, declared=declared, **where)
    dae = lmoc.compile_text(text)
    assert dae.states == states
    run = dae.simulate(rtol=1e-10, points=6)
    # the distance r from the axis: r'' = r, and it starts at 1 and rests in space: r' = 0
    assert np.hypot(run["x"], run["y"]) == pytest.approx(np.cosh(run.time - start), rel=1e-7)


CRANK = """
    model Crank "A slider crank"
      parameter Real r = 0.3, l = 1, J = 0.1, m = 2;
      Real {declared}, n, s, w = der(phi), v = der(x);
    equation
      x = r*cos(phi) + l*cos(psi);
      0 = r*sin(phi) - l*sin(psi);
      J*der(w) = -r*sin(phi)*n - r*cos(phi)*s - 0.2*sin(phi) + 1;
      m*der(v) = -n;
      0 = l*cos(psi)*s - l*sin(psi)*n;
    end Crank;"""


@pytest.mark.parametrize("phi", [0.0, np.pi])
@pytest.mark.parametrize("declared", ["x, psi, phi({})", "phi({}), x(stateSelect = StateSelect.prefer), psi"])
def test_slider_crank_at_a_dead_centre_turns_by_its_crank(phi, declared):
    dae = lmoc.compile_text(CRANK.format(declared=declared.format(f"start = {phi}, fixed = true")))
    assert dae.states == ["phi", "w"]
    run = dae.simulate(stop=0.5, points=6, rtol=1e-10)
    angle = run["phi"]
    assert run["x"] == pytest.approx(0.3 * np.cos(angle) + np.sqrt(1 - (0.3 * np.sin(angle)) ** 2), abs=1e-9)
    # the work of the moment 1 - 0.2 sin(phi) is kinetic energy
    work = angle - phi + 0.2 * (np.cos(angle) - np.cos(phi))
    assert 0.05 * run["w"] ** 2 + run["v"] ** 2 == pytest.approx(work, abs=1e-8)


def test_who_asks_for_a_coordinate_gets_it():
    """Also where the scene cannot start with it."""
    text = CRANK.format(declared="phi(start = 0, fixed = true), psi, x(start = 1.3)")
    assert lmoc.compile_text(text, states=["x"]).states == ["x", "v"]


def test_wishes_hold_where_the_start_allows_them():
    """Near the top y is a poor coordinate, but no impossible one."""
    start = f"start = {np.cos(1.55)}", f"start = {np.sin(1.55)}, stateSelect = StateSelect.prefer"
    assert lmoc.compile_text(PENDULUM.format(L=1, x=start[0], y=start[1])).states == ["y", "vy"]


def test_another_place_to_start_from_is_another_reduction():
    text = PENDULUM.format(L=2, x="start = L*cos(p)", y="start = L*sin(p)").replace("g = 9.81", "p = 0, g = 9.81")
    dae = lmoc.compile_text(text)
    assert dae.states == ["y", "vy"]
    for p in (0.0, 1.2, -np.pi / 2, np.pi):
        run = dae.simulate(stop=0.2, points=3, rtol=1e-10, parameters={"p": p})
        phi = lmoc.compile_text(ANGLE.format(L=2, phi=p)).simulate(stop=0.2, points=3, rtol=1e-10)["phi"]
        assert run["x"] == pytest.approx(2 * np.cos(phi), abs=1e-8)
        assert run["y"] == pytest.approx(2 * np.sin(phi), abs=1e-8)
        assert any(d.code == "N0631" for d in run.notes) == (p == -np.pi / 2)


def test_a_coordinate_without_start_value_begins_where_the_constraints_hold():
    """x = 0 is out of reach of the crank."""
    declared = "phi(start = 0.4, fixed = true), psi, x(stateSelect = StateSelect.prefer)"
    text = CRANK.format(declared=declared).replace("equation", "Real free, pace = der(free); equation der(pace) = 0;")
    dae = lmoc.compile_text(text)
    assert set(dae.states) == {"x", "v", "free", "pace"}
    run = dae.simulate(stop=0.1, points=2)
    assert run["v"][0] == run["free"][0] == run["pace"][0] == 0
    assert run["phi"][0] == pytest.approx(0.4, abs=1e-9)
    assert run["x"][0] == pytest.approx(0.3 * np.cos(0.4) + np.sqrt(1 - (0.3 * np.sin(0.4)) ** 2), abs=1e-9)


LOOP = """
    parameter l = 2
    var a b c d x y
    start a = 1
    x = cos(a) + l*cos(b)
    y = sin(a) + l*sin(b)
    x = 3 + cos(c)
    y = sin(c) + d
    d = 0.1*time
"""


def test_the_start_point_satisfies_the_constraints():
    flat = flat_model(LOOP)
    system = EquationSystem(normalize(flat, flat.parameter_values(), None, Report()))
    point = start_point(system, np.ones(system.rows, int), 0)
    a, b, c, d, x, y = (point.sample.value[0, flat.find(name)[0]] for name in "abcdxy")
    left = [np.cos(a) + 2 * np.cos(b) - 3 - np.cos(c), np.sin(a) + 2 * np.sin(b) - np.sin(c)]
    assert left == pytest.approx([0, 0], abs=1e-9)
    assert d == pytest.approx(0, abs=1e-9)


def test_the_start_point_of_contradictory_constraints_is_what_is_given():
    flat = flat_model("var x y\nstart x = 2\nx**2 + y**2 = -1\nx = sin(y) + 3")
    system = EquationSystem(normalize(flat, flat.parameter_values(), None, Report()))
    assert start_point(system, np.ones(system.rows, int), 0).sample.value[0, flat.find("x")] == 2


def test_a_search_is_not_made_again_for_what_no_loop_reads():
    flat, known = flat_model(LOOP + "    parameter m = 3\n    var z\n    z = m*sin(a)\n"), {}

    def start(known: dict | None, **parameters: float) -> np.ndarray:
        values = flat.parameter_values({int(flat.find(name)[0]): v for name, v in parameters.items()})
        system = EquationSystem(normalize(flat, values, None, Report()))
        tied = np.where(system.source == 5, 0, 1)
        return start_point(system, tied, 0, known=known).sample.value[0, : flat.count]

    first = start(known)
    assert len(known) == 1
    other = start(known, m=5.0)
    assert len(known) == 1 and other[flat.find("m")] == 5 and other[flat.find("b")] == first[flat.find("b")]
    longer = start(known, l=2.5)
    assert len(known) == 2 and longer[flat.find("b")] != first[flat.find("b")]
    for parameters in ({"m": 5.0}, {"l": 2.5}):
        assert start(known, **parameters).tobytes() == start(None, **parameters).tobytes() and len(known) == 2


def test_loops_that_are_copies_are_put_together_once(monkeypatch):
    from lmoc.structure.coordinates import closure

    text = """
        model Many
          parameter Real r[60] = {if mod(i, 3) == 0 then 2 else 1 for i in 1:60};
          Real x[60](start = {if i == 7 then 0.5 else 0.3 for i in 1:60}, each fixed = true);
          Real y[60](each start = -1), vx[60] = der(x), vy[60] = der(y), s[60];
        equation
          for i in 1:60 loop
            der(vx[i]) = -s[i]*x[i];
            der(vy[i]) = -s[i]*y[i] - 9.81;
            x[i]^2 + y[i]^2 = r[i]^2;
          end for;
        end Many;"""
    looked_at = []
    one = closure._assemblies
    monkeypatch.setattr(closure, "_assemblies", lambda part, *rest: looked_at.append(part.count) or one(part, *rest))
    dae = lmoc.compile_text(text)
    assert 3 <= len(looked_at) < 10  # of either length, and the one that starts elsewhere; a start is looked for twice
    run = dae.simulate(stop=1e-9, points=2)
    for i in (1, 3, 7, 31, 60):
        x, r = 0.5 if i == 7 else 0.3, 2 if i % 3 == 0 else 1
        assert run[f"x[{i}]"][0] == x
        assert run[f"y[{i}]"][0] == pytest.approx(-np.sqrt(r * r - x * x), rel=1e-12)


def test_many_constraints_are_closed_sparsely(monkeypatch):
    from lmoc.structure.coordinates import closure

    names = []
    for dense in (200, 0):
        monkeypatch.setattr(closure, "DENSE", dense)
        names.append(reduce(flat_model(f"{PLANAR}start x = 0\nstart y = 0.5")).state_names)
    assert names == [["x", "der(x)"]] * 2


PLANAR = """
    var x y F
    2*der(der(x)) = -F*x
    2*der(der(y)) = -F*y - 19.62
    x**2 + y**2 = 0.25
"""


@pytest.mark.parametrize("initial", [{"x": 1.0, "y": 0.0}, {"x": 1.0}, {"x": -1.0}])
def test_a_start_of_one_run_only_where_the_coordinates_do_not_serve(initial):
    """Compiled as it hangs, where x tells the place, and let go at the side, where it does not."""
    dae = lmoc.compile_text(PENDULUM.format(L=1.0, x="start = 0", y="start = -1"))
    assert dae.states == ["x", "vx"]
    run = dae.simulate(stop=0.3, points=6, rtol=1e-10, initial=initial)
    assert "N0631" in {note.code for note in run.notes}
    phi = 0.0 if initial["x"] > 0 else np.pi
    angle = lmoc.compile_text(ANGLE.format(L=1.0, phi=phi)).simulate(stop=0.3, points=6, rtol=1e-10)["phi"]
    assert run["x"] == pytest.approx(np.cos(angle), abs=2e-8)
    assert run["y"] == pytest.approx(np.sin(angle), abs=2e-8)
    assert dae.states == ["x", "vx"] and dae.simulate(stop=0.1)["y"][-1] == pytest.approx(-1)


FOLDING = """
    model Loop
      import Planar.*;
      inner World world;
      Ground ground;
      Revolute r1(phi(start = 0.4115)), r2(phi(start = 0)), r3(phi(start = -0.4115));
      Link l1(rx = 0, ry = -0.5), l2(rx = 0, ry = -0.5);
      Prismatic p(s(start = 0.4, fixed = true), v(fixed = true));
      Body b(m = 1, J = 0.1);
      Real open(start = {open}) = p.s;
    equation
      connect(ground.frame, r1.a);
      connect(ground.frame, p.a);
      connect(p.b, r3.a);
      connect(r1.b, l1.a);
      connect(r3.b, l2.a);
      connect(l1.b, r2.a);
      connect(l2.b, r2.b);
      connect(b.frame, l1.b);
    end Loop;"""


@pytest.mark.parametrize("opening", [0, 0.2, 0.9, -0.4])
def test_of_several_names_of_a_variable_the_fixed_one_tells_the_start(opening):
    """Two bars fold onto each other, so that the carriage stands at 0, or open by what is fixed."""
    run = lmoc.compile_text(FOLDING.format(open=opening)).simulate(stop=0.01, points=2)
    assert run["p.s"][0] == pytest.approx(0.4) and run["open"][0] == pytest.approx(0.4)
    assert run["r1.phi"][0] == pytest.approx(np.arcsin(0.4)) and run["r3.phi"][0] == pytest.approx(-np.arcsin(0.4))
