"""Right-hand sides of seven scenes, written by hand in casadi as one who knows them would.

Of the two mechanisms all coordinates and velocities are states; accelerations and multipliers come from one linear
solve with the constraints on acceleration level. Andrews' squeezer, the car axis and Pleiades follow Mazzia and
Magherini, Test Set for IVP Solvers, 2.4.
"""

from __future__ import annotations

import numpy as np


def _index_one(q, v, mass, force, constraint, time=None):
    """``M a + Gᵀ λ = f``, ``G a = -d/dt(G) v - …`` solved for a, as a casadi function ``(t, (q, v)) -> (v, a)``."""
    import casadi as ca

    t = ca.SX.sym("t") if time is None else time
    jacobian = ca.jacobian(constraint, q)
    rate = ca.mtimes(jacobian, v) + ca.jacobian(constraint, t)
    bias = ca.jtimes(rate, q, v) + ca.jacobian(rate, t)
    factors = ca.ldl(ca.sparsify(mass))  # M first: the symbolic QR of the whole matrix loses half of the digits
    free, response = ca.ldl_solve(force, *factors), ca.ldl_solve(ca.densify(jacobian.T), *factors)
    schur = ca.ldl(ca.mtimes(jacobian, response))
    multipliers = ca.ldl_solve(ca.mtimes(jacobian, free) + bias, *schur)
    acceleration = free - ca.mtimes(response, multipliers)
    return ca.Function("ode", [t, ca.vertcat(q, v)], [ca.densify(ca.vertcat(v, acceleration))])


def andrews():
    """Return the function, the start (14,) and the stop time."""
    import casadi as ca

    m1, m2, m3, m4, m5, m6, m7 = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498
    i1, i2, i3, i4, i5, i6, i7 = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5
    xa, ya, xb, yb, xc, yc, c0 = -0.06934, -0.00227, -0.03635, 0.03273, 0.014, 0.072, 4530
    d, da, e, ea, rr, ra, l0 = 0.028, 0.0115, 0.02, 0.01421, 0.007, 0.00092, 0.07785
    ss, sa, sb, sc, sd, ta, tb = 0.035, 0.01874, 0.01043, 0.018, 0.02, 0.02308, 0.00916
    u, ua, ub, zf, zt, fa, mom = 0.04, 0.01228, 0.00449, 0.02, 0.04, 0.01421, 0.033
    q, v = ca.SX.sym("q", 7), ca.SX.sym("v", 7)
    be, th, ga, ph, de, om, ep = ca.vertsplit(q)
    bp, thp, _, php, dep, omp, epp = ca.vertsplit(v)
    sin, cos = ca.sin, ca.cos
    m = ca.SX(7, 7)
    m[0, 0] = m1 * ra**2 + m2 * (rr**2 - 2 * da * rr * cos(th) + da**2) + i1 + i2
    m[0, 1] = m[1, 0] = m2 * (da**2 - da * rr * cos(th)) + i2
    m[1, 1] = m2 * da**2 + i2
    m[2, 2] = m3 * (sa**2 + sb**2) + i3
    m[3, 3] = m4 * (e - ea) ** 2 + i4
    m[3, 4] = m[4, 3] = m4 * ((e - ea) ** 2 + zt * (e - ea) * sin(ph)) + i4
    m[4, 4] = m4 * (zt**2 + 2 * zt * (e - ea) * sin(ph) + (e - ea) ** 2) + m5 * (ta**2 + tb**2) + i4 + i5
    m[5, 5] = m6 * (zf - fa) ** 2 + i6
    m[5, 6] = m[6, 5] = m6 * ((zf - fa) ** 2 - u * (zf - fa) * sin(om)) + i6
    m[6, 6] = m6 * ((zf - fa) ** 2 - 2 * u * (zf - fa) * sin(om) + u**2) + m7 * (ua**2 + ub**2) + i6 + i7
    x, y = sd * cos(ga) + sc * sin(ga) + xb, sd * sin(ga) - sc * cos(ga) + yb
    length = ca.sqrt((x - xc) ** 2 + (y - yc) ** 2)
    f = -c0 * (length - l0) / length
    fx, fy = f * (x - xc), f * (y - yc)
    force = ca.vertcat(
        mom - m2 * da * rr * thp * (thp + 2 * bp) * sin(th),
        m2 * da * rr * bp**2 * sin(th),
        fx * (sc * cos(ga) - sd * sin(ga)) + fy * (sd * cos(ga) + sc * sin(ga)),
        m4 * zt * (e - ea) * dep**2 * cos(ph),
        -m4 * zt * (e - ea) * php * (php + 2 * dep) * cos(ph),
        -m6 * u * (zf - fa) * epp**2 * cos(om),
        m6 * u * (zf - fa) * omp * (omp + 2 * epp) * cos(om),
    )
    a, b = rr * cos(be) - d * cos(be + th), rr * sin(be) - d * sin(be + th)
    constraint = ca.vertcat(
        a - ss * sin(ga) - xb,
        b + ss * cos(ga) - yb,
        a - e * sin(ph + de) - zt * cos(de) - xa,
        b + e * cos(ph + de) - zt * sin(de) - ya,
        a - zf * cos(om + ep) - u * sin(ep) - xa,
        b - zf * sin(om + ep) + u * cos(ep) - ya,
    )
    start = [-0.0617138900142764496, 0, 0.45527981916307038, 0.222668390165885884, 0.487364979543842550,
             -0.222668390165885884, 1.23054744454982119]  # fmt: skip
    return _index_one(q, v, m, force, constraint), np.array([*start, *[0.0] * 7]), 0.03


def car_axis():
    """Return the function, the start (8,) and the stop time."""
    import casadi as ca

    length, l0, mass, eps, r, w, g = 1.0, 0.5, 10.0, 1e-2, 0.1, 10.0, 1.0
    k = mass * eps**2 / 2
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 4), ca.SX.sym("v", 4)
    xl, yl, xr, yr = ca.vertsplit(q)
    yb = r * ca.sin(w * t)
    xb = ca.sqrt(length**2 - yb**2)
    ll, lr = ca.sqrt(xl**2 + yl**2), ca.sqrt((xr - xb) ** 2 + (yr - yb) ** 2)
    force = ca.vertcat(
        (l0 - ll) * xl / ll, (l0 - ll) * yl / ll - k * g, (l0 - lr) * (xr - xb) / lr, (l0 - lr) * (yr - yb) / lr - k * g
    )
    constraint = ca.vertcat(xl * xb + yl * yb, (xl - xr) ** 2 + (yl - yr) ** 2 - length**2)
    start = np.array([0, 0.5, 1, 0.5, -0.5, 0, -0.5, 0])
    return _index_one(q, v, k * ca.SX.eye(4), force, constraint, t), start, 3.0


def pendulum():
    """Return the function, the start (2,) and the stop time."""
    import casadi as ca

    t, x = ca.SX.sym("t"), ca.SX.sym("x", 2)
    return ca.Function("ode", [t, x], [ca.vertcat(x[1], -9.81 * ca.sin(x[0]))]), np.array([1.5, 0.0]), 2000.0


def pleiades():
    """Return the function, the start (28,) with places before velocities, and the stop time."""
    import casadi as ca

    t, s = ca.SX.sym("t"), ca.SX.sym("s", 28)
    x, y = ca.vertsplit(s[:7]), ca.vertsplit(s[7:14])
    ax, ay = [0] * 7, [0] * 7
    for i in range(7):
        for j in range(i):
            dx, dy = x[j] - x[i], y[j] - y[i]
            square = dx**2 + dy**2
            inverse_cube = 1 / (square * ca.sqrt(square))
            px, py = dx * inverse_cube, dy * inverse_cube
            ax[i], ay[i] = ax[i] + (j + 1) * px, ay[i] + (j + 1) * py
            ax[j], ay[j] = ax[j] - (i + 1) * px, ay[j] - (i + 1) * py
    start = [3, 3, -1, -3, 2, -2, 2, 3, -3, 2, 0, 0, -4, 4, 0, 0, 0, 0, 0, 1.75, -1.5, 0, 0, 0, -1.25, 1, 0, 0]
    return ca.Function("ode", [t, s], [ca.vertcat(s[14:], *ax, *ay)]), np.array(start, float), 3.0


def plucked_string():
    """Return the function, the start (200,) and the stop time."""
    import casadi as ca

    n, m, k, at, height = 100, 0.01, 1e4, 30, 0.01
    t, s = ca.SX.sym("t"), ca.SX.sym("s", 2 * n)
    pull = k * (ca.vertcat(s[:n], 0) - ca.vertcat(0, s[:n]))
    i = np.arange(1, n + 1)
    shape = np.where(i <= at, height * i / at, height * (n + 1 - i) / (n + 1 - at))
    ode = ca.vertcat(s[n:], (pull[1:] - pull[:-1]) / m)
    return ca.Function("ode", [t, s], [ca.densify(ode)]), np.concatenate([shape, np.zeros(n)]), 1.0


def quarter_car():
    """Return the function, the start (4,) and the stop time."""
    import casadi as ca

    m1, m2, k1, k2, c1, c2, g = 50, 300, 160000, 16000, 100, 1200, 9.81
    t, s = ca.SX.sym("t"), ca.SX.sym("s", 4)
    q1, q2, v1, v2 = ca.vertsplit(s)
    u, du = 0.05 * ca.sin(6 * t), 0.3 * ca.cos(6 * t)
    tire, strut = k1 * (u - q1) + c1 * (du - v1), k2 * (q1 - q2) + c2 * (v1 - v2)
    return ca.Function("ode", [t, s], [ca.vertcat(v1, v2, (tire - strut) / m1 - g, strut / m2 - g)]), np.zeros(4), 2.0


def chain_of_bars():
    """Return the function, the start (10,) with angles to the horizontal before their rates, and the stop time."""
    import casadi as ca

    n, m, length, g = 5, 1.0, 1.0, 9.81
    t, s = ca.SX.sym("t"), ca.SX.sym("s", 2 * n)
    angle, rate = s[:n], s[n:]
    i, j = np.indices((n, n))
    beyond = n - np.maximum(i, j) - 1.0  # bars that both carry
    weight = m * length**2 * (beyond + np.where(i == j, 1 / 3, 1 / 2))
    apart = ca.repmat(angle, 1, n) - ca.repmat(angle.T, n, 1)
    mass, swing = ca.DM(weight) * ca.cos(apart), ca.DM(weight) * ca.sin(apart)
    arms = m * g * length * (n - np.arange(n) - 0.5)
    force = -ca.mtimes(swing, rate**2) - ca.DM(arms) * ca.cos(angle)
    acceleration = ca.ldl_solve(force, *ca.ldl(mass))
    return ca.Function("ode", [t, s], [ca.densify(ca.vertcat(rate, acceleration))]), np.zeros(2 * n), 2.0
