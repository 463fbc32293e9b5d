"""Derivatives of starts by the implicit function theorem, against closed forms; and where they do not follow."""

import numpy as np
import pytest

import lmoc
from lmoc import simulation
from lmoc.numerics.start import start_slopes

BAR = """
model Bar "a point on a circle: y follows from a start value of x, or both are asked for"
  parameter Real L = 2, x0 = 1.2, w = 0.5;
  Real x({x});
  Real y(start = 1, {y}fixed = false);
  Real vx({v});
  Real vy;
  Real f;
equation
  x^2 + y^2 = L^2;
  der(x) = vx;
  der(y) = vy;
  der(vx) = -f*x;
  der(vy) = -f*y - 9.81;
end Bar;
"""


def _slopes(model, names):
    """The derivatives at the start, and how many of them took starts of their own."""
    dae = lmoc.compile_text(model)
    made = []
    with pytest.MonkeyPatch.context() as patch:
        own = simulation._start_states
        patch.setattr(simulation, "_start_states", lambda *a: made.append(a) or own(*a))
        run = dae.simulate(stop=0.1, points=3, rtol=1e-9, sensitivities=names)
    return run, len(made)


def test_start_values_on_states_and_on_what_follows_from_them():
    """vx is asked for, whatever the states are: vy = -vx x/y with y = √(L² - x²)."""
    model = BAR.format(x="start = x0, fixed = true", y="", v="start = w*L, fixed = true")
    run, made = _slopes(model, ("x0", "L", "w"))
    assert made == 0
    x, L, w = 1.2, 2.0, 0.5
    y = np.sqrt(L**2 - x**2)
    truth = {
        "x0": {"x": 1, "y": -x / y, "vx": 0, "vy": -w * L / y - w * L * x**2 / y**3},
        "L": {"x": 0, "y": L / y, "vx": w, "vy": -w * x / y + w * L * x * L / y**3},
        "w": {"x": 0, "y": 0, "vx": L, "vy": -L * x / y},
    }
    for by, of in truth.items():
        for name, value in of.items():
            assert run.sensitivity(name, by)[0] == pytest.approx(value, abs=1e-7), (name, by)


def test_by_a_start_value_that_is_no_state():
    model = BAR.format(x="start = x0, fixed = true", y="", v="start = w*L, fixed = true")
    run, made = _slopes(model, ("vx",))
    assert made == 0
    assert run.sensitivity("vy", "vx")[0] == pytest.approx(-1.2 / 1.6, abs=1e-7)


def test_start_values_that_cannot_be_met_are_differentiated_by_starts():
    """x and y are asked for and lie beside the circle: the nearest place follows from no equation that is met."""
    model = BAR.format(x="start = x0", y="", v="start = w*L, fixed = true")
    run, made = _slopes(model, ("x0",))
    assert made > 0
    dae = lmoc.compile_text(model)
    near = {k: dae.simulate(stop=1, points=2, parameters={"x0": 1.2 + k})["x"][0] for k in (-1e-4, 1e-4)}
    assert run.sensitivity("x", "x0")[0] == pytest.approx((near[1e-4] - near[-1e-4]) / 2e-4, abs=1e-5)


def test_equations_decide_level_by_level():
    rows = np.array([[1.0, 0.0], [0.0, 1.0], [0.6, 0.8]])
    met, reads = np.array([True, True, False]), rows != 0

    def deciding(count, *level):
        return start_slopes._deciding(rows[:count], reads[:count], np.array(level), met[:count])

    assert [rows.tolist() for rows in deciding(3, 0, 1, 2)] == [[0, 1], []]
    assert deciding(3, 0, 2, 1) is None  # what is missed would decide
    assert deciding(1, 0) is None  # a direction is left
    parallel = np.array([[0.6, 0.8], [0.6, 0.8], [0.0, 1.0]])
    for level in ([0, 0, 1], [0, 1, 1]):  # nearby, the second row may decide what the third one does
        assert start_slopes._deciding(parallel, parallel != 0, np.array(level), np.ones(3, bool)) is None


ARM = """
model Arm "an arm on a slide: how high its end is, is asked for, and guesses for the slide and how far it reaches"
  parameter Real y0 = 0.5;
  Real s(stateSelect = StateSelect.always), phi(stateSelect = StateSelect.always);
  Real y(start = y0, fixed = true), x(start = 1), z(start = 1);
equation
  der(s) = 0;
  der(phi) = 0;
  y = s + sin(phi);
  x = cos(phi);
  z = 2*s;
end Arm;
"""


def test_a_guess_without_a_slope_has_one_nearby():
    """x = cos(φ) has no slope at φ = 0, but draws φ back on both sides of it: s takes its share of what y is raised."""
    run, made = _slopes(ARM, ("y0",))
    assert made > 0
    dae = lmoc.compile_text(ARM)
    near = {k: dae.simulate(stop=1, points=2, parameters={"y0": 0.5 + k})["s"][0] for k in (-1e-3, 1e-3)}
    truth = (near[1e-3] - near[-1e-3]) / 2e-3
    assert truth > 0.1
    assert run.sensitivity("s", "y0")[0] == pytest.approx(truth, abs=1e-5)


def test_a_start_value_that_contradicts_a_fixed_one_is_refused():
    """All states are given, and another variable is fixed besides."""
    dae = lmoc.compile_text(
        "model S Real q(start = 1, stateSelect = StateSelect.always), z(start = 2, fixed = true);"
        "equation der(q) = -q; z = 2*q; end S;"
    )
    with pytest.raises(lmoc.ModelError, match="contradict"):
        dae.simulate(stop=0.1, sensitivities=("q",))


def test_an_equation_without_a_slope_may_keep_what_it_reads():
    """√(L² - y²) is asked to be x0 = L at y = 0, where it has its largest value; c more, it has none nearby."""
    held = BAR.format(x="start = x0, fixed = true", y="", v="").replace("x0 = 1.2", "x0 = L + c")
    held = held.replace("L = 2", "L = 2, c = 0").replace("y(start = 1", "y(start = 0").replace("vx()", "vx")
    run, made = _slopes(held, ("L",))
    assert made == 0
    assert run.sensitivity("x", "L")[0] == pytest.approx(1) and run.sensitivity("y", "L")[0] == 0
    with pytest.raises(lmoc.ModelError):
        lmoc.compile_text(held).simulate(stop=0.1, points=3, sensitivities="c")
