"""Which scenes count as linear: read off their programs, whatever the values of parameters are."""

import numpy as np
import pytest

import lmoc
from lmoc.numerics.plan.linearity import is_linear


def linear(text: str, **arguments: object) -> bool:
    """Whether the plan of a short run is linear."""
    dae = lmoc.compile_text(f"model M {text} end M;")
    return dae.simulate(stop=0.1, points=3, **arguments).trajectory.observer.plan.once(is_linear)


STATES = "parameter Real k = 2; Real x(start = 1, fixed = true), v(start = 0, fixed = true);"
LOOP = """Real a, b;
  equation der(x) = v; der(v) = a; k*a + b = -x; a - 3*b = v*{factor};"""


@pytest.mark.parametrize(
    "rate", ["-k*x - sqrt(k)*v", "-k*x + sin(time)", "-(k*x + 1)/k", "-x - abs(sin(time))", "-k*(x + v)*2"]
)
def test_what_is_linear(rate):
    assert linear(f"{STATES} equation der(x) = v; der(v) = {rate};")


@pytest.mark.parametrize("rate", ["-k*x^3", "-x*v", "-x*sin(time)", "-sin(x)", "-x/(1 + time)", "-abs(x)"])
def test_what_is_not_linear(rate):
    assert not linear(f"{STATES} equation der(x) = v; der(v) = {rate};")


def test_an_input_is_not_a_coefficient():
    text = "input Real u; Real x(start = 1, fixed = true); equation der(x) = {};"
    assert linear(text.format("u - x"), inputs={"u": "sin(time)"})
    assert not linear(text.format("-u*x"), inputs={"u": "sin(time)"})


def test_equations_solved_together():
    assert linear(STATES + LOOP.format(factor="1"))
    assert not linear(STATES + LOOP.format(factor="x"))
    assert not linear(STATES + LOOP.format(factor="1").replace("k*a", "(k + x^2)*a"))


def test_laws_and_events_are_not_linear():
    text = "parameter Real e = 0.5; Real x(start = 1, fixed = true), v(start = 0, fixed = true);"
    assert not linear(text + "equation der(x) = v; der(v) = -x - (if time > 5 then 1 else 0);")
    assert not linear(text + "equation der(x) = v; der(v) = -1; when x < 0 then reinit(v, -e*pre(v)); end when;")


def test_the_energy_ledger_does_not_count():
    assert linear(
        "Mass m(m = 1, q(start = 1, fixed = true)); Spring s(k = 1); Damper d(c = 1); Fixed w;"
        "equation connect(w.flange, s.a); connect(s.b, m.flange); connect(w.flange, d.a);"
        "connect(d.b, m.flange);"
    )


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
def test_errors_of_a_linear_run_are_as_asked_for(rtol):
    """m q'' + c q' + k q = 0, damped so that the run is long for its motion, and short for `auto`."""
    dae = lmoc.compile_text("""model D
      Real q(start = 1, fixed = true), v(start = 0, fixed = true);
      equation der(q) = v; der(v) = -4*q - 0.2*v; end D;""")
    run = dae.simulate(stop=20, points=101, rtol=rtol)
    w = np.sqrt(4 - 0.01)
    exact = np.exp(-0.1 * run.time) * (np.cos(w * run.time) + 0.1 / w * np.sin(w * run.time))
    assert np.abs(run["q"] - exact).max() < 30 * rtol
