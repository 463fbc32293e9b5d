"""Taylor series as instructions: coefficients that satisfy the differential equation, whatever a scene is made of."""

from __future__ import annotations

import math

import numpy as np
import pytest
from oracles.models import compiled

import lmoc
from lmoc.engine.library import library
from lmoc.lower.series import LENGTH
from lmoc.lower.series_code import NUMBER, RECURRENCES, of_one_order, simplified
from lmoc.messages.diagnostics import Report
from lmoc.numerics.evaluate.taylor_system import TaylorSystem
from lmoc.numerics.plan.plan import build_plan
from lmoc.numerics.signals.signals import bind_signals

FUNCTIONS = {
    "sin(x)": math.sin, "cos(x)": math.cos, "tan(x)": math.tan, "exp(x)": math.exp, "log(x)": math.log,
    "sqrt(x)": math.sqrt, "atan(x)": math.atan, "asin(x/2)": lambda x: math.asin(x / 2), "tanh(x)": math.tanh,
    "x^1.5": lambda x: x**1.5, "x^7": lambda x: x**7, "x^(-2)": lambda x: x**-2, "1/x": lambda x: 1 / x,
    "(3 - x)*x": lambda x: (3 - x) * x, "x/(1 + x^2)": lambda x: x / (1 + x * x), "x^x": lambda x: x**x,
    "atan2(x, 2)": lambda x: math.atan2(x, 2), "atan2(1, x)": lambda x: math.atan2(1, x), "sin(x)*cos(x)*2":
    lambda x: 2 * math.sin(x) * math.cos(x),
}  # fmt: skip


def system_of(text: str) -> tuple[lmoc.DAE, TaylorSystem]:
    dae = lmoc.compile_text(text)
    report = Report()
    signals = bind_signals(dae.flat, None, report)
    plan = build_plan(dae.reduced, signals, False, report)
    system = TaylorSystem(plan)
    system.prepare(plan.base(dae.values, signals), signals)
    return dae, system


def coefficients(system: TaylorSystem, t: float, x: np.ndarray, order: int) -> np.ndarray:
    out = np.zeros((system.n, LENGTH))
    assert system.series(t, np.array(x, float), order, out.ctypes.data)
    return out[:, : order + 1]


def test_the_instructions_have_their_numbers_in_the_engine():
    assert tuple(library().lmoc_recurrences().decode().split()) == RECURRENCES


def test_sums_read_no_copies_and_no_negatives():
    def code(*lines: str) -> list[tuple[int, ...]]:
        return [(NUMBER[name], *map(int, rest)) for name, *rest in map(str.split, lines)]

    before = code("copy 1 0 0", "neg 2 1 0", "add 3 2 9", "sub 4 9 2", "sub 5 2 9", "scale 6 2 7", "convolve 7 1 2",
                  "copy 8 0 0", "add 10 8 1", "copy 8 1 0", "neg 11 2 0", "add 12 11 2")  # fmt: skip
    after = code("copy 1 0 0", "neg 2 0 0", "sub 3 9 0", "add 4 9 0", "sub 5 2 9", "scale 6 2 7", "convolve 7 1 2",
                 "copy 8 0 0", "add 10 8 0", "copy 8 0 0", "copy 11 0 0", "sub 12 0 0")  # fmt: skip
    assert simplified(before) == after  # what is filled twice is read as it stands
    assert of_one_order(before, {3}) == {4, 5, 6, 7, 8, 10, 11, 12}


@pytest.mark.parametrize("expression", FUNCTIONS)
def test_series_of_functions_along_a_line(expression):
    """x = 0.9 + t/2, der(y) = f(x): y's coefficients are those of the integral, found from values at complex points."""
    _, system = system_of(f"""model M Real x(start = 0.9, fixed = true), y(start = 0, fixed = true);
        equation der(x) = 0.5; der(y) = {expression}; end M;""")
    order, radius, f = 10, 0.5, FUNCTIONS[expression]
    names = [system.plan.reduced.register_name(int(r)) for r in system.plan.states]
    x = np.array([0.9 if n == "x" else 0.0 for n in names])
    found = coefficients(system, 0.0, x, order)[names.index("y")]
    nodes = np.cos(np.pi * (np.arange(64) + 0.5) / 64)  # f is analytic about 0.9: its Chebyshev series within 0.25
    fit = np.polynomial.chebyshev.Chebyshev.fit(nodes * radius, [f(0.9 + t * radius / 2) for t in nodes], 30)
    power = fit.convert(kind=np.polynomial.Polynomial, domain=[-1, 1]).coef
    expected = np.concatenate([[0.0], power[:6] / np.arange(1, 7)])
    np.testing.assert_allclose(found[:7], expected, rtol=1e-5, atol=1e-7 * np.abs(expected).max())


def test_time_and_sums_and_what_stays():
    _, system = system_of("""model M parameter Real a = 2; Real x(start = 1, fixed = true), y(start = 3, fixed = true);
        equation der(x) = sin(a*time) + time^2; der(y) = a; end M;""")
    names = [system.plan.reduced.register_name(int(r)) for r in system.plan.states]
    found = coefficients(system, 0.3, [1.0, 3.0] if names == ["x", "y"] else [3.0, 1.0], 6)
    x, y = found[names.index("x")], found[names.index("y")]
    slopes = [2**k * math.sin(0.6 + k * math.pi / 2) / math.factorial(k) for k in range(6)]
    for k, own in enumerate((0.09, 0.6, 1.0)):
        slopes[k] += own
    np.testing.assert_allclose(x[1:], np.array(slopes) / np.arange(1, 7), rtol=1e-13)
    assert y[1] == 2.0 and not y[2:].any()


@pytest.mark.parametrize("scene", ["classic/andrews", "classic/slider_crank", "planar/four_bar", "planar/chain"])
def test_blocks_have_series(scene):
    """By the derivative of the polynomial a little later: it is the right-hand side there."""
    dae = compiled(scene)
    run = dae.simulate(times=[0.0, 1e-9], rtol=1e-10, solver="taylor", energy=False)
    assert run.stats["solver"] == "taylor"
    fine = dae.simulate(stop=0.02, points=5, rtol=1e-11, solver="dop853")
    own = dae.simulate(stop=0.02, points=5, rtol=1e-11, solver="taylor")
    for name in dae.states:
        np.testing.assert_allclose(own[name], fine[name], rtol=1e-9, atol=1e-9 * np.abs(fine[name]).max())


def test_kinks_and_samples_have_none():
    dae = lmoc.compile_text("model M Real x(start = 1, fixed = true); equation der(x) = -abs(x); end M;")
    run = dae.simulate(stop=1, points=3, solver="taylor")
    assert run.stats["solver"] == "dop853" and "kinks" in str(run.stats)


def test_a_function_of_what_grows_evenly_with_time_takes_no_sum():
    """der(y) = cos(w*t + 1): the coefficients are those of the closed form, at another time than zero."""
    _, system = system_of("model M parameter Real w = 3; Real y(start = 0, fixed = true);\n"
                          "equation der(y) = cos(1 + w*time); end M;")  # fmt: skip
    names = [RECURRENCES[op] for op, *_ in np.reshape(system._of.code, (-1, 4)).tolist()]
    assert names.count("of_time") == 2 and "chain" not in names
    found = coefficients(system, 0.4, [0.0], 12)[0]
    turned = [math.sin(2.2 + k * math.pi / 2) * 3.0 ** (k - 1) / math.factorial(k) for k in range(1, 13)]
    assert np.allclose(found[1:], turned, rtol=1e-13)
