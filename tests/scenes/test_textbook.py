"""The scenes of ``models/textbook``, each with its answer by hand or by an integration of equations written by hand."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import ROOT
from numpy import arcsin, arctan, cos, exp, hypot, pi, sin, sqrt, tan, tanh
from oracles import models
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import lmoc
from lmoc.view.page.equations import page_equations

G = 9.81
MODELS = ROOT / "models/textbook"


def compiled(name: str) -> lmoc.DAE:
    return models.compiled(f"textbook/{name}")


def run(name: str, balance: float = 1e-6, rtol: float = 1e-9, **options) -> lmoc.Run:
    found = compiled(name).simulate(rtol=rtol, points=options.pop("points", 201), **options)
    assert found.energy.balance < balance
    return found


def solution(rate, times: np.ndarray, start, largest: float = np.inf, rtol: float = 1e-11) -> np.ndarray:
    """The variables at these times, from the first of them on."""
    found = solve_ivp(rate, (times[0], times[-1]), start, "DOP853", times, rtol=rtol, atol=1e-12, max_step=largest)
    return found.y


def linear(M, C, K, force, times: np.ndarray, kinks=()) -> np.ndarray:
    """Coordinates of M*q'' + C*q' + K*q = force(t), from rest; the force is smooth between its kinks."""
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    B = np.concatenate([np.zeros((n, n)), np.linalg.inv(M)])
    last, found = np.zeros(2 * n), []
    for begin, end in pairwise((times[0], *kinks, times[-1])):
        inside = times[(times >= begin) & (times < end)]
        at = np.unique([begin, *inside, end])
        z = solution(lambda t, z: A @ z + B @ force(t), at, last)
        last = z[:, -1]
        found.append(z[:n, np.isin(at, inside)])
    return np.concatenate([*found, last[:n, None]], axis=1)


def instant(r: lmoc.Run, kind: str) -> float:
    return next(e.time for e in r.events if e.kind == kind)


# ------------------------------------------------------------------------------------------ along lines


def test_half_car():
    r = run("half_car", stop=1.2, points=61)
    m, J, m1, m2, l1, l2, k1, k2, c1, c2, kt = 600, 900, 40, 35, 1.5, 1.1, 17e3, 20e3, 1200, 1300, 190e3
    rear, front = np.array([-1, 0, 1, -l1]), np.array([0, -1, 1, l2])  # lengths of the struts by q1, q2, q, theta
    K, C = (a * np.outer(rear, rear) + b * np.outer(front, front) for a, b in ((k1, k2), (c1, c2)))
    K = K + np.diag([kt, kt, 0, 0])

    def force(t):
        way = np.array([10 * t - l1 - l2, 10 * t])
        return kt * np.append(np.where((way > 0) & (way < 2), 0.04 * (1 - cos(pi * way)), 0), [0, 0])

    q = linear(np.diag([m1, m2, m, J]), C, K, force, r.time, [0.2, 0.26, 0.46])
    found = [r["axle1.q"], r["axle2.q"], r["q"], r["theta"]]
    assert np.allclose(found, q, rtol=0, atol=1e-8)


def test_building_whose_roof_stands_still():
    r = run("building", stop=8, points=81)
    n, m, k, c, ma, w = 5, 2e5, 2e8, 4e5, 2e4, 9.0
    chain = 2 * np.eye(n + 1) - np.eye(n + 1, k=1) - np.eye(n + 1, k=-1)
    chain[n - 1, n - 1], chain[n], chain[:, n] = 1, 0, 0
    mount = np.zeros(n + 1)
    mount[-2:] = [1, -1]
    M, C, K = np.diag([m] * n + [ma]), c * chain, k * chain + ma * w**2 * np.outer(mount, mount)

    def ground(value, rate):
        return np.array([k * value + c * rate] + [0] * n)

    q = linear(M, C, K, lambda t: 0.005 * ground(sin(w * t), w * cos(w * t)), r.time)
    found = [r[f"storey[{i}].q"] for i in range(1, n + 1)] + [r["absorber.q"]]
    assert np.allclose(found, q, rtol=0, atol=1e-7)
    steady = np.linalg.solve(K + 1j * w * C - w**2 * M, 0.005 * ground(1, 1j * w))
    assert abs(steady[n - 1]) < 1e-12 and abs(steady[0]) > 0.004  # Den Hartog: the roof has no part in it


def test_valve_train():
    """Pressed on: q = lift(omega*t). In flight: m*q'' = -F - k*q. Back on the cam: its velocity."""
    angle = np.linspace(0, 2 * pi, 25)
    h, m, k, F, w = 0.008, 0.25, 5e3, 20.0, 300.0
    lift = CubicSpline(angle, h / 2 * (1 - cos(angle)), bc_type="periodic")

    def force(t):
        return m * w**2 * lift(w * t, 2) + k * lift(w * t) + F

    # of the cosine the force at angle 180 deg is zero where m*w^2*h/2 = k*h + F
    limit = sqrt((k * h + F) / (m * h / 2))
    below = run("valve_train", parameters={"omega": 0.97 * limit}, stop=0.03, balance=1e-5)
    assert not below.events and below["gap"].max() < 1e-12
    r = run("valve_train", stop=0.04, balance=1e-5)
    kinds = [(e.kind, e.time) for e in r.events]
    assert [kind for kind, _ in kinds] == ["release", "contact"] * (len(kinds) // 2) + ["release"] * (len(kinds) % 2)
    off = brentq(force, 0.25 * 2 * pi / w, 0.5 * 2 * pi / w)
    free = sqrt(k / m)

    def flight(t):
        y, v = lift(w * off) + F / k, w * lift(w * off, 1)
        return y * cos(free * (t - off)) + v / free * sin(free * (t - off)) - F / k

    back = brentq(lambda t: flight(t) - lift(w * t), off + 1e-3, off + 2 * pi / w)
    assert [kinds[0][1], kinds[1][1]] == pytest.approx([off, back], rel=1e-6)
    flies = (r.time > off) & (r.time < back)
    assert r["q"][flies] == pytest.approx(flight(r.time[flies]), abs=1e-9)
    pressed = r.time < off
    assert r["N"][pressed] == pytest.approx(force(r.time[pressed]), rel=1e-6)


# ------------------------------------------------------------------------------------------ shafts


@pytest.mark.parametrize("load", [800, 300])
def test_hoist(load):
    r = run("hoist", parameters={"m": load})
    alpha = (850 - load * G * 0.2 / 2) / (30 + load * 0.04 / 4)
    assert r["height"] == pytest.approx(0.1 * alpha * r.time**2 / 2, abs=1e-9)
    assert r["S"] == pytest.approx(np.full(201, load * (G + 0.1 * alpha) / 2))


@pytest.mark.parametrize("S", [60, 35])
def test_belt_drive(S):
    r = run("belt_drive", parameters={"S": S}, stop=8)
    beta = pi - 2 * arcsin(0.12 / 0.6)
    F = S * (exp(0.4 * beta) - 1)  # Euler and Eytelwein
    a1, a2 = (6 - 0.08 * F) / 0.2, 0.2 * F / 1.5
    grip = 0.08 * 150 / (0.2 * a2 - 0.08 * a1)
    assert instant(r, "stick") == pytest.approx(grip)
    both = 0.2 + 1.5 * 0.4**2
    assert r["omega1"][-1] == pytest.approx(150 + a1 * grip + 6 / both * (8 - grip))
    assert r["omega2"][-1] == pytest.approx(0.4 * r["omega1"][-1])
    assert r.energy.lost[-1] == pytest.approx(F * 0.08 * 150 * grip / 2)


@pytest.mark.parametrize("M2", [30, 12])
def test_gearbox(M2):
    r = run("gearbox", parameters={"M2": M2})
    slip = 3.5 * 80 / 2 - 80  # of the cone
    meets = slip / (M2 * (1 / (0.01 * 2**2) + 1 / 40))
    assert instant(r, "lock") == pytest.approx(0.5 + meets)
    last = 80 + M2 / 40 * meets
    assert [r["omega1"][-1], r["omega2"][-1]] == pytest.approx([2 * last, last])
    assert r.energy.lost[-1] == pytest.approx(M2 * slip * meets / 2)


@pytest.mark.parametrize("mu", [0.12, 0.2])
def test_winch(mu):
    r = run("winch", parameters={"mu": mu, "U": 36})
    ratio = 40 * tan(0.1) / tan(0.1 + arctan(mu))  # with the efficiency of the worm
    inertia = 5e-4 + (0.1 + 150 * 0.01) / (40 * ratio)
    c = 0.08**2 / 0.15
    full = (0.08 * 36 / 0.15 - 150 * G * 0.1 / ratio) / c
    exact = full * (r.time - inertia / c * (1 - exp(-c / inertia * r.time)))
    on, held = r.time < 2, r.time > 2.1
    assert r["motor.shaft.theta"][on] == pytest.approx(exact[on], abs=1e-6)
    assert not r["omega"][held].any() and not r["load.v"][held].any()
    assert np.ptp(r["height"][held]) == 0 and 0 < r["height"][-1] - r["height"][on][-1] < 0.02 * r["height"][-1]


@pytest.mark.parametrize("mass", [1300, 2000])
def test_clutch_start(mass):
    r = run("clutch_start", parameters={"m": mass})
    behind = 0.02 + (2 + mass * 0.3**2) / 14**2
    road = 200 * 0.3 / 14
    a1, a2 = (90 - 150) / 0.25, (150 - road) / behind
    locks = 200 / (a2 - a1)
    assert instant(r, "lock") == pytest.approx(locks)
    last = a2 * locks + (90 - road) / (0.25 + behind) * (4 - locks)
    assert [r["omega1"][-1], r["v"][-1]] == pytest.approx([last, last / 14 * 0.3])
    assert r.energy.lost[-1] == pytest.approx(150 * 200 * locks / 2)


@pytest.mark.parametrize("M", [35, 60])
def test_bicycle(M):
    r = run("bicycle", parameters={"M": M})
    ratio, air = 44 / 18, 1.2 * 0.5 / 2
    F = (M - 0.5) / ratio / 0.34
    coasting = 85 + 2 * 0.12 / 0.34**2
    riding = coasting + 0.08 / (ratio * 0.34) ** 2
    full = sqrt(F / air)
    rides = r.time <= 30
    speed = full * tanh(F / full / riding * np.minimum(r.time, 30))
    later = speed / (1 + air * speed / coasting * (r.time - 30))
    assert r["v"] == pytest.approx(np.where(rides, speed, later), rel=1e-7)
    cadence = speed[-1] / 0.34 / ratio
    assert instant(r, "unlock") == pytest.approx(30) and instant(r, "stick") == pytest.approx(30 + 0.08 * cadence / 0.5)


# ------------------------------------------------------------------------------------------ in the plane


def reduced(place, masses, power, times: np.ndarray, start) -> np.ndarray:
    """The coordinate of a mechanism with one degree of freedom.

    Parameters
    ----------
    place : callable
        ``place(phi)`` gives the coordinates that have inertia, ``masses``, as analytic functions
    power : callable
        ``power(phi, places, slopes, omega)``: that of all forces by the rate of ``phi``
    """
    masses, h = np.asarray(masses, float), 1e-3

    def rate(t, z):
        phi, omega = z
        p = [np.asarray(place(phi + k * h)) for k in (-2, -1, 0, 1, 2)]
        slope = (8 * (p[3] - p[1]) - (p[4] - p[0])) / (12 * h)
        bend = (16 * (p[3] + p[1]) - (p[4] + p[0]) - 30 * p[2]) / (12 * h * h)
        inertia = masses @ slope**2
        return [omega, (power(phi, p[2], slope, omega) - masses @ (slope * bend) * omega**2) / inertia]

    return solution(rate, times, start, rtol=1e-10)[0]


def test_engine():
    r = run("engine", stop=0.15, points=51)
    s, l = 0.05, 0.16

    def place(phi):  # angle of the crank, angle of the rod, its centre, the piston
        psi = -arcsin(s / l * sin(phi))
        x, y = s * cos(phi) + l / 2 * cos(psi), s * sin(phi) + l / 2 * sin(psi)
        return [phi, psi, x, y, s * cos(phi) + l * cos(psi)]

    def power(phi, places, slopes, omega):
        gas = 8e5 * sin(phi) ** 2 if sin(phi) > 0 else 0.0
        return -50 - 0.005 * gas * slopes[4]

    masses = [0.2 + 1.2 * s**2 / 3, 0.6 * l**2 / 12, 0.6, 0.6, 0.5]
    assert r["main.phi"] == pytest.approx(reduced(place, masses, power, r.time, [0.3, 100]), abs=1e-6)


def test_double_wishbone():
    r = run("double_wishbone", stop=0.5, points=26)
    a, b, h, e, H, d, u, k, c, d0, m, P = 0.36, 0.27, 0.28, 0.08, 0.26, 0.26, 0.12, 90e3, 3e3, 0.56, 30, 3500

    def place(phi):  # lower wishbone, upper one, wheel and its place, length of the strut, heights of the wishbones
        x, y = a * cos(phi), a * sin(phi)
        far = np.hypot(e - x, H - y)
        along = (h**2 - b**2 + far**2) / (2 * far)
        out = sqrt(h**2 - along**2)
        ex, ey = (e - x) / far, (H - y) / far
        tx, ty = x + along * ex + out * ey, y + along * ey - out * ex  # the upper ball
        camber = np.arctan2(ty - y, tx - x) - pi / 2
        upper = np.arctan2(ty - H, tx - e)
        wx, wy = x + u * cos(camber) - h / 2 * sin(camber), y + u * sin(camber) + h / 2 * cos(camber)
        return [phi, upper, camber, wx, wy, hypot(0.16 - d * cos(phi), 0.5 - d * sin(phi))]

    def power(phi, places, slopes, omega):
        pull = k * (places[5] - d0) + c * slopes[5] * omega
        weight = 3 * a / 2 * cos(phi) + 2 * b / 2 * cos(places[1]) * slopes[1]
        return (P - m * G) * slopes[4] - G * weight - pull * slopes[5]

    masses = [3 * a**2 / 3, 2 * b**2 / 3, 0.6, m, m, 0]
    phi = reduced(place, masses, power, r.time, [-0.2, 0])
    assert r["lowerPin.phi"] == pytest.approx(phi, abs=1e-6)
    found = np.array([place(x) for x in phi])
    assert r["camber"] == pytest.approx(found[:, 2], abs=1e-6) and r["y"] == pytest.approx(found[:, 4], abs=1e-6)


def coaster(H: float, R: float = 10.0, L: float = 40.0, n: int = 8, p: int = 16):
    i, j, tail = np.arange(n) / n, np.arange(p + 1) / p, np.arange(1, 5) / 2
    x = np.concatenate([L * (i - 1), R * sin(2 * pi * j) + 0.1 * R * j, 0.1 * R + R * tail])
    y = np.concatenate([H / 2 * (1 + cos(pi * i)), R * (1 - cos(2 * pi * j)), 0 * tail])
    way = np.concatenate([[0], np.cumsum(hypot(np.diff(x), np.diff(y)))])
    return [CubicSpline(way, v, bc_type="natural") for v in (x, y)]


def test_roller_coaster():
    r = run("roller_coaster", stop=8, balance=1e-5)
    x, y = coaster(26)

    def rate(t, z):
        length = hypot(x(z[0], 1), y(z[0], 1))
        return [z[1] / length, -G * y(z[0], 1) / length]

    s, v = solution(rate, r.time, [0.5, 0], 0.02)
    assert np.allclose([r["track.s"], r["v"]], [s, v], rtol=0, atol=1e-4) and not r.events
    length = hypot(x(s, 1), y(s, 1))
    bent = (x(s, 1) * y(s, 2) - y(s, 1) * x(s, 2)) / length**3
    assert r["N"] == pytest.approx(500 * (bent * v**2 + G * x(s, 1) / length), abs=2)
    assert v**2 / 2 + G * r["y"] == pytest.approx(np.full(201, G * r["y"][0]), abs=1e-3)
    low = run("roller_coaster", stop=8, parameters={"H": 22}, balance=1e-5)
    off = instant(low, "release")
    # it leaves the loop where its height above the centre is 2/3 of that of the start
    left = low["y"][np.searchsorted(low.time, off)]
    assert left - 10 == pytest.approx(2 / 3 * (22 - 10), rel=0.05)


def test_a_curve_through_many_points_stands_by_its_name():
    along = "stretch·s̈ + stretch_slope·ṡ² = -9.81·sin(φ)"
    assert along in str(compiled("roller_coaster").equations())
    html = page_equations(run("roller_coaster", stop=0.01, balance=1e-5)).html
    assert "track.cx over track.s" in html and "is a curve through many points" not in html
