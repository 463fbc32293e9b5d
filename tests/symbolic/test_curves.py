"""Curves through many points in the equations of motion: by their names, their rates by the chain rule."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import lmoc
from lmoc.symbolic.equations import EquationsOfMotion

ANGLES = np.linspace(0, 2 * np.pi, 14)
LIFTS = 0.02 * np.sin(ANGLES / 2) ** 2
TABLE = "{" + ", ".join(f"{{{a!r}, {h!r}}}" for a, h in zip(ANGLES.tolist(), LIFTS.tolist(), strict=True)) + "}"
J, M, K, D0, T = 0.01, 2.0, 5000.0, 0.1, 3.0


@cache
def cam() -> lmoc.DAE:
    """A cam on a shaft that is free to turn, under a mass that a spring presses on."""
    return lmoc.compile_text(
        f"model S Torque drive(tau = {T}); CamProfile cam(profile = {TABLE}); Fixed top(q0 = 0.1);"
        f"Inertia shaft(J = {J}, theta(start = 0, fixed = true), omega(start = 5, fixed = true));"
        f"Spring spring(k = {K}, d0 = {0.1 + D0}); Mass mass(m = {M}, q(start = 0), v(start = 0));"
        "equation connect(drive.shaft, shaft.shaft);"
        "connect(shaft.shaft, cam.shaft); connect(cam.flange, mass.flange); connect(mass.flange, spring.a);"
        "connect(spring.b, top.flange); annotation(experiment(StopTime = 0.2)); end S;"
    )


def test_the_equation_of_a_cam_on_a_free_shaft_is_the_textbooks():
    found = cam().equations()
    closed = next(m.equations for m in found.modes if m.mode == {"cam": "contact"})
    inertia, mass, k, h, rise, bend = sp.symbols("shaft.J mass.m spring.k cam.lift cam.rise cam.rise_slope")
    angle, rate, acceleration = sp.symbols("shaft.theta der(shaft.theta) der(der(shaft.theta))")
    own = (inertia + mass * rise**2) * acceleration + mass * rise * bend * rate**2 + k * rise * h
    (equation,) = closed.equations
    rest = sp.expand(equation.residual - own)
    assert not rest.free_symbols & {angle, rate, acceleration, bend, h}  # the moment and the force of the closed valve
    assert closed.curves == {"cam.lift": ("shaft.theta", "cam.rise"), "cam.rise": ("shaft.theta", "")}
    assert "curves: cam.lift over shaft.theta, cam.rise over shaft.theta (the slope of cam.lift)" in str(found)
    solved = next(m.equations for m in cam().equations(explicit=True).modes if m.mode == {"cam": "contact"})
    (value,) = sp.solve(equation.residual, acceleration)
    assert sp.simplify(solved.equations[0].residual.subs(acceleration, value)) == 0


def test_the_run_of_a_cam_on_a_free_shaft_satisfies_that_equation():
    run = cam().simulate(rtol=1e-9, points=41)
    assert not [e for e in run.events if e.kind == "release"]
    h = CubicSpline(ANGLES, LIFTS, bc_type="periodic")

    def rates(_: float, x: np.ndarray) -> list[float]:
        angle, omega = x
        lift, rise, bend = (float(h(angle % (2 * np.pi), n)) for n in range(3))
        return [omega, (T - M * rise * bend * omega**2 - K * rise * (lift + D0)) / (J + M * rise**2)]

    # bends of the spline jump in no point, their slopes do: short steps
    own = solve_ivp(rates, (0, 0.2), [0.0, 5.0], "DOP853", run.time, rtol=1e-11, atol=1e-12, max_step=1e-3).y
    assert run["shaft.theta"] == pytest.approx(own[0], abs=1e-6 * np.abs(own[0]).max())
    assert (run["cam.f"] > 0).all()


def on_a_curve(scene: str, parts: str) -> EquationsOfMotion:
    """Return the equations of what moves along an ellipse, a part of it or all; `POINTS` stands for its points."""
    angles, closed = ("for k in 0:12", "true") if scene == "closed" else ("for k in 2:9", "false")
    points = f"{{{{2*cos(0.5235987755982988*k), sin(0.5235987755982988*k)}} {angles}}}, closed = {closed}"
    text = f"model S import Planar.*; inner World world; {parts} end S;".replace("POINTS", points)
    return lmoc.compile_text(text).equations()


LENGTH, BEND, ANGLE, TURN, BEND_OF_TURN = sp.symbols(
    "track.stretch track.stretch_slope track.phi track.phi_slope track.phi_curvature"
)
RATE, ACCELERATION, G = *sp.symbols("der(track.s) der(der(track.s))"), sp.Rational("9.81")


@pytest.mark.parametrize("scene", ["closed"])
def test_a_track_that_alone_ties_the_way_down_gives_the_equation_along_it(scene):
    """With the length l and the angle φ of the tangent l·s̈ + l'·ṡ² = -g·sin φ, whatever the curve."""
    found = on_a_curve(
        scene,
        "PointMass car(m = 2); Track track(points = POINTS, s(start = 0.3, fixed = true),"
        "v(start = 3, fixed = true)); equation connect(track.point, car.point);",
    )
    own = LENGTH * ACCELERATION + BEND * RATE**2 + G * sp.sin(ANGLE)
    (equation,) = found.equations
    assert sp.simplify(equation.residual / own).free_symbols <= {sp.Symbol("car.m")}
    assert found.curves == {"track.stretch": ("track.s", ""), "track.phi": ("track.s", "")}


@pytest.mark.parametrize("scene", ["open"])
def test_a_disk_that_rolls_on_a_curve_has_the_equation_of_its_centre(scene):
    """(m + J/r²)·v̇ = -m·g·sin φ, where the centre goes by v = (l - r·φ')·ṡ."""
    found = on_a_curve(
        scene,
        "Body disk(m = 2, J = 0.04, theta(start = 0, fixed = true)); DiskTrack track(points = POINTS, r = 0.1,"
        "s(start = 0.3, fixed = true), v(start = 3, fixed = true)); equation connect(track.disk, disk.frame);",
    )
    m, inertia, r, turned = sp.symbols("disk.m disk.J track.r der(disk.theta)")
    way, change = LENGTH - r * TURN, BEND - r * BEND_OF_TURN
    rolls, turns = found.equations
    own = (m + inertia / r**2) * (way * ACCELERATION + change * RATE**2) + m * G * sp.sin(ANGLE)
    assert sp.simplify(rolls.residual - r**2 * own) == 0
    assert sp.simplify(turns.residual - (way * RATE + r * turned)) == 0


@pytest.mark.parametrize("count", [1, 2])
def test_a_force_over_the_position_stands_in_the_equation_by_its_name(count):
    points = ", ".join(f"{{{x}, {x**3}}}" for x in np.linspace(-1, 1, 21).round(2).tolist())
    rest = "q(each start = 0, each fixed = true), v(each start = 0, each fixed = true)"
    found = lmoc.compile_text(
        f"model S TableForce push[{count}](each table = {{{points}}}); Mass mass[{count}](each m = 2, {rest}); equation"
        f" for i in 1:{count} loop connect(push[i].flange, mass[i].flange); end for; end S;"
    ).equations()
    for k, one in enumerate(found.equations, 1):
        m, a, f = sp.symbols(f"mass[{k}].m der(der(mass[{k}].q)) push[{k}].f")
        assert sp.expand(one.residual - (m * a - f)) == 0 or sp.expand(one.residual + (m * a - f)) == 0
    assert found.curves == {f"push[{k}].f": (f"mass[{k}].q", "") for k in range(1, count + 1)}


def test_a_curve_that_moves_along_is_no_curve_over_the_position():
    """Of h(q - time), the rates are h'·(q̇ - 1): the chain rule over q alone would leave the time out."""
    pieces = "".join(f"if x < {k / 10} then {k}*x^3 else " for k in range(1, 10))
    found = lmoc.compile_text(
        f"model S function g input Real x; output Real y; algorithm y := noEvent({pieces}9*x^3); end g;"
        "Real q(start = 0.05, fixed = true), v(start = 0.3, fixed = true), y, h; equation der(q) = v; h = g(q - time);"
        "y = q + h; 2*der(v) + 3*der(der(y)) = -5*q; end S;"
    ).equations()
    assert not found.curves
    (equation,) = found.equations
    assert sp.Symbol("time") in equation.residual.free_symbols


def test_the_slope_of_a_curve_is_no_other_variable_of_the_model():
    pieces = "".join(f"if x < {k / 10} then {k}*x^3 else " for k in range(1, 10))
    (equation,) = lmoc.compile_text(
        f"model S function g input Real x; output Real y; algorithm y := noEvent({pieces}9*x^3); end g;"
        "parameter Real h_slope = 2; Real q(start = 0.05, fixed = true), v(start = 0.3, fixed = true), h;"
        "equation der(q) = v; h = g(q); h_slope*der(v) = -5*q - h; end S;"
    ).equations().equations
    own, acceleration, q, h = sp.symbols("h_slope der(der(q)) q h")
    assert sp.simplify(equation.residual / (own * acceleration + 5 * q + h)).is_number


def test_squares_go_where_they_are_of_a_polynomial():
    from lmoc.symbolic.sorting import without_squares

    a, b = sp.symbols("a b")
    held = 1 / (1 + sp.cos(a))
    assert sp.simplify(without_squares(sp.sin(b) ** 2 + sp.cos(b) ** 2 + held) - 1 - held) == 0
