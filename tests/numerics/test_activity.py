"""Short pulses in long runs are seen by every solver, and nothing is paid where there are none."""

import math

import numpy as np
import pytest

import lmoc
from lmoc.numerics.options.options import ADAPTIVE
from lmoc.numerics.plan.activity import StepBounds, finest_scales

PUSHED = """model P
  input Real u(unit = "N") = {};
  Mass m(m = 1, q(fixed = true), v(fixed = true));
  Force f(f = u);
equation
  connect(f.flange, m.flange);
end P;"""


@pytest.mark.parametrize("solver", ADAPTIVE)
@pytest.mark.parametrize("place", [0.5, 33.3])
def test_a_gaussian_of_ten_milliseconds(solver, place):
    dae = lmoc.compile_text(PUSHED.format(f"100*exp(-((time - {place})/0.01)^2)"))
    run = dae.simulate(stop=100, points=11, solver=solver)
    assert run["m.v"][-1] == pytest.approx(math.sqrt(math.pi), rel=1e-4)


@pytest.mark.parametrize(
    "pulse",
    [
        "1/(0.01*(1 + ((time - 70)/0.01)^2))/3.14159265358979",
        "exp(-abs(time - 70)/0.01)/0.02",
        "200*sin(3.14159265358979*(time - 70)/0.01)^2*(if time > 70 and time < 70.01 then 1 else 0)",
        "cos(3.14159265358979*(time - 70)/100)^2000000*126*3.544907701811032/4.460",
    ],
    ids=["Lorentz", "Laplace", "half a period", "power of a cosine"],
)
def test_pulses_of_other_shapes(pulse):
    run = lmoc.compile_text(PUSHED.format(pulse)).simulate(stop=100, rtol=1e-8)
    coarse = lmoc.compile_text(PUSHED.format(pulse)).simulate(stop=100, rtol=1e-8, max_step=0.005)
    assert run["m.v"][-1] == pytest.approx(coarse["m.v"][-1], rel=1e-5) and run["m.v"][-1] > 0.5


def test_a_pulse_in_an_equation_and_not_in_an_input():
    dae = lmoc.compile_text("""model M parameter Real T = 0.01; Real v(start = 0, fixed = true); Real x(start = 1,
        fixed = true); equation der(v) = x*exp(-((time - 40)/T)^2)/T; der(x) = -0.1*v*0; end M;""")
    assert dae.simulate(stop=100)["v"][-1] == pytest.approx(math.sqrt(math.pi), rel=1e-4)
    assert dae.simulate(stop=100, parameters={"T": 0.004})["v"][-1] == pytest.approx(math.sqrt(math.pi), rel=1e-4)


@pytest.mark.parametrize(
    ("pulse", "impulse"),
    [
        (lambda t: 200 * math.sin(math.pi * (t - 70) / 0.01) ** 2 if 70 < t < 70.01 else 0.0, 1.0),
        (lambda t: 100 * math.exp(-(((t - 70) / 0.01) ** 2)), math.sqrt(math.pi)),
        (lambda t: 100.0 if 70 < t < 70.01 else 0, 1.0),
        (lambda t: math.sin(t) + 100 * math.exp(-(((t - 70) / 0.01) ** 2)), math.sqrt(math.pi) + 1 - math.cos(100)),
    ],
)
def test_a_callable_with_a_pulse(pulse, impulse):
    run = lmoc.compile_text(PUSHED.format(0)).simulate(stop=100, inputs={"u": pulse})
    assert run["m.v"][-1] == pytest.approx(impulse, rel=1e-4)


def test_steady_signals_cost_no_more_steps():
    free = lmoc.compile_text(PUSHED.format(0))
    for formula, call in (("3*sin(2*time)", lambda t: 3 * math.sin(2 * t)), ("2 + time", lambda t: 2 + t)):
        own = lmoc.compile_text(PUSHED.format(formula)).simulate(stop=20)
        watched = free.simulate(stop=20, inputs={"u": call})
        restarts = 16 * 8  # a callable is looked at in 16 parts, and after each a method begins with a short step
        assert watched.stats["steps"] <= own.stats["steps"] + restarts


def test_the_finest_scale_of_a_signal():
    t = np.linspace(0, 1, 2**12 + 1)
    assert np.isinf(finest_scales(np.zeros_like(t), 0.0)).all()
    assert np.isinf(finest_scales(1 + 2 * t - t**3, 2.0)).all()
    width = 2.0**-6
    scales = finest_scales(np.exp(-(((t - 0.3) / width) ** 2)), 1.0)
    assert 0.2 * width <= scales[int(0.3 * 2**12)] <= width / 2
    assert scales[-1] > 0.2 and scales[0] > 0.05
    swing = finest_scales(np.sin(2 * np.pi * 64 * t), 2.0)
    assert (swing[100:-100] == swing[2048]).all() and 1 / 16 < swing[2048] * 64 < 1 / 4
    assert np.isinf(finest_scales(np.full(2**10 + 1, np.nan), np.nan)).all()


def test_bounds_within_a_stretch():
    bounds = StepBounds(np.array([0.0, 1.0, 2.0]), np.array([np.inf, 0.1, 0.5]))
    cases = {(0, 1): np.inf, (0, 1.5): 0.1, (1, 2): 0.1, (2, 3): 0.5, (1.5, 9): 0.1, (5, 6): 0.5}
    assert {case: bounds.within(*case) for case in cases} == cases
    assert StepBounds(np.zeros(0), np.zeros(0)).within(0, 1) == np.inf
