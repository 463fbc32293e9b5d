"""The chain of `models/bench/chain.lmo`, written by hand for other tools.

Each function returns (seconds to build, seconds to run, position of the first mass at the end).
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

M, K, C, AMPLITUDE, STOP, RTOL, ATOL = 1.0, 100.0, 0.1, 0.01, 10.0, 1e-6, 1e-9


def mode(n: int) -> int:
    """The mode in which a chain starts: fast enough at every length."""
    return max(3, n // 20)


def start(n: int) -> np.ndarray:
    i = np.arange(1, n + 1)
    return np.concatenate([AMPLITUDE * np.sin(mode(n) * np.pi * i / (n + 1)), np.zeros(n)])


def exact_first(n: int, t: float = STOP) -> float:
    """Position of the first mass: the chain stays in the mode it starts in."""
    s = 4 * np.sin(mode(n) * np.pi / (2 * (n + 1))) ** 2
    damping, stiffness = C * s / M, K * s / M
    w = np.sqrt(stiffness - damping**2 / 4)
    shape = np.cos(w * t) + damping / (2 * w) * np.sin(w * t)
    return AMPLITUDE * np.sin(mode(n) * np.pi / (n + 1)) * np.exp(-damping * t / 2) * shape


def casadi_cvodes(n: int, points: int = 501) -> tuple[float, float, float]:
    """The minimal ODE as SX vectors, integrated by casadi's cvodes."""
    import casadi as ca

    begin = time.perf_counter()
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    zero = ca.SX.zeros(1)
    stretch = ca.vertcat(q, zero) - ca.vertcat(zero, q)
    rate = ca.vertcat(v, zero) - ca.vertcat(zero, v)
    f = K * stretch + C * rate
    a = (f[1:] - f[:-1]) / M
    options = {"reltol": RTOL, "abstol": ATOL, "max_num_steps": 10**7}
    grid = np.linspace(0, STOP, points)
    ode = {"x": ca.vertcat(q, v), "ode": ca.vertcat(v, a)}
    solver = ca.integrator("chain", "cvodes", ode, 0, grid, options)
    built = time.perf_counter() - begin
    begin = time.perf_counter()
    x = np.array(solver(x0=start(n))["xf"])
    return built, time.perf_counter() - begin, float(x[0, -1])


def scipy_ivp(n: int, method: str = "DOP853", points: int = 501) -> tuple[float, float, float]:
    """The minimal ODE in numpy, integrated by scipy."""
    from scipy.integrate import solve_ivp

    f = np.zeros(n + 1)

    def rhs(t: float, x: np.ndarray) -> np.ndarray:
        q, v = x[:n], x[n:]
        stretch = K * np.diff(q, prepend=0.0, append=0.0)
        np.add(stretch, C * np.diff(v, prepend=0.0, append=0.0), out=f)
        return np.concatenate([v, np.diff(f) / M])

    begin = time.perf_counter()
    done = solve_ivp(rhs, (0, STOP), start(n), method, np.linspace(0, STOP, points), rtol=RTOL, atol=ATOL)
    return 0.0, time.perf_counter() - begin, float(done.y[0, -1])


def sundials_c(n: int, points: int = 501) -> tuple[float, float, float]:
    """`chain.c`: CVODE with a band matrix by hand.

    Raises
    ------
    OSError
        Where there is no compiler, or the headers of SUNDIALS are not installed.
    """
    source = Path(__file__).with_name("chain.c")
    libraries = ["cvode", "nvecserial", "sunmatrixband", "sunlinsolband"]
    with tempfile.TemporaryDirectory() as folder:
        program = str(Path(folder) / "chain")
        begin = time.perf_counter()
        link = [f"-lsundials_{name}" for name in libraries] + ["-lm"]
        command = ["cc", "-O3", "-march=native", str(source), "-o", program, *link]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise OSError(f"the C compiler refused (are the headers of SUNDIALS installed?): {done.stderr[:60]}")
        built = time.perf_counter() - begin
        arguments = [str(a) for a in (n, mode(n), points, RTOL, ATOL)]
        answer = subprocess.run([program, *arguments], capture_output=True, text=True, check=True).stdout
    ran, end = map(float, answer.split())
    return built, ran, end


def sympy_lagrange(n: int) -> tuple[float, float, float]:
    """sympy.physics.mechanics derives, numpy runs: what a script of a student does."""
    import sympy as sp
    from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

    begin = time.perf_counter()
    q = dynamicsymbols(f"q:{n}")
    t = dynamicsymbols._t
    d = [sp.diff(x, t) for x in q]
    ends = [0, *q, 0]
    rates = [0, *d, 0]
    kinetic = sum(sp.Float(M) * x**2 for x in d) / 2
    elastic = sum(K * (b - a) ** 2 for a, b in zip(ends, ends[1:], strict=False)) / 2
    loss = sum(C * (b - a) ** 2 for a, b in zip(rates, rates[1:], strict=False)) / 2
    method = LagrangesMethod(kinetic - elastic, q)
    method.form_lagranges_equations()
    state = [*q, *d]
    forces = sp.Matrix([-sp.diff(loss, x) for x in d])
    right = method.mass_matrix.LUsolve(method.forcing + forces)
    function = sp.lambdify(state, [*d, *right])
    built = time.perf_counter() - begin
    from scipy.integrate import solve_ivp

    begin = time.perf_counter()
    done = solve_ivp(lambda _, x: function(*x), (0, STOP), start(n), "DOP853", rtol=RTOL, atol=ATOL)
    return built, time.perf_counter() - begin, float(done.y[0, -1])


MODELICA = """\
connector Flange Real q; flow Real f; end Flange;
model Fixed Flange flange; equation flange.q = 0; end Fixed;
model Mass Flange flange; parameter Real m = 1; Real q; Real v; Real a;
equation q = flange.q; v = der(q); a = der(v); m*a = flange.f; end Mass;
model Spring Flange a; Flange b; parameter Real k = 1; Real f; Real extension;
equation extension = b.q - a.q; f = k*extension; a.f = -f; b.f = f; end Spring;
model Damper Flange a; Flange b; parameter Real c = 1; Real f; Real d; Real rate;
equation d = b.q - a.q; rate = der(d); f = c*rate; a.f = -f; b.f = f; end Damper;
model Chain
  parameter Integer N = {n};
  Fixed left; Fixed right;
  Mass mass[N](each m = 1, q(start = {{0.01*sin({mode}*3.141592653589793*i/(N + 1)) for i in 1:N}}));
  Spring spring[N + 1](each k = 100);
  Damper damper[N + 1](each c = 0.1);
equation
  connect(left.flange, spring[1].a);
  connect(left.flange, damper[1].a);
  for i in 1:N loop
    connect(spring[i].b, mass[i].flange);
    connect(damper[i].b, mass[i].flange);
    connect(mass[i].flange, spring[i + 1].a);
    connect(mass[i].flange, damper[i + 1].a);
  end for;
  connect(spring[N + 1].b, right.flange);
  connect(damper[N + 1].b, right.flange);
end Chain;
"""


def rumoca(n: int) -> tuple[float, float, float]:
    """The same parts in Modelica, compiled and run by rumoca where it is installed."""
    import rumoca as rm

    begin = time.perf_counter()
    model = rm.Session().loads(MODELICA.format(n=n, mode=mode(n)), model="Chain")
    built = time.perf_counter() - begin
    begin = time.perf_counter()
    result = model.simulate(config=rm.SimConfig(rtol=RTOL, atol=ATOL, dt=STOP / 500), t=(0, STOP))
    return built, time.perf_counter() - begin, float(np.asarray(result["mass[1].q"])[-1])
